"""What all sensors of a calibrated rig saw at one moment, in one frame and one picture."""

from rigcal.fusing.fuse import Fused, fuse
from rigcal.fusing.write import write_fused

__all__ = ["Fused", "fuse", "write_fused"]
