import cv2
import numpy as np
import pytest

from rigcal_camera import CameraConfig, lens_of

PINHOLE = (0.2, 0.1, 0.001, 0.002, 0.01, 0.3, 0.05, 0.01, 0.001, 0.002, -0.001, 0.003, 0.05, -0.03)
FISHEYE = (-0.0540096, -0.0784275, 0.0959641, -0.0515253)
LENSES = [("pinhole", PINHOLE[:n]) for n in (0, 4, 5, 8, 12, 14)]
LENSES += [("fisheye", ()), ("fisheye", FISHEYE)]


def camera(model="pinhole", distortion=()):
    return CameraConfig(
        width_px=1232,
        height_px=1024,
        model=model,
        focal_px=(600.0, 610.0),
        principal_px=(615.5, 511.5),
        distortion=distortion,
    )


@pytest.fixture
def points():
    rng = np.random.default_rng(0)
    p = rng.normal(size=(200, 3)) * [0.6, 0.5, 0.5] + [0, 0, 2]
    p[:, 2] = np.maximum(p[:, 2], 0.8)
    p[0] = [0, 0, 1]
    return p


def opencv_pixels(config, p):
    (fx, fy), (cx, cy) = config.focal_px, config.principal_px
    K = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])
    zero = np.zeros(3)
    d = np.array(config.distortion or (0.0,) * 4)
    if config.model == "fisheye":
        return cv2.fisheye.projectPoints(p[:, None], zero, zero, K, d)[0].reshape(-1, 2)
    return cv2.projectPoints(p, zero, zero, K, d)[0].reshape(-1, 2)


@pytest.mark.parametrize(("model", "distortion"), LENSES)
def test_pixels_are_those_of_opencv(model, distortion, points):
    config = camera(model, distortion)
    uv, _, valid = lens_of(config).pixels_from_points(points)
    assert valid.all()
    np.testing.assert_allclose(uv, opencv_pixels(config, points), atol=1e-9)


@pytest.mark.parametrize(("model", "distortion"), LENSES)
def test_jacobian_agrees_with_central_differences(model, distortion, points):
    lens = lens_of(camera(model, distortion))
    J = lens.pixels_from_points(points)[1]
    step = 1e-6
    numeric = np.stack(
        [
            (lens.pixels_from_points(points + e)[0] - lens.pixels_from_points(points - e)[0])
            / (2 * step)
            for e in step * np.eye(3)
        ],
        axis=2,
    )
    np.testing.assert_allclose(J, numeric, rtol=1e-6, atol=1e-4)


@pytest.mark.parametrize(("model", "distortion"), LENSES)
def test_rays_lead_back_to_the_points(model, distortion, points):
    lens = lens_of(camera(model, distortion))
    directions = points / np.linalg.norm(points, axis=1, keepdims=True)
    rays = lens.rays_from_pixels(lens.pixels_from_points(points)[0])
    np.testing.assert_allclose(rays, directions, atol=1e-10)


def test_points_behind_a_pinhole_camera_are_not_imaged():
    lens = lens_of(camera())
    uv, J, valid = lens.pixels_from_points(np.array([[0.1, 0, -1.0], [0, 0, 0], [0, 0, 1]]))
    assert valid.tolist() == [False, False, True]
    assert np.isfinite(uv).all()
    assert np.isfinite(J).all()


def test_a_fisheye_sees_beside_itself():
    lens = lens_of(
        CameraConfig(
            width_px=1000,
            height_px=1000,
            model="fisheye",
            focal_px=(250.0, 250.0),
            principal_px=(499.5, 499.5),
        )
    )
    p = np.array([[1.0, 0, -0.1], [0, 0, -1.0]])
    assert lens.sees(p).tolist() == [True, False]
    ray = lens.rays_from_pixels(lens.pixels_from_points(p[:1])[0])
    np.testing.assert_allclose(ray, p[:1] / np.linalg.norm(p[0]), atol=1e-12)


def test_points_beyond_the_fold_of_a_distortion_polynomial_are_not_seen():
    """r (1 - 0.3 r^2) turns back at r = 1.05: r = 1.8 would land in the image a second time."""
    lens = lens_of(camera(distortion=(-0.3, 0.0, 0.0, 0.0)))
    p = np.array([[0.9, 0, 1.0], [1.8, 0, 1.0]])
    uv = lens.pixels_from_points(p)[0]
    assert (uv > 0).all()
    assert (uv < 1232).all()
    assert lens.sees(p).tolist() == [True, False]


def test_pixels_outside_the_reach_of_the_lens_have_no_ray():
    lens = lens_of(camera(distortion=(-0.3, 0.0, 0.0, 0.0)))
    rays = lens.rays_from_pixels(np.array([[615.5, 511.5], [1231.0, 1023.0], [1e5, 0.0]]))
    assert np.isfinite(rays).all(axis=1).tolist() == [True, False, False]


def test_a_wrong_number_of_coefficients_is_refused():
    with pytest.raises(ValueError, match=r"distortion has 3 numbers.*0, 4, 5, 8, 12, 14"):
        camera(distortion=(0.1, 0.2, 0.3))
    with pytest.raises(ValueError, match=r"distortion has 5 numbers; model fisheye takes 0, 4"):
        camera("fisheye", (0.1, 0.2, 0.3, 0.4, 0.5))
