"""The camera under the kit that every sensor plugin is tested by."""

from rigcal.testing import SensorConformance
from rigcal_camera import CAMERA, CameraConfig


class TestCamera(SensorConformance):
    sensor_type = CAMERA
    config = CameraConfig(
        topic="/camera/image_raw",
        width_px=720,
        height_px=540,
        focal_px=(427.5, 427.5),
        principal_px=(359.5, 269.5),
        distortion=(-0.1, 0.02, 0.0005, -0.0003),
        sigma_px=0.2,
    )
    noise_free_effects = CAMERA.effects.model_validate({"noise_grey": 0.0})
    # Noise of pixels makes noise of corners, which is below the configured one.
    raw_noise_is_configured = False


class TestFisheye(SensorConformance):
    sensor_type = CAMERA
    config = CameraConfig(
        topic="/camera/image_raw",
        width_px=720,
        height_px=540,
        model="fisheye",
        focal_px=(300.0, 300.0),
        principal_px=(359.5, 269.5),
        distortion=(0.01, -0.002, 0.0005, 0.0),
        sigma_px=0.2,
    )
    distances_m = (1.0, 1.8)
    noise_free_effects = CAMERA.effects.model_validate({"noise_grey": 0.0})
    raw_noise_is_configured = False
