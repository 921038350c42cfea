"""A simulated recording with its ground truth."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from rigcal.calibration import Calibration, SensorResult
from rigcal.calibration_file import save_calibration
from rigcal.errors import ConfigError
from rigcal.geometry import se3
from rigcal.geometry.se3 import Array
from rigcal.plugin import Effects
from rigcal.plugin.registry import Registry
from rigcal.progress import Progress
from rigcal.recording import ros
from rigcal.recording.writer import RecordingWriter
from rigcal.rig import Rig, T_root_sensors, build_targets
from rigcal.scene import Scene
from rigcal.targets import Target
from rigcal.validation import nearest_of
from rigcal_sim.coverage import default_scenario
from rigcal_sim.poses import BoardPoses, sample_board_poses, sensor_poses, stream
from rigcal_sim.scenario import ScenarioConfig, StampsConfig
from rigcal_sim.scenario_file import sensor_effects
from rigcal_sim.scene import build_scene

FORMATS = ("mcap", "bag")
_BATCH = 4


@dataclass(frozen=True)
class Entry:
    """One message of the recording."""

    topic: str
    type: str
    message: Any
    stamp_ns: int


@dataclass(frozen=True)
class Summary:
    """What was written. `seen` counts the exposures in which each sensor has the board in view."""

    recordings: tuple[Path, ...]
    truth: Path
    exposures: int
    redrawn: int
    seen: Mapping[str, int]


@dataclass(frozen=True, eq=False)
class _Setting:
    """What all exposures of a recording share."""

    rig: Rig
    registry: Registry
    scenario: ScenarioConfig
    target: Target
    T_w_s: Mapping[str, Array]
    effects: Mapping[str, Effects]
    seed: int


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

    Every exposure is shown to every sensor. `scenario` None: boards where the sensors look.
    `poses`: how many exposures, instead of the scenario's number. The same arguments give the
    same bytes, whatever `jobs` (processes; default: one per core) is. ConfigError for a rig or
    a scenario that cannot be simulated.
    """
    out = Path(out)
    target = _target(rig, registry, scenario)
    check_simulable(rig, registry)
    scenario = scenario or default_scenario(rig, registry, target)
    effects = sensor_effects(scenario, rig, registry)
    boards = sample_board_poses(rig, registry, target, scenario, seed, poses)
    setting = _Setting(rig, registry, scenario, target, sensor_poses(rig, scenario), effects, seed)
    recordings = tuple(out / f"recording.{suffix}" for suffix in formats)
    out.mkdir(parents=True, exist_ok=True)
    tell = progress or (lambda *_: None)
    with ExitStack() as stack:
        writers = [stack.enter_context(RecordingWriter(path)) for path in recordings]
        start_ns = round(scenario.stamps.start_s * 1e9)
        _write(writers, [_static_transforms(rig, start_ns)])
        total = len(boards.T_w_t)
        tell("simulating", 0, total)
        exposures = _exposures(setting, boards.T_w_t, jobs or os.cpu_count() or 1)
        for done, entries in enumerate(exposures, start=1):
            _write(writers, entries)
            tell("simulating", done, total)
    save_calibration(out / "truth.yaml", truth(rig, scenario, boards, seed))
    seen = {name: sum(name in sensors for sensors in boards.seen_by) for name in rig.sensors}
    return Summary(recordings, out / "truth.yaml", total, boards.redrawn, seen)


def truth(rig: Rig, scenario: ScenarioConfig, boards: BoardPoses, seed: int) -> Calibration:
    """The true tree, every sensor a child of the root, with `T_root_t` of every exposure."""
    T_root_w = se3.inverse(scenario.root_pose.T_w_root)
    return Calibration(
        root=rig.root,
        sensors={name: SensorResult(rig.root, T) for name, T in T_root_sensors(rig).items()},
        target_poses={f"{k:04d}": T_root_w @ T_w_t for k, T_w_t in enumerate(boards.T_w_t)},
        provenance={"simulated_by": f"rigcal-sim {version('rigcal-sim')}", "seed": seed},
    )


def check_simulable(rig: Rig, registry: Registry) -> None:
    """ConfigError for sensors whose type has no simulator, and for missing or shared topics."""
    owners: dict[str, str] = {}
    for name, config in rig.sensors.items():
        kind = registry.sensor_type(config.type)
        if kind.simulate is None or kind.encode is None or kind.message_type is None:
            raise ConfigError(
                f"sensors.{name}: sensor type '{config.type}' cannot be simulated (its plugin "
                "offers no simulator); remove the sensor from the rig to simulate the others"
            )
        if config.topic is None:
            raise ConfigError(f"sensors.{name}: add `topic: /{name}/...`, the name of its messages")
        if (other := owners.setdefault(config.topic, name)) != name:
            raise ConfigError(
                f"sensors.{name}: topic '{config.topic}' is also that of sensor '{other}'; "
                "a simulated recording needs a topic for each"
            )


