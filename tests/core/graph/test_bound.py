"""The Cramer-Rao bound: what the data allow, and the ratio of errors to it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from rigcal.estimation import calibrate, prepare
from rigcal.graph.bound import cramer_rao_bound, efficiency

RIG = {"lidar": ("plane", 0.0), "cam": ("pose", 0.0), "scan": ("line", 10.0)}


def bound_of(ring, observations, T_root_t):
    stages = prepare(ring.rig, ring.registry, observations)
    return cramer_rao_bound(stages.task, ring.T_root, T_root_t)


def boards_of(ring):
    """`T_root_t` of every exposure, from the joint estimate of exact data."""
    return calibrate(ring.rig, ring.registry, ring.observations).target_poses


def test_it_is_the_covariance_that_the_estimate_reports(make_ring) -> None:
    ring = make_ring(0, RIG, count=40, sigma=0.0)
    rig = replace(ring.rig, noise="configured")
    result = calibrate(rig, ring.registry, ring.observations)
    bounds = bound_of(ring, ring.observations, result.target_poses)
    assert set(bounds) == {"cam", "scan"}
    for sensor, C in bounds.items():
        np.testing.assert_allclose(result.sensors[sensor].covariance, C, rtol=1e-3, atol=1e-10)


def test_twice_the_boards_half_the_covariance(make_ring) -> None:
    ring = make_ring(1, RIG, count=40, sigma=0.0)
    boards = boards_of(ring)
    again = tuple(replace(o, exposure=f"{o.exposure} again") for o in ring.observations)
    twice = boards | {f"{k} again": T for k, T in boards.items()}
    once = bound_of(ring, ring.observations, boards)
    both = bound_of(ring, ring.observations + again, twice)
    for sensor, C in once.items():
        np.testing.assert_allclose(2 * both[sensor], C, rtol=1e-6, atol=1e-12)


def test_errors_as_large_as_the_bound_have_ratio_one() -> None:
    rng = np.random.default_rng(0)
    A = rng.normal(size=(6, 6))
    C = A @ A.T
    errors = rng.multivariate_normal(np.zeros(6), C, size=2000)
    bounds = np.broadcast_to(C, (2000, 6, 6))
    for scale in (1.0, 2.0):
        result = efficiency(scale * errors, bounds)
        for ratio in (result.rotation, result.translation, result.pose):
            assert abs(ratio.value / scale - 1) < 4 * ratio.deviation
            assert ratio.deviation < 0.03


def test_a_deviation_is_the_scatter_of_the_ratio() -> None:
    rng = np.random.default_rng(1)
    C = np.diag([1.0, 0.1, 0.1, 4.0, 1.0, 0.1])
    bounds = np.broadcast_to(C, (50, 6, 6))
    results = [
        efficiency(rng.multivariate_normal(np.zeros(6), C, size=50), bounds) for _ in range(300)
    ]
    for part in ("rotation", "translation", "pose"):
        ratios = [getattr(r, part) for r in results]
        scatter = np.std([r.value for r in ratios])
        np.testing.assert_allclose(scatter, ratios[0].deviation, rtol=0.2)
