"""Autoware's sensor kit: sensor_kit_calibration.yaml and sensors_calibration.yaml."""

from __future__ import annotations

from collections.abc import Mapping

from rigcal.calibration import Calibration
from rigcal.exporting.exporter import Exporter
from rigcal.exporting.frames import Frame, base_frame, notes, sensor_frames
from rigcal.exporting.text import commented_yaml
from rigcal.rig import Rig

KIT = "sensor_kit_base_link"


def autoware_texts(calibration: Calibration, rig: Rig | None) -> Mapping[str, str]:
    """Poses in sensor_kit_base_link, which is put at the root sensor's frame.

    Where the kit stands in the robot is a file of its own, if the rig has a `base`. Optical frames
    are not in it: Autoware's description of a camera adds its own by the standard rotation.
    """
    assert rig is not None  # the format needs it
    root = calibration.root
    sensors = [f for f in sensor_frames(calibration, rig) if f.name in calibration.sensors]
    poses = {root: dict.fromkeys(("x", "y", "z", "roll", "pitch", "yaw"), 0.0)}
    poses |= {frame.name: _pose(frame) for frame in sensors if frame.name != root}
    lines = [
        *notes(calibration, rig),
        "roll, pitch, yaw about the fixed axes x, y, z of the parent: R = Rz Ry Rx.",
        f"{KIT} is the frame of the root sensor. Optical frames are left to Autoware's cameras.",
        "Names of sensors are those of the rig file; Autoware's may be longer (NAME/camera_link).",
    ]
    texts = {"sensor_kit_calibration.yaml": commented_yaml(lines, {KIT: poses})}
    for frame in base_frame(calibration, rig):
        content = {frame.parent: {KIT: _pose(frame)}}
        texts["sensors_calibration.yaml"] = commented_yaml(lines, content)
    return texts


def _pose(frame: Frame) -> dict[str, float]:
    (x, y, z), (roll, pitch, yaw) = frame.translation, frame.rpy
    return {"x": x, "y": y, "z": z, "roll": roll, "pitch": pitch, "yaw": yaw}


AUTOWARE = Exporter("autoware", "Autoware: calibration of a sensor kit", autoware_texts, True)
