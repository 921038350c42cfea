import numpy as np
import pytest

from rigcal.recording.message import Message
from rigcal_camera import CAMERA, CameraEffects, lens_of
from rigcal_camera.effects import expose

SIZE = (512, 640)


@pytest.fixture
def image_of(camera):
    def make(light, seed=0, **effects):
        rng = np.random.default_rng(seed)
        light = np.broadcast_to(np.asarray(light, np.float32), SIZE)
        quiet = {"blur_px": 0, "noise_grey": 0} | effects
        return expose(light, lens_of(camera()), CameraEffects(**quiet), rng)

    return make


def read(message, config, part=CAMERA.decode):
    return part(Message(message.__msgtype__, message, 0, None, "x"), config)


def test_without_effects_the_light_is_the_image(image_of):
    np.testing.assert_array_equal(image_of(np.arange(640) % 256), [np.arange(640) % 256] * 512)


def test_exposure_scales_and_saturates(image_of):
    image = image_of([[50.0] * 320 + [150.0] * 320], exposure=2.0)
    assert set(image[:, :320].ravel()) == {100}
    assert set(image[:, 320:].ravel()) == {255}


@pytest.mark.parametrize(
    ("grey", "effects", "variance"),
    [
        (100.0, {"noise_grey": 3.0}, 9.0),
        (160.0, {"electrons_per_grey": 10.0}, 16.0),
        (160.0, {"electrons_per_grey": 10.0, "noise_grey": 3.0}, 25.0),
        (80.0, {"electrons_per_grey": 10.0, "exposure": 2.0}, 16.0),
    ],
)
def test_noise_has_the_variance_of_the_model(grey, effects, variance, image_of):
    """327 680 pixels: the variance is good to 0.25 %; rounding adds 1/12."""
    image = image_of(grey, **effects).astype(float)
    assert image.var() == pytest.approx(variance + 1 / 12, rel=0.015)
    assert image.mean() == pytest.approx(grey * effects.get("exposure", 1), abs=0.05)


def test_corners_of_the_image_lose_light(image_of):
    image = image_of(200.0, vignetting=0.4)
    assert image[256, 320] == 200
    assert image[0, 0] == 120
    assert image[0, 320] == pytest.approx(200 * (1 - 0.4 * 256**2 / (256**2 + 320**2)), abs=1)


def test_blur_has_its_sigma_and_keeps_the_light(image_of):
    light = np.zeros(SIZE, np.float32)
    light[100, 200] = 2000.0
    spot = image_of(light, blur_px=1.5).astype(float)[90:111, 190:211]
    offset = np.arange(-10, 11)
    assert spot.sum() == pytest.approx(2000, rel=0.03)
    assert np.sqrt(spot.sum(axis=0) @ offset**2 / spot.sum()) == pytest.approx(1.5, abs=0.1)


@pytest.mark.parametrize("encoding", ["mono8", "rgb8", "bgr8"])
@pytest.mark.parametrize("quality", [None, 90])
def test_messages_are_sent_as_asked_and_read_again(encoding, quality, board, camera, photograph):
    config = camera()
    image = photograph(board["april"], None, config)
    raw = CAMERA.encode(image, config, 5, "cam0")
    message = CAMERA.transport(raw, CameraEffects(encoding=encoding, jpeg_quality=quality))
    assert (message.header.stamp.nanosec, message.header.frame_id) == (5, "cam0")
    if quality is None:
        assert message.encoding == encoding
        np.testing.assert_array_equal(read(message, config), image)
    else:
        assert message.__msgtype__ == "sensor_msgs/msg/CompressedImage"
        assert message.data.size < image.size
        np.testing.assert_allclose(read(message, config), image, atol=12.0)
    seen = read(message, config, CAMERA.view).image
    assert seen.shape == (SIZE if encoding == "mono8" else (*SIZE, 3))


def test_a_board_is_found_in_a_compressed_picture(board, camera, pose, photograph):
    config, target = camera(), board["april"]
    T_s_t = pose((25, -20, 10), (0.1, -0.05, 1.3))
    raw = CAMERA.encode(photograph(target, T_s_t, config), config, 0, "cam0")
    image = read(CAMERA.transport(raw, CameraEffects(jpeg_quality=80)), config)
    (found,) = CAMERA.detect(image, config, target).candidates
    assert len(found.measurement["index"]) == len(target.points)
    assert np.sqrt(np.mean(CAMERA.errors(found, config, target, T_s_t) ** 2)) < 0.15
