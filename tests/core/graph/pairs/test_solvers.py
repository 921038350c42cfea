"""Minimal solvers find the transform that made exact data, from any pose of the sensors."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rigcal.geometry import se3
from rigcal.graph import solvers
from rigcal.graph.plane_line import from_planes_and_lines

SAMPLES = 200


def planes(rng, count):
    """Unit normals (S, count, 3) and distances of planes in general position."""
    n = rng.normal(size=(SAMPLES, count, 3))
    n /= np.linalg.norm(n, axis=-1, keepdims=True)
    return n, rng.uniform(1, 4, (SAMPLES, count))


def in_b(n, d, T_a_b):
    """The same planes in frame b."""
    return n @ T_a_b[:3, :3], d + n @ T_a_b[:3, 3]


def traces(n_b, d_b):
    """Points and directions of the lines that planes leave in z = 0."""
    xy = np.hypot(n_b[..., 0], n_b[..., 1])
    zero = np.zeros_like(xy)
    v = np.stack([-n_b[..., 1], n_b[..., 0], zero], axis=-1) / xy[..., None]
    foot = np.stack([n_b[..., 0], n_b[..., 1], zero], axis=-1)
    return -(d_b / xy**2)[..., None] * foot, v


def found(T, T_a_b):
    """How many samples at least one of the hypotheses solves."""
    return np.count_nonzero(np.abs(T - T_a_b).max(axis=(1, 2)) < 1e-6)


@given(seed=st.integers(0, 2**32 - 1))
def test_planes_and_lines(seed):
    rng = np.random.default_rng(seed)
    T_a_b = se3.exp(rng.normal(size=6))
    n, d = planes(rng, 3)
    T = from_planes_and_lines(n, d, *traces(*in_b(n, d, T_a_b)))
    regular = np.abs(np.linalg.det(n)) > 2 * solvers.LEAST_VOLUME
    assert found(T, T_a_b) >= 0.99 * regular.sum()
    assert len(T) <= 8 * SAMPLES


@given(seed=st.integers(0, 2**32 - 1))
def test_planes(seed):
    rng = np.random.default_rng(seed)
    T_a_b = se3.exp(rng.normal(size=6))
    n, d = planes(rng, 3)
    T = solvers.from_planes(n, d, *in_b(n, d, T_a_b))
    assert found(T, T_a_b) == np.count_nonzero(np.abs(np.linalg.det(n)) > solvers.LEAST_VOLUME)


@settings(max_examples=25)
@given(seed=st.integers(0, 2**32 - 1))
def test_planes_and_points(seed):
    rng = np.random.default_rng(seed)
    T_a_b = se3.exp(rng.normal(size=6))
    p_a = rng.uniform(-2, 2, (SAMPLES, 6, 3))
    n, _ = planes(rng, 6)
    d = -np.einsum("smi,smi->sm", n, p_a)
    near = p_a + rng.normal(0, 0.1, p_a.shape)
    T = solvers.from_planes_and_points(n, d, se3.apply(se3.inverse(T_a_b), p_a), near)
    assert found(T, T_a_b) > 0.8 * SAMPLES


def test_points_on_a_line_give_nothing():
    p = np.linspace(0, 1, 3)[None, :, None] * np.array([1.0, 2.0, 3.0])
    assert len(solvers.from_points(p, p)) == 0


@pytest.mark.parametrize("case", ["parallel", "one axis", "same line"])
def test_degenerate_planes_and_lines_give_nothing(case):
    n = np.tile([0.6, 0.0, 0.8], (1, 3, 1))
    if case == "one axis":
        angle = np.array([0.0, 0.5, 1.0])
        n = np.stack([np.cos(angle), 0 * angle, np.sin(angle)], axis=-1)[None]
    if case == "same line":
        n = np.array([[[0.6, 0.0, 0.8], [0.6, 0.0, -0.8], [1.0, 0.0, 0.0]]])
    assert len(from_planes_and_lines(n, np.ones((1, 3)), *traces(n, np.ones((1, 3))))) == 0
