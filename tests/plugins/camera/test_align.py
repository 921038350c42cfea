"""Corners in images without noise, and how they are aligned with the print."""

import numpy as np
import pytest

from rigcal.geometry import se3
from rigcal_camera import CAMERA, lens_of
from rigcal_camera.align import align_corners
from rigcal_camera.detector import explain, find_corners
from rigcal_camera.near import near

LENSES = {
    "plain": {},
    "barrel": {"distortion": (-0.28, 0.08, 0.0005, -0.0004)},
    "fisheye": {"model": "fisheye", "distortion": (-0.054, -0.078, 0.096, -0.0515)},
}


@pytest.mark.parametrize("lens_name", LENSES)
@pytest.mark.parametrize("kind", ["april", "kalibr", "kalibr_thin", "poster", "chess", "charuco"])
def test_corners_without_noise_are_exact(kind, lens_name, board, camera, pose, photograph):
    """Residuals at the true pose, through the detector; tags down to 16 px, cells of 2 px.

    The nearest fills the image: a tag of 0.35 m has sides of 170 px, which a lens bends.
    """
    target, config = board[kind], camera(**LENSES[lens_name])
    errors = []
    views = ((5, 10, 100), 0.9), ((15, -25, 8), 1.1), ((-20, 30, -35), 1.8), ((5, 10, 100), 2.6)
    for rpy_deg, distance_m in views:
        T_s_t = pose(rpy_deg, (0.03, -0.02, distance_m))
        image = photograph(target, T_s_t, config, noise_grey=0)
        for found in CAMERA.detect(image, config, target).candidates[:1]:
            errors.append(CAMERA.errors(found, config, target, T_s_t).ravel())
    rms = [float(np.sqrt(np.mean(e**2))) for e in errors]
    assert len(rms) >= 3
    assert max(rms) < 0.02
    assert np.abs(np.concatenate(errors).mean()) < 0.003


@pytest.fixture(scope="module")
def start(board, camera, pose, photograph):
    """A view, its truth, and corners that are off by 0.3 px each."""

    def make(noise_grey=0.0, blur_px=0.6, **scene):
        target, config, T_s_t = board["april"], camera(), pose((15, -25, 8), (0.03, -0.02, 1.3))
        image = photograph(target, T_s_t, config, noise_grey=noise_grey, blur_px=blur_px, **scene)
        truth = lens_of(config).pixels_from_points(se3.apply(T_s_t, target.points))[0]
        turn = np.random.default_rng(0).uniform(0, 2 * np.pi, len(truth))
        wrong = truth + 0.3 * np.column_stack([np.cos(turn), np.sin(turn)])
        return image, truth, wrong, target, lens_of(config), T_s_t

    return make


def rms(error):
    return float(np.sqrt(np.mean(error**2)))


@pytest.mark.parametrize("blur_px", [0.5, 0.8, 1.2])
def test_neither_blur_nor_light_moves_a_corner(blur_px, start):
    image, truth, wrong, target, lens, T_s_t = start(blur_px=blur_px)
    dim = (0.4 * image + 30).astype(np.uint8)
    for picture in (image, dim, 255 - image):
        found = align_corners(picture, wrong, target.points, target, lens, T_s_t)
        assert rms(found - truth) < 0.02


def test_the_pose_does_not_pull(start):
    """Drawn from a pose that is 0.2 deg and 3 mm off, which moves the print by 1 px."""
    image, truth, wrong, target, lens, T_s_t = start()
    off = T_s_t @ se3.exp(np.array([0.002, -0.002, 0.002, 0.003, 0.003, 0.003]))
    predicted = lens.pixels_from_points(se3.apply(off, target.points))[0]
    assert np.linalg.norm(predicted - truth, axis=1).mean() > 0.9
    found = align_corners(image, wrong, target.points, target, lens, off)
    assert rms(found - truth) < 0.02


def test_corners_stay_as_found_where_alignment_explains_them_worse(
    board, camera, pose, photograph, monkeypatch
):
    """Judged by the corners that the pose explained before: leaving some out is no improvement."""
    target, config, T_s_t = board["april"], camera(), pose((15, -25, 8), (0.03, -0.02, 1.3))
    image = photograph(target, T_s_t, config, noise_grey=2.0)
    found = find_corners(image, target, lens_of(config))

    def spoilt(image, uv, p_t, target, lens, T_s_t):
        exact = lens.pixels_from_points(se3.apply(T_s_t, p_t))[0]
        exact[:4] += 3.0
        return exact

    monkeypatch.setattr("rigcal_camera.detector.align_corners", spoilt)
    (kept,) = explain(found, config, target, image).candidates
    (as_found,) = explain(found, config, target).candidates
    np.testing.assert_array_equal(kept.measurement["uv"], as_found.measurement["uv"])
    np.testing.assert_array_equal(kept.geometry.T_s_t, as_found.geometry.T_s_t)


@pytest.mark.parametrize("kind", ["april", "kalibr", "chess"])
def test_a_second_look_has_corners_as_exact_as_the_first(kind, board, camera, pose, photograph):
    """In an image without noise; the prediction is off by 3 cm and 1 degree."""
    target, config, T_s_t = board[kind], camera(), pose((15, -25, 8), (0.03, -0.02, 1.8))
    image = photograph(target, T_s_t, config, noise_grey=0)
    off = T_s_t @ se3.exp(np.array([0.01, -0.01, 0.01, 0.02, -0.01, 0.02]))
    found = min(
        (
            CAMERA.errors(c, config, target, T_s_t)
            for c in near(image, config, target, off).candidates
        ),
        key=lambda errors: float(np.sum(errors**2)),
    )
    assert len(found) == len(target.points)
    assert np.linalg.norm(found, axis=1).max() < 0.05
    assert rms(found) < 0.02


def test_what_does_not_look_like_the_print_stays(start):
    image, _, wrong, target, lens, T_s_t = start()
    covered = np.array(image)
    covered[:, :300] = 120
    found = align_corners(covered, wrong, target.points, target, lens, T_s_t)
    hidden = wrong[:, 0] < 290
    assert hidden.sum() > 10
    np.testing.assert_array_equal(found[hidden], wrong[hidden])
    outside = wrong + np.array([1000.0, 0.0])
    same = align_corners(image, outside, target.points, target, lens, T_s_t)
    np.testing.assert_array_equal(same, outside)
