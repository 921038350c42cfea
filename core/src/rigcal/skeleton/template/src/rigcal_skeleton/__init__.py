"""A skeleton sensor for rigcal: the parts bound together.

Importing this module must load nothing heavy (OpenCV, open3d, torch ...): `rigcal` does it at every
start. Import such libraries inside the functions that use them.
"""

import rigcal.plugin as rp
from rigcal_skeleton.config import SkeletonConfig
from rigcal_skeleton.detector import detect
from rigcal_skeleton.messages import POSES, decode, encode, view
from rigcal_skeleton.simulator import sees, simulate

__all__ = ["SKELETON", "SkeletonConfig"]

SKELETON = rp.SensorType(
    name="skeleton",
    config=SkeletonConfig,
    message_types=(POSES, ".csv"),
    decode=decode,
    detect=detect,
    # What follows is optional.
    sees=sees,
    simulate=simulate,
    encode=encode,
    message_type=POSES,
    view=view,
)


@rp.hookimpl
def rigcal_sensor_types() -> list[rp.SensorType]:
    """What this distribution brings to rigcal."""
    return [SKELETON]
