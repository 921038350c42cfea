"""Camera-only bundle adjustment: rigcal against pycolmap, OpenCV and mrcal on the same corners.

    uv run --with pycolmap python bench/camera_workload.py [--repeats 7] [--seeds 3]

Five cameras 72 degrees apart, 120 board poses, 0.2 px, intrinsics known. Three figures each:

solve      median seconds of the optimiser, from the same first poses. rigcal: `joint.solve`, edges
           stacked inside it; pycolmap: `BundleAdjuster.solve`, its structures filled before;
           OpenCV: the calls of `stereoCalibrate`; mrcal: `mrcal.optimize`
process    median seconds of a new process: imports, first poses from the corners, solve. "rigcal,
           everything" is what `rigcal calibrate` does: pairs, spanning tree, robust stage, noise
           scales, inliers, covariances
rms/bound  rms of translation and rotation errors of the four free cameras over the seeds, by the
           Cramer-Rao bound

Contenders that are not installed are named and left out. mrcal is a Debian package:
`apt-get install mrcal python3-mrcal`.
"""

from __future__ import annotations

import argparse
import importlib.util
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from camera import contenders
from camera.problem import (
    CAMERA,
    CAMERAS,
    COLUMNS,
    ROWS,
    SQUARE_M,
    bound,
    first_poses,
    intrinsics,
    load_views,
    make_rig,
    make_views,
    save_views,
    squared_errors,
)

from rigcal.geometry import se3

SYSTEM_PYTHON = Path("/usr/bin/python3")
MRCAL = Path(__file__).parent / "camera" / "mrcal_solve.py"


def main():
    """Print the table, or solve once for `--only` (the timed process)."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--repeats", type=int, default=7)
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--only", nargs=2, metavar=("NAME", "VIEWS"), help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    p_t, K = make_rig()[1].points, intrinsics()
    if arguments.only:
        name, views = arguments.only
        contenders.whole(name, load_views(views), p_t, K)
        return
    names = [*contenders.SOLVERS, "rigcal, everything"]
    if importlib.util.find_spec("pycolmap") is None:
        print("pycolmap is not installed: run with `uv run --with pycolmap`")
        names.remove("pycolmap")
    squares = {name: [] for name in names}
    bounds, seconds, processes = [], {}, {}
    with tempfile.TemporaryDirectory() as folder:
        for seed in range(arguments.seeds):
            views = make_views(seed)
            bounds.append(bound(views, seed))
            first = first_poses(views, p_t, K)
            for name in names:
                T, _ = solve(name, views, p_t, K, first)
                squares[name].append(squared_errors(T, seed))
            T, times = solve_mrcal(Path(folder), views, p_t, K, first, arguments.repeats)
            if times is not None:
                squares.setdefault("mrcal", []).append(squared_errors(T, seed))
            if seed == 0:
                path = Path(folder) / "views.npz"
                save_views(path, views)
                corners = sum(len(v.index) for v in views)
                print(f"{len(views)} views, {corners} corners, {len(first[1])} boards")
                # In turns, so that all meet the same load of the machine.
                for _ in range(arguments.repeats):
                    for name in names:
                        seconds.setdefault(name, []).append(solve(name, views, p_t, K, first)[1])
                        processes.setdefault(name, []).append(run(name, path))
                if times is not None:
                    seconds["mrcal"] = times
    print_table(squares, np.array(bounds), seconds, processes)


def solve(name, views, p_t, K, first):
    """`T_cam0_cam` and the solver's seconds."""
    if name in contenders.SOLVERS:
        return contenders.SOLVERS[name](views, p_t, K, *first)
    start = time.perf_counter()
    return contenders.whole_rigcal(views), time.perf_counter() - start


def run(name, views):
    """Seconds of a new process that solves the views."""
    start = time.perf_counter()
    subprocess.run([sys.executable, __file__, "--only", name, views], check=True)
    return time.perf_counter() - start


def solve_mrcal(folder, views, p_t, K, first, repeats):
    """`T_cam0_cam` and seconds by mrcal in the system's Python; None if it is not installed."""
    found = [SYSTEM_PYTHON, "-c", "import mrcal"]
    if not SYSTEM_PYTHON.exists() or subprocess.run(found, capture_output=True).returncode:
        print("mrcal is not installed: apt-get install mrcal python3-mrcal")
        return None, None
    origin = p_t.min(axis=0)
    cell = np.round((p_t - origin)[:, :2] / SQUARE_M).astype(int)
    grids = np.full((len(views), ROWS, COLUMNS, 3), -1.0)
    boards = sorted(first[1])
    number = {b: i for i, b in enumerate(boards)}
    for grid, v in zip(grids, views, strict=True):
        column, row = cell[v.index].T
        grid[row, column] = np.column_stack([v.uv, np.ones(len(v.uv))])
    T_t_grid = se3.transform(np.eye(3), origin)
    np.savez(
        folder / "mrcal.npz",
        grids=grids,
        ends=[[v.camera, number[v.board]] for v in views],
        K=K,
        square=SQUARE_M,
        size=[CAMERA["width_px"], CAMERA["height_px"]],
        T_cam_cam0=se3.inverse(first[0]),
        T_cam0_grid=np.stack([first[1][b] for b in boards]) @ T_t_grid,
    )
    command = [SYSTEM_PYTHON, MRCAL, folder / "mrcal.npz", folder / "result.npz", str(repeats)]
    subprocess.run(command, check=True, capture_output=True)
    with np.load(folder / "result.npz") as result:
        return se3.inverse(result["T_cam_cam0"]), list(result["seconds"])


def print_table(squares, bounds, seconds, processes):
    """One row per contender."""
    seeds = len(bounds)
    rotation, translation = np.sqrt(bounds.mean(axis=0) / (CAMERAS - 1))
    print(
        f"bound: {1000 * translation:.4f} mm, {np.degrees(rotation):.5f} deg rms per camera; "
        f"{seeds} seeds"
    )
    print(f"{'':20} {'solve s':>9} {'process s':>10} {'transl./bound':>14} {'rot./bound':>11}")
    for name, errors in squares.items():
        ratio = np.sqrt(np.sum(errors, axis=0) / np.sum(bounds, axis=0))
        process = f"{np.median(processes[name]):10.2f}" if name in processes else f"{'-':>10}"
        print(
            f"{name:20} {np.median(seconds[name]):9.3f} {process} {ratio[1]:14.3f} {ratio[0]:11.3f}"
        )


if __name__ == "__main__":
    main()
