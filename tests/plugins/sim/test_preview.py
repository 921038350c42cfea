from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure

from rigcal.calibration import Calibration
from rigcal.calibration_file import load_calibration
from rigcal.errors import ConfigError
from rigcal.geometry import se3
from rigcal.plugin import FrameView, Registry, SensorConfig, SensorType
from rigcal.recording import nearest_message, open_recording
from rigcal.rig import Rig, build_targets
from rigcal.targets.target import Target, TargetConfig
from rigcal_sim.dataset import simulate
from rigcal_sim.preview import write_preview
from rigcal_sim.preview.frames import views
from rigcal_sim.preview.levelled import levelled_rotation
from rigcal_sim.preview.oblique import oblique_view
from rigcal_sim.preview.overview import fan_of, field_of_view, sector_of
from rigcal_sim.preview.panels import Sensor, draw_panel
from rigcal_sim.scenario import ScenarioConfig

MakeRig = Callable[..., Rig]
CARRIED = ScenarioConfig.model_validate(
    {
        "board": {"bearings_deg": [-30, 0, 30], "radii_m": [1.5]},
        "recording": {"mode": "continuous", "hold_s": 1.0},
        "sensors": {"a": {"rate_hz": 7.0, "jitter_s": 0.02}, "b": {"rate_hz": 3.0}},
    }
)


CONFIG = SensorConfig(type="x", topic="/x")
UPRIGHT = np.array([[0, 0, -1], [-1, 0, 0], [0, 1, 0]])
"""`R_w_t` of a board that looks back along x."""


def looking_ahead(half_angle_deg: float, reach_m: float, flat: bool = False) -> SensorType:
    def sees(points: Any, config: Any) -> Any:
        distance = np.linalg.norm(points, axis=1)
        angle = np.degrees(np.arccos(points[:, 0] / distance))
        return (angle <= half_angle_deg) & (distance <= reach_m)

    return SensorType("x", SensorConfig, (), None, None, sees=sees, flat=flat)  # type: ignore[arg-type]


@pytest.mark.parametrize("flat", [True, False])
def test_a_field_of_view_is_what_the_sensor_sees_as_far_as_the_boards_stand(flat: bool) -> None:
    T = se3.transform(se3.rotation_from_rpy(np.array([0, 0, np.pi / 2])), np.array([1.0, 2, 3]))
    boards = np.tile(T[:3, 3] + [0.0, 2.0, 0.0], (5, 4, 1))
    field = field_of_view(looking_ahead(30, 9, flat), CONFIG, T, boards) - T[:3, 3]
    distance = np.linalg.norm(field, axis=1)
    np.testing.assert_allclose(distance, 0.85 * 2.0)
    angle = np.degrees(np.arccos(field[:, 1] / distance))
    assert 29 < angle.max() <= 30.001
    if flat:
        np.testing.assert_allclose(field[:, 2], 0, atol=1e-12)


def test_a_sensor_that_does_not_reach_the_boards_has_a_shorter_field() -> None:
    boards = np.tile([8.0, 0, 0], (5, 4, 1))
    field = field_of_view(looking_ahead(30, 3), CONFIG, np.eye(4), boards)
    distance = np.linalg.norm(field, axis=1)
    assert 1.5 < distance.min() <= distance.max() <= 3.0


def test_the_outline_of_a_fan_goes_back_to_the_sensor_unless_it_sees_all_around() -> None:
    boards = np.tile([2.0, 0, 0], (5, 4, 1))
    part, whole = (
        field_of_view(looking_ahead(half, 9, flat=True), CONFIG, np.eye(4), boards)
        for half in (100, 180)
    )
    np.testing.assert_array_equal(fan_of(part, np.zeros(3))[-1], np.zeros(3))
    assert np.linalg.norm(fan_of(whole, np.zeros(3)), axis=1).min() > 1
    steps = np.linalg.norm(np.diff(fan_of(part, np.zeros(3))[:-1], axis=0), axis=1)
    assert steps.max() < 2 * np.median(steps)


def test_a_sector_reaches_as_far_as_its_points() -> None:
    angles = np.radians(np.linspace(-40, 40, 400))
    points = np.array([1.0, 1.0]) + 2 * np.column_stack([np.cos(angles), np.sin(angles)])
    reach = np.linalg.norm(sector_of(points, np.array([1.0, 1.0])) - 1, axis=1)
    assert np.count_nonzero(reach > 1.9) == pytest.approx(80 / 2, abs=2)
    assert reach[reach < 1.9].max() == 0


@pytest.mark.parametrize("rpy_deg", [(0, 0, 0), (-90, 0, -90), (180, 0, 30)])
def test_pictures_are_upright_whatever_the_axes_of_the_root(rpy_deg: tuple[int, int, int]) -> None:
    """Level, a camera and a sensor mounted upside down; boards held upright within 25 degrees."""
    R_w_root, rng = se3.rotation_from_rpy(np.radians(rpy_deg)), np.random.default_rng(0)
    boards = {}
    for k in range(40):
        R_w_t = se3.rotation_from_rpy(rng.uniform(-0.4, 0.4, 3)) @ [
            [0, 0, -1],
            [-1, 0, 0],
            [0, 1, 0],
        ]
        boards[str(k)] = se3.transform(R_w_root.T @ R_w_t, rng.normal(size=3))
    R = levelled_rotation(Calibration("root", {}, target_poses=boards).up)
    np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-12)
    np.testing.assert_allclose(R @ R_w_root.T @ [0, 0, 1], [0, 0, 1], atol=1e-9)


