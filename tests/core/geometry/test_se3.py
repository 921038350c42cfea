"""Laws of SE(3), on random transforms."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rigcal.geometry import se3

number = st.floats(-2.0, 2.0)
tangents = st.lists(number, min_size=6, max_size=6).map(np.array)
# Near zero and near pi the closed forms change.
angles = st.sampled_from([0.0, 1e-9, 1e-6, 1e-5, 1e-3, 1.0, 3.0, np.pi - 1e-6, np.pi - 1e-9])


def unit(v):
    norm = np.linalg.norm(v)
    return v / norm if norm > 1e-3 else np.array([1.0, 0, 0])


@given(tangents)
def test_log_inverts_exp(xi):
    xi[:3] *= min(1.0, 3.1 / max(np.linalg.norm(xi[:3]), 1e-9))
    np.testing.assert_allclose(se3.log(se3.exp(xi)), xi, atol=1e-9)


@given(tangents, angles)
def test_exp_inverts_log_at_every_angle(xi, angle):
    T = se3.transform(se3.exp_so3(unit(xi[:3]) * angle), xi[3:])
    np.testing.assert_allclose(se3.exp(se3.log(T)), T, atol=1e-8)


@given(tangents, tangents)
def test_adjoint_carries_a_perturbation_to_the_other_side(a, b):
    T = se3.exp(a)
    left = se3.exp(se3.adjoint(T) @ (b * 0.1)) @ T
    np.testing.assert_allclose(left, T @ se3.exp(b * 0.1), atol=1e-9)


@given(tangents)
def test_quaternion_round_trip(a):
    R = se3.exp_so3(a[:3] * 2)
    q = se3.quaternion_from_rotation(R)
    assert q[3] >= 0
    np.testing.assert_allclose(se3.rotation_from_quaternion(q), R, atol=1e-12)


@given(tangents)
def test_inverse(a):
    T = se3.exp(a)
    np.testing.assert_allclose(T @ se3.inverse(T), np.eye(4), atol=1e-12)


@settings(max_examples=30)
@given(tangents, st.integers(0, 2**31))
def test_nearest_rotation_undoes_noise(a, seed):
    R = se3.exp_so3(a[:3])
    noisy = R + np.random.default_rng(seed).normal(0, 1e-3, (3, 3))
    nearest = se3.nearest_rotation(noisy)
    assert np.linalg.det(nearest) > 0
    assert se3.rotation_angle(R.T @ nearest) < 0.01


def test_rpy_turns_about_fixed_axes_as_urdf_says():
    R = se3.rotation_from_rpy(np.array([0.1, 0.2, 0.3]))
    cr, sr, cp, sp, cy, sy = (f(a) for a in (0.1, 0.2, 0.3) for f in (np.cos, np.sin))
    first = [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr]
    np.testing.assert_allclose(R[0], first)


def test_functions_broadcast_over_leading_dimensions():
    xi = np.random.default_rng(0).normal(size=(5, 4, 6))
    T = se3.exp(xi)
    assert T.shape == (5, 4, 4, 4)
    np.testing.assert_allclose(se3.log(T), se3.log(se3.exp(xi)), atol=1e-12)
    np.testing.assert_allclose(se3.inverse(T)[2, 3], se3.inverse(T[2, 3]))


@pytest.mark.parametrize("rpy", [[0.1, -0.2, 3.0], [-1.5, 1.2, -2.8], [0.0, np.pi / 2, 0.7]])
def test_rpy_give_the_rotation_back(rpy):
    R = se3.rotation_from_rpy(np.array(rpy))
    np.testing.assert_allclose(se3.rotation_from_rpy(se3.rpy_from_rotation(R)), R, atol=1e-12)
