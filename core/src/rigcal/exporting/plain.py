"""Formats that every program reads: plain JSON, and 4 x 4 matrices as text."""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import TYPE_CHECKING

from rigcal.calibration import Calibration
from rigcal.exporting.exporter import Exporter
from rigcal.geometry import se3
from rigcal.geometry.se3 import Array

if TYPE_CHECKING:
    from rigcal.rig import Rig


def json_text(calibration: Calibration, rig: Rig | None = None) -> str:
    """Every sensor's pose in the root, as matrix, translation and quaternion.

    The covariance is that of the sensor's pose in its `covariance_parent`.
    """
    sensors = {}
    for name, T_root_s in _poses(calibration):
        result = calibration.sensors[name]
        sensors[name] = {
            "matrix": T_root_s.tolist(),
            "translation_m": T_root_s[:3, 3].tolist(),
            "quaternion_xyzw": se3.quaternion_from_rotation(T_root_s[:3, :3]).tolist(),
        }
        if result.covariance is not None:
            sensors[name] |= {
                "covariance": result.covariance.tolist(),
                "covariance_parent": result.parent,
            }
    content = {
        "root": calibration.root,
        "convention": f"p_{calibration.root} = matrix @ [p_sensor, 1]; metres; covariance over "
        "[rotation rad, translation m], right perturbation, sensor frame",
        "sensors": sensors,
    }
    return json.dumps(content, indent=2, ensure_ascii=False, allow_nan=False) + "\n"


def matrices_text(calibration: Calibration, rig: Rig | None = None) -> str:
    """Four rows of four numbers per sensor; `numpy.loadtxt` reads them as (4 n, 4)."""
    root = calibration.root
    lines = [f"# p_{root} = T @ [p_sensor, 1]; metres; one T of 4 rows per sensor"]
    for name, T_root_s in _poses(calibration):
        lines.append(f"# T_{root}_{name}")
        lines += [" ".join(map(repr, row)) for row in T_root_s.tolist()]
    return "\n".join(lines) + "\n"


def _poses(calibration: Calibration) -> Iterator[tuple[str, Array]]:
    for name in calibration.sensors:
        yield name, calibration.T(calibration.root, name)


JSON = Exporter("json", "JSON: every sensor's pose in the root, with covariance", json_text)
MATRICES = Exporter("matrices", "text: a 4 x 4 matrix per sensor", matrices_text)