def test_near_points_cover_far_ones_and_walls_are_left_out() -> None:
    outline = np.array(
        [[2.0, y, z] for y, z in ((-0.5, -0.4), (0.5, -0.4), (0.5, 0.4), (-0.5, 0.4))]
    )
    wall = np.array([[6.0, y, 0.0] for y in np.linspace(-1, 1, 50)])
    board = np.array([[2.0, y, z] for y in np.linspace(-0.4, 0.4, 30) for z in (-0.1, 0.0, 0.1)])
    picture = oblique_view(np.concatenate([wall, board]), outline, np.eye(3))
    bare = oblique_view(board, outline, np.eye(3))
    np.testing.assert_array_equal(picture.pixels, bare.pixels)
    v, u = np.nonzero(picture.pixels[..., 3])
    left, right, bottom, top = picture.extent
    height, width = picture.pixels.shape[:2]
    x, y = left + u / width * (right - left), top - v / height * (top - bottom)
    low, high = picture.outline.min(axis=0), picture.outline.max(axis=0)
    assert (x > low[0] - 0.02).all()
    assert (x < high[0] + 0.02).all()
    assert (y > low[1] - 0.02).all()
    assert (y < high[1] + 0.02).all()


def test_of_an_image_without_a_lens_model_nothing_is_said() -> None:
    """Which corners are in an image is not known of a type that offers no `project`."""
    kind = looking_ahead(30, 9)
    outline = np.array([[-0.5, -0.4], [0.5, -0.4], [0.5, 0.4], [-0.5, 0.4]])
    target = Target("board", TargetConfig(type="plain"), outline, np.zeros((1, 3)))
    nothing_there = replace(kind, project=lambda p, c: (p[:, :2], np.zeros(len(p), bool)))
    for shown, note in ((kind, ""), (nothing_there, "no corner of the board in the image")):
        axes = Figure().add_subplot()
        sensor = Sensor("a", shown, CONFIG, target, np.eye(4), np.eye(3))
        draw_panel(axes, sensor, FrameView(image=np.zeros((4, 6), np.uint8)))
        assert axes.get_title(loc="right") == note


def test_the_frame_shown_is_the_one_nearest_to_the_middle_of_the_hold(
    make_rig: MakeRig, registry: Registry, tmp_path: Path
) -> None:
    """Sensors run at their own rates and jitter: no index says which frame it is."""
    rig = make_rig()
    summary = simulate(rig, registry, CARRIED, 1, tmp_path, jobs=1)
    truth = load_calibration(summary.truth)
    with open_recording(summary.recordings[0]) as recording:
        for config in rig.sensors.values():
            stamps = np.array([m.stamp_ns for m in recording.read(config.source)])
            for start, end in truth.holds_ns.values():
                middle = (start + end) // 2
                best = np.abs(stamps - middle).min()
                assert (
                    abs(nearest_message(recording, config.source, middle).stamp_ns - middle) == best
                )


def test_what_cannot_be_shown_is_said(
    make_rig: MakeRig, registry: Registry, tmp_path: Path
) -> None:
    rig = make_rig()
    summary = simulate(rig, registry, CARRIED, 1, tmp_path, jobs=1)
    hold = next(iter(load_calibration(summary.truth).holds_ns.values()))
    with open_recording(summary.recordings[0]) as recording:
        seen = views(rig, registry, recording, hold)
        assert seen["a"] == "sensor type 'ranger' offers no view"
        shown = SimpleNamespace(
            sensor_type=lambda name: replace(
                registry.sensor_type(name), view=lambda *_: FrameView(points=np.zeros((1, 3)))
            )
        )
        before = hold[0] - 10**9
        assert views(rig, shown, recording, (before, before + 1000)) == dict.fromkeys(  # type: ignore[arg-type]
            "ab", "no frame while the board was held still"
        )


def test_a_truth_of_something_else_is_refused(
    make_rig: MakeRig, registry: Registry, tmp_path: Path
) -> None:
    rig = make_rig()
    summary = simulate(rig, registry, CARRIED, 1, tmp_path, jobs=1)
    truth, target = load_calibration(summary.truth), build_targets(rig, registry)["board"]
    for wrong, words in (
        (replace(truth, holds_ns={}), "does not say when the board was held"),
        (replace(truth, sensors={"a": truth.sensors["a"]}), "has no sensor 'b'"),
    ):
        with pytest.raises(ConfigError, match=words):
            write_preview(rig, registry, target, summary.recordings[0], wrong, tmp_path / "p")
    assert not (tmp_path / "p").exists()
