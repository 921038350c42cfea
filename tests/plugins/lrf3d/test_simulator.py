import numpy as np
import pytest

from rigcal.errors import ConfigError
from rigcal.geometry import se3
from rigcal.scene import Scene
from rigcal.targets.target import Target
from rigcal_lrf3d import LRF3D, Cloud, Lrf3dConfig, MultibeamScan, SpinningScan
from rigcal_lrf3d.beams import beams_of, scan_poses
from rigcal_lrf3d.simulator import simulate

FACING = np.array([[0.0, 0.0, -1.0], [-1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
"""Columns: the board's right, up and outward axes for a sensor that looks along x."""


def test_without_tilt_and_offset_a_scan_stands_upright() -> None:
    T_s_l = scan_poses(SpinningScan())
    np.testing.assert_allclose(T_s_l[:, :3, 0], np.tile([0.0, 0.0, 1.0], (len(T_s_l), 1)))
    np.testing.assert_array_equal(T_s_l[:, :3, 3], 0)


def test_tilt_and_offset_move_the_scan_plane() -> None:
    scan = {"pattern": "spinning_lrf", "tilt_deg": 10, "offset_m": 0.05, "scan_angle_deg": 180}
    T_s_l = scan_poses(SpinningScan.model_validate(scan))
    assert len(T_s_l) == 180
    np.testing.assert_allclose(np.degrees(np.arccos(T_s_l[:, 2, 0])), 10)
    np.testing.assert_allclose(np.linalg.norm(T_s_l[:, :2, 3], axis=1), 0.05)
    # The forward axis leans towards the side to which the laser is moved.
    np.testing.assert_allclose(
        np.einsum("ki,ki->k", T_s_l[:, :2, 0], T_s_l[:, :2, 3]), 0.05 * np.sin(np.radians(10))
    )


def test_beams_are_unit_directions_of_the_expected_number() -> None:
    scan = {"pattern": "multibeam", "elevations_deg": [-10, 0, 10], "azimuth_step_deg": 0.5}
    origins, directions = beams_of(MultibeamScan.model_validate(scan), np.random.default_rng(0))
    assert directions.shape == (3 * 720, 3)
    np.testing.assert_allclose(np.linalg.norm(directions, axis=1), 1)
    np.testing.assert_array_equal(origins, 0)
    np.testing.assert_allclose(
        np.unique(np.degrees(np.arcsin(directions[:, 2])).round(9)), [-10, 0, 10]
    )


def test_points_lie_on_the_board_in_the_sensors_frame(config: Lrf3dConfig, board: Target) -> None:
    rng = np.random.default_rng(3)
    T_w_s = se3.exp(rng.normal(0, 0.2, 6))
    T_w_t = T_w_s @ se3.transform(FACING, np.array([2.0, 0.0, 0.1]))
    cloud = simulate(T_w_s, Scene(board, T_w_t), config, rng)
    p_t = se3.apply(se3.inverse(T_w_t) @ T_w_s, cloud.points)
    assert len(p_t) > 500
    assert np.std(p_t[:, 2]) < 1.1 * config.sigma_m
    assert abs(np.mean(p_t[:, 2])) < 5 * config.sigma_m / np.sqrt(len(p_t))
    assert np.all(np.abs(p_t[:, :2]) < board.size / 2 + 6 * config.sigma_m)


def test_nothing_beyond_the_ranges_is_returned(board: Target) -> None:
    scan = {"pattern": "multibeam", "elevations_deg": [0.0]}
    config = Lrf3dConfig.model_validate({"scan": scan, "range_max_m": 1.5})
    scene = Scene(board, se3.transform(FACING, np.array([2.0, 0.0, 0.0])))
    assert len(simulate(np.eye(4), scene, config, np.random.default_rng(1)).points) == 0


def test_the_noise_of_angles_moves_points_on_slanted_boards_only(board: Target) -> None:
    scan = {"pattern": "multibeam", "elevations_deg": [-4.0, 0.0, 4.0]}
    config = Lrf3dConfig.model_validate({"scan": scan, "sigma_m": 1e-6, "sigma_angle_deg": 0.1})

    def spread(turn_deg: float) -> float:
        R = se3.exp_so3(np.array([0.0, 0.0, np.radians(turn_deg)])) @ FACING
        T_w_t = se3.transform(R, np.array([2.0, 0.0, 0.0]))
        cloud = simulate(np.eye(4), Scene(board, T_w_t), config, np.random.default_rng(1))
        return float(np.std(se3.apply(se3.inverse(T_w_t), cloud.points)[:, 2]))

    expected = 2.0 * np.sin(np.radians(50)) * np.radians(0.1)
    assert spread(50) == pytest.approx(expected, rel=0.25)
    assert spread(0) < 0.4 * expected


def test_the_same_seed_gives_the_same_cloud(config: Lrf3dConfig, board: Target) -> None:
    scene = Scene(board, se3.transform(FACING, np.array([2.0, 0.0, 0.0])))
    a, b = (simulate(np.eye(4), scene, config, np.random.default_rng(9)) for _ in range(2))
    assert isinstance(a, Cloud)
    assert a.points.tobytes() == b.points.tobytes()


def test_a_sensor_without_scan_cannot_be_simulated(board: Target) -> None:
    with pytest.raises(ConfigError, match="lacks `scan`"):
        simulate(np.eye(4), Scene(board, None), Lrf3dConfig(), np.random.default_rng(1))


def test_sees_agrees_with_what_the_beams_reach() -> None:
    assert LRF3D.sees is not None
    points = np.array([[2.0, 0, 0], [2.0, 0, 2.0], [0, 0, 40.0], [-1.0, -1.0, -1.3], [0, 0, -1.0]])
    multibeam = {"scan": {"pattern": "multibeam", "elevations_deg": [-15, 15]}, "range_max_m": 30}
    seen = LRF3D.sees(points, Lrf3dConfig.model_validate(multibeam))
    assert seen.tolist() == [True, False, False, False, False]
    spinning = {"scan": {"pattern": "spinning_lrf"}, "range_max_m": 30}
    seen = LRF3D.sees(points, Lrf3dConfig.model_validate(spinning))
    assert seen.tolist() == [True, True, False, True, False]
    part = {"scan": {"pattern": "spinning_lrf", "scan_angle_deg": 40, "angle_min_deg": 0}}
    seen = LRF3D.sees(
        np.array([[0, 2.0, 0], [0, -2.0, 0], [2.0, 0, 0]]), Lrf3dConfig.model_validate(part)
    )
    assert seen.tolist() == [True, False, False]
