"""Pairs of sensors that see one board, at the level of features."""

import numpy as np
import pytest

from rigcal.geometry import se3
from rigcal.observation import Observation
from rigcal.targets.checkerboard import CheckerboardConfig, build_checkerboard
from rigcal.testing.features import facing_boards, observe

T_A_B = se3.transform(
    se3.rotation_from_rpy(np.array([0.06, -0.05, 0.5])), np.array([0.1, 0.5, 0.1])
)


@pytest.fixture(scope="session")
def target():
    config = CheckerboardConfig(
        type="checkerboard",
        columns=8,
        rows=5,
        square_size_m=0.1,
        width_m=1.0,
        height_m=0.8,
    )
    return build_checkerboard("board", config)


@pytest.fixture(scope="session")
def watch(target):
    """watch(kinds, rng, boards, outliers, disagreement): pairs of observations of a and b.

    Each sensor's outliers are of its own; `disagreement` (m) moves each of its boards along their
    normals, beyond the noise that the observations state.
    """

    def watch(kinds, rng, boards=40, outliers=0.0, disagreement=0.0):
        T_a_t = facing_boards(boards, rng) if isinstance(boards, int) else boards
        pairs = []
        for k, T in enumerate(T_a_t):
            seen = []
            for name, kind, T_s_t in zip("ab", kinds, (T, se3.inverse(T_A_B) @ T), strict=True):
                if rng.uniform() < outliers:
                    T_s_t = T_s_t @ se3.exp(rng.normal(0, 0.4, 6))
                T_s_t = T_s_t @ se3.exp(np.array([0, 0, 0, 0, 0, rng.normal(0, disagreement)]))
                candidate = observe(kind, T_s_t, target, rng)
                candidates = () if candidate is None else (candidate,)
                seen.append(Observation(name, str(k), 0, f"{name}{k}", candidates, "not in view"))
            if all(o.candidates for o in seen):
                pairs.append(tuple(seen))
        return pairs

    return watch


@pytest.fixture(scope="session")
def T_a_b():
    """The transform of the pairs that `watch` makes."""
    return T_A_B
