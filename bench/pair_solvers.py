"""Three solvers for a plane sensor and a 2D laser, measured against each other.

    uv run python bench/pair_solvers.py [--samples 2000] [--sigma-mm 3]

The minimal solver (quartic, three exposures), the one that rigcal had before (Newton's method from
24 random rotations, three exposures) and the linear one (nine unknowns, five exposures; Q. Zhang,
R. Pless, IROS 2004) solve samples of the same boards, 2 to 4 m away, turned by up to 34 deg about
each axis. A sample is solved if one of its hypotheses is within 5 deg and 20 cm of the truth, from
where refinement on the inliers goes on. Then what RANSAC pays: samples, and seconds, until a solved
sample without outliers was drawn with a probability of 99.9 %.
"""

from __future__ import annotations

import argparse
import time

import numpy as np

from rigcal.geometry import se3
from rigcal.geometry.shapes import plane_of_target, tangent_basis
from rigcal.graph.plane_line import from_planes_and_lines
from rigcal.testing.features import facing_boards

T_A_B = se3.transform(
    se3.rotation_from_rpy(np.array([0.06, -0.05, 0.5])), np.array([0.1, 0.5, 0.1])
)
HALF_LENGTH_M = 0.4
STARTS, NEWTON_STEPS = 24, 12
NEAR = np.radians(5.0), 0.2
OUTLIERS = (0.0, 0.2, 0.4, 0.6)


def draw(samples, size, sigma, rng):
    """Planes n_a (S, size, 3), d_a (S, size) and ends of lines in b (S, size, 2, 3), noisy."""
    T_a_t = facing_boards(samples * size, rng)
    n_a, d_a = plane_of_target(T_a_t)
    n_b, d_b = n_a @ T_A_B[:3, :3], d_a + n_a @ T_A_B[:3, 3]
    xy = np.hypot(n_b[:, 0], n_b[:, 1])
    across = np.column_stack([n_b[:, 0], n_b[:, 1], 0 * xy]) / xy[:, None]
    along = np.column_stack([-across[:, 1], across[:, 0], 0 * xy])
    foot = -(d_b / xy)[:, None] * across
    centre = se3.apply(se3.inverse(T_A_B), T_a_t[:, :3, 3])
    middle = foot + np.sum((centre - foot) * along, axis=1, keepdims=True) * along
    ends = middle[:, None] + np.array([-1.0, 1.0])[:, None] * HALF_LENGTH_M * along[:, None]
    ends = ends + rng.normal(0, sigma, (len(n_a), 2, 1)) * across[:, None]
    tilt = np.einsum("nij,nj->ni", tangent_basis(n_a), rng.normal(0, sigma, (len(n_a), 2)))
    noisy = se3.exp_so3(np.cross(n_a, tilt)) @ n_a[..., None]
    d = -np.sum(noisy[..., 0] * T_a_t[:, :3, 3], axis=1) + rng.normal(0, sigma, len(n_a))
    return (x.reshape(samples, size, *x.shape[1:]) for x in (noisy[..., 0], d, ends))


def minimal(n, d, ends, rng):
    """The product's solver."""
    return from_planes_and_lines(n, d, ends[:, :, 0], directions(ends))


def newton(n, d, ends, rng):
    """Newton's method on SO(3) for `n_i . R v_i = 0` from random rotations."""
    v, samples = directions(ends), len(n)
    R = np.tile(se3.rotation_from_quaternion(rng.normal(size=(STARTS, 4))), (samples, 1, 1))
    n, d, v, p = (np.repeat(x, STARTS, axis=0) for x in (n, d, v, ends[:, :, 0]))
    for _ in range(NEWTON_STEPS):
        f, J = np.einsum("sij,sij->si", n @ R, v), np.cross(v, n @ R)
        regular = np.abs(np.linalg.det(J)) > 1e-6
        step = np.zeros_like(f)
        step[regular] = -np.linalg.solve(J[regular], f[regular][..., None])[..., 0]
        length = np.linalg.norm(step, axis=1, keepdims=True)
        R = R @ se3.exp_so3(step * np.minimum(1, 0.7 / np.maximum(length, 1e-12)))
    found = np.abs(np.einsum("sij,sij->si", n @ R, v)).max(axis=1) < 1e-9
    found &= np.abs(np.linalg.det(n)) > 1e-3
    R, n, d, p = R[found], n[found], d[found], p[found]
    rhs = -d - np.einsum("sij,sij->si", n @ R, p)
    return se3.transform(R, np.linalg.solve(n, rhs[..., None])[..., 0])


