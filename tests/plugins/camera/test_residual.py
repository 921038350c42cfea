from dataclasses import replace

import numpy as np

from rigcal.geometry import se3
from rigcal_camera import CAMERA

BARREL = (-0.28, 0.08, 0.0005, -0.0004)


def observed(board, camera, pose, **fields):
    config, target = camera(distortion=BARREL, **fields), board["april"]
    T_s_t = pose((25, -20, 10), (0.1, -0.05, 1.3))
    candidate = CAMERA.observe(T_s_t, config, target, np.random.default_rng(1))
    return CAMERA.residual(candidate, config, target), candidate, config, target, T_s_t


def test_residual_has_unit_variance_at_the_truth(board, camera, pose):
    residual, candidate, _, _, T_s_t = observed(board, camera, pose, sigma_px=0.4)
    r, J = residual(T_s_t)
    assert residual.block == 2
    assert residual.dof == len(r) == 2 * len(candidate.measurement["index"])
    assert J.shape == (len(r), 6)
    assert 0.7 < np.std(r) < 1.3


def test_jacobian_agrees_with_central_differences(board, camera, pose):
    residual, *_, T_s_t = observed(board, camera, pose)
    step = 1e-6
    numeric = np.stack(
        [
            (residual(T_s_t @ se3.exp(e))[0] - residual(T_s_t @ se3.exp(-e))[0]) / (2 * step)
            for e in step * np.eye(6)
        ],
        axis=1,
    )
    J = residual(T_s_t)[1]
    np.testing.assert_allclose(J, numeric, rtol=1e-5, atol=1e-5 * np.abs(J).max())


def test_a_board_behind_the_camera_costs_much_but_stays_finite(board, camera, pose):
    residual, *_, T_s_t = observed(board, camera, pose)
    behind = T_s_t.copy()
    behind[2, 3] = -1.5
    r, J = residual(behind)
    assert np.isfinite(r).all()
    assert np.isfinite(J).all()
    far_off = T_s_t @ se3.exp(np.array([0.5, 0.5, 0, 0.5, 0, 0]))
    assert np.sum(r**2) > 10 * np.sum(residual(far_off)[0] ** 2)


def test_errors_are_in_pixels(board, camera, pose):
    residual, candidate, config, target, T_s_t = observed(board, camera, pose, sigma_px=0.4)
    error = CAMERA.errors(candidate, config, target, T_s_t)
    assert CAMERA.unit == "px"
    np.testing.assert_allclose(error.ravel(), 0.4 * residual(T_s_t)[0])


def test_all_views_at_once_are_the_views_one_by_one(board, camera, pose):
    view, *_, T_s_t = observed(board, camera, pose)
    views = [replace(view, p_t=view.p_t[:n], uv=view.uv[:n]) for n in (12, 40, 25)]
    T = T_s_t @ se3.exp(np.random.default_rng(2).normal(0, 0.05, (3, 6)))
    T[2, 2, 3] = -1.0
    r, J = type(views[0]).stack(views)(T)
    one_by_one = [view(pose) for view, pose in zip(views, T, strict=True)]
    np.testing.assert_allclose(r, np.concatenate([r for r, _ in one_by_one]), rtol=1e-12, atol=1e-9)
    np.testing.assert_allclose(J, np.concatenate([J for _, J in one_by_one]), rtol=1e-12, atol=1e-9)
