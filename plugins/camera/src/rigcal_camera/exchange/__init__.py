"""Lenses and poses of cameras in the files of other tools."""

from rigcal_camera.exchange.camera_info import CAMERA_INFO
from rigcal_camera.exchange.kalibr import KALIBR
from rigcal_camera.exchange.opencv import OPENCV

EXPORTERS = (KALIBR, OPENCV, CAMERA_INFO)

__all__ = ["EXPORTERS"]