def linear(n, d, ends, rng):
    """`n . (x r1 + y r2 + t) = -d` for both ends of five lines, then the nearest rotation."""
    p = np.concatenate([ends[..., :2], np.ones((*ends.shape[:-1], 1))], axis=-1)
    A = np.einsum("smki,smj->smkij", p, n).reshape(len(n), -1, 9)
    b = -np.repeat(d, 2, axis=1)
    x = np.einsum("sij,sj->si", np.linalg.pinv(A), b).reshape(-1, 3, 3)
    r1, r2, t = x[:, 0], x[:, 1], x[:, 2]
    R = se3.nearest_rotation(np.stack([r1, r2, np.cross(r1, r2)], axis=-1))
    return se3.transform(R, t)


def directions(ends):
    """Unit directions (S, m, 3) of lines with ends (S, m, 2, 3)."""
    v = ends[:, :, 1] - ends[:, :, 0]
    return v / np.linalg.norm(v, axis=-1, keepdims=True)


def measure(solve, size, samples, sigma):
    """Share of samples solved, s per sample, hypotheses per sample, median errors (rad, m)."""
    rng, hypotheses, seconds, best = np.random.default_rng(0), 0, 0.0, []
    parts = [list(draw(1, size, sigma, rng)) for _ in range(samples)]
    whole = [np.concatenate(x) for x in zip(*parts, strict=True)]
    solve(*(x[:10] for x in whole), rng)
    for chunk in np.array_split(np.arange(samples), max(1, samples // 100)):
        start = time.process_time()
        T = solve(*(x[chunk] for x in whole), rng)
        seconds, hypotheses = seconds + time.process_time() - start, hypotheses + len(T)
    for part in parts:
        T = solve(*part, rng)
        if len(T):
            e = se3.log(se3.inverse(T_A_B) @ T)
            angle, shift = np.linalg.norm(e[:, :3], axis=1), np.linalg.norm(e[:, 3:], axis=1)
            nearest = np.argmin(np.maximum(angle / NEAR[0], shift / NEAR[1]))
            best.append((angle[nearest], shift[nearest]))
    error = np.array(best)
    solved = np.all(error < NEAR, axis=1)
    return solved.sum() / samples, seconds / samples, hypotheses / samples, np.median(error, axis=0)


def main():
    """Print one table of single samples and one of RANSAC."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--samples", type=int, default=2000)
    parser.add_argument("--sigma-mm", type=float, default=3.0, help="noise; as many mrad of tilt")
    arguments = parser.parse_args()
    solvers = {"minimal": (minimal, 3), "newton": (newton, 3), "linear": (linear, 5)}
    for sigma in (0.0, arguments.sigma_mm / 1000):
        print(f"\n{arguments.samples} samples, noise {1000 * sigma:g} mm and mrad")
        print(f"{'':8} {'solved':>7} {'us':>7} {'roots':>6} {'deg':>8} {'mm':>8}")
        rows = {
            name: measure(solve, size, arguments.samples, sigma)
            for name, (solve, size) in solvers.items()
        }
        for name, (solved, seconds, roots, (angle, shift)) in rows.items():
            print(
                f"{name:8} {100 * solved:6.2f}% {1e6 * seconds:7.1f} {roots:6.2f} "
                f"{np.degrees(angle):8.4f} {1000 * shift:8.3f}"
            )
    print("\nRANSAC at that noise: samples (ms) by share of outliers")
    print(f"{'':8}" + "".join(f"{100 * share:16.0f}%" for share in OUTLIERS))
    for name, (solved, seconds, *_) in rows.items():
        size, cells = solvers[name][1], ""
        for share in OUTLIERS:
            good = min(solved * (1 - share) ** size, 1 - 1e-9)
            count = np.ceil(np.log(1e-3) / np.log1p(-good)) if good else np.inf
            cells += f"{count:8.0f} ({1000 * count * seconds:6.2f})"
        print(f"{name:8}{cells}")


if __name__ == "__main__":
    main()
