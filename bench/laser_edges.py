"""Laser edges in constant-cost form: what an edge costs by its number of beams.

    uv run python bench/laser_edges.py [--edges 200] [--repeats 15]

make         once per edge: its beams are compressed to a 4 x 4 moment matrix (3 rows, 2 for a scan)
iteration    per edge and iteration: evaluation with Jacobian and the linear step by GTSAM
uncompressed evaluation of one row per beam with its Jacobian, per edge, for comparison
"""

from __future__ import annotations

import argparse
import time

import numpy as np

from rigcal.geometry import se3
from rigcal.geometry.shapes import plane_of_target
from rigcal.graph.edge import SensorTargetEdge
from rigcal.graph.linear import LinearSystem
from rigcal.graph.numbers import NO_NUMBERS
from rigcal.graph.stack import EdgeStack
from rigcal.residual import beam_residual

SIGMA_M, MOST_BEAMS_AT_ONCE = 0.01, 200_000


def main():
    """Print a row per number of beams."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--edges", type=int, default=200)
    parser.add_argument("--repeats", type=int, default=15)
    arguments = parser.parse_args()
    for planar in (False, True):
        print(f"{'2D scans' if planar else '3D planes'}: {arguments.edges} edges")
        print(f"{'beams':>7} {'make ms':>9} {'iteration us':>13} {'uncompressed us':>16}")
        cases = {beams: Case(beams, arguments.edges, planar) for beams in (50, 500, 5000, 50_000)}
        times = {beams: [] for beams in cases}
        # In turns, so that all meet the same load of the machine.
        for _ in range(arguments.repeats):
            for beams, case in cases.items():
                times[beams].append((case.iterate(), case.uncompressed()))
        for beams, case in cases.items():
            iteration, raw = 1e6 * np.median(times[beams], axis=0)
            print(f"{beams:7} {1e3 * case.make_s:9.2f} {iteration:13.1f} {raw:16.1f}")


class Case:
    """`edges` exposures that one laser saw with `beams` each."""

    def __init__(self, beams, edges, planar):
        rng = np.random.default_rng(0)
        facing = se3.rotation_from_rpy(np.array([np.pi / 2, 0, -np.pi / 2]))
        tilt = se3.rotation_from_rpy(rng.uniform(-0.5, 0.5, (edges, 3)))
        place = np.stack([rng.uniform(1.5, 2.5, edges), *rng.uniform(-0.2, 0.2, (2, edges))], 1)
        self.T_s_t = se3.transform(facing @ tilt, place)
        self.rho, found = [], []
        start = time.perf_counter()
        for k, T in enumerate(self.T_s_t):
            rho, (n, d) = beams_on(T, beams, planar, rng), plane_of_target(T)
            ranges = -d / (rho @ n) + rng.normal(0, SIGMA_M, beams)
            if k * beams < MOST_BEAMS_AT_ONCE:
                self.rho.append(rho)
            if planar:
                n, d = np.array([*n[:2], 0.0]) / np.hypot(*n[:2]), d / np.hypot(*n[:2])
            sigma = np.full(beams, SIGMA_M)
            residual = beam_residual(rho, ranges, sigma, n, d, planar=planar)
            found.append(SensorTargetEdge("laser", str(k), residual))
        self.make_s = (time.perf_counter() - start) / edges
        self.stack = EdgeStack(found, ["laser"], [e.exposure for e in found])
        free = np.array([True])
        self.system = LinearSystem(
            self.stack.sensor, self.stack.exposure, free, edges, NO_NUMBERS, np.zeros(6)
        )

    def iterate(self):
        """Seconds per edge of one iteration."""
        start = time.perf_counter()
        blocks = self.stack.blocks(self.T_s_t)
        self.system.solve(blocks, self.T_s_t, NO_NUMBERS, np.zeros((1, 6)), 1e-6)
        return (time.perf_counter() - start) / len(self.T_s_t)

    def uncompressed(self):
        """Seconds per edge of range errors with Jacobian, a row per beam."""
        start = time.perf_counter()
        for T, rho in zip(self.T_s_t, self.rho, strict=False):
            n, d = plane_of_target(T)
            cosine = rho @ n
            t = -d / cosine
            p_t = se3.apply(se3.inverse(T), t[:, None] * rho)
            # A motion of the target's plane along its normal, at the point where the beam meets it.
            zero = np.zeros(len(t))
            along = np.stack([p_t[:, 1], -p_t[:, 0], zero, zero, zero, zero + 1], axis=1)
            J = -along / cosine[:, None] / SIGMA_M
            J.T @ J
        return (time.perf_counter() - start) / len(self.rho)


def beams_on(T_s_t, count, planar, rng):
    """Unit directions (count, 3) to points of a board of 1.2 x 0.9 m, in z = 0 for a scan."""
    if planar:
        middle = np.arctan2(T_s_t[1, 3], T_s_t[0, 3])
        angle = middle + rng.uniform(-0.15, 0.15, count)
        return np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    p_t = np.column_stack([rng.uniform([-0.6, -0.45], [0.6, 0.45], (count, 2)), np.zeros(count)])
    p_s = se3.apply(T_s_t, p_t)
    return p_s / np.linalg.norm(p_s, axis=1, keepdims=True)


if __name__ == "__main__":
    main()
