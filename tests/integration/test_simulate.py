"""The simulator with the sensor types of the other packages."""

from __future__ import annotations

import json
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from matplotlib.image import imread

from rigcal import Registry, load_rig, parse_rig
from rigcal.recording import Source, open_recording
from rigcal.rig import build_targets
from rigcal_sim.dataset import simulate
from rigcal_sim.default import default_scenario
from rigcal_sim.plan import plan_shots
from rigcal_sim.sampling import sample_board_poses
from rigcal_sim.scenario import ScenarioConfig
from rigcal_sim.scenario_file import load_scenario, sensor_effects

EXAMPLES = Path(__file__).parents[2] / "examples"
DEMO = Path(str(files("rigcal_sim") / "demo"))
BOARD = {"type": "apriltag_grid", "columns": 3, "rows": 2, "tag_size_m": 0.2, "tag_gap_m": 0.05}
SMALL: dict[str, Any] = {
    "version": 1,
    "root": "front",
    "targets": {"board": BOARD | {"width_m": 0.9, "height_m": 0.6}},
    "sensors": {
        "cam": {
            "type": "camera", "topic": "/cam/image_raw", "width_px": 320, "height_px": 240,
            "focal_px": [200.0, 200.0], "principal_px": [159.5, 119.5],
            "pose": {
                "parent": "front", "translation_m": [0, 0, 0.2], "rpy_deg": [-90.0, 0.0, -90.0]
            },
        },
        "front": {
            "type": "lrf2d", "topic": "/scan", "range_max_m": 10.0,
            "angle_min_deg": -90.0, "angle_max_deg": 90.0, "angle_step_deg": 1.0,
        },
        "lidar": {
            "type": "lrf3d", "topic": "/points",
            "scan": {"pattern": "multibeam", "elevations_deg": [-5, 0, 5], "azimuth_step_deg": 2.0},
            "pose": {"parent": "front", "translation_m": [-0.1, 0, 0.3]},
        },
    },
}  # fmt: skip
SCENARIO = ScenarioConfig.model_validate(
    {
        "board": {"bearings_deg": [-15, 0, 15], "radii_m": [1.4, 1.8]},
        "room": {"size_m": [8, 7, 3]},
        "person": True,
    }
)


@pytest.fixture(scope="module")
def registry() -> Registry:
    return Registry.from_entry_points()


def test_workers_do_not_change_a_byte(registry: Registry, tmp_path: Path) -> None:
    rig = parse_rig(SMALL, registry)
    for jobs in (1, 2):
        simulate(rig, registry, SCENARIO, 5, tmp_path / str(jobs), jobs=jobs)
    for name in ("recording.mcap", "truth.yaml"):
        assert (tmp_path / "1" / name).read_bytes() == (tmp_path / "2" / name).read_bytes()


def test_a_recording_holds_standard_messages(registry: Registry, tmp_path: Path) -> None:
    rig = parse_rig(SMALL, registry)
    summary = simulate(
        rig, registry, SCENARIO, 5, tmp_path, formats=("mcap", "bag"), poses=2, jobs=1
    )
    for path in summary.recordings:
        with open_recording(path) as recording:
            assert recording.contents() == {
                "/cam/camera_info": ("sensor_msgs/msg/CameraInfo", 2),
                "/cam/image_raw": ("sensor_msgs/msg/Image", 2),
                "/points": ("sensor_msgs/msg/PointCloud2", 2),
                "/scan": ("sensor_msgs/msg/LaserScan", 2),
                "/tf_static": ("tf2_msgs/msg/TFMessage", 1),
            }
            image, _ = recording.read(Source(topic="/cam/image_raw"))
            info, _ = recording.read(Source(topic="/cam/camera_info"))
        assert image.stamp_ns == info.stamp_ns
        assert image.value.header.frame_id == info.value.header.frame_id == "cam"


def test_the_command_simulates_where_the_sensors_look(tmp_path: Path, command: Any) -> None:
    rig = tmp_path / "rig.yaml"
    rig.write_text(yaml.safe_dump(SMALL))
    ran = command("simulate", rig, "--out", tmp_path / "out", "--poses", 2, "--json")
    assert ran.code == 0
    answer = json.loads(ran.out)
    assert answer["exposures"] == 2
    assert Path(answer["truth"]).is_file()
    assert [Path(path).name for path in answer["recordings"]] == ["recording.mcap"]
    assert answer["sizes_bytes"] == [Path(path).stat().st_size for path in answer["recordings"]]
    assert answer["messages"]["/cam/image_raw"] == answer["messages"]["/scan"] == 2
    assert answer["redrawn"] >= answer["unseen"] >= 0


