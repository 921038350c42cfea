"""Static transforms of ROS 2: a launch file that publishes them, and the message as YAML."""

from __future__ import annotations

import xml.etree.ElementTree as ET

from rigcal.calibration import Calibration
from rigcal.exporting.exporter import Exporter
from rigcal.exporting.frames import notes, sensor_frames
from rigcal.exporting.text import commented_yaml, xml_comment, xml_document
from rigcal.rig import Rig

_AXES = ("x", "y", "z")


def launch_text(calibration: Calibration, rig: Rig | None) -> str:
    """An XML launch file: one static_transform_publisher of tf2_ros per frame."""
    assert rig is not None  # the format needs it
    launch = ET.Element("launch")
    order = "Quaternions by name: qx, qy, qz, qw. Start with: ros2 launch THIS_FILE"
    xml_comment(launch, [*notes(calibration, rig), order])
    for frame in sensor_frames(calibration, rig):
        values = {
            **dict(zip(_AXES, frame.translation, strict=True)),
            **dict(zip(("qx", "qy", "qz", "qw"), frame.quaternion, strict=True)),
            "frame-id": frame.parent,
            "child-frame-id": frame.name,
        }
        ET.SubElement(
            launch,
            "node",
            pkg="tf2_ros",
            exec="static_transform_publisher",
            args=" ".join(f"--{key} {value}" for key, value in values.items()),
        )
    return xml_document(launch)


def tf_text(calibration: Calibration, rig: Rig | None) -> str:
    """A tf2_msgs/msg/TFMessage for /tf_static as YAML."""
    assert rig is not None  # the format needs it
    transforms = [
        {
            "header": {"frame_id": frame.parent},
            "child_frame_id": frame.name,
            "transform": {
                "translation": dict(zip(_AXES, frame.translation, strict=True)),
                "rotation": dict(zip((*_AXES, "w"), frame.quaternion, strict=True)),
            },
        }
        for frame in sensor_frames(calibration, rig)
    ]
    lines = [
        *notes(calibration, rig),
        "Quaternions: x, y, z, w.",
        "A tf2_msgs/msg/TFMessage. To publish it: ros2 topic pub --qos-durability transient_local",
        '/tf_static tf2_msgs/msg/TFMessage "$(cat THIS_FILE)"',
    ]
    return commented_yaml(lines, {"transforms": transforms})


LAUNCH = Exporter("ros2-launch", "ROS 2 launch file: static transforms", launch_text, True)
TF = Exporter("tf-static", "YAML: static transforms as a tf2_msgs/msg/TFMessage", tf_text, True)
