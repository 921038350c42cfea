"""What an image can show of a cloud, and the colours it gives."""

from __future__ import annotations

import numpy as np

from rigcal.fusing.colour import by_range, dots, dots_by_range, sample, visible


def seen_from_origin(points: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A pinhole of 400 px focal length looking along z."""
    uv = 400 * points[:, :2] / points[:, 2:] + 320
    return uv, np.linalg.norm(points, axis=1), np.all((uv >= 0) & (uv < 640), axis=1)


def wall(distance: float, half: float, step: float) -> np.ndarray:
    x, y = np.meshgrid(np.arange(-half, half, step), np.arange(-half, half, step))
    return np.column_stack([x.ravel(), y.ravel(), np.full(x.size, distance)])


def test_what_is_behind_a_board_is_hidden() -> None:
    board, background = wall(2.0, 0.4, 0.02), wall(4.0, 2.5, 0.04)
    shown = visible(*seen_from_origin(np.vstack([board, background])))
    assert shown[: len(board)].all()
    behind = np.all(np.abs(background[:, :2]) < 2 * 0.38, axis=1)
    beside = np.any(np.abs(background[:, :2]) > 2 * 0.46, axis=1)
    assert shown[len(board) :][behind].mean() < 0.02
    assert shown[len(board) :][beside].mean() > 0.98


def test_a_slanted_plane_does_not_hide_itself() -> None:
    plane = wall(0.0, 1.0, 0.02) @ np.diag([1.0, 1.0, 0.0]) + [0, 0, 3.0]
    plane[:, 2] += plane[:, 0]
    uv, ranges, inside = seen_from_origin(plane)
    assert visible(uv, ranges, inside)[inside].mean() > 0.99


def test_points_outside_the_image_are_not_shown() -> None:
    uv = np.array([[5.0, 5.0], [7.0, 5.0]])
    assert not visible(uv, np.ones(2), np.zeros(2, bool)).any()
    assert visible(uv, np.ones(2), np.array([True, False])).tolist() == [True, False]


def test_colours_are_those_of_the_nearest_pixels() -> None:
    image = np.arange(12, dtype=np.uint8).reshape(2, 2, 3)
    uv = np.array([[0.4, 0.4], [1.0, 0.0], [0.0, 1.4]])
    np.testing.assert_array_equal(sample(image, uv), [image[0, 0], image[0, 1], image[1, 0]])
    np.testing.assert_array_equal(sample(image[..., 0], uv)[:, 1], image[[0, 0, 1], [0, 1, 0], 0])


def test_later_dots_cover_earlier_ones_and_stay_in_the_picture() -> None:
    picture = np.zeros((6, 6, 3), np.uint8)
    dots(picture, np.array([[0.0, 0.0], [1.0, 0.0]]), np.array([[9, 9, 9], [5, 5, 5]], np.uint8))
    assert picture[0, 0, 0] == 5
    assert picture[:2, :3].any()
    assert not picture[2:].any()


def test_near_is_blue_and_far_is_red() -> None:
    colours = by_range(np.linspace(1, 9, 50)).astype(int)
    assert colours[5, 2] > colours[5, 0]
    assert colours[-3, 0] > colours[-3, 2]


def test_nearer_points_cover_farther_ones() -> None:
    """And of points equally far, the last, on every machine."""
    uv, ranges = np.full((40, 2), 5.0), np.repeat([9.0, 1.0, 4.0, 1.0], 10)
    picture = np.zeros((10, 10, 3), np.uint8)
    dots_by_range(picture, uv, ranges)
    np.testing.assert_array_equal(picture[5, 5], by_range(ranges)[-1])
    assert picture[5, 5, 2] > picture[5, 5, 0]
    dots_by_range(picture, np.zeros((0, 2)), np.zeros(0))
