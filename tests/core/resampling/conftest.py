"""Errors that all measurements of an exposure share."""

from dataclasses import replace

import numpy as np
import pytest

from rigcal.geometry import se3
from rigcal.observation import PoseGeometry


@pytest.fixture
def trembling():
    """`trembling(o, rng, sigma_m)`: what a camera saw of a board that had moved."""

    def moved(o, rng, sigma_m):
        shift = se3.exp(np.append(np.zeros(3), rng.normal(0, sigma_m, 3)))
        candidates = [
            replace(c, geometry=PoseGeometry(c.geometry.T_s_t @ shift, c.geometry.covariance))
            for c in o.candidates
        ]
        return replace(o, candidates=tuple(candidates))

    return moved
