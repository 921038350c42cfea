"""How near the estimates come to the Cramer-Rao bound, at feature level.

    uv run python bench/efficiency.py [RIG SCENARIO] [--runs 100] [--jobs 1] [--json FILE]

Every run draws boards and noise anew and estimates the sensors from the same observations by the
tree of pairs, by the graph of MSG-Cal and by the joint estimate. Printed per sensor: rms errors,
the bound, and errors over the bound with two standard deviations of chance; and the graph error of
the three.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

import numpy as np

from rigcal.estimation import finish, pairwise_calibration, prepare
from rigcal.geometry import se3
from rigcal.graph.bound import cramer_rao_bound, efficiency
from rigcal.graph.method import Method
from rigcal.graph.msgcal import graph_error_m2
from rigcal.plugin.registry import Registry
from rigcal.rig import T_root_sensors, load_rig
from rigcal.workers import in_order
from rigcal_sim.features import observe_boards
from rigcal_sim.scenario_file import load_scenario

EXAMPLES = Path(__file__).parents[1] / "examples"
METHODS = ("pairwise", "msgcal", "joint")


def run(rig_path, scenario_path, seed):
    """Per sensor: the bound, and the error by each method; the graph error of each method."""
    registry = Registry.from_entry_points()
    rig = load_rig(rig_path, registry)
    features = observe_boards(rig, registry, load_scenario(scenario_path, rig, registry), seed)
    stages = prepare(rig, registry, features.observations, seed)
    truth = T_root_sensors(rig)
    bounds = cramer_rao_bound(stages.task, truth, features.T_root_t)
    results = {"pairwise": pairwise_calibration(stages)}
    results |= {name: finish(stages, Method(name)) for name in ("msgcal", "joint")}
    graph, errors, graph_errors = stages.graph(), {}, {}
    for method, calibration in results.items():
        T = {s: calibration.T(rig.root, s) for s in rig.sensors}
        graph_errors[method] = graph_error_m2(graph, T)
        errors[method] = {s: se3.log(se3.inverse(truth[s]) @ T[s]) for s in bounds}
    return bounds, errors, graph_errors


def main():
    """Run and print."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("rig", nargs="?", default=EXAMPLES / "husky.yaml", type=Path)
    scenario = EXAMPLES / "husky_scenario.yaml"
    parser.add_argument("scenario", nargs="?", default=scenario, type=Path)
    parser.add_argument("--runs", type=int, default=100)
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--json", type=Path, help="file for the ratios")
    arguments = parser.parse_args()
    files, seeds = (arguments.rig, arguments.scenario), range(arguments.runs)
    runs = list(in_order(lambda files, seed: run(*files, seed), files, seeds, arguments.jobs))
    print(f"{len(runs)} runs; ratios are rms error / Cramer-Rao bound, +- two standard deviations")
    print_errors(runs)
    ratios = print_ratios(runs)
    for method in METHODS:
        values = 1e6 * np.array([graph_errors[method] for _, _, graph_errors in runs])
        print(f"graph error of {method:8}: {values.mean():8.2f} +- {values.std():.2f} mm^2")
    if arguments.json:
        arguments.json.write_text(json.dumps(ratios, indent=1))


def print_errors(runs):
    """Rms errors in mm and deg per sensor and method, and the bound."""
    print(f"\n{'':10}" + "".join(f"{m:>20}" for m in (*METHODS, "bound")))
    print(f"{'sensor':10}" + f"{'mm':>11}{'deg':>9}" * 4)
    for s in runs[0][0]:
        C = np.mean([np.diagonal(bounds[s]) for bounds, _, _ in runs], axis=0)
        squares = [np.mean([errors[m][s] ** 2 for _, errors, _ in runs], axis=0) for m in METHODS]
        cells = [
            f"{1e3 * np.sqrt(v[3:].sum()):11.3f}{np.degrees(np.sqrt(v[:3].sum())):9.4f}"
            for v in (*squares, C)
        ]
        print(f"{s:10}" + "".join(cells))


def print_ratios(runs):
    """Efficiency per sensor and method; returns it as plain numbers."""
    parts = ("translation", "rotation", "pose")
    print(f"\n{'sensor':10}{'method':10}" + "".join(f"{p:>18}" for p in parts))
    table = {}
    for s in runs[0][0]:
        bounds = np.stack([b[s] for b, _, _ in runs])
        for method in METHODS:
            result = efficiency(np.stack([errors[method][s] for _, errors, _ in runs]), bounds)
            ratios = [getattr(result, part) for part in parts]
            cells = "".join(f"{r.value:10.3f} +- {2 * r.deviation:.3f}" for r in ratios)
            print(f"{s:10}{method:10}{cells}")
            table.setdefault(s, {})[method] = {
                p: vars(r) for p, r in zip(parts, ratios, strict=True)
            }
    print()
    return table


if __name__ == "__main__":
    main()
