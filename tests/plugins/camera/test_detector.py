import dataclasses
import re

import numpy as np
import pytest

from rigcal.geometry import se3
from rigcal_camera import CAMERA, lens_of

FISHEYE = {"model": "fisheye", "distortion": (-0.054, -0.078, 0.096, -0.0515)}
BARREL = {"distortion": (-0.28, 0.08, 0.0005, -0.0004)}
TURNED = ((25, -20, 10), (0.1, -0.05, 1.3))
VIEWS = [TURNED, ((-30, 15, 170), (-0.1, 0.1, 1.5)), ((5, 35, -80), (0, 0, 1.6))]
KINDS = [
    "april",
    "april_top_left",
    "poster",
    "kalibr",
    "charuco",
    "charuco_inverted",
    "charuco_legacy",
]


def truth(target, T_s_t, config, index):
    p_s = se3.apply(T_s_t, target.points[index])
    return lens_of(config).pixels_from_points(p_s)[0]


def only(detection):
    assert detection.reason == ""
    (candidate,) = detection.candidates
    return candidate


def distance(a, b):
    difference = se3.log(se3.inverse(a) @ b)
    return np.degrees(np.linalg.norm(difference[:3])), np.linalg.norm(difference[3:])


@pytest.mark.parametrize("lens", [{}, BARREL, FISHEYE], ids=["plain", "barrel", "fisheye"])
@pytest.mark.parametrize("kind", [*KINDS, "chess"])
def test_pose_and_corners_of_a_rendered_board(kind, lens, board, camera, pose, photograph):
    config, target = camera(**lens), board[kind]
    for view in VIEWS if lens == {} else VIEWS[:1]:
        T_s_t = pose(*view)
        found = only(CAMERA.detect(photograph(target, T_s_t, config), config, target))
        index, uv = found.measurement["index"], found.measurement["uv"]
        assert len(index) >= 0.8 * len(target.points)
        error = uv - truth(target, T_s_t, config, index)
        assert np.sqrt(np.mean(error**2)) < 0.2
        degrees, metres = distance(found.geometry.T_s_t, T_s_t)
        assert degrees < 0.3
        assert metres < 0.005
        assert found.measurement["sigma_px"] < 0.2


def test_small_tags_of_a_poster_are_found_beside_a_large_one(board, camera, pose, photograph):
    """The AprilTag library's faster half resolution would see the large ones only."""
    target, config, T_s_t = board["poster"], camera(), pose((5, -5, 8), (0, 0, 2.1))
    found = only(CAMERA.detect(photograph(target, T_s_t, config), config, target))
    assert set(found.measurement["index"]) == set(range(len(target.points)))
    degrees, metres = distance(found.geometry.T_s_t, T_s_t)
    assert degrees < 0.2
    assert metres < 0.003


def test_a_tag_code_printed_with_another_rotation_is_found(board, camera, pose, photograph):
    """Libraries disagree by quarter turns: the grid's geometry decides, not a convention."""
    target, config, T_s_t = board["april"], camera(), pose(*TURNED)
    image = photograph(target, T_s_t, config)
    corners = target.groups["tag_corners"]
    for turn in (1, 2, 3):
        # The board that the label says: each tag's corners cyclically renamed in place.
        points = target.points.copy()
        points[corners] = target.points[np.roll(corners, turn, axis=1)]
        other = dataclasses.replace(target, points=points)
        found = only(CAMERA.detect(image, config, other))
        assert distance(found.geometry.T_s_t, T_s_t)[0] < 0.3


def test_a_symmetric_checkerboard_has_two_equal_candidates(board, camera, pose, photograph):
    target, config, T_s_t = board["chess_symmetric"], camera(), pose(*TURNED)
    detection = CAMERA.detect(photograph(target, T_s_t, config), config, target)
    a, b = detection.candidates
    assert a.score == b.score
    half_turn = se3.transform(np.diag([-1.0, -1.0, 1.0]), np.zeros(3))
    assert distance(a.geometry.T_s_t, b.geometry.T_s_t @ half_turn)[0] < 1e-3
    nearest = min((a, b), key=lambda c: distance(c.geometry.T_s_t, T_s_t)[0])
    assert distance(nearest.geometry.T_s_t, T_s_t)[0] < 0.3


