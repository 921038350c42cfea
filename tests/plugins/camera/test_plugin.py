import subprocess
import sys
from importlib.metadata import entry_points

import numpy as np

import rigcal_camera


def test_the_hook_hands_over_the_camera():
    assert rigcal_camera.rigcal_sensor_types() == [rigcal_camera.CAMERA]
    (entry,) = [e for e in entry_points(group="rigcal") if e.name == "camera"]
    assert entry.load() is rigcal_camera


def test_listing_the_plugin_loads_no_image_library():
    heavy = "cv2", "pyapriltags", "scipy", "rosbags"
    code = f"import sys, rigcal_camera; print([m for m in {heavy!r} if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_the_config_survives_a_round_trip():
    config = rigcal_camera.CameraConfig(
        topic="/cam0/image_raw",
        width_px=640,
        height_px=480,
        focal_px=(500.0, 501.0),
        principal_px=(319.5, 239.5),
        distortion=(0.1, -0.2, 0.0, 0.0),
    )
    data = config.model_dump(mode="json")
    assert rigcal_camera.CameraConfig.model_validate(data) == config
    assert config.sigma_px == 0.2


def test_points_are_projected_to_pixels_of_the_view():
    config = rigcal_camera.CameraConfig(
        width_px=640, height_px=480, focal_px=(500.0, 500.0), principal_px=(319.5, 239.5)
    )
    points = np.array([[0.2, 0.1, 1.0], [1.0, 0.0, 1.0], [0.0, 0.0, -1.0]])
    uv, inside = rigcal_camera.CAMERA.project(points, config)
    np.testing.assert_allclose(uv[0], [419.5, 289.5])
    assert inside.tolist() == [True, False, False]
