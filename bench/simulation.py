"""Time to simulate, encode and write each sensor's frames.

    uv run python bench/simulation.py [RIG SCENARIO] [--poses N]

Prints CPU milliseconds per frame and sensor, median over the poses, in one process: `scene` puts
up what stands around the rig, `simulate` makes the frame, `mcap` and `bag` write its messages.
"""

from __future__ import annotations

import argparse
import tempfile
from collections import defaultdict
from pathlib import Path
from statistics import median
from time import process_time

from rigcal import Registry, load_rig
from rigcal.recording.writer import RecordingWriter
from rigcal.rig import build_targets
from rigcal_sim.frames import Setting, simulate_shots
from rigcal_sim.plan import plan_shots
from rigcal_sim.poses import stream
from rigcal_sim.sampling import sample_board_poses
from rigcal_sim.scenario_file import load_scenario, sensor_effects
from rigcal_sim.scene import build_scene
from rigcal_sim.sight import sensor_poses

EXAMPLES = Path(__file__).parents[1] / "examples"
STEPS = ("scene", "simulate", "mcap", "bag")


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("rig", nargs="?", default=EXAMPLES / "husky.yaml", type=Path)
    parser.add_argument("scenario", nargs="?", default=EXAMPLES / "husky_scenario.yaml", type=Path)
    parser.add_argument("--poses", type=int, default=24)
    options = parser.parse_args()
    registry = Registry.from_entry_points()
    rig = load_rig(options.rig, registry)
    scenario = load_scenario(options.scenario, rig, registry)
    target = next(iter(build_targets(rig, registry).values()))
    effects = sensor_effects(scenario, rig, registry)
    T_w_s = sensor_poses(rig, scenario)
    setting = Setting(rig, registry, scenario, target, T_w_s, effects, 0)
    boards = sample_board_poses(rig, registry, target, scenario, 0, options.poses)
    shots = plan_shots(rig, scenario, effects, boards.T_w_t, 0).shots
    simulate_shots(setting, shots[: len(rig.sensors)])  # textures and tables are made once
    times = {name: defaultdict(list) for name in rig.sensors}
    with tempfile.TemporaryDirectory() as folder:
        paths = {suffix: Path(folder) / f"r.{suffix}" for suffix in ("mcap", "bag")}
        with RecordingWriter(paths["mcap"]) as mcap, RecordingWriter(paths["bag"]) as bag:
            for shot in shots:
                taken = times[shot.sensor]
                start = process_time()
                build_scene(target, shot.T_w_t, scenario, stream(0, shot.exposure, "objects"))
                taken["scene"].append(process_time() - start)
                start = process_time()
                entries = simulate_shots(setting, [shot])
                taken["simulate"].append(process_time() - start)
                for name, writer in (("mcap", mcap), ("bag", bag)):
                    start = process_time()
                    for e in entries:
                        writer.write(e.topic, e.type, e.message, e.stamp_ns)
                    taken[name].append(process_time() - start)
        sizes = {suffix: path.stat().st_size / 1e6 for suffix, path in paths.items()}
    print("CPU ms per frame".ljust(16), *(step.rjust(9) for step in STEPS))
    for name, taken in times.items():
        row = (f"{1000 * median(taken[step]):9.1f}" for step in STEPS)
        print(name.ljust(16), *row)
    print(f"{len(boards.T_w_t)} exposures:", *(f"{s} {mb:.0f} MB" for s, mb in sizes.items()))


if __name__ == "__main__":
    main()