@pytest.mark.parametrize(("distance_m", "count"), [(12.0, 2), (1.0, 1)])
def test_two_planar_poses_are_declared_when_the_view_does_not_tell(
    distance_m, count, board, camera, pose
):
    """Seen from afar a tilt and its mirror image project alike; from near they do not."""
    target, config, T_s_t = (
        board["charuco"],
        camera(sigma_px=0.3),
        pose((12, 0, 0), (0, 0, distance_m)),
    )
    seen = CAMERA.observe(T_s_t, config, target, np.random.default_rng(3)).measurement
    given = dataclasses.replace(target, find=lambda image: (seen["index"], seen["uv"]))
    detection = CAMERA.detect(np.zeros((512, 640), dtype=np.uint8), config, given)
    assert len(detection.candidates) == count
    scores = [candidate.score for candidate in detection.candidates]
    assert scores == sorted(scores, reverse=True)
    nearest = min(distance(c.geometry.T_s_t, T_s_t)[0] for c in detection.candidates)
    assert nearest < 6


def test_part_of_a_board_is_enough(board, camera, pose, photograph):
    config, target = camera(), board["april"]
    T_s_t = pose((10, 20, 5), (0.45, 0.1, 1.0))
    found = only(CAMERA.detect(photograph(target, T_s_t, config), config, target))
    assert 8 <= len(found.measurement["index"]) < len(target.points)
    assert distance(found.geometry.T_s_t, T_s_t)[0] < 0.5


def test_wrong_corners_are_left_out(board, camera, pose, photograph):
    config, target, T_s_t = camera(), board["chess"], pose(*TURNED)
    index = np.arange(len(target.points))
    uv = truth(target, T_s_t, config, index)
    wrong = np.array([3, 11, 20, 33])
    uv[wrong] += np.array([[6.0, -2], [40, 10], [-3, 3], [0, 200]])
    finder = dataclasses.replace(target, find=lambda image: (index, uv))
    image = np.zeros((512, 640), dtype=np.uint8)
    found = only(CAMERA.detect(image, config, finder))
    np.testing.assert_array_equal(found.measurement["index"], np.delete(index, wrong))
    assert distance(found.geometry.T_s_t, T_s_t)[0] < 1e-3


@pytest.mark.parametrize(
    ("kind", "reason"),
    [
        ("april", r"found 0 of the 12 tags of 'board'"),
        ("kalibr", r"found 0 of the 12 tags"),
        ("chess", r"no checkerboard of 8 x 5 inner corners"),
        ("charuco", r"found 0 markers of DICT_4X4_1000"),
    ],
)
def test_no_board_in_sight_says_what_was_looked_for(kind, reason, board, camera, photograph):
    detection = CAMERA.detect(photograph(board[kind], None, camera()), camera(), board[kind])
    assert detection.candidates == ()
    assert re.search(reason, detection.reason)


def test_tags_of_another_board_are_counted_as_such(board, camera, pose, photograph):
    image = photograph(board["april"], pose(), camera())
    detection = CAMERA.detect(image, camera(), board["april_top_left"])
    assert "found 0 of the 12 tags of 'board', and 12 of other ids" in detection.reason
    assert detection.candidates == ()


def test_the_back_of_a_board_is_no_board(board, camera, photograph):
    target, config = board["april"], camera()
    T_s_t = se3.transform(np.eye(3), np.array([0, 0, 1.5]))
    assert CAMERA.detect(photograph(target, T_s_t, config), config, target).candidates == ()
    assert CAMERA.observe(T_s_t, config, target, np.random.default_rng(0)) is None


def test_covariance_of_the_pose_matches_its_scatter(board, camera, pose):
    """Mean squared Mahalanobis distance over 100 draws, expected 6 +- 0.35."""
    target, config, T_s_t = board["april"], camera(), pose(*TURNED)
    rng = np.random.default_rng(5)
    nees = []
    for _ in range(100):
        geometry = CAMERA.observe(T_s_t, config, target, rng).geometry
        error = se3.log(se3.inverse(geometry.T_s_t) @ T_s_t)
        nees.append(error @ np.linalg.solve(geometry.covariance, error))
    assert 4.9 < np.mean(nees) < 7.1
