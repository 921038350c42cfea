from __future__ import annotations

import numpy as np
import pytest

from rigcal.errors import ConfigError, RecordingError
from rigcal.geometry import se3
from rigcal.ranging import RangeEffects
from rigcal.recording.message import Message
from rigcal.scene import Scene
from rigcal_lrf2d import LRF2D, Lrf2dConfig, Scan
from rigcal_lrf2d.simulator import beam_angles

FACING = se3.transform(np.array([[0.0, 0, -1], [-1, 0, 0], [0, 1, 0]]), np.array([2.0, 0, 0]))


def test_beams_run_from_the_first_to_the_last_angle(world) -> None:
    angles = beam_angles(world.config)
    assert len(angles) == 1081
    assert np.degrees(angles[[0, 1, -1]]) == pytest.approx([-135, -134.75, 135])


def test_ranges_are_those_of_the_board_with_the_configured_noise(world) -> None:
    scan = LRF2D.simulate(np.eye(4), Scene(world.target, FACING), world.config, rng(0))
    on_board = np.abs(np.tan(scan.angles)) * 2 < 0.59
    on_board &= np.cos(scan.angles) > 0
    errors = scan.ranges[on_board] - 2 / np.cos(scan.angles[on_board])
    assert np.std(errors) == pytest.approx(0.01, rel=0.2)
    assert not np.isfinite(scan.ranges[~on_board & (np.abs(scan.angles) > 0.31)]).any()


def test_the_sensor_stands_where_its_pose_says(world) -> None:
    T_w_s = se3.transform(se3.rotation_from_rpy(np.array([0, 0, np.pi / 2])), np.array([1.0, 0, 0]))
    scan = LRF2D.simulate(T_w_s, Scene(world.target, FACING), world.config, rng(0))
    ahead = np.degrees(scan.angles[np.isfinite(scan.ranges)].mean())
    assert ahead == pytest.approx(-90, abs=1)
    assert scan.ranges[np.argmin(np.abs(np.degrees(scan.angles) + 90))] == pytest.approx(
        1, abs=0.05
    )


def test_angle_noise_shows_at_oblique_incidence_only(world) -> None:
    config = world.config.model_copy(update={"sigma_m": 1e-9, "sigma_angle_deg": 0.5})
    turned = FACING @ se3.exp(np.array([0, 1.0, 0, 0, 0, 0]))
    spread = []
    for T_s_t in (FACING, turned):
        ahead = [
            LRF2D.simulate(np.eye(4), Scene(world.target, T_s_t), config, rng(seed)).ranges[540]
            for seed in range(200)
        ]
        spread.append(np.std(ahead))
    assert spread[0] < 0.0005
    assert spread[1] == pytest.approx(2 * np.tan(1.0) * np.radians(0.5), rel=0.2)


def test_beyond_the_greatest_range_nothing_returns(world) -> None:
    config = world.config.model_copy(update={"range_max_m": 1.9})
    scan = LRF2D.simulate(np.eye(4), Scene(world.target, FACING), config, rng(0))
    assert not scan.valid.any()


def test_the_same_seed_gives_the_same_scan(world) -> None:
    scans = [
        LRF2D.simulate(np.eye(4), Scene(world.target, FACING), world.config, rng(4))
        for _ in range(2)
    ]
    np.testing.assert_array_equal(scans[0].ranges, scans[1].ranges)


def test_simulation_without_angles_names_what_is_missing() -> None:
    with pytest.raises(ConfigError, match=r"lacks angle_max_deg, angle_step_deg"):
        beam_angles(Lrf2dConfig(angle_min_deg=0))


def test_it_sees_what_lies_within_its_angles_and_ranges(world) -> None:
    config = world.config.model_copy(update={"range_min_m": 0.5})
    points = np.array([[1.0, 0, 0.3], [-1, 0, 0], [31, 0, 0], [0.1, 0, 0], [-1, 1.1, 0]])
    assert LRF2D.sees(points, config).tolist() == [True, False, False, False, True]
    assert LRF2D.sees(points, Lrf2dConfig()).all()


def test_sees_works_across_the_back() -> None:
    config = Lrf2dConfig(angle_min_deg=90, angle_max_deg=270)
    points = np.array([[-1.0, -0.1, 0], [-1, 0.1, 0], [1, 0, 0]])
    assert LRF2D.sees(points, config).tolist() == [True, True, False]


def test_a_scan_survives_its_message(world) -> None:
    scan = LRF2D.simulate(np.eye(4), Scene(world.target, FACING), world.config, rng(0))
    message = LRF2D.encode(scan, world.config, 12_000_000_034, "front")
    assert (message.header.stamp.sec, message.header.stamp.nanosec) == (12, 34)
    assert message.header.frame_id == "front"
    assert message.ranges.dtype == np.float32
    again = LRF2D.decode(
        Message(LRF2D.message_type, message, 12_000_000_034, None, "front, message 0"),
        world.config,
    )
    np.testing.assert_allclose(again.angles, scan.angles, atol=1e-6)
    np.testing.assert_allclose(again.ranges, scan.ranges, rtol=1e-6)


def test_a_scan_with_a_missing_step_cannot_be_a_message(world) -> None:
    with pytest.raises(RecordingError, match="evenly"):
        LRF2D.encode(Scan(np.array([0, 0.1, 0.5]), np.ones(3)), world.config, 0, "front")


def rng(seed: int) -> np.random.Generator:
    return np.random.default_rng(seed)


def test_effects_of_the_scenario_spoil_the_scan(world) -> None:
    scene = Scene(world.target, FACING)
    clean = LRF2D.simulate(np.eye(4), scene, world.config, rng(3))
    spoilt = LRF2D.simulate(
        np.eye(4), scene, world.config, rng(3), RangeEffects(bias_m=0.05, dropout=0.25)
    )
    assert issubclass(LRF2D.effects, RangeEffects)
    kept = spoilt.valid
    assert 0.6 < kept.sum() / clean.valid.sum() < 0.9
    np.testing.assert_allclose(spoilt.ranges[kept] - clean.ranges[kept], 0.05)
    # Without noise nothing is perturbed, the angles neither.
    wide = world.config.model_copy(update={"sigma_angle_deg": 1.0})
    exact = LRF2D.simulate(np.eye(4), scene, wide, rng(3), RangeEffects(noise=0.0))
    np.testing.assert_allclose(exact.ranges[exact.valid] * np.cos(exact.angles[exact.valid]), 2.0)
