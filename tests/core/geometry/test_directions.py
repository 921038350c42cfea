"""Boards that face a viewer, wherever it looks from."""

import numpy as np
import pytest

from rigcal.geometry.directions import facing

UP = np.array([0.0, 0.0, 1.0])


def test_a_board_in_front_stands_upright_with_its_face_to_the_viewer():
    R = facing(np.array([1.0, 0.0, 0.0]), UP, np.zeros(3))
    np.testing.assert_allclose(R.T @ UP, [0, 1, 0], atol=1e-12)
    np.testing.assert_allclose(R @ [0, 0, 1], [-1, 0, 0], atol=1e-12)


@pytest.mark.parametrize("away", [UP, -UP, np.array([1e-9, 0, 1])])
def test_a_board_straight_above_or_below_faces_the_viewer_too(away):
    """A ceiling camera, or a laser under a table."""
    R = facing(away, UP, np.zeros(3))
    np.testing.assert_allclose(R @ [0, 0, 1], -away, atol=1e-8)
    np.testing.assert_allclose(R.T @ R, np.eye(3), atol=1e-8)
    assert np.linalg.det(R) == pytest.approx(1)


def test_roll_turns_it_in_its_own_plane_and_pitch_about_its_level_edge():
    away = np.array([0.0, 1.0, 0.0])
    level = facing(away, UP, np.zeros(3))
    rolled, pitched = (facing(away, UP, np.array(rpy)) for rpy in ([30, 0, 0], [0, 20, 0]))
    np.testing.assert_allclose(rolled[:, 2], level[:, 2], atol=1e-12)
    assert rolled[:, 0] @ level[:, 0] == pytest.approx(np.cos(np.radians(30)))
    np.testing.assert_allclose(pitched[:, 0], level[:, 0], atol=1e-12)
    assert pitched[:, 2] @ level[:, 2] == pytest.approx(np.cos(np.radians(20)))
