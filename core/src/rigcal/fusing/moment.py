"""The frames of all sensors that are nearest in time to one of them."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from rigcal.errors import ConfigError
from rigcal.plugin.contract import SensorConfig, SensorType
from rigcal.plugin.registry import Registry
from rigcal.recording import Message, Recording, nearest_message, open_recording
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
    with open_recording(Path(recording), registry.message_definitions, formats) as opened:
        lead = _numbered(opened, leader, rig.sensors[leader], number)
        found = {leader: lead}
        for name, config in rig.sensors.items():
            if name != leader and _is_shown(kinds[name]):
                message = _beside(opened, config, lead)
                if message is not None:
                    found[name] = message
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


def _beside(opened: Recording, config: SensorConfig, lead: Message) -> Message | None:
    """The message of the same exposure (None if there is none), or the one nearest in time."""
    if lead.exposure is None:
        return nearest_message(opened, config.source, lead.stamp_ns)
    return next((m for m in opened.read(config.source) if m.exposure == lead.exposure), None)
