from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from rigcal.geometry import se3
from rigcal.geometry.se3 import Array
from rigcal_lrf3d import DepthScan, Lrf3dConfig, MultibeamScan, RosetteScan, SpinningScan
from rigcal_lrf3d.beams import beams_of, reaches, scan_poses
from rigcal_lrf3d.scans import Scan

SCANS: list[Scan] = [
    SpinningScan(tilt_deg=10.0),
    SpinningScan(tilt_deg=-20.0, scan_angle_deg=120.0, angle_min_deg=-40.0, angle_max_deg=70.0),
    MultibeamScan(elevations_deg=(-15.0, 0.0, 15.0)),
    RosetteScan(),
    DepthScan(),
]


def beams(scan: Scan, seed: int = 0) -> tuple[Array, Array]:
    return beams_of(scan, np.random.default_rng(seed))


def test_without_tilt_and_offset_a_2d_laser_is_plainly_spun_about_z() -> None:
    """Beam b of the scan at turn a: polar angle b from z, in the half-plane at 90 deg + a."""
    scan = SpinningScan(scan_angle_deg=180.0, angle_min_deg=-135, angle_max_deg=135)
    origins, directions = beams(scan)
    turn = np.radians(np.arange(180) - 89.5)[:, None]
    polar = np.radians(np.arange(-135, 136))
    expected = np.stack(
        [-np.sin(turn) * np.sin(polar), np.cos(turn) * np.sin(polar), np.cos(polar) + 0 * turn],
        axis=-1,
    )
    np.testing.assert_array_equal(origins, 0.0)
    np.testing.assert_allclose(directions, expected.reshape(-1, 3), atol=1e-12)


def test_every_scan_is_taken_from_its_own_pose() -> None:
    scan = SpinningScan(tilt_deg=10.0, offset_m=0.05, scans_per_deg=0.5, scan_angle_deg=360.0)
    origins, directions = beams(scan)
    T_s_l = scan_poses(scan)
    assert len(T_s_l) == 180
    per_scan = directions.reshape(180, -1, 3)
    for k in (0, 57, 179):
        R_l_s = se3.inverse(T_s_l[k])[:3, :3]
        np.testing.assert_allclose((per_scan[k] @ R_l_s.T)[:, 2], 0.0, atol=1e-12)
        np.testing.assert_array_equal(origins.reshape(180, -1, 3)[k, 17], T_s_l[k, :3, 3])


def test_a_rosette_fills_its_view_and_does_not_repeat() -> None:
    scan = RosetteScan(fov_deg=60.0, points_per_frame=5000)
    first, second = (beams(scan, seed)[1] for seed in (0, 1))
    assert first.shape == (5000, 3)
    np.testing.assert_allclose(np.linalg.norm(first, axis=1), 1.0)
    off = np.degrees(np.arccos(first[:, 0]))
    assert 29.5 < off.max() <= 30.0 + 1e-9
    assert off.min() < 2.0
    assert np.abs(first - second).max() > 0.1
    np.testing.assert_array_equal(first, beams(scan, 0)[1])


def test_a_rosette_covers_more_from_frame_to_frame() -> None:
    scan = RosetteScan(fov_deg=60.0, points_per_frame=2000)

    def covered(frames: int) -> int:
        d = np.concatenate([beams(scan, seed)[1] for seed in range(frames)])
        return len(np.unique(np.round(d[:, 1:] * 60), axis=0))

    assert covered(10) > 1.5 * covered(1)
    d = np.concatenate([beams(scan, seed)[1] for seed in range(20)])
    around = np.histogram(np.arctan2(d[:, 2], d[:, 1]), 12, (-np.pi, np.pi))[0]
    assert around.min() > 0.5 * around.mean()


def test_pixels_of_a_depth_camera_are_those_of_a_pinhole() -> None:
    scan = DepthScan(width_px=5, height_px=3, focal_px=4.0)
    _, d = beams(scan)
    uv = np.column_stack([-d[:, 1], -d[:, 2]]) / d[:, :1] * 4.0
    expected = np.stack(np.meshgrid([-2, -1, 0, 1, 2], [-1, 0, 1]), axis=-1).reshape(-1, 2)
    np.testing.assert_allclose(uv, expected, atol=1e-12)


@pytest.mark.parametrize("scan", SCANS, ids=lambda s: s.pattern)
def test_what_a_scan_reaches_is_where_its_beams_go(scan: Scan) -> None:
    _, d = beams(scan)
    assert reaches(scan, 3.0 * d).all()
    # Farther from every beam than beams are apart, nothing is reached.
    apart = 15.1 if isinstance(scan, MultibeamScan) else 5.0
    points = np.random.default_rng(0).normal(size=(600, 3))
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    far = np.max(points @ d.T, axis=1) < np.cos(np.radians(apart))
    assert far.sum() > 50 or scan == SCANS[0]
    assert not reaches(scan, points[far]).any()


@pytest.mark.parametrize("scan", SCANS, ids=lambda s: s.pattern)
def test_a_scan_survives_the_file(scan: Scan) -> None:
    config = Lrf3dConfig(scan=scan)
    assert Lrf3dConfig.model_validate_json(config.model_dump_json()) == config
    assert config.beams_start_at_sensor


@pytest.mark.parametrize(
    ("scan", "message"),
    [
        ({"pattern": "multibeam", "elevations_deg": []}, "is empty; list the elevation of every"),
        ({"pattern": "spinning_lrf", "angle_step_deg": 300}, "leaves one beam.*make it smaller"),
        ({"pattern": "spinning_lrf", "scan_angle_deg": 0.5}, "gives no whole scan; make one"),
        ({"pattern": "rosette", "points_per_frame": 0}, "greater than or equal to 1"),
        ({"pattern": "rosette", "fov_deg": 200}, "less than or equal to 170"),
        ({"pattern": "depth_camera", "width_px": 0}, "greater than or equal to 1"),
        ({"pattern": "livox"}, "'rosette', 'depth_camera'"),
    ],
)
def test_a_scan_without_beams_is_refused(scan: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        Lrf3dConfig.model_validate({"scan": scan})
