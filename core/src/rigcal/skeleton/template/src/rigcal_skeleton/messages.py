"""Messages and files of the sensor, as frames: arrays (N, 3) of points in m, and back."""

from typing import Any

import numpy as np

import rigcal.plugin as rp
from rigcal.recording import ros
from rigcal_skeleton.config import SkeletonConfig

POSES = "geometry_msgs/msg/PoseArray"


def decode(message: rp.Message, config: SkeletonConfig) -> rp.Array:
    """The points (N, 3) in a PoseArray, or in a file with a line `x,y,z` for each.

    RecordingError for data that cannot be used: it says where, what was found and what was
    expected, and loses this frame only.
    """
    if message.type == POSES:
        rows = [[p.position.x, p.position.y, p.position.z] for p in message.value.poses]
    else:
        try:
            text = message.value.read_text(encoding="utf-8")
            rows = [[float(word) for word in line.split(",")] for line in text.splitlines()]
        except (OSError, ValueError) as error:
            raise rp.RecordingError(f"{message.origin}: expected x,y,z in m: {error}") from error
    for number, row in enumerate(rows, start=1):
        if len(row) != 3:
            raise rp.RecordingError(
                f"{message.origin}: line {number}: found {len(row)} numbers, expected x,y,z"
            )
    frame = np.array(rows, np.float64).reshape(-1, 3)
    return frame[np.isfinite(frame).all(axis=1)]


def encode(frame: rp.Array, config: SkeletonConfig, stamp_ns: int, frame_id: str) -> Any:
    """The message that carries a frame."""
    points = [ros.make("geometry_msgs/msg/Point", x=x, y=y, z=z) for x, y, z in frame]
    facing = ros.make("geometry_msgs/msg/Quaternion", w=1.0)
    poses = [ros.make("geometry_msgs/msg/Pose", position=p, orientation=facing) for p in points]
    return ros.make(POSES, header=ros.header(stamp_ns, frame_id), poses=poses)


def view(message: rp.Message, config: SkeletonConfig) -> rp.FrameView:
    """What reports and viewers show."""
    return rp.FrameView(points=decode(message, config))
