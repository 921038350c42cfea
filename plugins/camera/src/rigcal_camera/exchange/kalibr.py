"""Kalibr's camchain: lenses, and the pose of each camera in the one before."""

from __future__ import annotations

from typing import Any

from rigcal.errors import InputError
from rigcal.exporting.text import commented_yaml
from rigcal.plugin import Calibration, Exporter, Rig
from rigcal_camera.config import CameraConfig
from rigcal_camera.exchange.cameras import cameras_of

_NUMBERS = 4
"""Kalibr's radtan (k1, k2, p1, p2) and equidistant (k1 to k4) both have as many."""


def camchain_text(calibration: Calibration, rig: Rig | None) -> str:
    """A camchain of all cameras in the order of the rig, called cam0, cam1, ... as Kalibr must.

    InputError for a lens that Kalibr has no model of.
    Source of the format: github.com/ethz-asl/kalibr/wiki/yaml-formats.
    """
    chain, names = {}, list(cameras_of(calibration, rig).items())
    for n, (name, config) in enumerate(names):
        entry = _lens(name, config)
        if n:
            T_cn_cnm1 = calibration.T(name, names[n - 1][0]) + 0.0
            entry = {"T_cn_cnm1": T_cn_cnm1.tolist(), **entry}
        chain[f"cam{n}"] = entry
    lines = [
        "Kalibr camchain, calibrated by rigcal. Frames are optical: z forward, x right, y down.",
        "T_cn_cnm1: p_cam(n) = T_cn_cnm1 @ [p_cam(n-1), 1]; metres; no quaternions.",
        "intrinsics: fu, fv, pu, pv; radtan: k1, k2, p1, p2; equidistant: k1, k2, k3, k4.",
        *(f"cam{n} is {name} of the rig." for n, (name, _) in enumerate(names)),
    ]
    return commented_yaml(lines, chain)


def _lens(name: str, config: CameraConfig) -> dict[str, Any]:
    if any(config.distortion[_NUMBERS:]):
        raise InputError(
            f"camera '{name}' has {len(config.distortion)} numbers of distortion, and Kalibr's "
            f"radtan only {_NUMBERS} (k1, k2, p1, p2): calibrate it with these, or use "
            "`--format opencv`"
        )
    distortion = (*config.distortion[:_NUMBERS], *(0.0,) * _NUMBERS)[:_NUMBERS]
    entry = {
        "cam_overlaps": [],
        "camera_model": "pinhole",
        "distortion_coeffs": list(distortion),
        "distortion_model": "equidistant" if config.model == "fisheye" else "radtan",
        "intrinsics": [*config.focal_px, *config.principal_px],
        "resolution": [config.width_px, config.height_px],
    }
    return entry | ({"rostopic": config.topic} if config.topic else {})


KALIBR = Exporter("kalibr", "Kalibr: camchain of the cameras", camchain_text, needs_rig=True)
