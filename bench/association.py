"""A continuous recording against one frame per pose: exposures, frames, accuracy, cost.

    uv run python bench/association.py DIR [--poses 30] [--images 0.5] [--light 0.3]

Simulates the rig of examples/husky.yaml as people record: the board is carried and held still,
cameras and 3D laser at 10 Hz, 2D lasers at 40 Hz, stamps off by up to 5 ms, hands that tremble.
The same poses are recorded once more with one frame per pose and a board that does not tremble.
DIR keeps the recordings; a second run uses them again.
"""

from __future__ import annotations

import argparse
import os
import sys
from pathlib import Path

import numpy as np
import yaml

from rigcal import evaluate, load_calibration, load_observations
from rigcal.errors import RigcalError
from rigcal.estimation import calibrate
from rigcal.frames import Look, look_at, streams_of
from rigcal.geometry import se3
from rigcal.geometry.shapes import plane_of_target, tangent_basis
from rigcal.observation import LineGeometry, Observation, PlaneGeometry, PoseGeometry
from rigcal.plugin.registry import Registry
from rigcal.rig import load_rig
from rigcal.second_look import look_again
from rigcal.visibility import spots_in_view

EXAMPLES = Path(__file__).parents[1] / "examples"
DRAWS = 5
RIGHT_M = 0.03


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("out", type=Path)
    parser.add_argument("--poses", type=int, default=30)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--images", type=float, default=0.5, help="size of images and clouds")
    parser.add_argument("--light", type=float, default=0.3, help="of the room; tags are missed")
    parser.add_argument("--jobs", type=int, default=2)
    options = parser.parse_args()
    write_inputs(options.out, options.images, options.poses, options.light)
    for mode in ("continuous", "one_frame"):
        if not (options.out / mode / "truth.yaml").exists():
            scenario, seed = options.out / f"{mode}.yaml", ("--seed", options.seed)
            rigcal("simulate", rig_of(options.out), "--scenario", scenario, *seed,
                   "--out", options.out / mode, "--jobs", options.jobs)  # fmt: skip
    Study(options.out, options.jobs).run()


def rig_of(out):
    return out / "rig.yaml"


def write_inputs(out, images, poses, light=0.3):
    """The rig with smaller images and clouds, and the two scenarios."""
    out.mkdir(parents=True, exist_ok=True)
    rig = yaml.safe_load((EXAMPLES / "husky.yaml").read_text())
    for sensor in rig["sensors"].values():
        if sensor["type"] == "camera":
            sensor["width_px"], sensor["height_px"] = (
                round(images * sensor[k]) for k in ("width_px", "height_px")
            )
            sensor["focal_px"] = [images * f for f in sensor["focal_px"]]
            sensor["principal_px"] = [images * (c + 0.5) - 0.5 for c in sensor["principal_px"]]
        if sensor["type"] == "lrf3d":
            sensor["scan"]["scans_per_deg"] *= images
    rig_of(out).write_text(yaml.safe_dump(rig))
    scenario = yaml.safe_load((EXAMPLES / "husky_continuous_scenario.yaml").read_text())
    scenario["board"]["poses"] = poses
    scenario["stamps"]["jitter_s"] = 0.005
    scenario["recording"]["hold_s"] = 2.0
    rates = {"camera": 10.0, "lrf2d": 40.0, "lrf3d": 10.0}
    scenario["defaults"] = {kind: {"rate_hz": rate} for kind, rate in rates.items()}
    camera = {"board_px_per_mm": 1.5, "exposure": light}
    scenario["defaults"]["camera"] |= camera
    scenario["sensors"] = {
        name: {"phase_s": 0.009 * i} for i, name in enumerate(rig["sensors"]) if i
    }
    (out / "continuous.yaml").write_text(yaml.safe_dump(scenario))
    del scenario["recording"], scenario["sensors"]
    scenario["defaults"] = {"camera": camera}
    (out / "one_frame.yaml").write_text(yaml.safe_dump(scenario))


def rigcal(*arguments):
    """One command; its CPU seconds and the peak of its memory in MB."""
    command = [str(Path(sys.executable).with_name("rigcal")), *map(str, arguments), "--quiet"]
    pid = os.posix_spawn(command[0], command, os.environ)
    # Of this child alone: RUSAGE_CHILDREN keeps the largest peak of all so far.
    _, status, usage = os.wait4(pid, 0)
    if status:
        sys.exit(f"{' '.join(command)} failed")
    return usage.ru_utime + usage.ru_stime, usage.ru_maxrss / 1024


