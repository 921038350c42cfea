"""Planar calibration targets."""

from rigcal.targets.apriltag_grid import APRILTAG_GRID
from rigcal.targets.apriltag_poster import APRILTAG_POSTER
from rigcal.targets.charuco import CHARUCO
from rigcal.targets.checkerboard import CHECKERBOARD
from rigcal.targets.printed import board_outline, check_board_holds
from rigcal.targets.target import Patch, Target, TargetConfig, TargetType

BUILTIN_TARGETS: tuple[TargetType, ...] = (
    APRILTAG_GRID,
    APRILTAG_POSTER,
    CHECKERBOARD,
    CHARUCO,
)

__all__ = [
    "BUILTIN_TARGETS",
    "Patch",
    "Target",
    "TargetConfig",
    "TargetType",
    "board_outline",
    "check_board_holds",
]
