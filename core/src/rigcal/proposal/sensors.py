"""The sensors of a recording: by the types of their messages, with what these say of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import takewhile
from pathlib import PurePosixPath
from typing import Any

from rigcal.errors import RigcalError
from rigcal.plugin.contract import SensorType
from rigcal.plugin.registry import Registry
from rigcal.recording.message import Message, Recording, Source

Contents = Mapping[str, tuple[str, int]]


@dataclass(frozen=True, eq=False)
class Found:
    """A sensor of a recording.

    `fields` are those of its config that are known so far; `frame` is what its messages call
    their frame; `notes` are for the reader of the rig file.
    """

    name: str
    topic: str
    message_type: str
    count: int
    kind: SensorType
    frame: str = ""
    fields: dict[str, Any] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)


def sensors_in(recording: Recording, registry: Registry) -> tuple[list[Found], list[str]]:
    """The sensors in order of their topics, and what to say of topics that could be several."""
    contents = {t: c for t, c in recording.contents().items() if c[1] and not t.startswith(".")}
    kinds, unsure = {}, []
    for topic, (message_type, _) in contents.items():
        accepting = [k for k in registry.sensor_types.values() if message_type in k.message_types]
        own = [k for k in accepting if k.message_type == message_type] or accepting
        if len(own) == 1:
            kinds[topic] = own[0]
        elif own:
            choices = " or ".join(kind.name for kind in own)
            unsure.append(f"{topic} ({message_type}) may be a {choices}: add it by hand")
    kinds = {t: kind for t, kind in kinds.items() if not _is_copy(t, kind, kinds)}
    names = _names(list(kinds))
    found = [
        Found(names[topic], topic, *contents[topic], kind=kind) for topic, kind in kinds.items()
    ]
    return [_described(sensor, recording, contents, list(kinds)) for sensor in found], unsure


def _is_copy(topic: str, kind: SensorType, kinds: Mapping[str, SensorType]) -> bool:
    """Whether a topic is another form of one above it (/image_raw/compressed of /image_raw)."""
    above = map(str, PurePosixPath(topic).parents)
    return any(kinds.get(parent) is kind for parent in above)


def _names(topics: list[str]) -> dict[str, str]:
    """Short names: the namespace; with its last part where that is not enough, or missing."""
    parts = {topic: [p for p in str(_base(topic)).split("/") if p] for topic in topics}
    short = {topic: "_".join(p[:-1] or p) for topic, p in parts.items()}
    every = list(short.values())
    return {
        topic: name if every.count(name) == 1 else "_".join(parts[topic]).strip("_")
        for topic, name in short.items()
    }


def _described(
    sensor: Found, recording: Recording, contents: Contents, others: Sequence[str]
) -> Found:
    """What the first of its own messages says, then what messages beside it do."""
    fields, notes, frame = dict[str, Any](), list[str](), ""
    beside = _beside(sensor, contents, others)
    if len({contents[topic][0] for topic in beside}) < len(beside):
        notes.append(f"several topics may describe it, none is used: {', '.join(beside)}")
        beside = []
    notes += [f"described by {topic}" for topic in beside]
    for topic in (sensor.topic, *beside):
        try:
            message = next(iter(recording.read(Source(topic=topic), 0, 1)))
            frame = frame or _frame(message)
            describe = sensor.kind.describes.get(message.type)
            fields |= describe(message.value) if describe else {}
        except RigcalError as error:
            notes.append(f"{topic}: {error}")
    return Found(
        sensor.name, sensor.topic, sensor.message_type, sensor.count, sensor.kind, frame, fields,
        notes,
    )  # fmt: skip


def _beside(sensor: Found, contents: Contents, others: Sequence[str]) -> list[str]:
    """Topics of its namespace that describe it and are called more like it than like another.

    A namespace may have two cameras: /left_image and /left_camera_info, /right_image and so on.
    """
    own = _base(sensor.topic)
    beside = [
        topic
        for topic, (message_type, _) in contents.items()
        if PurePosixPath(topic).parent == own.parent
        and message_type in sensor.kind.describes
        and message_type not in sensor.kind.message_types
        and all(_alike(topic, sensor.topic) >= _alike(topic, other) for other in others)
    ]
    alike = [_alike(topic, sensor.topic) for topic in beside]
    return [topic for topic, words in zip(beside, alike, strict=True) if words == max(alike)]


def _alike(topic: str, of_sensor: str) -> int:
    """How many words two names have in common at their start, 0 in different namespaces."""
    own, path = _base(of_sensor), PurePosixPath(topic)
    words = zip(path.name.split("_"), own.name.split("_"), strict=False)
    same = takewhile(lambda pair: pair[0] == pair[1], words)
    return sum(1 for _ in same) if own.parent == path.parent else 0


def _base(topic: str) -> PurePosixPath:
    """The topic whose compressed form this one is, by the names of ROS's image_transport."""
    path = PurePosixPath(topic)
    return path.parent if path.name == "compressed" else path


def _frame(message: Message) -> str:
    frame = getattr(getattr(message.value, "header", None), "frame_id", "")
    return str(frame).removeprefix("/")
