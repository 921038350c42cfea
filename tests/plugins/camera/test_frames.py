from types import SimpleNamespace

import cv2
import numpy as np
import pytest

from rigcal.errors import RecordingError
from rigcal.recording.message import Message
from rigcal_camera import CAMERA, CameraConfig

IMAGE = "sensor_msgs/msg/Image"
CAM = CameraConfig(width_px=6, height_px=4, focal_px=(5, 5), principal_px=(2.5, 1.5))
GREY = np.arange(24, dtype=np.uint8).reshape(4, 6) * 10


def raw(pixels, encoding, padding=0, big_endian=0):
    rows = np.ascontiguousarray(pixels).view(np.uint8).reshape(len(pixels), -1)
    data = np.pad(rows, ((0, 0), (0, padding)), constant_values=77)
    value = SimpleNamespace(
        height=len(pixels),
        width=pixels.shape[1],
        encoding=encoding,
        is_bigendian=big_endian,
        step=data.shape[1],
        data=data.ravel(),
    )
    return Message(IMAGE, value, 0, None, "a.bag: /cam0 message 7")


def file(path):
    return Message(path.suffix, path, 0, None, str(path))


@pytest.mark.parametrize("padding", [0, 5])
def test_grey_images_are_read_as_they_are(padding):
    np.testing.assert_array_equal(CAMERA.decode(raw(GREY, "mono8", padding), CAM), GREY)
    np.testing.assert_array_equal(CAMERA.decode(raw(GREY, "8UC1", padding), CAM), GREY)


@pytest.mark.parametrize("encoding", ["rgb8", "bgr8", "rgba8", "bgra8"])
def test_colour_order_is_respected(encoding):
    red = np.zeros((4, 6, len(encoding) - 1), dtype=np.uint8)
    red[..., encoding.index("r")] = 200
    image = CAMERA.decode(raw(red, encoding, padding=3), CAM)
    assert image.dtype == np.uint8
    # ITU-R BT.601 weighs red with 0.299; taken for blue it would be 23.
    np.testing.assert_allclose(image, 60, atol=1)


@pytest.mark.parametrize("encoding", ["rgb8", "bgr8", "rgba8", "bgra8", "bayer_rggb8"])
def test_views_show_the_colours(encoding):
    if encoding.startswith("bayer"):
        red = np.tile(np.array([[200, 0], [0, 0]], dtype=np.uint8), (2, 3))
    else:
        red = np.zeros((4, 6, len(encoding) - 1), dtype=np.uint8)
        red[..., encoding.index("r")] = 200
    image = CAMERA.view(raw(red, encoding, padding=3), CAM).image
    np.testing.assert_array_equal(image[1:-1, 1:-1], np.full((2, 4, 3), [200, 0, 0]))


def test_views_of_grey_images_and_of_files(tmp_path):
    np.testing.assert_array_equal(CAMERA.view(raw(GREY, "mono8"), CAM).image, GREY)
    for name, pixels in (("grey.png", GREY), ("blue.png", np.dstack([GREY, 0 * GREY, 0 * GREY]))):
        cv2.imwrite(str(tmp_path / name), pixels)
    np.testing.assert_array_equal(CAMERA.view(file(tmp_path / "grey.png"), CAM).image, GREY)
    image = CAMERA.view(file(tmp_path / "blue.png"), CAM).image
    np.testing.assert_array_equal(image, np.dstack([0 * GREY, 0 * GREY, GREY]))


@pytest.mark.parametrize("order", ["rggb", "bggr", "gbrg", "grbg"])
def test_bayer_order_is_respected(order):
    cells = np.array([200 if colour == "r" else 0 for colour in order], dtype=np.uint8)
    mosaic = np.tile(cells.reshape(2, 2), (2, 3))
    image = CAMERA.decode(raw(mosaic, f"bayer_{order}8"), CAM)
    np.testing.assert_allclose(image[1:-1, 1:-1], 60, atol=1)


