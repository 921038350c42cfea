from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rigcal.calibration_file import load_calibration
from rigcal.errors import ConfigError
from rigcal.plugin import Registry
from rigcal.recording import Source, open_recording
from rigcal.rig import Rig, T_root_sensors
from rigcal_sim.dataset import Summary, simulate
from rigcal_sim.scenario import ScenarioConfig

MakeRig = Callable[..., Rig]
SCENARIO = ScenarioConfig.model_validate(
    {
        "board": {"bearings_deg": [-30, 0, 30], "radii_m": [1.5, 2.0], "height_m": [-0.1, 0.1]},
        "root_pose": {"translation_m": [0.1, 0.0, 0.2], "rpy_deg": [0, 0, 10]},
        "room": {"size_m": [8, 8, 3]},
        "person": True,
        "stamps": {"start_s": 100.0, "period_s": 2.0, "jitter_s": 0.01},
    }
)


def run(rig: Rig, registry: Registry, out: Path, seed: int = 1, **options: Any) -> Summary:
    return simulate(rig, registry, SCENARIO, seed, out, jobs=1, **options)


def ranges_and_stamps(path: Path, topic: str) -> tuple[np.ndarray, np.ndarray]:
    with open_recording(path) as recording:
        messages = list(recording.read(Source(topic=topic)))
    return np.array([m.value.ranges for m in messages]), np.array([m.stamp_ns for m in messages])


def test_every_sensor_has_a_message_per_exposure_in_both_formats(
    make_rig: MakeRig, registry: Registry, tmp_path: Path
) -> None:
    summary = run(make_rig(), registry, tmp_path, formats=("mcap", "bag"))
    assert summary.exposures == 6
    assert summary.seen == {"a": 6, "b": 6}
    assert [path.name for path in summary.recordings] == ["recording.mcap", "recording.bag"]
    for path in summary.recordings:
        with open_recording(path) as recording:
            assert {topic: n for topic, (_, n) in recording.contents().items()} == {
                "/a/scan": 6,
                "/b/scan": 6,
                "/tf_static": 1,
            }


def test_exposures_are_a_period_apart_and_sensors_within_the_jitter(
    make_rig: MakeRig, registry: Registry, tmp_path: Path
) -> None:
    path = run(make_rig(), registry, tmp_path).recordings[0]
    expected = 100e9 + 2e9 * np.arange(1, 7)
    late = [ranges_and_stamps(path, f"/{name}/scan")[1] - expected for name in "ab"]
    assert np.abs(late).max() <= 0.01e9 + 1
    assert np.ptp(late) > 1e6
    assert not np.array_equal(late[0], late[1])


def test_effects_reach_the_sensors_and_their_clocks(
    make_rig: MakeRig, registry: Registry, tmp_path: Path
) -> None:
    effects = {"a": {"drop_outs": 1.0}, "b": {"clock_offset_s": 0.25, "jitter_s": 0.0}}
    scenario = SCENARIO.model_copy(update={"sensors": effects})
    path = simulate(make_rig(), registry, scenario, 1, tmp_path, jobs=1).recordings[0]
    assert np.all(np.isinf(ranges_and_stamps(path, "/a/scan")[0]))
    ranges, stamps = ranges_and_stamps(path, "/b/scan")
    assert np.all(np.isfinite(ranges))
    np.testing.assert_array_equal(stamps, 100.25e9 + 2e9 * np.arange(1, 7))


