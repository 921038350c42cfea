"""Is one of caliscope's webcams out of step? Its corners are moved in time and calibrated again.

    uv run python bench/caliscope_lag.py FRAMES SESSION [--camera cam1]

FRAMES is the folder recording of examples/real/README.md, SESSION the session's folder with
camera_array.toml. For every lag (a share of the time between two frames) the corners of one camera
are interpolated towards its next frame. Printed: rms reprojection errors, and how far every camera
then lies from caliscope's own estimate, both aligned on cam0. All observations weigh by their own
noise (`noise: estimated`).
"""

from __future__ import annotations

import argparse
import tomllib
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import yaml

from rigcal import Calibration, Observation, Registry, Rig, calibrate, detect, parse_rig
from rigcal.geometry import se3
from rigcal.observation import Candidate, PoseGeometry
from rigcal.rig import build_targets
from rigcal_camera.lens import lens_of
from rigcal_camera.pose import refine_pose

RIG_FILE = Path(__file__).parents[1] / "examples" / "real" / "caliscope.yaml"
LAGS = (0.0, 0.2, 0.4, 0.5, 0.6, 0.7, 0.8, 1.0)


def main() -> None:
    """Print a row for every lag."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("frames", type=Path)
    parser.add_argument("session", type=Path)
    parser.add_argument("--camera", default="cam1")
    arguments = parser.parse_args()
    registry = Registry.from_entry_points()
    rig = _rig(registry)
    reference = _reference(arguments.session / "camera_array.toml")
    observations = detect(rig, registry, arguments.frames)
    for lag in LAGS:
        moved = _moved(rig, registry, observations, arguments.camera, lag)
        print(f"{arguments.camera} {lag:.1f}:", _row(calibrate(rig, registry, moved), reference))


def _rig(registry: Registry) -> Rig:
    data = yaml.safe_load(RIG_FILE.read_text())
    data["noise"] = "estimated"
    for sensor in data["sensors"].values():
        sensor["sigma_px"] = 0.5
    return parse_rig(data, registry)


def _reference(path: Path) -> dict[str, se3.Array]:
    """`T_world_cam` of every camera."""
    cameras = tomllib.loads(path.read_text())["cameras"]
    poses = {}
    for number, camera in cameras.items():
        rotation = np.array(camera["rotation"], dtype=np.float64)
        R = rotation if rotation.shape == (3, 3) else se3.exp_so3(rotation.reshape(3))
        poses[f"cam{number}"] = se3.inverse(se3.transform(R, np.ravel(camera["translation"])))
    return poses


def _moved(
    rig: Rig, registry: Registry, observations: Sequence[Observation], camera: str, lag: float
) -> list[Observation]:
    """The observations, those of one camera interpolated towards its next frame."""
    points = build_targets(rig, registry)["board"].points
    lens = lens_of(rig.sensors[camera])
    own = {int(o.exposure): o for o in observations if o.sensor == camera and o.candidates}
    result = [o for o in observations if o.sensor != camera]
    for number, o in own.items():
        later = own.get(number + 1)
        if later is None:
            continue
        a, b = o.candidates[0], later.candidates[0]
        index, at_a, at_b = np.intersect1d(
            a.measurement["index"], b.measurement["index"], return_indices=True
        )
        uv = (1 - lag) * a.measurement["uv"][at_a] + lag * b.measurement["uv"][at_b]
        fit = None
        if len(index) >= 6 and isinstance(a.geometry, PoseGeometry):
            fit = refine_pose(lens, a.geometry.T_s_t, points[index], uv)
        if fit is not None:
            measurement = {**a.measurement, "uv": uv, "index": index}
            geometry = PoseGeometry(fit.T_s_t, a.geometry.covariance)
            result.append(replace(o, candidates=(Candidate(geometry, measurement),)))
    return result


def _row(calibration: Calibration, reference: dict[str, se3.Array]) -> str:
    words = []
    for name, sensor in calibration.sensors.items():
        T_true = se3.inverse(reference["cam0"]) @ reference[name]
        error = se3.inverse(T_true) @ calibration.T("cam0", name)
        apart = 1e3 * float(np.linalg.norm(calibration.T("cam0", name)[:3, 3] - T_true[:3, 3]))
        turned = np.degrees(float(se3.rotation_angle(error[:3, :3])))
        assert sensor.residual is not None
        words.append(f"{name} {sensor.residual.rms:.2f} px {apart:.1f} mm {turned:.2f} deg")
    return "  |  ".join(words)


if __name__ == "__main__":
    main()
