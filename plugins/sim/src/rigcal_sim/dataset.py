"""A simulated recording with its ground truth."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from importlib.metadata import version
from pathlib import Path

from rigcal.calibration import Calibration, SensorResult
from rigcal.calibration_file import save_calibration
from rigcal.errors import ConfigError
from rigcal.geometry import se3
from rigcal.geometry.se3 import Array
from rigcal.plugin import Registry
from rigcal.progress import Progress
from rigcal.recording.writer import RecordingWriter
from rigcal.rig import Rig, T_root_sensors, build_targets
from rigcal.targets import Target
from rigcal.validation import nearest_of
from rigcal.workers import in_order
from rigcal_sim.carry import tour
from rigcal_sim.default import default_scenario
from rigcal_sim.frames import Entry, Setting, check_simulable, simulate_shots, static_transforms
from rigcal_sim.plan import Interval, Plan, Shot, plan_shots
from rigcal_sim.sampling import BoardPoses, sample_board_poses
from rigcal_sim.scenario import ScenarioConfig
from rigcal_sim.scenario_file import sensor_effects
from rigcal_sim.sight import sensor_poses
from rigcal_sim.timing import ContinuousConfig

FORMATS = ("mcap", "bag")
_BATCH = 16


@dataclass(frozen=True)
class Summary:
    """What was written.

    `target` is the name of the target that was shown. `seen` counts the exposures in which each
    sensor has the board in view. `redrawn` poses were drawn again; `unseen` of them, or of those
    kept with `redraw: false`, because too few sensors saw them. `messages` are counted by topic.
    """

    recordings: tuple[Path, ...]
    truth: Path
    target: str
    exposures: int
    redrawn: int
    unseen: int
    seen: Mapping[str, int]
    messages: Mapping[str, int]


def simulate(
    rig: Rig,
    registry: Registry,
    scenario: ScenarioConfig | None,
    seed: int,
    out: Path | str,
    formats: Sequence[str] = ("mcap",),
    progress: Progress | None = None,
    poses: int | None = None,
    jobs: int | None = None,
) -> Summary:
    """Write `recording.mcap` and/or `recording.bag`, and `truth.yaml`, into folder `out`.

    Every pose of the board is shown to every sensor. `scenario` None: boards where the sensors
    look. `poses`: how many, instead of the scenario's number. The same arguments give the same
    bytes, whatever `jobs` (processes; default: one per core) is. ConfigError for a rig or a
    scenario that cannot be simulated.
    """
    out = Path(out)
    target = _target(rig, registry, scenario)
    check_simulable(rig, registry)
    scenario = scenario or default_scenario(rig, registry, target)
    effects = sensor_effects(scenario, rig, registry)
    T_w_s = sensor_poses(rig, scenario)
    setting = Setting(rig, registry, scenario, target, T_w_s, effects, seed)
    boards = sample_board_poses(rig, registry, target, scenario, seed, poses)
    if isinstance(scenario.recording, ContinuousConfig):
        boards = _in_order_of(boards, tour(boards.T_w_t))
    plan = plan_shots(rig, scenario, effects, boards.T_w_t, seed)
    recordings = tuple(out / f"recording.{suffix}" for suffix in formats)
    out.mkdir(parents=True, exist_ok=True)
    messages = _record(setting, plan, recordings, progress, jobs)
    save_calibration(out / "truth.yaml", truth(rig, scenario, boards.T_w_t, plan.holds, seed))
    seen = {name: sum(name in sensors for sensors in boards.seen_by) for name in rig.sensors}
    return Summary(
        recordings=recordings,
        truth=out / "truth.yaml",
        target=target.name,
        exposures=len(boards.T_w_t),
        redrawn=boards.redrawn,
        unseen=boards.unseen,
        seen=seen,
        messages=messages,
    )


def truth(
    rig: Rig, scenario: ScenarioConfig, T_w_t: Array, holds: Sequence[Interval], seed: int
) -> Calibration:
    """The true tree, every sensor a child of the root, with `T_root_t` of every exposure.

    And from when to when the board stood there, in true time: without clock offset and jitter.
    """
    T_root_w = se3.inverse(scenario.root_pose.T_w_root)
    names = [f"{k:04d}" for k in range(len(T_w_t))]
    return Calibration(
        root=rig.root,
        sensors={name: SensorResult(rig.root, T) for name, T in T_root_sensors(rig).items()},
        target_poses=dict(zip(names, T_root_w @ T_w_t, strict=True)),
        holds_ns=dict(zip(names, holds, strict=True)),
        provenance={"simulated_by": f"rigcal-sim {version('rigcal-sim')}", "seed": seed},
    )


def _target(rig: Rig, registry: Registry, scenario: ScenarioConfig | None) -> Target:
    targets = build_targets(rig, registry)
    name = (scenario.target if scenario else None) or next(iter(targets))
    if name not in targets:
        raise ConfigError(
            f"scenario: target: the rig has no target '{name}'{nearest_of(name, list(targets))}"
        )
    return targets[name]


def _in_order_of(boards: BoardPoses, order: list[int]) -> BoardPoses:
    seen_by = tuple(boards.seen_by[k] for k in order)
    return replace(boards, T_w_t=boards.T_w_t[order], seen_by=seen_by)


def _record(
    setting: Setting,
    plan: Plan,
    recordings: Sequence[Path],
    progress: Progress | None,
    jobs: int | None,
) -> dict[str, int]:
    """Write all frames, a few of them in memory at a time; messages by topic."""
    tell = progress or (lambda *_: None)
    total = len(plan.shots)
    messages: Counter[str] = Counter()
    with ExitStack() as stack:
        writers = [stack.enter_context(RecordingWriter(path)) for path in recordings]
        tell("simulating", 0, total)
        batches = [plan.shots[k : k + _BATCH] for k in range(0, total, _BATCH)]
        for done, entries in enumerate(_entries(setting, batches, jobs)):
            for entry in entries:
                messages[entry.topic] += 1
                for writer in writers:
                    writer.write(entry.topic, entry.type, entry.message, entry.stamp_ns)
            tell("simulating", min(done * _BATCH, total), total)
    return dict(sorted(messages.items()))


def _entries(
    setting: Setting, batches: Sequence[Sequence[Shot]], jobs: int | None
) -> Iterator[list[Entry]]:
    """The messages of the recording, by stamp."""
    start_ns = round(setting.scenario.stamps.start_s * 1e9)
    yield [static_transforms(setting.rig, min(start_ns, batches[0][0].stamp_ns))]
    workers = min(jobs or os.cpu_count() or 1, len(batches))
    yield from in_order(simulate_shots, setting, batches, workers)
