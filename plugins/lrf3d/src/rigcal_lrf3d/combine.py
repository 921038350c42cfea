"""The returns of several clouds of a board that stands still, as one candidate."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rigcal.observation import Candidate, MeanGeometry
from rigcal.targets.target import Target
from rigcal_lrf3d.config import Lrf3dConfig


def combine(
    candidates: Sequence[Candidate], mean: MeanGeometry, config: Lrf3dConfig, target: Target
) -> Candidate:
    """All returns of all clouds, on the mean of the planes.

    `noise_ratio` is the factor on a range's sigma with which they say together what the scatter of
    the planes allows: 1 if the clouds' errors are independent.
    """
    points = np.concatenate([np.asarray(c.measurement["points"]) for c in candidates])
    ratio = np.array(np.sqrt(mean.variance_ratio * len(candidates)))
    score = float(np.mean([c.score for c in candidates]))
    return Candidate(mean.geometry, {"points": points, "noise_ratio": ratio}, score)
