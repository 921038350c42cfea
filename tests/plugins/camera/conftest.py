import numpy as np
import pytest

from rigcal.geometry import se3
from rigcal.scene import Scene
from rigcal.targets import BUILTIN_TARGETS
from rigcal_camera import CAMERA, CameraConfig, CameraEffects

FACING = np.diag([1.0, -1.0, -1.0])
"""R_s_t of an upright board that faces the camera."""


@pytest.fixture(scope="session")
def board():
    types = {target.name: target for target in BUILTIN_TARGETS}

    def build(kind, **fields):
        return types[kind].build("board", types[kind].config(type=kind, **fields))

    april = {"columns": 4, "rows": 3, "tag_size_m": 0.15, "tag_gap_m": 0.05}
    kalibr = {"columns": 4, "rows": 3, "tag_size_m": 0.15, "tag_spacing": 0.3}
    chess = {"square_size_m": 0.1, "width_m": 1.0, "height_m": 0.8}
    charuco = {"columns": 7, "rows": 5, "square_size_m": 0.12, "marker_size_m": 0.09}
    # Sizes differ fivefold, and two tags are turned.
    poster = [
        {"id": 7, "x_m": -0.23, "y_m": 0.12, "size_m": 0.35},
        {"id": 100, "x_m": 0.2, "y_m": 0.1, "size_m": 0.25, "turn_deg": 30},
        {"id": 3, "x_m": 0.05, "y_m": -0.2, "size_m": 0.22, "turn_deg": -90},
        {"id": 586, "x_m": -0.3, "y_m": -0.2, "size_m": 0.07},
        {"id": 41, "x_m": 0.3, "y_m": -0.2, "size_m": 0.07},
    ]
    return {
        "poster": build("apriltag_poster", width_m=0.85, height_m=0.65, tags=poster),
        "april": build("apriltag_grid", **april, width_m=0.85, height_m=0.65),
        "april_top_left": build(
            "apriltag_grid", **april, width_m=0.85, height_m=0.65, id_order="top_left", first_id=20
        ),
        "kalibr": build("apriltag_grid", **kalibr, border_cells=2, corner_squares=True),
        "kalibr_thin": build("apriltag_grid", **kalibr, corner_squares=True),
        "chess": build("checkerboard", columns=8, rows=5, **chess),
        "chess_symmetric": build("checkerboard", columns=7, rows=5, **chess),
        "charuco": build("charuco", **charuco),
        "charuco_inverted": build("charuco", **charuco, inverted=True, width_m=1.0, height_m=0.8),
        "charuco_legacy": build("charuco", **(charuco | {"rows": 6}), legacy_pattern=True),
    }


@pytest.fixture(scope="session")
def camera():
    def make(**fields):
        defaults = {
            "width_px": 640,
            "height_px": 512,
            "focal_px": (450.0, 455.0),
            "principal_px": (319.5, 255.5),
        }
        return CameraConfig(**(defaults | fields))

    return make


@pytest.fixture(scope="session")
def pose():
    def make(rpy_deg=(0, 0, 0), translation=(0, 0, 1.5)):
        R = FACING @ se3.rotation_from_rpy(np.radians(rpy_deg))
        return se3.transform(R, np.array(translation, dtype=np.float64))

    return make


@pytest.fixture(scope="session")
def photograph():
    def take(target, T_s_t, config, surfaces=(), solids=(), seed=0, **effects):
        scene, rng = Scene(target, T_s_t, surfaces, solids), np.random.default_rng(seed)
        return CAMERA.simulate(np.eye(4), scene, config, rng, CameraEffects(**effects))

    return take
