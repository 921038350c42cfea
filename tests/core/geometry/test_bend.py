"""A bent face by hand: heights, and where rays meet it."""

import numpy as np

from rigcal.geometry.bend import height_by_bend, onto_bend, range_to_bend

BEND = np.array([1 / 60, 0.0, 0.0])  # along x only: 3 mm at 0.6 m


def test_heights():
    points = np.array([[0.6, 0.0, 9.0], [-0.6, 0.4, 0.0], [0.0, 0.4, 0.0]])
    np.testing.assert_allclose(onto_bend(points, BEND)[:, 2], [0.003, 0.003, 0.0], atol=1e-12)
    np.testing.assert_allclose(onto_bend(points, BEND)[:, :2], points[:, :2])
    np.testing.assert_allclose(height_by_bend(np.array([[0.5, 0.2]])), [[0.125, 0.02, 0.1]])


def test_rays_that_fall_straight_on_it_are_shorter_by_the_height():
    origins = np.array([[0.6, 0.1, 2.0], [0.0, 0.1, 2.0]])
    down = np.tile([0.0, 0.0, -1.0], (2, 1))
    np.testing.assert_allclose(range_to_bend(origins, down, BEND), [1.997, 2.0], atol=1e-12)


def test_slanting_rays_end_on_the_face():
    rng = np.random.default_rng(0)
    origin, aim = np.array([0.3, -0.5, 2.0]), rng.uniform(-0.6, 0.6, (20, 3)) * [1, 1, 0]
    bend = np.array([0.05, -0.03, 0.02])
    d = (aim - origin) / np.linalg.norm(aim - origin, axis=1)[:, None]
    met = origin + range_to_bend(origin, d, bend)[:, None] * d
    np.testing.assert_allclose(met[:, 2], height_by_bend(met) @ bend, atol=1e-12)


def test_a_ray_along_a_flat_face_meets_it_nowhere():
    (found,) = range_to_bend(np.array([0.0, 0.0, 2.0]), np.array([[1.0, 0.0, 0.0]]), 0 * BEND)
    assert np.isposinf(found)