def test_truth_holds_the_poses_of_the_rig_and_of_the_board(
    make_rig: MakeRig, registry: Registry, tmp_path: Path
) -> None:
    rig = make_rig()
    summary = run(rig, registry, tmp_path)
    truth = load_calibration(summary.truth)
    for name, T_root_s in T_root_sensors(rig).items():
        np.testing.assert_allclose(truth.T("a", name), T_root_s, atol=1e-12)
    assert list(truth.target_poses) == [f"{k:04d}" for k in range(6)]
    # The beams of ranger a hit the board where the truth says.
    angles = np.radians(np.linspace(-90, 90, 19))
    d_a = np.column_stack([np.cos(angles), np.sin(angles), 0 * angles])
    ranges, _ = ranges_and_stamps(summary.recordings[0], "/a/scan")
    hits = 0
    for row, T_root_t in zip(ranges, truth.target_poses.values(), strict=True):
        n, t = T_root_t[:3, 2], T_root_t[:3, 3]
        expected = n @ t / (d_a @ n)
        at_board = (expected[:, None] * d_a - t) @ T_root_t[:3, :2]
        on_board = (expected > 0) & np.all(np.abs(at_board) < [0.38, 0.28], axis=1)
        np.testing.assert_allclose(row[on_board], expected[on_board], atol=0.05)
        hits += int(np.count_nonzero(on_board))
    assert hits >= 6


def test_true_poses_are_in_tf_static(make_rig: MakeRig, registry: Registry, tmp_path: Path) -> None:
    path = run(make_rig(), registry, tmp_path).recordings[0]
    with open_recording(path) as recording:
        (message,) = recording.read(Source(topic="/tf_static"))
    (transform,) = message.value.transforms
    assert (transform.header.frame_id, transform.child_frame_id) == ("a", "b")
    t = transform.transform.translation
    np.testing.assert_allclose([t.x, t.y, t.z], [0.1, 0.0, 0.2])


def test_the_same_seed_gives_the_same_bytes_and_another_does_not(
    make_rig: MakeRig, registry: Registry, tmp_path: Path
) -> None:
    folders = [tmp_path / name for name in ("first", "again", "other")]
    for folder, seed in zip(folders, (1, 1, 2), strict=True):
        run(make_rig(), registry, folder, seed=seed, formats=("mcap", "bag"))
    for name in ("recording.mcap", "recording.bag", "truth.yaml"):
        first, again, other = ((folder / name).read_bytes() for folder in folders)
        assert first == again
        assert first != other


def test_a_sensors_data_do_not_depend_on_the_other_sensors(
    make_rig: MakeRig, registry: Registry, tmp_path: Path
) -> None:
    rig = make_rig()
    turned_around = replace(rig, sensors={name: rig.sensors[name] for name in "ba"})
    first, second = (
        ranges_and_stamps(run(r, registry, tmp_path / str(i)).recordings[0], "/b/scan")
        for i, r in enumerate((rig, turned_around))
    )
    np.testing.assert_array_equal(first[0], second[0])
    np.testing.assert_array_equal(first[1], second[1])


def test_number_of_poses_and_progress(
    make_rig: MakeRig, registry: Registry, tmp_path: Path
) -> None:
    told: list[tuple[str, int, int]] = []
    summary = run(make_rig(), registry, tmp_path, poses=3, progress=lambda *step: told.append(step))
    assert summary.exposures == 3
    assert told[0] == ("simulating", 0, 6)
    assert told[-1] == ("simulating", 6, 6)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"topic": None}, "sensors.b: add `topic: /b/..."),
        ({"topic": "/a/scan"}, "topic '/a/scan' is also that of sensor 'a'"),
        ({"pose": None}, "no pose connects b to the root 'a'"),
    ],
)
def test_a_rig_that_cannot_be_simulated_is_refused(
    changes: dict[str, Any], message: str, make_rig: MakeRig, registry: Registry, tmp_path: Path
) -> None:
    with pytest.raises(ConfigError) as caught:
        run(make_rig(**changes), registry, tmp_path / "out")
    assert message in str(caught.value)
    assert not (tmp_path / "out").exists()


def test_an_unknown_target_is_refused(
    make_rig: MakeRig, registry: Registry, tmp_path: Path
) -> None:
    scenario = SCENARIO.model_copy(update={"target": "bord"})
    with pytest.raises(ConfigError, match=r"no target 'bord', did you mean 'board'\?"):
        simulate(make_rig(), registry, scenario, 1, tmp_path)
