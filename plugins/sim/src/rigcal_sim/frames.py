"""What the sensors of a rig say of one scene: simulated frames as ROS messages."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from rigcal.errors import ConfigError
from rigcal.geometry.se3 import Array
from rigcal.plugin import Effects, Registry
from rigcal.recording import ros
from rigcal.rig import Rig, T_root_sensors
from rigcal.targets import Target
from rigcal_sim.plan import Shot
from rigcal_sim.poses import stream
from rigcal_sim.scenario import ScenarioConfig
from rigcal_sim.scene import build_scene


@dataclass(frozen=True)
class Entry:
    """One message of the recording."""

    topic: str
    type: str
    message: Any
    stamp_ns: int


@dataclass(frozen=True, eq=False)
class Setting:
    """What all frames of a recording share."""

    rig: Rig
    registry: Registry
    scenario: ScenarioConfig
    target: Target
    T_w_s: Mapping[str, Array]
    effects: Mapping[str, Effects]
    seed: int


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


def simulate_shots(setting: Setting, shots: Sequence[Shot]) -> list[Entry]:
    """The messages of some frames, by stamp."""
    return [entry for shot in shots for entry in _messages(setting, shot)]


def _messages(setting: Setting, shot: Shot) -> list[Entry]:
    """One frame, and what goes along with it."""
    name, stamp_ns = shot.sensor, shot.stamp_ns
    config, effects = setting.rig.sensors[name], setting.effects[name]
    kind = setting.registry.sensor_type(config.type)
    assert kind.simulate is not None  # check_simulable has seen to these
    assert kind.encode is not None
    assert config.topic is not None
    scene_rng = stream(setting.seed, shot.exposure, "objects")
    scene = build_scene(setting.target, shot.T_w_t, setting.scenario, scene_rng)
    rng = stream(setting.seed, shot.number, name)
    frame = kind.simulate(setting.T_w_s[name], scene, config, rng, effects)
    message = kind.encode(frame, config, stamp_ns, name)
    if kind.transport is not None:
        message = kind.transport(message, effects)
    entries = [Entry(config.topic, message.__msgtype__, message, stamp_ns)]
    extra = kind.extra_messages(config, stamp_ns, name) if kind.extra_messages else {}
    for suffix, (type_name, value) in extra.items():
        entries.append(Entry(_beside(config.topic, suffix), type_name, value, stamp_ns))
    return entries


def static_transforms(rig: Rig, stamp_ns: int) -> Entry:
    """The true poses as ROS keeps them: one transform from the root to each other sensor."""
    poses = {name: (rig.root, T) for name, T in T_root_sensors(rig).items() if name != rig.root}
    return Entry("/tf_static", ros.TF_TYPE, ros.tf_static(poses, stamp_ns), stamp_ns)


def _beside(topic: str, suffix: str) -> str:
    """`/cam0/camera_info` for topic `/cam0/image_raw`."""
    return f"{topic.rpartition('/')[0]}/{suffix.lstrip('/')}"