class Study:
    """Everything that is measured on the two recordings."""

    def __init__(self, out, jobs):
        self.out, self.jobs = out, jobs
        self.registry = Registry.from_entry_points()
        self.rig = load_rig(rig_of(out), self.registry)
        self.recording = out / "continuous" / "recording.mcap"
        self.truth = load_calibration(out / "continuous" / "truth.yaml")
        self.holds = yaml.safe_load((out / "continuous" / "truth.yaml").read_text())["holds"]
        self.streams = streams_of(self.rig, self.registry, self.recording)

    def run(self):
        cost = {mode: self.detect(mode) for mode in ("one_frame", "continuous")}
        seen = self.observations("continuous")
        first = calibrate(self.rig, self.registry, seen)
        again = look_again(self.rig, self.registry, self.recording, seen, first, jobs=self.jobs)
        second = calibrate(self.rig, self.registry, again)
        self.print_exposures(seen)
        self.print_sensors(seen, again, second)
        self.print_consistency(seen)
        draws = [self.one_frame_of_each(np.random.default_rng(k)) for k in range(DRAWS)]
        results = {
            "one frame per pose": [
                calibrate(self.rig, self.registry, self.observations("one_frame"))
            ],
            "one frame of each hold": [c for d in draws if (c := self.calibrated(d))],
            "frames combined": [first],
            "and a second look": [second],
        }
        self.print_accuracy(results)
        total = sum(len(s.times_ns) for s in self.streams.values())
        looked_at = sum(len(o.frames) for o in seen)
        print(f"\ncost of detect, one process: {total} frames recorded, {looked_at} looked at")
        for mode, (cpu, mb) in cost.items():
            print(f"  {mode:12} {cpu:6.1f} s CPU, {mb:5.0f} MB at most")

    def calibrated(self, observations):
        """A calibration, or None where the data leave a pose open."""
        try:
            return calibrate(self.rig, self.registry, observations)
        except RigcalError as error:
            print(f"\none draw of one frame per hold has no answer: {str(error).splitlines()[0]}")
            return None

    def detect(self, mode):
        recording = self.out / mode / "recording.mcap"
        out = self.out / mode / "observations.npz"
        return rigcal("detect", rig_of(self.out), recording, "--out", out, "--jobs", 1)

    def observations(self, mode):
        return load_observations(self.out / mode / "observations.npz")[0]

    def hold_at(self, stamp_ns):
        """The hold at a time, or None."""
        for name, hold in self.holds.items():
            if hold["start_ns"] <= stamp_ns <= hold["end_ns"]:
                return name
        return None

    def T_s_t(self, sensor, hold):
        return self.truth.T(sensor, self.truth.root) @ self.truth.target_poses[hold]

    def in_view(self, sensor):
        """Holds in which a sensor has the board in view, nothing in between."""
        s = self.streams[sensor]
        return {
            k for k in self.holds
            if len(spots_in_view(self.T_s_t(sensor, k), s.kind, s.config, s.target))
        }  # fmt: skip

    def print_exposures(self, seen):
        names = {
            o.exposure: self.hold_at(o.stamp_ns) for o in seen if len(o.frames) and o.candidates
        }
        right = {hold for hold in names.values() if hold}
        wrong = sum(hold is None for hold in names.values())
        seconds = (max(s.times_ns[-1] for s in self.streams.values()) -
                   min(s.times_ns[0] for s in self.streams.values())) * 1e-9  # fmt: skip
        print(f"{len(self.holds)} exposures simulated in {seconds:.0f} s; "
              f"{len(right)} found, {len(names) - wrong - len(right)} of them twice, "
              f"{wrong} where the board moves")  # fmt: skip

    def print_sensors(self, seen, again, second):
        used = {s: r.inliers for s, r in second.sensors.items()}
        print("\nsensor     frames  looked at  combined  in view  right  "
              "second look: added  right   used")  # fmt: skip
        for s, stream in self.streams.items():
            own = [(o, a) for o, a in zip(seen, again, strict=True) if o.sensor == s]
            combined = sum(len(o.frames) for o, _ in own if o.candidates)
            looked_at = sum(len(o.frames) for o, _ in own)
            view = self.in_view(s)
            right = [o for o, _ in own if self.right(o, o.candidates)]
            added = [a for o, a in own if len(a.candidates) > len(o.candidates)]
            good = [a for a in added if self.right(a, a.candidates[-1:])]
            print(f"{s:9} {len(stream.times_ns):7} {looked_at:10} {combined:9} {len(view):8} "
                  f"{len(right):6} {len(added):19} {len(good):6} {used[s]:6}")  # fmt: skip

    def right(self, o, candidates):
        hold = self.hold_at(o.stamp_ns)
        T = None if hold is None or not candidates else self.T_s_t(o.sensor, hold)
        return T is not None and min(offset_m(c.geometry, T) for c in candidates) < RIGHT_M

    def one_frame_of_each(self, rng):
        """One frame of every sensor in every hold, drawn at random."""
        looks, names = {}, {}
        for s, stream in self.streams.items():
            looks[s] = []
            for name, hold in self.holds.items():
                inside = np.flatnonzero(
                    (stream.times_ns > hold["start_ns"] + 50_000_000)
                    & (stream.times_ns < hold["end_ns"] - 50_000_000)
                )
                index = int(rng.choice(inside))
                looks[s].append(Look(index))
                names[s, index] = name
        frames = look_at(self.streams, looks, "one frame of each", jobs=self.jobs)
        return [
            Observation(
                f.stamp.sensor, names[f.stamp.sensor, f.stamp.index], f.stamp.stamp_ns, f.origin,
                f.detection.candidates, f.detection.reason, (f.stamp.index,),
            )
            for f in frames
        ]  # fmt: skip

    def print_consistency(self, seen):
        """NEES per degree of freedom against the truth, of combined frames and of single ones."""
        right = [o for o in seen if len(o.frames) > 1 and self.right(o, o.candidates)]
        looks = {
            s: [Look(i) for o in right if o.sensor == s for i in o.frames] for s in self.streams
        }
        frames = look_at(self.streams, looks, "consistency", jobs=self.jobs)
        single = {(f.stamp.sensor, f.stamp.index): f.detection.candidates for f in frames}
        print("\nNEES / dof  combined  single frames (mean over exposures)")
        for s in self.streams:
            rows = []
            for o in (o for o in right if o.sensor == s):
                T = self.T_s_t(s, self.hold_at(o.stamp_ns))
                each = [single[s, i] for i in o.frames]
                of_frames = [min(nees(c.geometry, T) for c in found) for found in each if found]
                combined = min(nees(c.geometry, T) for c in o.candidates)
                rows.append((combined, np.mean(of_frames)))
            if rows:
                print(f"{s:9} {np.mean(rows, 0)[0]:11.2f} {np.mean(rows, 0)[1]:9.2f}")

    def print_accuracy(self, results):
        print("\nerror against the truth, mm / deg (in sigmas); rms over draws")
        print(f"{'sensor':9}" + "".join(f"{name:>26}" for name in results))
        totals = []
        for s in self.rig.sensors:
            if s == self.rig.root:
                continue
            cells, row = [], []
            for calibrations in results.values():
                errors = [evaluate(c, self.truth).sensors[s] for c in calibrations]
                mm = 1e3 * rms([e.translation_m for e in errors])
                deg = np.degrees(rms([e.rotation_rad for e in errors]))
                sigmas = rms([np.sqrt(e.nees / 6) for e in errors])
                row.append((mm, deg))
                cells.append(f"{mm:12.3f} / {deg:.4f} ({sigmas:.1f})"[:26].rjust(26))
            totals.append(row)
            print(f"{s:9}" + "".join(cells))
        mean = np.sqrt(np.mean(np.square(totals), axis=0))
        print(
            f"{'rms':9}"
            + "".join(f"{mm:12.3f} / {deg:.4f}".rjust(20) + " " * 6 for mm, deg in mean)
        )


