from collections.abc import Callable

import numpy as np
import pytest

from rigcal.geometry import se3
from rigcal.geometry.se3 import Array
from rigcal.observation import Candidate, Detection, PlaneGeometry
from rigcal.scene import Scene, Surface
from rigcal.targets.target import Target, TargetConfig
from rigcal_lrf3d import Cloud, Lrf3dConfig
from rigcal_lrf3d.detector import MAX_CANDIDATES, detect
from rigcal_lrf3d.simulator import simulate

FACING = np.array([[0.0, 0.0, -1.0], [-1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
"""Columns: the board's right, up and outward axes for a sensor that looks along x."""

MakeScene = Callable[[Array, Target], Scene]
BoardPoses = Callable[[int, int], list[Array]]


def look(scene: Scene, config: Lrf3dConfig, seed: int = 1) -> Cloud:
    return simulate(np.eye(4), scene, config, np.random.default_rng(seed))


def is_board(candidate: Candidate, T_s_t: Array) -> bool:
    g = candidate.geometry
    assert isinstance(g, PlaneGeometry)
    angle = np.degrees(np.arccos(min(1.0, float(g.normal @ T_s_t[:3, 2]))))
    return bool(angle < 1.0 and np.linalg.norm(g.center - T_s_t[:3, 3]) < 0.15)


def lies_in(candidate: Candidate, T_s_t: Array) -> bool:
    g = candidate.geometry
    assert isinstance(g, PlaneGeometry)
    offset = g.normal @ T_s_t[:3, 3] + g.d
    return bool(g.normal @ T_s_t[:3, 2] > 0.99 and abs(offset) < 0.02)


def square_board(side: float) -> Target:
    outline = side / 2 * np.array([[-1.0, -1], [1, -1], [1, 1], [-1, 1]])
    return Target("square", TargetConfig(type="plain"), outline, np.zeros((0, 3)))


def test_the_board_is_found_in_a_persons_hands(
    config: Lrf3dConfig, board: Target, room: MakeScene, board_poses: BoardPoses
) -> None:
    first = 0
    poses = board_poses(6, 5)
    for k, T_s_t in enumerate(poses):
        detection = detect(look(room(T_s_t, board), config, k), config, board)
        assert any(is_board(c, T_s_t) for c in detection.candidates), detection.reason
        assert len(detection.candidates) <= MAX_CANDIDATES
        scores = [c.score for c in detection.candidates]
        assert scores == sorted(scores, reverse=True)
        first += is_board(detection.candidates[0], T_s_t)
    assert first >= len(poses) - 1


def test_nothing_in_an_empty_room_looks_like_a_whole_board(
    config: Lrf3dConfig, board: Target, empty_room: Scene
) -> None:
    detection = detect(look(empty_room, config), config, board)
    assert all(c.score < 0.85 for c in detection.candidates)
    assert detection.candidates or "1.2 x 0.9 m" in detection.reason


def test_geometry_and_measurement_are_what_they_say(config: Lrf3dConfig, board: Target) -> None:
    T_s_t = se3.transform(
        se3.rotation_from_rpy(np.array([0.1, 0.2, 0.4])) @ FACING, np.array([2.0, 0.6, 0.0])
    )
    (best,) = detect(look(Scene(board, T_s_t), config), config, board).candidates
    g = best.geometry
    assert isinstance(g, PlaneGeometry)
    assert best.score > 0.85
    assert g.d > 0
    assert abs(g.normal @ g.center + g.d) < 1e-9
    assert np.linalg.eigvalsh(g.covariance)[0] > 0
    points = np.asarray(best.measurement["points"], np.float64)
    assert np.std(points @ g.normal + g.d) == pytest.approx(config.sigma_m, rel=0.2)
    np.testing.assert_allclose(g.boundary @ g.normal + g.d, 0, atol=1e-9)
    p_t = se3.apply(se3.inverse(T_s_t), g.boundary)
    assert np.all(np.abs(p_t[:, :2]) < board.size / 2 + 0.01)
    assert np.all(np.ptp(p_t[:, :2], axis=0) > board.size - 0.15)


def test_a_board_just_in_front_of_a_wall_is_found(config: Lrf3dConfig, board: Target) -> None:
    T_s_t = se3.transform(FACING, np.array([2.0, 0.0, 0.0]))
    wall = Surface(
        T_s_t @ se3.transform(np.eye(3), np.array([0.0, 0.0, -0.2])),
        np.array([[-3.0, -1.5], [3.0, -1.5], [3.0, 1.5], [-3.0, 1.5]]),
    )
    detection = detect(look(Scene(board, T_s_t, (wall,)), config), config, board)
    assert is_board(detection.candidates[0], T_s_t)


def test_a_board_seen_in_part_is_kept_but_ranked_lower(config: Lrf3dConfig, board: Target) -> None:
    T_s_t = se3.transform(FACING, np.array([2.2, 0.0, 0.0]))
    screen = Surface(
        se3.transform(FACING, np.array([1.2, 0.9, 0.0])),
        np.array([[-0.8, -0.6], [0.8, -0.6], [0.8, 0.6], [-0.8, 0.6]]),
    )
    whole = detect(look(Scene(board, T_s_t), config), config, board).candidates[0]
    part = detect(look(Scene(board, T_s_t, (screen,)), config), config, board)
    kept = [c for c in part.candidates if lies_in(c, T_s_t)]
    assert len(kept) == 1
    assert kept[0].score < 0.85 * whole.score


@pytest.mark.parametrize(("side", "word"), [(0.4, "too large"), (2.2, "too small")])
def test_a_board_of_another_size_is_refused_with_the_reason(
    config: Lrf3dConfig, board: Target, side: float, word: str
) -> None:
    scene = Scene(board, se3.transform(FACING, np.array([2.0, 0.0, 0.0])))
    detection = detect(look(scene, config), config, square_board(side))
    assert detection.candidates == ()
    assert word in detection.reason
    assert f"{side:g} x {side:g} m" in detection.reason


@pytest.mark.parametrize("count", [0, 3, 19])
def test_a_cloud_of_too_few_returns_is_no_error(count: int, board: Target) -> None:
    detection = detect(Cloud(np.ones((count, 3))), Lrf3dConfig(), board)
    assert detection.candidates == ()
    assert f"{count} returns" in detection.reason


@pytest.mark.parametrize("spread", [np.zeros(3), np.array([1.0, 0, 0]), np.ones(3)])
def test_clouds_without_planes_give_a_reason(spread: Array, board: Target) -> None:
    noise = np.random.default_rng(1).normal(size=(500, 3)) * spread + np.array([3.0, 0, 0])
    detection = detect(Cloud(noise), Lrf3dConfig(), board)
    assert detection.candidates == ()
    assert "flat region" in detection.reason


def test_the_same_cloud_gives_the_same_bytes(
    config: Lrf3dConfig, board: Target, room: MakeScene, board_poses: BoardPoses
) -> None:
    cloud = look(room(board_poses(1, 8)[0], board), config)

    def content(detection: Detection) -> list[bytes]:
        parts = []
        for c in detection.candidates:
            g = c.geometry
            assert isinstance(g, PlaneGeometry)
            arrays = [g.normal, g.center, g.covariance, g.boundary, c.measurement["points"]]
            parts += [np.asarray(a).tobytes() for a in (*arrays, g.d, c.score)]
        return parts

    assert content(detect(cloud, config, board)) == content(detect(cloud, config, board))


def test_the_order_of_points_does_not_matter(
    config: Lrf3dConfig, board: Target, room: MakeScene, board_poses: BoardPoses
) -> None:
    cloud = look(room(board_poses(1, 9)[0], board), config)
    mixed = Cloud(np.random.default_rng(2).permutation(cloud.points))
    a, b = (detect(c, config, board).candidates[0].geometry for c in (cloud, mixed))
    assert isinstance(a, PlaneGeometry)
    assert isinstance(b, PlaneGeometry)
    np.testing.assert_allclose(a.normal, b.normal, atol=1e-4)
    np.testing.assert_allclose(a.center, b.center, atol=5e-3)
