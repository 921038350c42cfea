"""Hypothesis strategies: rotations, poses, planes, geometries, candidates, observations.

    from hypothesis import given
    from rigcal.testing import strategies as st

    @given(st.poses(), st.planes())
    def test_a_law(T_a_b, plane): ...

All draw plain numpy arrays and frozen objects of rigcal, shrink towards simple ones, and keep to
the conventions of docs/conventions.md.
"""

from __future__ import annotations

import numpy as np
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from hypothesis.strategies import SearchStrategy

from rigcal.geometry import se3
from rigcal.geometry.se3 import Array
from rigcal.observation import (
    Candidate,
    Geometry,
    LineGeometry,
    Observation,
    PlaneGeometry,
    PointGeometry,
    PoseGeometry,
)

_NAMES = st.text("abcdefghij0123456789", min_size=1, max_size=6)


def vectors(size: int = 3, largest: float = 10.0) -> SearchStrategy[Array]:
    """(size,) numbers between -largest and largest."""
    numbers = st.floats(-largest, largest, allow_subnormal=False)
    return arrays(np.float64, size, elements=numbers)


def directions() -> SearchStrategy[Array]:
    """(3,) unit vectors."""

    def unit(v: Array) -> Array:
        length = float(np.linalg.norm(v))
        result: Array = v / length if length > 1e-3 else np.array([0.0, 0.0, 1.0])
        return result

    return vectors(3, 1.0).map(unit)


def rotations(most_deg: float = 180.0) -> SearchStrategy[Array]:
    """(3, 3) rotations by up to `most_deg` about any axis."""
    angles = st.floats(0.0, float(np.radians(most_deg)), allow_subnormal=False)
    return st.builds(lambda axis, angle: se3.exp_so3(axis * angle), directions(), angles)


def poses(most_deg: float = 180.0, farthest_m: float = 10.0) -> SearchStrategy[Array]:
    """(4, 4) transforms."""
    return st.builds(se3.transform, rotations(most_deg), vectors(3, farthest_m))


def motions(most_deg: float = 5.0, farthest_m: float = 0.1) -> SearchStrategy[Array]:
    """(6,) small tangent vectors [rotation (rad), translation (m)]."""
    turn = vectors(3, float(np.radians(most_deg)) / np.sqrt(3))
    return st.builds(lambda w, v: np.concatenate([w, v]), turn, vectors(3, farthest_m))


def planes(farthest_m: float = 10.0) -> SearchStrategy[tuple[Array, float]]:
    """A plane `n . p + d = 0` as a sensor sees it: unit normal (3,) to its side, d > 0 (m)."""
    return st.tuples(directions(), st.floats(0.1, farthest_m))


def covariances(size: int, smallest: float = 1e-4, largest: float = 1e-1) -> SearchStrategy[Array]:
    """(size, size) symmetric positive definite, standard deviations in the given limits."""

    def build(sigma: Array, seed: int) -> Array:
        Q = np.linalg.qr(np.random.default_rng(seed).normal(size=(size, size)))[0]
        C = (Q * sigma**2) @ Q.T
        result: Array = (C + C.T) / 2
        return result

    sigmas = arrays(np.float64, size, elements=st.floats(smallest, largest))
    return st.builds(build, sigmas, st.integers(0, 1000))


@st.composite
def _plane_geometries(draw: st.DrawFn) -> PlaneGeometry:
    n, d = draw(planes())
    return PlaneGeometry(n, d, -d * n, draw(covariances(3)))


def geometries() -> SearchStrategy[Geometry]:
    """What a detector may report: pose, plane, line (in z = 0) and point, in the sensor's frame."""
    ends = vectors(2, 5.0).map(lambda xy: np.append(xy, 0.0))
    flags = st.booleans()
    return st.one_of(
        st.builds(PointGeometry, vectors(3), covariances(3), vectors(3, 1.0)),
        st.builds(PoseGeometry, poses(), covariances(6)),
        _plane_geometries(),
        st.builds(
            lambda start, end, C, a, b: LineGeometry(
                start, end + np.array([10.5, 0.0, 0.0]), C, a, b
            ),
            ends,
            ends,
            covariances(6),
            flags,
            flags,
        ),
    )


def candidates() -> SearchStrategy[Candidate]:
    """Any geometry with a few arrays as measurement."""
    measurement = st.dictionaries(_NAMES, st.integers(0, 5).flatmap(vectors), max_size=3)
    return st.builds(Candidate, geometries(), measurement, st.floats(-10, 10))


def observations() -> SearchStrategy[Observation]:
    """What one sensor says of one exposure: up to three candidates, or a reason."""
    return st.builds(
        lambda sensor, exposure, stamp, found: Observation(
            sensor, str(exposure), stamp, f"{sensor} #{exposure}", found, "" if found else "dark"
        ),
        st.sampled_from(["bow", "stern"]),
        st.integers(0, 20),
        st.integers(0, 2**62),
        st.lists(candidates(), max_size=3).map(tuple),
    )
