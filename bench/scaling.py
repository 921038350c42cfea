"""How long the global stage takes, and how it grows with exposures and sensors.

    uv run python bench/scaling.py [--exposures 30 120 480 1920] [--sensors 2 8 32] [--husky]

The global stage is `rigcal.graph.solve.estimate`: robust stage, rounds of noise scales and inliers,
covariances. Observations are those of flawless detectors with the configured noise; it starts a few
millimetres and tenths of a degree off, as after the pairwise stage. Every case runs in a process of
its own, which tells its largest memory. `--husky` adds the stages of `rigcal calibrate` for the rig
of examples/husky.yaml with its 120 exposures.
"""

from __future__ import annotations

import argparse
import json
import resource
import subprocess
import sys
import time
from pathlib import Path

import numpy as np

from rigcal.estimation import calibrate
from rigcal.geometry import se3
from rigcal.graph.edge import SensorTargetEdge
from rigcal.graph.solve import estimate
from rigcal.plugin.registry import Registry
from rigcal.residual import residual_of
from rigcal.rig import build_targets, load_rig, parse_rig

EXAMPLES = Path(__file__).parent.parent / "examples"
BOARD = {
    "type": "apriltag_grid",
    "family": "tag36h11",
    "columns": 6,
    "rows": 4,
    "tag_size_m": 0.15,
    "tag_gap_m": 0.04,
    "width_m": 1.2,
    "height_m": 0.9,
}
CAMERA = {
    "type": "camera",
    "width_px": 1232,
    "height_px": 1024,
    "focal_px": [600.0, 600.0],
    "principal_px": [615.5, 511.5],
    "sigma_px": 0.1,
}
SCANNER = {
    "type": "lrf2d",
    "angle_min_deg": -135.0,
    "angle_max_deg": 135.0,
    "angle_step_deg": 0.25,
    "range_max_m": 30.0,
    "sigma_m": 0.01,
}
LIDAR = {
    "type": "lrf3d",
    "scan": {
        "pattern": "multibeam",
        "elevations_deg": [*range(-15, 17, 2)],
        "azimuth_step_deg": 0.4,
    },
    "sigma_m": 0.01,
}


