"""How exact are the corners that the detector finds in simulated images?

    uv run python bench/render_accuracy.py [--each] [--noise 2]

Views near to far, straight and tilted, through three lenses, against the projection of the
board's points. The renderer's own error is 0.003 px rms (`tests/plugins/camera/test_print.py`
compares it with brute force), so that what is seen here is the detector's. Units: px, per axis.
"""

from __future__ import annotations

import argparse

import numpy as np

from rigcal.geometry import se3
from rigcal.scene import Scene
from rigcal.targets import BUILTIN_TARGETS
from rigcal_camera import CAMERA, CameraConfig, CameraEffects, lens_of

TYPES = {kind.name: kind for kind in BUILTIN_TARGETS}
POSTER = [
    {"id": 7, "x_m": -0.32, "y_m": 0.15, "size_m": 0.4},
    {"id": 100, "x_m": 0.28, "y_m": 0.12, "size_m": 0.3, "turn_deg": 30},
    {"id": 3, "x_m": 0.05, "y_m": -0.25, "size_m": 0.25, "turn_deg": -90},
    {"id": 41, "x_m": 0.4, "y_m": -0.28, "size_m": 0.2},
]
SHAPES = {
    "tags": (
        "apriltag_grid",
        {"columns": 6, "rows": 4, "tag_size_m": 0.15, "tag_gap_m": 0.04},
    ),
    "kalibr": (
        "apriltag_grid",
        {"columns": 5, "rows": 4, "tag_size_m": 0.16, "tag_spacing": 0.3}
        | {"border_cells": 2, "corner_squares": True},
    ),
    "poster": ("apriltag_poster", {"tags": POSTER}),
    "chess": ("checkerboard", {"columns": 10, "rows": 7, "square_size_m": 0.1}),
    "charuco": ("charuco", {"columns": 9, "rows": 6, "square_size_m": 0.13, "marker_size_m": 0.1}),
}
LENSES = {
    "pinhole": {},
    "barrel": {"distortion": (-0.28, 0.08, 0.0005, -0.0004, -0.01)},
    "fisheye": {"model": "fisheye", "distortion": (-0.054, -0.078, 0.096, -0.0515)},
}
DISTANCES_M = (0.8, 1.2, 1.8, 2.7)
TILTS_DEG = ((0, 0, 0), (-12, -40, 20), (30, 20, 45))


def camera(**lens):
    size = {"width_px": 616, "height_px": 512}
    return CameraConfig(focal_px=(300.0, 300.0), principal_px=(307.5, 255.5), **size, **lens)


def pose(distance_m, tilt_deg):
    R = np.diag([1.0, -1.0, -1.0]) @ se3.rotation_from_rpy(np.radians(tilt_deg))
    return se3.transform(R, np.array([0.031 * distance_m, -0.017 * distance_m, distance_m]))


def detected(image, config, target, T_s_t):
    """Pixels (N, 2) of the target's points in the image, NaN where not found."""
    uv = np.full((len(target.points), 2), np.nan)
    candidates = CAMERA.detect(image, config, target).candidates
    if candidates:
        errors = [CAMERA.errors(c, config, target, T_s_t) for c in candidates]
        best = candidates[int(np.argmin([np.sum(e**2) for e in errors]))]
        uv[best.measurement["index"]] = best.measurement["uv"]
    return uv


def errors_of_view(target, T_s_t, config, effects):
    """Errors (N, 2) of all corners, NaN where not found; None: not all are in the image."""
    lens, rng = lens_of(config), np.random.default_rng(0)
    p_s = se3.apply(T_s_t, target.points)
    if not lens.sees(p_s).all():
        return None
    image = CAMERA.simulate(np.eye(4), Scene(target, T_s_t), config, rng, effects)
    return detected(image, config, target, T_s_t) - lens.pixels_from_points(p_s)[0]


def errors_by_view(target, config, effects):
    """(view, errors) of all views that show the whole board."""
    for distance in DISTANCES_M:
        for tilt in TILTS_DEG:
            errors = errors_of_view(target, pose(distance, tilt), config, effects)
            if errors is not None:
                yield f"{distance:3.1f} m {tilt}", errors


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--each", action="store_true", help="tell every view's errors too")
    parser.add_argument("--noise", type=float, default=0.0, help="of the images, grey levels")
    arguments = parser.parse_args()
    effects = CameraEffects(noise_grey=arguments.noise)
    for shape, (kind, fields) in SHAPES.items():
        fields = {"type": kind, "width_m": 1.2, "height_m": 0.9, **fields}
        target = TYPES[kind].build("board", TYPES[kind].config(**fields))
        for name, lens in LENSES.items():
            every = []
            for view, errors in errors_by_view(target, camera(**lens), effects):
                if arguments.each:
                    print(f"{shape}, {name}, {view}: {summary(errors)}")
                every.append(errors)
            print(f"{shape}, {name}, all: {summary(np.concatenate(every))}", flush=True)


def summary(e):
    e = e[np.isfinite(e).all(axis=1)]
    if not len(e):
        return "nothing found"
    bias = np.abs(e.mean(axis=0)).max()
    rms = np.sqrt(np.mean(e**2))
    return f"{len(e)} corners, rms {rms:.4f} max {np.abs(e).max():.4f} bias {bias:.4f}"


if __name__ == "__main__":
    main()
