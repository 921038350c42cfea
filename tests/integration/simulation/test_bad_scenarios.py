"""What a user reads who asks for a simulation that cannot be.

After a deliberate change: RIGCAL_UPDATE_GOLDEN=1 pytest tests/integration/simulation, then read
the difference.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import pytest

MESSAGES = Path(__file__).parent / "messages"
RIG, SCENARIO = "rig.yaml", "scenario.yaml"
LIDAR_POSE = (
    "    pose: {parent: front, translation_m: [-0.1, 0.0, 0.3], rpy_deg: [0.0, 5.0, 0.0]}\n"
)
CASES = {
    "board_behind_the_sensors": (SCENARIO, "bearings_deg: [-10, 10]", "bearings_deg: [0, 180]"),
    "nothing_seen_and_nothing_drawn_again": (
        SCENARIO,
        "board:\n  bearings_deg: [-10, 10]",
        "redraw: false\nboard:\n  bearings_deg: [180]",
    ),
    "room_too_small": (SCENARIO, "size_m: [8, 7, 3]", "size_m: [2.5, 7, 3]"),
    "hold_time_of_zero": (SCENARIO, "hold_s: 0.5", "hold_s: 0"),
    "mode_missing": (SCENARIO, "mode: continuous, ", ""),
    "mode_of_sampling_unknown": (SCENARIO, "  radii_m", "  mode: covering\n  radii_m"),
    "mode_unknown": (SCENARIO, "mode: continuous", "mode: continous"),
    "rate_missing": (SCENARIO, "lidar: {rate_hz: 2.0, ", "lidar: {"),
    "rate_of_zero": (SCENARIO, "rate_hz: 10.0", "rate_hz: 0"),
    "jitter_longer_than_a_period": (SCENARIO, "rate_hz: 10.0", "rate_hz: 200.0"),
    "sensor_unknown": (SCENARIO, "  lidar: {", "  lidr: {"),
    "type_unknown": (SCENARIO, "  lrf2d: {", "  lrf2: {"),
    "effect_unknown": (SCENARIO, "jpeg_quality", "jpg_quality"),
    "sigma_below_zero_in_an_effect": (SCENARIO, "jpeg_quality: 90", "noise_grey: -1"),
    "key_unknown": (SCENARIO, "bearings_deg", "bearing_deg"),
    "texture_missing": (SCENARIO, "grey: 0.3", "texture: poster.png"),
    "texture_unreadable": (SCENARIO, "grey: 0.3", "texture: scenario.yaml"),
    "shape_unknown": (SCENARIO, "shape: rectangle", "shape: rectangel"),
    "cover_of_no_poses": (
        SCENARIO, "  bearings_deg: [-10, 10]\n  radii_m: [1.4]\n  height_m: 0.1",
        "  {mode: cover, poses: 0, distance_m: [3, 1]}",
    ),
    "cover_out_of_reach": (
        SCENARIO, "  bearings_deg: [-10, 10]\n  radii_m: [1.4]\n  height_m: 0.1",
        "  {mode: cover, poses: 4, distance_m: [1, 1.2]}\nmin_sensors: 5",
    ),
    "zero_beams_of_a_2d_laser": (RIG, "angle_max_deg: 90.0", "angle_max_deg: -90.0"),
    "zero_beams_of_a_3d_laser": (RIG, "elevations_deg: [-5, 0, 5]", "elevations_deg: []"),
    "angle_step_of_zero": (RIG, "angle_step_deg: 1.0", "angle_step_deg: 0"),
    "sigma_below_zero": (RIG, "range_max_m: 3.0", "range_max_m: 3.0\n    sigma_m: -0.01"),
    "no_pose": (RIG, LIDAR_POSE, ""),
    "no_topic": (RIG, "    topic: /lidar/points\n", ""),
}  # fmt: skip


@pytest.mark.parametrize("name", CASES)
def test_a_simulation_that_cannot_be(
    name: str,
    rig_file: Path,
    scenario_file: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    command: Any,
) -> None:
    changed, old, new = CASES[name]
    for path in (rig_file, scenario_file):
        text = path.read_text()
        if path.name == changed:
            assert text.count(old) == 1
            text = text.replace(old, new)
        (tmp_path / path.name).write_text(text)
    monkeypatch.chdir(tmp_path)
    answer = command("simulate", RIG, "--scenario", SCENARIO, "--out", "out", "--quiet")
    assert answer.code == 2
    assert answer.out == ""
    assert not (tmp_path / "out").exists()
    golden = MESSAGES / f"{name}.txt"
    if "RIGCAL_UPDATE_GOLDEN" in os.environ:
        golden.write_text(answer.err)
    assert answer.err == golden.read_text()


def test_every_message_is_of_a_case() -> None:
    assert {path.stem for path in MESSAGES.iterdir()} == set(CASES)
