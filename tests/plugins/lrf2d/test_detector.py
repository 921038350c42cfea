from __future__ import annotations

import numpy as np
import pytest

from rigcal.geometry import se3
from rigcal.geometry.se3 import Array
from rigcal.geometry.shapes import plane_of_target
from rigcal.observation import Candidate, LineGeometry
from rigcal.scene import Scene, Surface
from rigcal.targets.target import Target, TargetConfig
from rigcal_lrf2d import LRF2D, Scan
from rigcal_lrf2d.scan import directions
from rigcal_lrf2d.simulator import simulate

FACING = se3.transform(np.array([[0.0, 0, -1], [-1, 0, 0], [0, 1, 0]]), np.array([2.0, 0, 0]))
"""A board 2 m ahead of the sensor, facing it."""


def line_of(candidate: Candidate) -> LineGeometry:
    assert isinstance(candidate.geometry, LineGeometry)
    return candidate.geometry


def across(geometry: LineGeometry, T_s_t: Array) -> Array:
    """(2,) distances of the end points from the trace of the target's plane, in the scan, m."""
    n, d = plane_of_target(T_s_t)
    distances: Array = (np.stack([geometry.start, geometry.end]) @ n + d) / np.hypot(n[0], n[1])
    return distances


def hits(scan: Scan, target: Target, T_s_t: Array) -> Array:
    """Angles of the beams that hit the target: all that would, but for what stands before it."""
    ranges, _ = Scene(target, T_s_t).cast(np.zeros(3), directions(scan.angles))
    with np.errstate(invalid="ignore"):
        result: Array = scan.angles[np.abs(ranges - scan.ranges) < 0.1]
    return result


def is_board(candidate: Candidate, board: Array, T_s_t: Array) -> bool:
    """Whether its beams are the board's, and its ends within 5 sigma (and a mm) of the plane."""
    angles = np.asarray(candidate.measurement["angles"], np.float64)
    shared = np.count_nonzero(np.isin(np.round(angles, 6), np.round(board, 6)))
    g = line_of(candidate)
    n = plane_of_target(T_s_t)[0] * [1, 1, 0]
    n /= np.linalg.norm(n)
    sigma = np.sqrt([n @ g.covariance[:3, :3] @ n, n @ g.covariance[3:, 3:] @ n])
    close = bool(np.all(np.abs(across(g, T_s_t)) < 5 * sigma + 0.001))
    return close and shared > 0.9 * len(angles) and shared > 0.8 * len(board)


def test_the_board_is_among_the_candidates(world) -> None:
    ranks = []
    for seed in range(200):
        rng = np.random.default_rng(seed)
        T_s_t = world.pose(rng)
        scene = world.scene(T_s_t)
        scan = simulate(np.eye(4), scene, world.config, rng)
        board = hits(scan, world.target, T_s_t)
        candidates = LRF2D.detect(scan, world.config, world.target).candidates
        assert len(candidates) <= 8
        if len(board) >= 10:
            found = [is_board(c, board, T_s_t) for c in candidates]
            ranks.append(found.index(True) if any(found) else 99)
    assert len(ranks) > 180
    assert np.mean(np.array(ranks) < 8) >= 0.97
    assert np.mean(np.array(ranks) == 0) >= 0.85


@pytest.mark.parametrize(("step", "sigma", "angle"), [(1.0, 0.01, 0.0), (0.33, 0.03, 0.1)])
def test_the_board_is_found_by_coarse_and_by_noisy_lasers(world, step, sigma, angle) -> None:
    config = world.config.model_copy(
        update={"angle_step_deg": step, "sigma_m": sigma, "sigma_angle_deg": angle}
    )
    found = []
    for seed in range(60):
        rng = np.random.default_rng(seed)
        T_s_t = world.pose(rng)
        scene = world.scene(T_s_t)
        scan = simulate(np.eye(4), scene, config, rng)
        board = hits(scan, world.target, T_s_t)
        candidates = LRF2D.detect(scan, config, world.target).candidates
        if len(board) >= 10:
            found.append(any(is_board(c, board, T_s_t) for c in candidates))
    assert np.mean(found) >= 0.93


def plate(x: float, y: float, width: float) -> Surface:
    return Surface(
        se3.transform(FACING[:3, :3], np.array([x, y, 0.0])),
        np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * [width / 2, 1],
    )


@pytest.mark.parametrize(
    ("surfaces", "start_is_edge", "end_is_edge"),
    [
        ((), True, True),
        ((plate(5, 0, 8),), True, True),
        ((plate(5, 0, 8), plate(1.5, -0.5, 0.4)), False, True),
        ((plate(5, 0, 8), plate(1.5, 0.5, 0.4)), True, False),
    ],
    ids=["free", "before a wall", "right end hidden", "left end hidden"],
)
def test_an_end_is_an_edge_unless_something_hides_the_rest(
    world, surfaces, start_is_edge, end_is_edge
) -> None:
    scene = Scene(world.target, FACING, surfaces)
    for seed in range(20):
        scan = simulate(np.eye(4), scene, world.config, np.random.default_rng(seed))
        best = LRF2D.detect(scan, world.config, world.target).candidates
        board = next(line_of(c) for c in best if abs(line_of(c).start[0] - 2) < 0.1)
        assert (board.start_is_edge, board.end_is_edge) == (start_is_edge, end_is_edge)
        if start_is_edge:
            assert board.start[1] == pytest.approx(-0.6, abs=0.01)
        if end_is_edge:
            assert board.end[1] == pytest.approx(0.6, abs=0.01)