def main():
    """Print a row per case, or run one of them."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--exposures", type=int, nargs="+", default=[30, 120, 480, 1920])
    parser.add_argument("--sensors", type=int, nargs="+", default=[2, 8, 32])
    parser.add_argument("--husky", action="store_true")
    parser.add_argument("--only", type=int, nargs=2, help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.only:
        print(json.dumps(run(*arguments.only)))
        return
    if arguments.husky:
        print_husky()
    print(f"{'sensors':>7} {'exposures':>9} {'edges':>7} {'global s':>9} {'ms/edge':>8} {'MB':>6}")
    for sensors in arguments.sensors:
        for exposures in arguments.exposures:
            command = [sys.executable, __file__, "--only", str(sensors), str(exposures)]
            done = subprocess.run(command, check=False, capture_output=True, text=True)
            if done.returncode:
                problem = done.stderr.strip().splitlines()[-1]
                print(f"{sensors:7} {exposures:9} {problem[:80]}", flush=True)
                continue
            edges, seconds, megabytes = json.loads(done.stdout)
            each = 1000 * seconds / edges
            print(
                f"{sensors:7} {exposures:9} {edges:7} {seconds:9.2f} {each:8.2f} {megabytes:6.0f}",
                flush=True,
            )


def run(sensors, exposures):
    """Edges, seconds of the global stage, largest memory in MB."""
    edges, T_root, boards = problem(sensors, exposures, np.random.default_rng(0))
    start = time.perf_counter()
    estimate(edges, T_root, boards, frozenset({"sensor0"}))
    seconds = time.perf_counter() - start
    return len(edges), seconds, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def problem(sensors, exposures, rng):
    """Edges and first poses of a rig of one 3D laser, and cameras and scanners all around it."""
    registry = Registry.from_entry_points()
    configs = {
        f"sensor{i}": (LIDAR if i == 0 else SCANNER if i % 3 == 0 else CAMERA) | {"topic": str(i)}
        for i in range(sensors)
    }
    rig = {"version": 1, "root": "sensor0", "targets": {"board": BOARD}, "sensors": configs}
    rig = parse_rig(rig, registry)
    target = build_targets(rig, registry)["board"]
    kinds = {name: registry.sensor_type(c.type) for name, c in rig.sensors.items()}
    T_root = {name: pose(i, c.type, sensors) for i, (name, c) in enumerate(rig.sensors.items())}
    boards = {str(k): T for k, T in enumerate(board_poses(exposures, rng))}
    edges = []
    for exposure, T_root_t in boards.items():
        own = []
        for name, config in rig.sensors.items():
            T_s_t = se3.inverse(T_root[name]) @ T_root_t
            candidate = kinds[name].observe(T_s_t, config, target, rng)
            if candidate is not None:
                residual = residual_of(kinds[name], candidate, config, target)
                own.append(SensorTargetEdge(name, exposure, residual))
        edges.extend(own if len(own) > 1 else [])
    used = {e.exposure for e in edges}
    off = {name: T @ se3.exp(rng.normal(0, 3e-3, 6)) for name, T in T_root.items()}
    off["sensor0"] = T_root["sensor0"]
    return (
        edges,
        off,
        {k: T @ se3.exp(rng.normal(0, 3e-3, 6)) for k, T in boards.items() if k in used},
    )


def pose(number, kind, count):
    """`T_root_s`: sensors in a ring, each looks outwards; every other scanner leans."""
    if number == 0:
        return np.eye(4)
    yaw = 2 * np.pi * number / max(count - 1, 1)
    place = np.array([0.3 * np.cos(yaw), 0.3 * np.sin(yaw), -0.1])
    camera = np.array([-np.pi / 2, 0.0, yaw - np.pi / 2])
    scanner = np.array([0.5 * (-1) ** number, 0.1, yaw])
    return se3.transform(se3.rotation_from_rpy(camera if kind == "camera" else scanner), place)


def board_poses(count, rng):
    """(count, 4, 4) boards at any bearing that face the rig, tilted by up to 35 degrees."""
    bearing = rng.uniform(-np.pi, np.pi, count)
    facing = np.stack([0 * bearing + np.pi / 2, 0 * bearing, bearing - np.pi / 2], axis=1)
    tilt = se3.rotation_from_rpy(np.radians(rng.uniform(-35, 35, (count, 3))))
    radius, height = rng.uniform(1.6, 2.3, count), rng.uniform(-0.3, 0.1, count)
    place = np.stack([radius * np.cos(bearing), radius * np.sin(bearing), height], axis=1)
    return se3.transform(se3.rotation_from_rpy(facing) @ tilt, place)


def print_husky():
    """Seconds of every stage of `calibrate` for the seed's rig."""
    from rigcal_sim.features import observe_boards
    from rigcal_sim.scenario_file import load_scenario

    registry = Registry.from_entry_points()
    rig = load_rig(EXAMPLES / "husky.yaml", registry)
    scenario = load_scenario(EXAMPLES / "husky_scenario.yaml", rig, registry)
    seen = observe_boards(rig, registry, scenario, 0).observations
    marks = [("", time.perf_counter())]

    def progress(stage, done, total):
        marks.append((stage, time.perf_counter()))

    calibrate(rig, registry, seen, progress=progress)
    total = time.perf_counter() - marks[0][1]
    stages = {stage: [t for name, t in marks if name == stage] for stage, _ in marks[1:]}
    count = sum(bool(o.candidates) for o in seen)
    print(f"husky: {len(rig.sensors)} sensors, 120 exposures, {count} observations")
    for stage, times in stages.items():
        print(f"  {stage:20} {times[-1] - times[0]:7.2f} s")
    print(f"  {'calibrate, in all':20} {total:7.2f} s")


if __name__ == "__main__":
    main()
