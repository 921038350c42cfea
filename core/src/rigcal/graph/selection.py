"""First poses of the target, and which candidate of every sensor fits them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from rigcal.geometry import se3
from rigcal.geometry.se3 import Array
from rigcal.geometry.shapes import plane_of_target, tangent_basis
from rigcal.graph.board import board_points, center_of, half_size
from rigcal.graph.correspondence import MODEL_ERROR_M
from rigcal.observation import Geometry, Observation, PlaneGeometry, PointGeometry, PoseGeometry
from rigcal.targets.target import Target

POSE_IS_OPEN = "neither a pose nor a plane was seen: lines and points leave the target's pose open"
_GATE_M = 4 * MODEL_ERROR_M


@dataclass(frozen=True, eq=False)
class Selection:
    """One exposure: `T_root_t`, the chosen candidate per sensor, and reasons for those left out."""

    T_root_t: Array
    chosen: Mapping[str, int]
    left_out: Mapping[str, str]
    has_pose: bool


def select(
    observations: Mapping[str, Observation], T_root: Mapping[str, Array], target: Target
) -> Selection | str:
    """The pose of the target in one exposure that most sensors agree on, or why there is none."""
    seen = {s: o for s, o in observations.items() if o.candidates}
    if len(seen) < 2:
        return f"only {next(iter(seen))} saw the target" if seen else "no sensor saw the target"
    hypotheses = _hypotheses(seen, T_root)
    if not hypotheses:
        return POSE_IS_OPEN
    best: tuple[float, Array, dict[str, tuple[int, float]], bool] | None = None
    for T_root_t, has_pose in hypotheses:
        fits = {
            s: _best_candidate(o, se3.inverse(T_root[s]) @ T_root_t, target, in_plane=has_pose)
            for s, o in seen.items()
        }
        score = sum(max(0.0, 1 - (e / _GATE_M) ** 2) for _, e in fits.values())
        if best is None or score > best[0]:
            best = score, T_root_t, fits, has_pose
    assert best is not None
    _, T_root_t, fits, has_pose = best
    chosen = {s: i for s, (i, e) in fits.items() if e < _GATE_M}
    left_out = {
        s: f"its nearest candidate is {1000 * e:.0f} mm from where the other sensors see the target"
        for s, (_, e) in fits.items()
        if s not in chosen
    }
    if len(chosen) < 2:
        apart = ", ".join(f"{s}: {1000 * e:.0f} mm" for s, (_, e) in fits.items())
        return f"no two sensors agree on where the target is ({apart})"
    return Selection(T_root_t, chosen, left_out, has_pose)


def _hypotheses(
    seen: Mapping[str, Observation], T_root: Mapping[str, Array]
) -> list[tuple[Array, bool]]:
    """Target poses in the root; from planes, whose turn about the normal is open, if need be."""
    poses, planes = [], []
    for s, o in seen.items():
        for candidate in o.candidates:
            g = candidate.geometry
            if isinstance(g, PoseGeometry):
                poses.append((T_root[s] @ g.T_s_t, True))
            elif isinstance(g, PlaneGeometry):
                R = np.column_stack([tangent_basis(g.normal), g.normal])
                planes.append((T_root[s] @ se3.transform(R, g.center), False))
    return poses or planes


def first_board(
    seen: Mapping[str, Observation], chosen: Mapping[str, int], T_root: Mapping[str, Array]
) -> Array | None:
    """`T_root_t` as the first chosen pose places it, or the first plane; None if there is none."""
    only = {s: replace(seen[s], candidates=(seen[s].candidates[i],)) for s, i in chosen.items()}
    hypotheses = _hypotheses(only, T_root)
    return hypotheses[0][0] if hypotheses else None


def _best_candidate(
    o: Observation, T_s_t: Array, target: Target, *, in_plane: bool
) -> tuple[int, float]:
    errors = [misfit(c.geometry, T_s_t, target, in_plane=in_plane) for c in o.candidates]
    best = int(np.argmin(errors))
    return best, errors[best]


def misfit(g: Geometry, T_s_t: Array, target: Target, *, in_plane: bool = True) -> float:
    """Rms distance (m) between what was seen and the target at `T_s_t`.

    What lies beyond the board's outline adds to it, unless the turn of the target in its own plane
    is not known (`in_plane` false).
    """
    if isinstance(g, PoseGeometry):
        corners = target.outline_points
        difference = se3.apply(T_s_t, corners) - se3.apply(g.T_s_t, corners)
        # Depth and tilt are what one view knows worst: what counts is which board it is.
        return float(np.sqrt(np.mean(np.sum(difference**2, axis=1)))) / 2
    if isinstance(g, PointGeometry):
        apart = se3.apply(se3.inverse(T_s_t), g.position) - g.target_point
        if in_plane:
            return float(np.linalg.norm(apart))
        return float(np.hypot(apart[2], _beyond(g, T_s_t, target, in_plane)))
    n, d = plane_of_target(T_s_t)
    across = float(np.sqrt(np.mean((board_points(g, half_size(target)) @ n + d) ** 2)))
    return float(np.hypot(across, _beyond(g, T_s_t, target, in_plane)))


def _beyond(g: Geometry, T_s_t: Array, target: Target, in_plane: bool) -> float:
    """How far (m) the middle of what was seen lies outside the board, with the board's leeway."""
    p_t = se3.apply(se3.inverse(T_s_t), center_of(g))[:2]
    half = target.size / 2
    if not in_plane:
        return max(0.0, float(np.hypot(*p_t)) - 1.2 * float(np.hypot(*half)))
    outside = np.maximum(0.0, np.abs(p_t - target.outline.mean(axis=0)) - half)
    return float(np.hypot(*outside))