def test_the_end_of_the_scan_is_no_edge(world) -> None:
    config = world.config.model_copy(update={"angle_min_deg": -10.0})
    scan = simulate(np.eye(4), Scene(world.target, FACING), config, np.random.default_rng(0))
    geometry = line_of(LRF2D.detect(scan, config, world.target).candidates[0])
    assert not geometry.start_is_edge
    assert geometry.end_is_edge


def test_a_board_across_the_ends_of_a_full_circle_is_one_segment(world) -> None:
    config = world.config.model_copy(update={"angle_min_deg": -180.0, "angle_max_deg": 179.75})
    behind = se3.transform(se3.rotation_from_rpy(np.array([0, 0, np.pi])), np.zeros(3)) @ FACING
    scene = Scene(world.target, behind, (plate(5, 0, 8),))
    scan = simulate(np.eye(4), scene, config, np.random.default_rng(0))
    geometry = line_of(LRF2D.detect(scan, config, world.target).candidates[0])
    assert geometry.start_is_edge
    assert geometry.end_is_edge
    assert np.linalg.norm(geometry.end - geometry.start) == pytest.approx(1.2, abs=0.02)


def test_mixed_pixels_are_left_out(world) -> None:
    scene = Scene(world.target, FACING, (plate(2.3, 0, 3),))
    scan = simulate(np.eye(4), scene, world.config, np.random.default_rng(1))
    board = hits(scan, world.target, FACING)
    ranges = scan.ranges.copy()
    for angle in (board[0], board[-1]):
        ranges[np.argmin(np.abs(scan.angles - angle))] = 2.2
    mixed = Scan(scan.angles, ranges)
    best = LRF2D.detect(mixed, world.config, world.target).candidates[0]
    assert np.abs(np.asarray(best.measurement["ranges"]) - 2.2).min() > 0.05
    assert line_of(best).start_is_edge
    assert line_of(best).end_is_edge


def test_a_finger_before_the_board_does_not_cut_it(world) -> None:
    scene = Scene(world.target, FACING, (plate(1.9, 0.1, 0.04),))
    scan = simulate(np.eye(4), scene, world.config, np.random.default_rng(1))
    best = line_of(LRF2D.detect(scan, world.config, world.target).candidates[0])
    assert np.linalg.norm(best.end - best.start) == pytest.approx(1.2, abs=0.02)


def test_the_covariance_of_the_ends_is_their_scatter(world) -> None:
    config = world.config.model_copy(update={"sigma_angle_deg": 0.1})
    turned = FACING @ se3.exp(np.array([0, 0.6, 0, 0, 0, 0]))
    scene = Scene(world.target, turned)
    squares = []
    for seed in range(200):
        scan = simulate(np.eye(4), scene, config, np.random.default_rng(seed))
        g = line_of(LRF2D.detect(scan, config, world.target).candidates[0])
        n = plane_of_target(turned)[0]
        N = np.zeros((2, 6))
        N[0, :3] = N[1, 3:] = n
        e = across(g, turned)
        squares.append(float(e @ np.linalg.solve(N @ g.covariance @ N.T, e)))
        assert np.linalg.eigvalsh(g.covariance)[0] > 0
    # Chi-square with 2 degrees of freedom: mean 2, standard error 2 / sqrt(200) = 0.14.
    assert np.mean(squares) == pytest.approx(2, abs=0.45)


def test_the_same_scan_gives_the_same_candidates(world) -> None:
    rng = np.random.default_rng(7)
    scene = world.scene(world.pose(rng))
    once, again = (
        LRF2D.detect(
            simulate(np.eye(4), scene, world.config, np.random.default_rng(3)),
            world.config,
            world.target,
        )
        for _ in range(2)
    )
    assert [c.score for c in once.candidates] == [c.score for c in again.candidates]
    for a, b in zip(once.candidates, again.candidates, strict=True):
        np.testing.assert_array_equal(line_of(a).start, line_of(b).start)
        np.testing.assert_array_equal(a.measurement["ranges"], b.measurement["ranges"])


@pytest.mark.parametrize("count", [0, 4])
def test_a_scan_with_hardly_a_return_has_a_reason(world, count: int) -> None:
    ranges = np.full(100, np.inf)
    ranges[:count] = 1.0
    detection = LRF2D.detect(Scan(np.linspace(-1, 1, 100), ranges), world.config, world.target)
    assert detection.candidates == ()
    assert f"{count} of 100 beams returned" in detection.reason


def test_walls_alone_are_no_candidates(world) -> None:
    scene = Scene(world.target, None, (plate(3, 0, 8),))
    scan = simulate(np.eye(4), scene, world.config, np.random.default_rng(0))
    detection = LRF2D.detect(scan, world.config, world.target)
    assert detection.candidates == ()
    assert "at most 1.50 m long" in detection.reason


def test_pure_clutter_raises_nothing(world) -> None:
    small = Target("small", TargetConfig(type="plain"), world.target.outline / 10, np.zeros((0, 3)))
    for seed in range(30):
        rng = np.random.default_rng(seed)
        scan = Scan(np.sort(rng.uniform(-3, 3, 300)), rng.uniform(0.01, 20, 300))
        LRF2D.detect(scan, world.config, small)
        LRF2D.detect(Scan(scan.angles, np.full(300, 1.0)), world.config, world.target)
        LRF2D.detect(Scan(np.zeros(300), scan.ranges), world.config, world.target)
