"""What the strategies draw is what their names say; laws of core tested with them."""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as hypothesis_strategies

from rigcal.geometry import se3
from rigcal.geometry.se3 import Array
from rigcal.observation import Candidate, Observation
from rigcal.observation_file import load_observations, save_observations
from rigcal.plugin import Detection
from rigcal.plugin.answers import check_detection
from rigcal.residual import residual_of_geometry
from rigcal.testing import strategies as st
from rigcal.testing.same import assert_same

few = settings(max_examples=40, deadline=None)


@few
@given(st.poses(), st.poses(), st.motions())
def test_poses_are_rigid_and_their_products_too(T: Array, T2: Array, xi: Array) -> None:
    for pose in (T, T @ T2, T @ se3.exp(xi)):
        np.testing.assert_allclose(pose[:3, :3].T @ pose[:3, :3], np.eye(3), atol=1e-9)
        assert np.linalg.det(pose[:3, :3]) > 0
    np.testing.assert_allclose(se3.log(se3.exp(xi)), xi, atol=1e-9)


@few
@given(st.planes(), st.covariances(4))
def test_planes_face_the_sensor_and_covariances_are_positive(
    plane: tuple[Array, float], covariance: Array
) -> None:
    n, d = plane
    assert abs(np.linalg.norm(n) - 1) < 1e-9
    assert d > 0
    assert np.linalg.eigvalsh(covariance).min() > 0


@few
@given(st.candidates(), st.poses(), st.motions())
def test_default_residuals_of_all_geometries_have_their_derivative(
    candidate: Candidate, T_s_t: Array, xi: Array
) -> None:
    check_detection(Detection((candidate,)))
    residual = residual_of_geometry(candidate)
    r, J = residual(T_s_t @ se3.exp(xi))
    assert np.isfinite(r).all()
    assert J.shape == (residual.dof, 6)


@few
@given(hypothesis_strategies.lists(st.observations(), max_size=4))
def test_observations_survive_their_file(observations: list[Observation]) -> None:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "o.npz"
        save_observations(path, observations)
        read = load_observations(path)[0]
    for before, after in zip(observations, read, strict=True):
        assert_same(before, after, where="the observation")
