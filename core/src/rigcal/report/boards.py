"""The boards of a solution as outlines."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from rigcal.calibration import Calibration
from rigcal.geometry import se3
from rigcal.geometry.se3 import Array
from rigcal.observation import Observation
from rigcal.plugin.registry import Registry
from rigcal.report.tables import natural_order
from rigcal.rig import Rig, build_targets

_EDGE = 24
"""Points along each side of a board's outline: a lens bends it."""


def sorted_exposures(names: Iterable[str]) -> list[str]:
    """Names of exposures, pose2 before pose10."""
    return sorted(names, key=natural_order)


def boards_in_root(
    calibration: Calibration, observations: Sequence[Observation], rig: Rig, registry: Registry
) -> Mapping[str, Array]:
    """The outline of the target (K, 3) in the root's frame, by exposure of the solution.

    The exposures of the observations are named as there.
    """
    targets = build_targets(rig, registry)
    shown = {o.exposure: rig.target_of(o.sensor) for o in observations if o.candidates}
    first = next(iter(targets))
    return {
        exposure: se3.apply(
            calibration.target_poses[exposure], targets[shown.get(exposure, first)].outline_points
        )
        for exposure in sorted_exposures(calibration.target_poses)
    }


def dense(outline: Array) -> Array:
    """Points (N, 3) along a closed outline (K, 3)."""
    steps = np.linspace(0, 1, _EDGE, endpoint=False)[None, :, None]
    following = np.roll(outline, -1, axis=0)
    result: Array = (outline[:, None] + steps * (following - outline)[:, None]).reshape(-1, 3)
    return result