@pytest.mark.parametrize("big_endian", [0, 1])
def test_sixteen_bits_keep_their_highest_eight(big_endian):
    twelve_bit = (GREY.astype(np.uint16) + 16) * 16
    stored = twelve_bit.astype(">u2" if big_endian else "<u2")
    image = CAMERA.decode(raw(stored, "mono16", padding=2, big_endian=big_endian), CAM)
    np.testing.assert_array_equal(image, GREY + 16)


@pytest.mark.parametrize("suffix", [".png", ".tif", ".bmp", ".jpg"])
def test_image_files(tmp_path, suffix):
    path = tmp_path / f"pose17{suffix}"
    cv2.imwrite(str(path), np.full((4, 6), 90, dtype=np.uint8))
    np.testing.assert_allclose(CAMERA.decode(file(path), CAM), 90, atol=2)


def test_compressed_messages():
    data = cv2.imencode(".png", GREY)[1]
    value = SimpleNamespace(format="png", data=data.ravel())
    message = Message("sensor_msgs/msg/CompressedImage", value, 0, None, "x")
    np.testing.assert_array_equal(CAMERA.decode(message, CAM), GREY)


def test_a_wrong_size_names_both():
    with pytest.raises(RecordingError, match=r"message 7: the image is 5 x 4 px.*says 6 x 4"):
        CAMERA.decode(raw(GREY[:, :5], "mono8"), CAM)


def test_data_that_are_no_image(tmp_path):
    path = tmp_path / "pose1.png"
    cv2.imwrite(str(path), GREY)
    path.write_bytes(path.read_bytes()[:20])
    with pytest.raises(RecordingError, match=r"pose1\.png: 20 bytes that are not an image"):
        CAMERA.decode(file(path), CAM)
    path.write_bytes(b"")
    with pytest.raises(RecordingError, match="0 bytes"):
        CAMERA.decode(file(path), CAM)
    with pytest.raises(RecordingError, match="cannot be read: No such file"):
        CAMERA.decode(file(tmp_path / "gone.png"), CAM)


def test_unknown_encoding_and_short_data():
    with pytest.raises(RecordingError, match="image encoding 'yuv422' is not read"):
        CAMERA.decode(raw(GREY, "yuv422"), CAM)
    message = raw(GREY, "mono8")
    message.value.data = message.value.data[:-3]
    with pytest.raises(RecordingError, match="21 bytes do not hold a 6 x 4 image"):
        CAMERA.decode(message, CAM)


def test_encoded_image_decodes_to_itself():
    value = CAMERA.encode(GREY, CAM, 1_500_000_000_123_456_789, "cam0")
    assert (value.header.stamp.sec, value.header.stamp.nanosec) == (1_500_000_000, 123_456_789)
    message = Message(IMAGE, value, 0, None, "x")
    np.testing.assert_array_equal(CAMERA.decode(message, CAM), GREY)


@pytest.mark.parametrize(
    ("model", "distortion", "name", "length"),
    [
        ("pinhole", (), "plumb_bob", 5),
        ("pinhole", (0.1, 0.2, 0.3, 0.4), "plumb_bob", 5),
        ("pinhole", (0.1,) * 8, "rational_polynomial", 8),
        ("fisheye", (), "equidistant", 4),
    ],
)
def test_camera_info_carries_the_intrinsics(model, distortion, name, length):
    config = CAM.model_copy(update={"model": model, "distortion": distortion})
    type_name, info = CAMERA.extra_messages(config, 5, "cam0")["camera_info"]
    assert type_name == "sensor_msgs/msg/CameraInfo"
    assert (info.width, info.height, info.distortion_model) == (6, 4, name)
    np.testing.assert_array_equal(info.k, [5, 0, 2.5, 0, 5, 1.5, 0, 0, 1])
    np.testing.assert_array_equal(info.d, [*distortion, *[0.0] * (length - len(distortion))])
