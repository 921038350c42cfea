"""Is the reported covariance true? NEES over seeded runs at feature level.

    uv run python bench/nees.py [RIG SCENARIO] [--runs 50]

Every run draws boards and noise anew, lets each sensor observe without a detector's flaws, and
calibrates. The normalised estimation error squared of a sensor has mean 6 if its covariance is
true; the mean over n runs lies in chi2(6 n) / n (Bar-Shalom, Li, Kirubarajan 2001, 5.4.2).
"""

from __future__ import annotations

import argparse
import os
from pathlib import Path

import numpy as np
from scipy.stats import chi2

import rigcal_sim
from rigcal.estimation import calibrate
from rigcal.geometry import se3
from rigcal.plugin.registry import Registry
from rigcal.rig import T_root_sensors, load_rig
from rigcal.workers import in_order
from rigcal_sim.features import observe_boards
from rigcal_sim.scenario_file import load_scenario

DEMO = Path(rigcal_sim.__file__).parent / "demo"


def run(rig_path, scenario_path, seed):
    """Per sensor: NEES, squared errors and variances of rotation and translation, inliers."""
    registry = Registry.from_entry_points()
    rig = load_rig(rig_path, registry)
    scenario = load_scenario(scenario_path, rig, registry)
    seen = observe_boards(rig, registry, scenario, seed).observations
    calibration = calibrate(rig, registry, seen, seed=seed)
    truth = T_root_sensors(rig)
    rows = {}
    for name, sensor in calibration.sensors.items():
        if sensor.covariance is None:
            continue
        e = se3.log(se3.inverse(sensor.T_parent_sensor) @ truth[name])
        v = np.diagonal(sensor.covariance)
        nees = e @ np.linalg.solve(sensor.covariance, e)
        rows[name] = [nees, e[:3] @ e[:3], e[3:] @ e[3:], v[:3].sum(), v[3:].sum(), sensor.inliers]
    wrong = [r for r in calibration.rejected if r.reason != "not in view"]
    return rows, len(wrong)


def main():
    """Print one row per sensor, then one per type with the interval of its mean."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("rig", nargs="?", default=DEMO / "rig.yaml", type=Path)
    parser.add_argument("scenario", nargs="?", default=DEMO / "scenario.yaml", type=Path)
    parser.add_argument("--runs", type=int, default=50)
    arguments = parser.parse_args()
    files, seeds = (arguments.rig, arguments.scenario), range(arguments.runs)
    jobs = os.cpu_count() or 1
    runs = list(in_order(lambda files, seed: run(*files, seed), files, seeds, jobs))
    rig = load_rig(arguments.rig, Registry.from_entry_points())
    n = arguments.runs
    print(f"{n} runs; mean NEES of one sensor is in {interval(n)} in 95 % of the cases")
    print(
        f"{'sensor':10} {'NEES':>6} {'rms mm':>8} {'sigma mm':>8} {'rms deg':>9} {'sigma deg':>9}"
    )
    kinds = {}
    for name, config in rig.sensors.items():
        if name == rig.root:
            continue
        table = np.array([rows[name] for rows, _ in runs])
        kinds.setdefault(config.type, []).append(table[:, 0])
        nees, rot, trans, rot_var, trans_var, _ = table.mean(axis=0)
        mm, degrees = 1000 * np.sqrt([trans, trans_var]), np.degrees(np.sqrt([rot, rot_var]))
        print(
            f"{name:10} {nees:6.2f} {mm[0]:8.3f} {mm[1]:8.3f} {degrees[0]:9.4f} {degrees[1]:9.4f}"
        )
    for kind, values in kinds.items():
        # The sensors of a run share the root's error: they count as one.
        low, high = np.array(chi2.interval(0.95, 6 * n)) / n
        mean = float(np.mean(values))
        verdict = "inside" if low <= mean <= high else "OUTSIDE"
        print(
            f"type {kind}: mean NEES {mean:.2f}, 95 % interval [{low:.2f}, {high:.2f}]: {verdict}"
        )
    print(f"observations rejected though true: {sum(wrong for _, wrong in runs)}")


def interval(n):
    """The 95 % interval of the mean of n NEES values of 6 degrees of freedom, in words."""
    low, high = np.array(chi2.interval(0.95, 6 * n)) / n
    return f"[{low:.2f}, {high:.2f}]"


if __name__ == "__main__":
    main()
