"""The calibration as a tree of frames with x forward, as ROS wants it (REP-103, REP-105).

    base_link -> root sensor -> every other sensor -> its optical frame, if it has one

rigcal's own frame of a sensor with an optical frame is the optical one.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rigcal.calibration import Calibration
from rigcal.errors import InputError
from rigcal.geometry import se3
from rigcal.geometry.se3 import Array
from rigcal.rig import Rig

T_BODY_OPTICAL = se3.transform(np.array([[0, 0, 1], [-1, 0, 0], [0, -1, 0]]), np.zeros(3))
"""A frame with z forward, x right, y down in one with x forward, y left, z up: rpy -90, 0, -90."""


@dataclass(frozen=True, eq=False)
class Frame:
    """A frame and its pose `T_parent_frame` (4, 4) in its parent."""

    name: str
    parent: str
    T_parent_frame: Array

    @property
    def translation(self) -> list[float]:
        """x, y, z in m."""
        return numbers(self.T_parent_frame[:3, 3])

    @property
    def quaternion(self) -> list[float]:
        """x, y, z, w."""
        return numbers(se3.quaternion_from_rotation(self.T_parent_frame[:3, :3]))

    @property
    def rpy(self) -> list[float]:
        """Roll, pitch, yaw about the fixed axes x, y, z of the parent, rad."""
        return numbers(se3.rpy_from_rotation(self.T_parent_frame[:3, :3]))


def sensor_frames(calibration: Calibration, rig: Rig) -> tuple[Frame, ...]:
    """Every frame but the uppermost: parents stand before their children.

    The uppermost is the parent of the first: that of the rig's `base`, else the root's. InputError
    when two frames would have one name.
    """
    root = calibration.root
    T_up_root = se3.inverse(_T_sensor_body(rig, root))
    frames = [*base_frame(calibration, rig), *_optical(rig, root)]
    for name in calibration.sensors:
        if name != root:
            T = T_up_root @ calibration.T(root, name) @ _T_sensor_body(rig, name)
            frames += [Frame(name, root, T), *_optical(rig, name)]
    names = [rig.base.parent if rig.base else root, *(frame.name for frame in frames)]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise InputError(f"two frames would be called '{twice[0]}': rename one in the rig file")
    return tuple(frames)


def base_frame(calibration: Calibration, rig: Rig) -> tuple[Frame, ...]:
    """The root sensor in the rig's `base`; empty if the rig has none."""
    if rig.base is None:
        return ()
    root = calibration.root
    T_base_root = rig.base.T_parent_sensor @ calibration.T(rig.root, root)
    return (Frame(root, rig.base.parent, T_base_root @ _T_sensor_body(rig, root)),)


def notes(calibration: Calibration, rig: Rig) -> list[str]:
    """What a reader of the file must know; none has two dashes in a row, for XML."""
    lines = [
        "Sensor poses, calibrated by rigcal. Metres and radians.",
        "Each is the pose of a child frame in its parent: p_parent = R p_child + t.",
        "Frames of sensors: x forward, y left, z up (REP 103).",
    ]
    if any(rig.sensors[name].optical for name in calibration.sensors):
        lines += [
            "A frame NAME_optical_frame (z forward, x right, y down) hangs from its sensor's frame",
            "by the standard rotation; calibration.yaml of rigcal gives poses of these ones.",
        ]
    if rig.base is None:
        lines += [
            "Uppermost is the root sensor. To hang it from the robot, give its pose in the rig:",
            "`base: {parent: base_link, translation_m: [...], rpy_deg: [...]}`.",
        ]
    return lines


def numbers(values: Array) -> list[float]:
    """Floats without the noise of the last digit (1e-15), nor a sign on zero."""
    return [float(value) for value in np.round(values, 15) + 0.0]


def _T_sensor_body(rig: Rig, name: str) -> Array:
    return se3.inverse(T_BODY_OPTICAL) if rig.sensors[name].optical else np.eye(4)


def _optical(rig: Rig, name: str) -> tuple[Frame, ...]:
    if not rig.sensors[name].optical:
        return ()
    return (Frame(f"{name}_optical_frame", name, T_BODY_OPTICAL),)
