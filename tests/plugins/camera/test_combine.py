"""Several images of a board that stands still, as one candidate."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2

from rigcal.association.combine import mean_of
from rigcal.geometry import se3
from rigcal.observation import PoseGeometry
from rigcal_camera import CAMERA
from rigcal_camera.lens import lens_of
from rigcal_camera.pose import refine_pose

FRAMES = 10


@pytest.fixture
def views(board, camera, pose):
    """A way to make views whose corners have noise of their own and in common, in px."""
    config, target = camera(sigma_px=0.1), board["april"]
    T_s_t = pose((25, -20, 10), (0.1, -0.05, 1.3))

    def make(seed, own=0.1, common=0.0, tremor_m=0.0):
        rng = np.random.default_rng(seed)
        lens, p_t = lens_of(config), target.points
        shared = common * rng.normal(size=(len(p_t), 2))
        found = []
        for _ in range(FRAMES):
            T = T_s_t @ se3.exp(np.append(np.zeros(3), tremor_m * rng.normal(size=3)))
            uv = lens.pixels_from_points(se3.apply(T, p_t))[0] + shared
            uv = uv + own * rng.normal(size=uv.shape)
            one = CAMERA.observe(T_s_t, config, target, rng)
            fit = refine_pose(lens, T, p_t, uv)
            covariance = np.linalg.inv(fit.information) * config.sigma_px**2
            measurement = {
                "uv": uv,
                "index": np.arange(len(p_t)),
                "sigma_px": np.array(fit.sigma_px),
            }
            found.append(
                replace(one, geometry=PoseGeometry(fit.T_s_t, covariance), measurement=measurement)
            )
        mean = mean_of([c.geometry for c in found])
        return CAMERA.combine(found, mean, config, target)

    make.config, make.target, make.T_s_t = config, target, T_s_t
    return make


def ratios(candidate):
    return float(candidate.measurement["noise_ratio"]), float(candidate.measurement["pose_ratio"])


def test_independent_noise_averages_out(views):
    noise, pose_ratio = ratios(views(1))
    assert noise == pytest.approx(np.sqrt(1 / FRAMES), rel=0.15)
    assert pose_ratio < 1.15


def test_noise_that_the_images_share_stays(views):
    noise, pose_ratio = ratios(views(2, own=0.05, common=np.sqrt(0.0075)))
    assert noise == pytest.approx(np.sqrt(0.75 + 0.025), rel=0.1)
    assert pose_ratio < 1.15


def test_tremor_is_told_from_corner_noise(views):
    noise, pose_ratio = ratios(views(3, tremor_m=0.001))
    assert noise == pytest.approx(np.sqrt(1 / FRAMES), rel=0.2)
    assert pose_ratio > 3


@pytest.mark.parametrize("tremor_m", [0.0, 0.0005])
def test_the_combined_view_is_as_far_off_as_its_residual_says(views, tremor_m):
    """At the least squares of the whitened residual: NEES and sum of squares by their laws."""
    nees, squares, dof = 0.0, 0.0, 0
    runs = 15
    for seed in range(runs):
        candidate = views(seed, tremor_m=tremor_m)
        r, J = CAMERA.residual(candidate, views.config, views.target)(views.T_s_t)
        xi = np.linalg.lstsq(J, r, rcond=None)[0]
        explained = xi @ (J.T @ J) @ xi
        nees, squares, dof = nees + explained, squares + r @ r - explained, dof + len(r) - 6
    # The whole of a tremor's direction is one number: somewhat wider than the law.
    assert 0.5 * 6 * runs < nees < 1.2 * chi2.ppf(0.999, 6 * runs)
    assert squares / dof == pytest.approx(1.0, rel=0.15)


def test_jacobian_of_a_trembling_view_is_the_derivative(views):
    residual = CAMERA.residual(views(4, tremor_m=0.001), views.config, views.target)
    T, step = views.T_s_t @ se3.exp(np.full(6, 0.01)), 1e-6
    numeric = np.stack(
        [
            (residual(T @ se3.exp(e))[0] - residual(T @ se3.exp(-e))[0]) / (2 * step)
            for e in step * np.eye(6)
        ],
        axis=1,
    )
    J = residual(T)[1]
    np.testing.assert_allclose(J, numeric, rtol=1e-4, atol=1e-5 * np.abs(J).max())


def test_together_they_are_as_one_by_one(views):
    some = [
        CAMERA.residual(views(k, tremor_m=0.001 * k), views.config, views.target) for k in (0, 1)
    ]
    T = np.stack([views.T_s_t @ se3.exp(np.full(6, 0.001 * k)) for k in (1, 2)])
    r, J = type(some[0]).stack(some)(T)
    each = [residual(t) for residual, t in zip(some, T, strict=True)]
    np.testing.assert_allclose(r, np.concatenate([e[0] for e in each]))
    np.testing.assert_allclose(J, np.concatenate([e[1] for e in each]))
