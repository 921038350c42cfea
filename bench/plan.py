"""Does `rigcal plan` keep its word? Prediction against outcome, at feature level.

    uv run python bench/plan.py [RIG] [--runs 10] [--recorded 15] [--jobs 1]

First, per sensor and number of exposures N: the predicted sigma, the median of the reported ones
and the rms of the actual errors over runs of N boards that cover the sensors' views (the
simulator's own draw, not the planner's). Then, over recordings of `--recorded` such boards: the
worst sigma reported before, after five proposed boards and after five at random of those that could
have been proposed, and what the plan promised. Hands miss a proposal by 0.1 m and 10 degrees.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from rigcal.errors import CalibrationError
from rigcal.estimation import calibrate
from rigcal.geometry import se3
from rigcal.planning import EXPOSURES, Sigma, plan
from rigcal.planning.candidates import draw_candidates
from rigcal.planning.result import worst
from rigcal.planning.site import Site
from rigcal.plugin.registry import Registry
from rigcal.rig import T_root_sensors, build_targets, load_rig
from rigcal.workers import in_order
from rigcal_sim.default import default_scenario
from rigcal_sim.features import observe_at, observe_boards

EXAMPLES = Path(__file__).parents[1] / "examples"
MISSED = np.array([np.radians(10.0)] * 3 + [0.1] * 3) / 2
RANDOM_DRAWS = 3


def setting(rig_path, exposures):
    """Registry, rig, and a scenario of so many boards that cover the views."""
    registry = Registry.from_entry_points()
    rig = load_rig(rig_path, registry)
    (target,) = build_targets(rig, registry).values()
    scenario = default_scenario(rig, registry, target)
    board = scenario.board.model_copy(update={"poses": exposures})
    return registry, rig, scenario.model_copy(update={"board": board})


def outcome(calibration, truth):
    """Per sensor: reported sigma, and actual errors (mm, deg)."""
    result = {}
    for name, sensor in calibration.sensors.items():
        if sensor.covariance is not None:
            v = np.diagonal(sensor.covariance)
            e = se3.log(se3.inverse(truth[name]) @ sensor.T_parent_sensor)
            sigma = Sigma(float(np.sqrt(v[3:].sum())), float(np.sqrt(v[:3].sum())))
            result[name] = (sigma, np.linalg.norm(e[3:]), np.linalg.norm(e[:3]))
    return result


def predicted_run(rig_path, exposures, seed):
    """Outcome of one recording; None where it is withheld."""
    registry, rig, scenario = setting(rig_path, exposures)
    seen = observe_boards(rig, registry, scenario, seed).observations
    try:
        return outcome(calibrate(rig, registry, seen, seed), T_root_sensors(rig))
    except CalibrationError:
        return None


def proposed_run(rig_path, exposures, seed):
    """Worst sigma before, promised, after the proposals, and after each of some random draws."""
    registry, rig, scenario = setting(rig_path, exposures)
    truth, rng = T_root_sensors(rig), np.random.default_rng([seed, 1])
    first = observe_boards(rig, registry, scenario, seed)
    result = plan(rig, registry, first.observations, seed=seed)

    def after(poses):
        boards = {f"more {k}": T @ se3.exp(rng.normal(0, MISSED)) for k, T in enumerate(poses)}
        more = observe_at(rig, registry, truth, boards, rng)
        try:
            found = outcome(calibrate(rig, registry, [*first.observations, *more], seed), truth)
        except CalibrationError:
            return np.inf
        return max(sigma.size for sigma, _, _ in found.values())

    site = Site.of(rig, registry, truth, result.boards)
    pool = draw_candidates(site, dict.fromkeys(rig.sensors, 12), rng)
    draws = [rng.permutation(len(pool))[:5] for _ in range(RANDOM_DRAWS)]
    return (
        worst(result.recorded),
        result.recorded[worst(result.recorded)].size,
        result.after[worst(result.after)].size,
        after([p.T_root_t for p in result.proposals]),
        [after([pool[i].T_root_t for i in draw]) for draw in draws],
    )


def main():
    """Run and print."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("rig", nargs="?", default=EXAMPLES / "husky.yaml", type=Path)
    parser.add_argument("--runs", type=int, default=10)
    parser.add_argument("--recorded", type=int, default=15)
    parser.add_argument("--jobs", type=int, default=1)
    arguments = parser.parse_args()
    print_predictions(arguments)
    print_proposals(arguments)


def print_predictions(arguments):
    """Predicted, reported and actual, and over all the ratio of reported to predicted."""
    registry, rig, _ = setting(arguments.rig, 1)
    predicted = plan(rig, registry).predicted
    columns = ("predicted", "reported", "actual rms")
    print(f"{'N':>3} {'sensor':10}" + "".join(f"{c + ' mm, deg':>24}" for c in columns))
    for n in EXPOSURES:
        runs = list(
            in_order(
                lambda fixed, seed: predicted_run(*fixed, seed),
                (arguments.rig, n), range(arguments.runs), arguments.jobs,
            )
        )  # fmt: skip
        good = [run for run in runs if run is not None]
        ratios = []
        for name, sigma in predicted[n].items() if good else ():
            reported = [run[name][0] for run in good]
            t, r = (np.median([getattr(s, k) for s in reported]) for k in vars(sigma))
            cells = [(sigma.translation_m, sigma.rotation_rad), (t, r)]
            cells.append(np.sqrt(np.mean([np.square(run[name][1:]) for run in good], axis=0)))
            print(f"{n:3} {name:10}" + "".join(cell(*pair) for pair in cells))
            ratios += [t / sigma.translation_m, r / sigma.rotation_rad]
        known = np.array([r for r in ratios if 0 < r < np.inf])
        withheld = f"{len(runs) - len(good)} of {len(runs)} recordings withheld\n"
        if not len(known):
            print(f"{n:3} {withheld}")
            continue
        print(
            f"{n:3} reported / predicted: median {np.median(known):.2f}, "
            f"{known.min():.2f} to {known.max():.2f}; {withheld}"
        )


def cell(metres, radians):
    """Both numbers as millimetres and degrees."""
    return f"{1e3 * metres:14.3f}, {np.degrees(radians):.4f}"


def print_proposals(arguments):
    """Worst sigmas in units of 20 mm and 0.5 deg."""
    print(f"{arguments.recorded} boards recorded; the worst sigma by 20 mm and 0.5 deg, 1: weak")
    print(f"{'run':>3} {'worst':10}{'before':>9}{'promised':>9}{'5 more':>9}   5 at random")
    runs = list(
        in_order(
            lambda fixed, seed: proposed_run(*fixed, seed),
            (arguments.rig, arguments.recorded), range(arguments.runs), arguments.jobs,
        )
    )  # fmt: skip
    for seed, (name, before, promised, after, at_random) in enumerate(runs):
        shown = "  ".join(f"{value:.4f}" for value in at_random)
        print(f"{seed:3} {name:10}{before:9.4f}{promised:9.4f}{after:9.4f}   {shown}")
    after = np.array([run[3] for run in runs])
    at_random = np.array([np.median(run[4]) for run in runs])
    promised = np.array([run[2] for run in runs])
    print(
        f"after five proposals the worst sigma is {np.median(after / at_random):.2f} times that "
        f"after five at random (median over runs); smaller in {np.sum(after < at_random)} of "
        f"{len(runs)}; {np.median(after / promised):.2f} times what was promised"
    )


if __name__ == "__main__":
    main()
