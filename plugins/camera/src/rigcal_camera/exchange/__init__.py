"""Lenses and poses of cameras in the files of other tools."""

from rigcal_camera.exchange.camera_info import CAMERA_INFO, CAMERA_INFO_FILE
from rigcal_camera.exchange.kalibr import CAMCHAIN_FILE, KALIBR
from rigcal_camera.exchange.opencv import OPENCV, OPENCV_FILE

EXPORTERS = (KALIBR, OPENCV, CAMERA_INFO)
IMPORTERS = (CAMCHAIN_FILE, OPENCV_FILE, CAMERA_INFO_FILE)

__all__ = ["EXPORTERS", "IMPORTERS"]
