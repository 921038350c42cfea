"""Is the reported covariance true? NEES and coverage over seeded runs at feature level.

    uv run python bench/nees.py [RIG SCENARIO] [--runs 50] [--jobs 2] [--stated 1.0]
                                   [--root SENSOR]

Every run draws boards and noise anew, lets each sensor observe without a detector's flaws, and
calibrates. The normalised estimation error squared of a sensor has mean 6 if its covariance is
true; the mean over n runs lies in chi2(6 n) / n (Bar-Shalom, Li, Kirubarajan 2001, 5.4.2). Its
distribution is chi2(6): the 50, 90 and 95 % ellipsoids contain the truth in that share of the runs.
`--stated 2` calibrates with a rig file whose every sigma is twice what the sensors' noise is. The
root has no covariance: `--root` takes another sensor for it, so that the rig's own is judged too.
"""

from __future__ import annotations

import argparse
import json
from dataclasses import replace
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


LEVELS = (0.5, 0.9, 0.95)


def run(rig_path, scenario_path, stated, root, seed):
    """Per sensor: NEES, squared errors and variances of rotation and translation, inliers."""
    registry = Registry.from_entry_points()
    rig = load_rig(rig_path, registry)
    scenario = load_scenario(scenario_path, rig, registry)
    seen = observe_boards(rig, registry, scenario, seed).observations
    rig = replace(rig, root=root or rig.root)
    if stated != 1:
        seen = [restated(o, stated) for o in seen]
    calibration = calibrate(misstating(rig, stated), registry, seen, seed=seed)
    truth = T_root_sensors(rig)
    rows = {}
    for name, sensor in calibration.sensors.items():
        if sensor.covariance is None:
            continue
        e = se3.log(se3.inverse(sensor.T_parent_sensor) @ truth[name])
        v = np.diagonal(sensor.covariance)
        nees = e @ np.linalg.solve(sensor.covariance, e)
        rows[name] = [nees, e[:3] @ e[:3], e[3:] @ e[3:], v[:3].sum(), v[3:].sum()]
    wrong = [r for r in calibration.rejected if r.reason != "not in view"]
    return rows, len(wrong)


def misstating(rig, stated):
    """The rig, every sigma in its file multiplied."""
    return replace(rig, sensors={name: noisier(c, stated) for name, c in rig.sensors.items()})


def noisier(config, stated):
    """A sensor's config, every sigma in it multiplied."""
    sigmas = [name for name in type(config).model_fields if name.startswith("sigma_")]
    return config.model_copy(update={name: stated * getattr(config, name) for name in sigmas})


def restated(observation, stated):
    """The observation with the covariance that a detector derives from those sigmas."""
    candidates = tuple(
        replace(c, geometry=replace(c.geometry, covariance=stated**2 * c.geometry.covariance))
        for c in observation.candidates
    )
    return replace(observation, candidates=candidates)


def main():
    """Print one row per sensor, then one per type with the interval of its mean."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("rig", nargs="?", default=DEMO / "rig.yaml", type=Path)
    parser.add_argument("scenario", nargs="?", default=DEMO / "scenario.yaml", type=Path)
    parser.add_argument("--runs", type=int, default=50)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--stated", type=float, default=1.0, help="stated sigma over true sigma")
    parser.add_argument("--root", help="sensor that the tree hangs from")
    parser.add_argument("--json", type=Path, help="file for every run's NEES")
    arguments = parser.parse_args()
    n = arguments.runs
    given = (arguments.rig, arguments.scenario, arguments.stated, arguments.root)
    runs = list(in_order(lambda given, seed: run(*given, seed), given, range(n), arguments.jobs))
    rig = load_rig(arguments.rig, Registry.from_entry_points())
    print(f"{n} runs, stated sigma {arguments.stated:g} times the true one")
    print(f"mean NEES of one sensor is in {interval(n)} in 95 % of the cases")
    print(f"{'sensor':10} {'NEES':>6}{shares()} {'rms / sigma mm':>16} {'rms / sigma deg':>18}")
    kinds = {}
    for name in runs[0][0]:
        table = np.array([rows[name] for rows, _ in runs])
        kinds.setdefault(rig.sensors[name].type, []).append(table[:, 0])
        print_sensor(name, table)
    for kind, values in kinds.items():
        print_kind(kind, np.array(values))
    print(f"observations rejected though true: {sum(wrong for _, wrong in runs)}")
    if arguments.json:
        nees = {name: [rows[name][0] for rows, _ in runs] for name in runs[0][0]}
        arguments.json.write_text(json.dumps(nees))


def print_sensor(name, table):
    """NEES, coverage, and rms errors beside the reported sigmas."""
    _, rotation, translation, rotation_var, translation_var = table.mean(axis=0)
    mm = 1000 * np.sqrt([translation, translation_var])
    deg = np.degrees(np.sqrt([rotation, rotation_var]))
    print(
        f"{name:10} {table[:, 0].mean():6.2f}{shares(table[:, 0])}"
        f"  {mm[0]:7.3f} {mm[1]:7.3f}   {deg[0]:8.4f} {deg[1]:8.4f}"
    )


def print_kind(kind, values):
    """Mean NEES and coverage of the sensors of a type, values (sensors, runs)."""
    n = values.shape[1]
    # The sensors of a run share the root's error: they count as one.
    low, high = np.array(chi2.interval(0.95, 6 * n)) / n
    verdict = "inside" if low <= values.mean() <= high else "OUTSIDE"
    print(f"type {kind}: mean NEES {values.mean():.2f} ({verdict}), contained{shares(values)}")


def shares(nees=None):
    """How many per cent of the runs each ellipsoid contains; their names without runs."""
    if nees is None:
        return "".join(f"{100 * level:6.0f} %" for level in LEVELS)
    return "".join(f"{100 * np.mean(nees <= chi2.ppf(level, 6)):6.1f} %" for level in LEVELS)


def interval(n):
    """The 95 % interval of the mean of n NEES values of 6 degrees of freedom, in words."""
    low, high = np.array(chi2.interval(0.95, 6 * n)) / n
    return f"[{low:.2f}, {high:.2f}]"


if __name__ == "__main__":
    main()
