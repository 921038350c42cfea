"""A rig file of sensors that only plugins know."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Literal

import yaml

from rigcal import propose_rig
from rigcal.plugin import Registry, SensorConfig, SensorType, hookimpl
from rigcal.recording import ros
from rigcal.recording.writer import RecordingWriter

POINT = "geometry_msgs/msg/PointStamped"
POSE = "geometry_msgs/msg/PoseStamped"


class SonarConfig(SensorConfig, frozen=True):
    type: Literal["sonar"] = "sonar"


class RadarConfig(SensorConfig, frozen=True):
    type: Literal["radar"] = "radar"


def _unused(*_: object) -> Any:
    raise AssertionError("only the topics count")


class Sensors:
    @hookimpl
    def rigcal_sensor_types(self) -> list[SensorType]:
        return [
            SensorType("sonar", SonarConfig, (POINT, POSE), _unused, _unused, message_type=POINT),
            SensorType("radar", RadarConfig, (POINT, POSE), _unused, _unused),
        ]


def test_a_topic_that_may_be_of_several_types_is_left_to_the_user(tmp_path: Path) -> None:
    """The type that makes such messages itself comes before those that take them as well."""
    path = tmp_path / "drive.mcap"
    with RecordingWriter(path) as writer:
        for topic, kind in (("/bow/echo", POINT), ("/mast/tip", POSE)):
            writer.write(topic, kind, ros.make(kind, header=ros.header(5, "here")), 5)
    text = propose_rig(path, Registry([Sensors()]), name="ship.yaml")
    assert "# /mast/tip (geometry_msgs/msg/PoseStamped) may be a sonar or radar: add it" in text
    assert "#     rigcal calibrate ship.yaml drive.mcap --out result" in text
    assert yaml.safe_load(text)["sensors"] == {"bow": {"type": "sonar", "topic": "/bow/echo"}}
