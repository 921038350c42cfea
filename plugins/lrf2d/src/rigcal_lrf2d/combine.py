"""The beams of several scans of a board that stands still, as one candidate."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rigcal.observation import Candidate, MeanGeometry
from rigcal.targets.target import Target
from rigcal_lrf2d.config import Lrf2dConfig


def combine(
    candidates: Sequence[Candidate], mean: MeanGeometry, config: Lrf2dConfig, target: Target
) -> Candidate:
    """All beams of all scans, on the mean of the lines.

    `noise_ratio` is the factor on a range's sigma with which they say together what the scatter of
    the lines allows: 1 if the scans' errors are independent.
    """
    beams = {
        name: np.concatenate([np.asarray(c.measurement[name]) for c in candidates])
        for name in ("angles", "ranges")
    }
    ratio = np.array(np.sqrt(mean.variance_ratio * len(candidates)))
    score = float(np.mean([c.score for c in candidates]))
    return Candidate(mean.geometry, {**beams, "noise_ratio": ratio}, score)
