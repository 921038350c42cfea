"""What a user reads when a recording or a rig file is wrong: word for word, exit status 2.

After a deliberate change: RIGCAL_UPDATE_GOLDEN=1 pytest tests/integration, then read the diff.
"""

import os
import re
from pathlib import Path

import pytest

NUMBERS = re.compile(r"\d+\.\d+|(?<=lidar: )\d|\d+(?= (indexed messages|messages|chunks|flat|too))")
MESSAGES = Path(__file__).parent / "messages"


@pytest.fixture
def check(command, tmp_path):
    def check(name, rig, data):
        ran = command("calibrate", rig, data, "--out", tmp_path / "out")
        assert (ran.code, ran.out) == (2, "")
        text = ran.err.replace(str(data), "RECORDING").replace(str(rig), "RIG")
        # Sizes and fits depend on compression and rounding; what is said of them does not.
        text = NUMBERS.sub("N", text)
        path = MESSAGES / f"{name}.txt"
        if "RIGCAL_UPDATE_GOLDEN" in os.environ:
            path.parent.mkdir(exist_ok=True)
            path.write_text(text)
        assert text == path.read_text()
        assert "Traceback" not in text
        assert not (tmp_path / "out" / "calibration.yaml").exists()

    return check


def edited(rig, tmp_path, *changes):
    text = rig.read_text()
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    path = tmp_path / "rig.yaml"
    path.write_text(text)
    return path


def test_topic_not_in_the_bag(check, rig, simulated, tmp_path):
    rig = edited(rig, tmp_path, ("/left/image_raw", "/left/image"))
    check("topic", rig, simulated / "recording.mcap")


def test_target_of_half_the_size(check, rig, simulated, tmp_path):
    rig = edited(
        rig,
        tmp_path,
        ("tag_size_m: 0.2", "tag_size_m: 0.1"),
        ("tag_gap_m: 0.05", "tag_gap_m: 0.025"),
    )
    check("half_the_size", rig, simulated / "recording.mcap")


def test_board_of_half_the_size(check, rig, simulated, tmp_path):
    rig = edited(
        rig,
        tmp_path,
        ("tag_size_m: 0.2", "tag_size_m: 0.1"),
        ("tag_gap_m: 0.05", "tag_gap_m: 0.025"),
        ("width_m: 1.2", "width_m: 0.6"),
        ("height_m: 0.9", "height_m: 0.45"),
    )
    check("board_of_half_the_size", rig, simulated / "recording.mcap")


def test_empty_folder(check, rig, tmp_path):
    (tmp_path / "empty").mkdir()
    check("empty_folder", rig, tmp_path / "empty")


@pytest.mark.parametrize("suffix", ["mcap", "bag"])
def test_truncated_recording(check, rig, simulated, tmp_path, suffix):
    data = (simulated / f"recording.{suffix}").read_bytes()
    path = tmp_path / f"cut.{suffix}"
    path.write_bytes(data[: len(data) // 2])
    check(f"truncated_{suffix}", rig, path)


def test_wrong_type_of_sensor_on_a_topic(check, rig, simulated, tmp_path):
    rig = edited(rig, tmp_path, ("topic: /scan", "topic: /left/image_raw"))
    check("type_of_message", rig, simulated / "recording.mcap")
