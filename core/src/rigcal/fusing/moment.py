"""The frames of all sensors that are nearest in time to one of them."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from rigcal.errors import ConfigError
from rigcal.plugin.contract import SensorConfig, SensorType
from rigcal.plugin.registry import Registry
from rigcal.recording import Message, Recording, open_recording
from rigcal.rig import Rig


def moment(
    rig: Rig, registry: Registry, recording: Path | str, leader: str, number: int | None
) -> Mapping[str, Message]:
    """Frame `number` of the sensor `leader` (None: the middle one), and of every other sensor that
    can be shown the frame nearest in time, or of the same exposure where files carry their key.

    A sensor that has none of that exposure is left out. ConfigError if there is no such frame;
    RecordingError if the recording lacks a source.
    """
    formats = tuple(registry.recording_formats.values())
    kinds = {name: registry.sensor_type(config.type) for name, config in rig.sensors.items()}
    definitions = {k: v for kind in kinds.values() for k, v in kind.message_definitions.items()}
    with open_recording(Path(recording), definitions, formats) as opened:
        lead = _numbered(opened, leader, rig.sensors[leader], number)
        found = {leader: lead}
        for name, config in rig.sensors.items():
            if name != leader and _is_shown(kinds[name]):
                nearest = _nearest(opened, config, lead)
                if nearest is not None:
                    found[name] = nearest
    return {name: found[name] for name in rig.sensors if name in found}


def _is_shown(kind: SensorType) -> bool:
    return kind.view is not None


def _numbered(opened: Recording, name: str, config: SensorConfig, number: int | None) -> Message:
    count = opened.count(config.source)
    index = count // 2 if number is None else number
    if not 0 <= index < count:
        raise ConfigError(
            f"sensor '{name}' has {count} frames in this recording, numbers 0 to {count - 1}; "
            f"there is no frame {index}"
        )
    return next(iter(opened.read(config.source, index, index + 1)))


def _nearest(opened: Recording, config: SensorConfig, lead: Message) -> Message | None:
    best: Message | None = None
    for message in opened.read(config.source):
        if lead.exposure is not None:
            if message.exposure == lead.exposure:
                return message
            continue
        off = abs(message.stamp_ns - lead.stamp_ns)
        if best is None or off < abs(best.stamp_ns - lead.stamp_ns):
            best = message
        elif message.stamp_ns > lead.stamp_ns:
            break
    return best
