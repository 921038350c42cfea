"""Exposures by stillness over many seeds, from features: the rig of MSG-Cal, no images, no clouds.

    uv run python bench/association_features.py [--poses 36] [--runs 1] [--tremor 1]

The board is carried as bench/association.py has it; every sensor reports what a flawless detector
would at each frame, misses the board in one frame of ten, and lasers also see a cabinet that never
moves. The same poses without tremor, one frame of each, are the measure.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from time import process_time

import numpy as np

from rigcal.association.continuous import first_look, more_frames, still_exposures
from rigcal.association.gathering import still_observations
from rigcal.calibration import Calibration, SensorResult
from rigcal.estimation import calibrate
from rigcal.evaluation import evaluate
from rigcal.exposures import FrameStamp
from rigcal.frames import DetectedFrame, Stream
from rigcal.geometry import se3
from rigcal.observation import Detection, Observation
from rigcal.plugin.registry import Registry
from rigcal.rig import T_root_sensors, build_targets, load_rig
from rigcal.visibility import spots_in_view
from rigcal_sim.carry import tour
from rigcal_sim.plan import plan_shots
from rigcal_sim.sampling import sample_board_poses
from rigcal_sim.scenario import ScenarioConfig
from rigcal_sim.scenario_file import sensor_effects
from rigcal_sim.sight import sensor_poses

EXAMPLES = Path(__file__).parents[1] / "examples"
MISSED = 0.1
CABINET = se3.transform(se3.exp_so3(np.array([np.pi / 2, 0.0, 0.0])), np.array([0.9, -2.6, -0.2]))
"""`T_w_t` of a surface as large as the board."""


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--poses", type=int, default=36)
    parser.add_argument("--runs", type=int, default=1)
    parser.add_argument("--tremor", type=float, default=1.0, help="of hands; 0: a stand")
    options = parser.parse_args()
    runs = [Run(options.poses, options.tremor, seed) for seed in range(options.runs)]
    rows = {name: np.array([run.errors[name] for run in runs]) for name in runs[0].errors}
    print("\nrms over runs, mm / deg, NEES / 6 (1 if the covariance is true)")
    for name in runs[0].sensors:
        i = runs[0].sensors.index(name)
        cells = []
        for values in rows.values():
            mm, deg, nees = values[:, i].T
            cells.append(f"{rms(mm):8.3f} / {rms(deg):.4f}, {np.mean(nees):5.2f}")
        print(f"{name:9}" + "".join(f"{cell:>34}" for cell in cells))
    print(" " * 9 + "".join(f"{name:>34}" for name in rows))


class Run:
    """One recording of a seed: exposures, frames, errors."""

    def __init__(self, poses, tremor, seed):
        self.registry = Registry.from_entry_points()
        self.rig = load_rig(EXAMPLES / "husky.yaml", self.registry)
        (self.target,) = build_targets(self.rig, self.registry).values()
        self.scenario = scenario(self.rig, poses, tremor)
        self.T_w_s = sensor_poses(self.rig, self.scenario)
        self.rng = np.random.default_rng(seed)
        boards = sample_board_poses(self.rig, self.registry, self.target, self.scenario, seed)
        T_w_t = boards.T_w_t[tour(boards.T_w_t)]
        effects = sensor_effects(self.scenario, self.rig, self.registry)
        plan = plan_shots(self.rig, self.scenario, effects, T_w_t, seed)
        self.shots = {s: [x for x in plan.shots if x.sensor == s] for s in self.rig.sensors}
        self.sensors = [s for s in self.rig.sensors if s != self.rig.root]
        started = process_time()
        observations, exposures = self.continuous()
        took = process_time() - started
        names = [self.hold_at(e, plan.holds) for e in exposures]
        used = sum(len(o.frames) for o in observations if o.candidates)
        print(
            f"seed {seed}: {len(T_w_t)} exposures simulated, {len(set(names) - {None})} found, "
            f"{names.count(None)} elsewhere; {sum(map(len, self.shots.values()))} frames recorded, "
            f"{self.looked_at} looked at, {used} combined; {took:.0f} s",
            flush=True,
        )
        self.errors = {
            "frames combined": self.evaluated(observations),
            "one frame of each hold": self.evaluated(self.one_of_each(plan.holds)),
            "one frame, board at rest": self.evaluated(self.at_rest(T_w_t)),
        }

    def continuous(self):
        streams = {s: self.stream(s) for s in self.rig.sensors}
        chosen = {s: first_look(x.times_ns) for s, x in streams.items()}
        frames = [self.frame(s, i) for s, own in chosen.items() for i in own]
        exposures = still_exposures(self.rig, streams, frames)
        assert exposures is not None, "the recording is not taken for a continuous one"
        more = more_frames(exposures, frames)
        frames += [self.frame(s, i) for s, own in more.items() for i in own]
        self.looked_at = len(frames)
        frames.sort(key=lambda f: (list(streams).index(f.stamp.sensor), f.stamp.index))
        return still_observations(exposures, streams, frames), exposures

    def stream(self, sensor):
        config = self.rig.sensors[sensor]
        kind = self.registry.sensor_type(config.type)
        times_ns = np.array([shot.stamp_ns for shot in self.shots[sensor]])
        return Stream(Path(), (), sensor, config, kind, self.target, times_ns)

    def frame(self, sensor, index):
        shot = self.shots[sensor][index]
        stamp = FrameStamp(sensor, shot.stamp_ns, None, int(index))
        return DetectedFrame(stamp, "features", self.detection(sensor, shot.T_w_t))

    def detection(self, sensor, T_w_t):
        config = self.rig.sensors[sensor]
        candidates = [] if config.type == "camera" else [self.observed(sensor, CABINET)]
        if self.rng.random() > MISSED:
            candidates.append(self.observed(sensor, T_w_t))
        found = tuple(c for c in candidates if c is not None)
        return Detection(found, "" if found else "not seen")

    def observed(self, sensor, T_w_t):
        config = self.rig.sensors[sensor]
        kind = self.registry.sensor_type(config.type)
        T_s_t = se3.inverse(self.T_w_s[sensor]) @ T_w_t
        if not len(spots_in_view(T_s_t, kind, config, self.target)):
            return None
        return kind.observe(T_s_t, config, self.target, self.rng)

    def hold_at(self, exposure, holds):
        middle = (exposure.start_ns + exposure.end_ns) / 2
        inside = [k for k, (a, b) in enumerate(holds) if a <= middle <= b]
        return inside[0] if inside else None

    def one_of_each(self, holds):
        """One frame of every sensor in every hold, drawn at random."""
        result = []
        for s, shots in self.shots.items():
            stamps = np.array([shot.stamp_ns for shot in shots])
            for k, (start, end) in enumerate(holds):
                inside = np.flatnonzero((stamps > start) & (stamps < end))
                shot = shots[self.rng.choice(inside)]
                result.append(self.observation(s, k, shot.T_w_t))
        return result

    def at_rest(self, T_w_t):
        return [self.observation(s, k, T) for k, T in enumerate(T_w_t) for s in self.rig.sensors]

    def observation(self, sensor, k, T_w_t):
        found = self.observed(sensor, T_w_t)
        candidates = () if found is None else (found,)
        return Observation(sensor, f"{k:04d}", 0, "features", candidates, "not seen")

    def evaluated(self, observations):
        """Rows of mm, deg, NEES / 6 per sensor."""
        result = calibrate(self.rig, self.registry, observations)
        true = {s: SensorResult(self.rig.root, T) for s, T in T_root_sensors(self.rig).items()}
        found = evaluate(result, Calibration(self.rig.root, true)).sensors
        return [
            (1e3 * e.translation_m, np.degrees(e.rotation_rad), e.nees / 6)
            for e in (found[s] for s in self.sensors)
        ]


def scenario(rig, poses, tremor):
    """Cameras and 3D laser at 10 Hz, 2D lasers at 40 Hz, jitter 5 ms; hands tremble by 0.3 mm."""
    held = {"hold_s": 2.0, "tremor_mm": 0.3 * tremor, "tremor_deg": 0.03 * tremor}
    rates = {"camera": 10.0, "lrf2d": 40.0, "lrf3d": 10.0}
    return ScenarioConfig.model_validate({
        "version": 1,
        "board": {"mode": "cover", "poses": poses, "distance_m": [1.3, 3.3], "max_pitch_deg": 35},
        "recording": {"mode": "continuous", **held},
        "stamps": {"jitter_s": 0.005},
        "defaults": {kind: {"rate_hz": rate} for kind, rate in rates.items()},
        "sensors": {name: {"phase_s": 0.009 * i} for i, name in enumerate(rig.sensors)},
    })  # fmt: skip


def rms(values):
    return float(np.sqrt(np.mean(np.square(values))))


if __name__ == "__main__":
    main()
