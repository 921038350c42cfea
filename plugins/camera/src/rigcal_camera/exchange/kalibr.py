"""Kalibr's camchain: lenses, and the pose of each camera in the one before."""

from __future__ import annotations

import re
from typing import Any

import numpy as np

from rigcal.errors import ConfigError, InputError
from rigcal.exporting.text import commented_yaml
from rigcal.geometry import se3
from rigcal.geometry.se3 import Array
from rigcal.plugin import Calibration, Exporter, Imported, Importer, Rig
from rigcal_camera.config import CameraConfig
from rigcal_camera.exchange.cameras import cameras_of
from rigcal_camera.exchange.lens import lens_fields
from rigcal_camera.exchange.mapping import mapping_in

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


def read_camchain(text: str, stem: str) -> Imported | None:
    """Lenses of a camchain, and each camera's pose in the one before."""
    content = mapping_in(text)
    names = [n for n in content if re.fullmatch(r"cam\d+", str(n))]
    names = [n for n in names if isinstance(content[n], dict) and "intrinsics" in content[n]]
    if not names:
        return None
    names.sort(key=lambda name: int(name[3:]))
    sensors, frames = {}, {}
    for before, name in zip([None, *names], names, strict=False):
        entry = content[name]
        sensors[name] = _fields(name, entry)
        if before is not None and "T_cn_cnm1" in entry:
            T_cn_cnm1 = _numbers(name, entry, "T_cn_cnm1", (4, 4))
            T_cn_cnm1[:3, :3] = se3.nearest_rotation(T_cn_cnm1[:3, :3])
            frames[name] = (before, se3.inverse(T_cn_cnm1))
    return Imported(sensors, frames)


def _fields(name: str, entry: dict[str, Any]) -> dict[str, Any]:
    if entry.get("camera_model", "pinhole") != "pinhole":
        raise ConfigError(
            f"{name}: camera_model is '{entry['camera_model']}', expected 'pinhole' (with radtan "
            "or equidistant distortion): calibrate the lens anew with that model"
        )
    fx, fy, cx, cy = _numbers(name, entry, "intrinsics", (4,)).tolist()
    K = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1.0]])
    size = _numbers(name, entry, "resolution", (2,)).astype(int).tolist()
    model, D = str(entry.get("distortion_model", "none")), entry.get("distortion_coeffs") or []
    fields = lens_fields(model, K, D, (size[0], size[1]))
    return fields | ({"topic": entry["rostopic"]} if "rostopic" in entry else {})


def _numbers(name: str, entry: dict[str, Any], key: str, shape: tuple[int, ...]) -> Array:
    try:
        values = np.array(entry.get(key), dtype=np.float64)
    except (TypeError, ValueError):
        values = np.empty(0)
    if values.shape != shape or not np.isfinite(values).all():
        raise ConfigError(f"{name}.{key}: expected {' x '.join(map(str, shape))} numbers")
    return values


CAMCHAIN_FILE = Importer("kalibr", "Kalibr camchain: lenses and poses", read_camchain)
KALIBR = Exporter("kalibr", "Kalibr: camchain of the cameras", camchain_text, needs_rig=True)