def rms(values):
    return float(np.sqrt(np.mean(np.square(values))))


def deviation(g, T_s_t):
    """What a geometry knows of the target's place: error, and its covariance."""
    if isinstance(g, PoseGeometry):
        return se3.log(se3.inverse(g.T_s_t) @ T_s_t), g.covariance
    n, d = plane_of_target(T_s_t)
    if isinstance(g, PlaneGeometry):
        tilt = tangent_basis(g.normal).T @ np.cross(g.normal, n)
        return np.append(tilt, -(g.center @ n + d)), g.covariance
    assert isinstance(g, LineGeometry)
    J = np.kron(np.eye(2), n[None])
    return np.array([g.start @ n + d, g.end @ n + d]), J @ g.covariance @ J.T


def nees(g, T_s_t):
    x, covariance = deviation(g, T_s_t)
    return float(x @ np.linalg.solve(covariance, x)) / len(x)


def offset_m(g, T_s_t):
    """How far the geometry lies from the target's plane, and from its middle along it, m."""
    x, _ = deviation(g, T_s_t)
    if isinstance(g, PoseGeometry):
        return float(np.linalg.norm(x[3:]))
    if isinstance(g, LineGeometry):
        away = np.linalg.norm((g.start + g.end) / 2 - T_s_t[:3, 3]) > 0.8
        return float(np.abs(x).max()) + away
    return abs(float(x[2])) + (np.linalg.norm(g.center - T_s_t[:3, 3]) > 0.8)


if __name__ == "__main__":
    main()
