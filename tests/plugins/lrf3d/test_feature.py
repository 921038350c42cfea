"""Points on the board that another program found."""

import numpy as np
import pytest

from rigcal.errors import ObservationError
from rigcal.geometry.shapes import plane_of_target
from rigcal_lrf3d import LRF3D, Lrf3dConfig


@pytest.fixture
def points(board, board_poses):
    """Returns (400, 3) from a board without noise, and its pose."""
    (T,) = board_poses(1, 3)
    p_t = np.random.default_rng(0).uniform(-0.4, 0.4, (400, 2))
    return T[:3, 3] + p_t @ T[:3, :2].T, T


def test_points_on_the_board_make_its_plane(points, board):
    on_board, T = points
    (found,) = LRF3D.fit({"points": on_board}, Lrf3dConfig(), board).candidates
    n, d = plane_of_target(T)
    np.testing.assert_allclose(found.geometry.normal, n, atol=1e-9)
    assert found.geometry.d == pytest.approx(d, abs=1e-9)


def test_points_at_the_sensors_origin_are_refused(points, board):
    """That is how drivers write missing returns."""
    with_missing = np.concatenate([points[0], np.zeros((3, 3))])
    with pytest.raises(ObservationError, match=r"3 of 403 `points` lie at the sensor's origin"):
        LRF3D.fit({"points": with_missing}, Lrf3dConfig(), board)