@pytest.mark.parametrize(("root", "rpy_deg"), [("front", (0, 0, 0)), ("cam", (-90, 0, -90))])
def test_the_world_is_upright_whatever_the_axes_of_the_root(
    root: str, rpy_deg: tuple[float, float, float], registry: Registry
) -> None:
    rig = parse_rig(SMALL | {"root": root}, registry)
    target = build_targets(rig, registry)["board"]
    assert default_scenario(rig, registry, target).root_pose.rpy_deg == rpy_deg


@pytest.mark.parametrize(
    ("rig_file", "scenario_file", "exposures", "cameras"),
    [
        (DEMO / "rig.yaml", DEMO / "scenario.yaml", 40, 10),
        (EXAMPLES / "husky.yaml", EXAMPLES / "husky_scenario.yaml", 120, 30),
    ],
)
def test_every_sensor_of_the_shipped_rigs_sees_enough_boards(
    rig_file: Path, scenario_file: Path, exposures: int, cameras: int, registry: Registry
) -> None:
    rig = load_rig(rig_file, registry)
    scenario = load_scenario(scenario_file, rig, registry)
    target = build_targets(rig, registry)["board"]
    poses = sample_board_poses(rig, registry, target, scenario, seed=0)
    assert len(poses.T_w_t) == exposures
    seen = {name: sum(name in sensors for sensors in poses.seen_by) for name in rig.sensors}
    assert min(seen.values()) >= cameras
    for i in range(5):
        pair = {f"cam{i}", f"cam{(i + 1) % 5}"}
        assert sum(pair <= set(sensors) for sensors in poses.seen_by) >= 3
    tilts = np.degrees(np.arccos(np.abs(poses.T_w_t[:, 2, 1])))
    assert np.ptp(tilts) > 20


def test_the_continuous_example_covers_all_sensors(registry: Registry) -> None:
    rig = load_rig(EXAMPLES / "husky.yaml", registry)
    scenario = load_scenario(EXAMPLES / "husky_continuous_scenario.yaml", rig, registry)
    target = build_targets(rig, registry)["board"]
    poses = sample_board_poses(rig, registry, target, scenario, seed=0)
    seen = {name: sum(name in sensors for sensors in poses.seen_by) for name in rig.sensors}
    assert min(seen.values()) >= 5
    plan = plan_shots(rig, scenario, sensor_effects(scenario, rig, registry), poses.T_w_t, 0)
    start, end = plan.holds[0][0], plan.holds[-1][1]
    assert 40 * 2.5 < (end - start) / 1e9 < 600
    for start, end in plan.holds:
        held = {shot.sensor for shot in plan.shots if start < shot.stamp_ns < end}
        assert held == set(rig.sensors)


GREEN, PINK = (34, 197, 94), (214, 51, 108)
"""Of the true corners and of the board's outline."""


def preview(command: Any, out: Path, *options: object) -> str:
    """What is printed."""
    rig = out.with_suffix(".yaml")
    rig.write_text(yaml.safe_dump(SMALL))
    ran = command("simulate", rig, "--out", out, "--poses", 2, "--preview", *options)
    assert ran.code == 0
    return str(ran.out)


def pixels_of(path: Path, colour: tuple[int, int, int]) -> int:
    rgb = np.round(255 * imread(path)[..., :3]).astype(int)
    return int(np.count_nonzero((np.abs(rgb - colour) < 25).all(axis=-1)))


def test_a_page_per_exposure_shows_corners_and_outline(tmp_path: Path, command: Any) -> None:
    index = Path(json.loads(preview(command, tmp_path / "out", "--json"))["preview"])
    assert index == tmp_path / "out" / "preview" / "index.html"
    pages = sorted(index.parent.glob("exposure_*.png"))
    assert len(pages) == 2
    for path in (*pages, index.parent / "rig.png"):
        assert f'src="{path.name}"' in index.read_text()
    for page in pages:
        assert pixels_of(page, GREEN) > 20
        assert pixels_of(page, PINK) > 200


def test_the_same_seed_draws_the_same_bytes_and_nothing_old_stays(
    tmp_path: Path, command: Any
) -> None:
    folders = [tmp_path / name / "preview" for name in ("a", "b")]
    folders[1].mkdir(parents=True)
    (folders[1] / "exposure_0009.png").write_bytes(b"of another run")
    assert preview(command, tmp_path / "a", "--quiet", "--jobs", 1) == ""
    assert preview(command, tmp_path / "b", "--quiet", "--jobs", 2) == ""
    a, b = ({path.name: path.read_bytes() for path in folder.iterdir()} for folder in folders)
    assert a == b
