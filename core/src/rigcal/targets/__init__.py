"""Planar calibration targets."""

from rigcal.targets.target import Patch, Target, TargetConfig, TargetType

__all__ = ["Patch", "Target", "TargetConfig", "TargetType"]