def _target(rig: Rig, registry: Registry, scenario: ScenarioConfig | None) -> Target:
    targets = build_targets(rig, registry)
    name = (scenario.target if scenario else None) or next(iter(targets))
    if name not in targets:
        raise ConfigError(
            f"scenario: target: the rig has no target '{name}'{nearest_of(name, list(targets))}"
        )
    return targets[name]


def _exposures(setting: _Setting, T_w_t: Array, jobs: int) -> Iterator[list[Entry]]:
    """The messages of all exposures in their order; only a few are in memory at a time."""
    numbers = range(len(T_w_t))
    if jobs == 1 or len(T_w_t) <= _BATCH:
        yield from (_expose(setting, T_w_t[k], k) for k in numbers)
        return
    from joblib import Parallel, delayed

    # Batches, because what a sensor makes of the target once (its texture) is made per batch.
    batches = [numbers[k : k + _BATCH] for k in numbers[::_BATCH]]
    parallel = Parallel(
        n_jobs=jobs, return_as="generator", batch_size=1, pre_dispatch="n_jobs + 1", max_nbytes=None
    )
    tasks = (delayed(_expose_batch)(setting, T_w_t[list(ks)], ks) for ks in batches)
    for batch in parallel(tasks):
        yield from batch


def _expose_batch(setting: _Setting, T_w_t: Array, exposures: Sequence[int]) -> list[list[Entry]]:
    """Some exposures (runs in a worker process)."""
    return [_expose(setting, T, k) for T, k in zip(T_w_t, exposures, strict=True)]


def _expose(setting: _Setting, T_w_t: Array, exposure: int) -> list[Entry]:
    """The messages of one exposure, by stamp."""
    rng = stream(setting.seed, exposure, "objects")
    scene = build_scene(setting.target, T_w_t, setting.scenario, rng)
    entries = []
    for name in setting.rig.sensors:
        entries += _messages(setting, scene, exposure, name)
    return sorted(entries, key=lambda entry: entry.stamp_ns)


def _messages(setting: _Setting, scene: Scene, exposure: int, name: str) -> list[Entry]:
    """What one sensor says in one exposure."""
    config = setting.rig.sensors[name]
    kind = setting.registry.sensor_type(config.type)
    assert kind.simulate is not None  # check_simulable has seen to these
    assert kind.encode is not None
    assert config.topic is not None
    effects = setting.effects[name]
    rng = stream(setting.seed, exposure, name)
    stamp_ns = _stamp_ns(setting.scenario.stamps, effects, exposure, rng)
    frame = kind.simulate(setting.T_w_s[name], scene, config, rng, effects)
    message = kind.encode(frame, config, stamp_ns, name)
    if kind.transport is not None:
        message = kind.transport(message, effects)
    entries = [Entry(config.topic, message.__msgtype__, message, stamp_ns)]
    extra = kind.extra_messages(config, stamp_ns, name) if kind.extra_messages else {}
    for suffix, (type_name, value) in extra.items():
        entries.append(Entry(_beside(config.topic, suffix), type_name, value, stamp_ns))
    return entries


def _stamp_ns(
    stamps: StampsConfig, effects: Effects, exposure: int, rng: np.random.Generator
) -> int:
    """Exposure k is k + 1 periods after the start, plus clock offset, give or take the jitter."""
    jitter_s = stamps.jitter_s if effects.jitter_s is None else effects.jitter_s
    late_s = (exposure + 1) * stamps.period_s + effects.clock_offset_s
    late_s += float(rng.uniform(-jitter_s, jitter_s))
    return round(stamps.start_s * 1e9) + round(late_s * 1e9)


def _beside(topic: str, suffix: str) -> str:
    """`/cam0/camera_info` for topic `/cam0/image_raw`."""
    return f"{topic.rpartition('/')[0]}/{suffix.lstrip('/')}"


def _write(writers: Sequence[RecordingWriter], entries: Iterable[Entry]) -> None:
    for entry in entries:
        for writer in writers:
            writer.write(entry.topic, entry.type, entry.message, entry.stamp_ns)


def _static_transforms(rig: Rig, stamp_ns: int) -> Entry:
    """The true poses as ROS keeps them: one transform from the root to each other sensor."""
    poses = {name: (rig.root, T) for name, T in T_root_sensors(rig).items() if name != rig.root}
    return Entry("/tf_static", ros.TF_TYPE, ros.tf_static(poses, stamp_ns), stamp_ns)
