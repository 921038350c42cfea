"""A first rig.yaml: the sensors of a recording, and what it and other tools say of them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np
import yaml
from pydantic import ValidationError

from rigcal.errors import ConfigError, InputError
from rigcal.geometry import se3
from rigcal.importing import Imported, import_file
from rigcal.plugin.registry import Registry
from rigcal.proposal.poses import Forest, base_of, poses_of
from rigcal.proposal.sensors import Found, sensors_in
from rigcal.proposal.text import Entry, rig_text
from rigcal.recording import Recording, Source, open_recording
from rigcal.recording.ros import TF_TYPE
from rigcal.rig import parse_rig
from rigcal.validation import explain, nearest_of

TF_STATIC = "/tf_static"


FileOf = tuple[Path, str | None]
"""A file of another tool, and the sensor whose it is, for a file that does not say it."""


def propose_rig(
    recording: Path | str,
    registry: Registry,
    files: Sequence[FileOf] = (),
    root: str | None = None,
    name: str = "rig.yaml",
) -> str:
    """The text of a rig.yaml that loads, with comments on what to fill in (the target, at least).

    Topics become sensors by the types of their messages; lenses and the like come from messages
    beside them (CameraInfo) and from `files`, poses from /tf_static and from `files`, which count
    first. A sensor of which something is missing stands in comments. `root` is by default the
    first sensor that sees in three dimensions. `name` is what the file will be called; its head
    says what to run. InputError where nothing can be made of it.
    """
    formats = tuple(registry.recording_formats.values())
    with open_recording(recording, registry.message_definitions, formats) as opened:
        sensors, notes = sensors_in(opened, registry)
        if not sensors:
            raise InputError(f"{recording}: no topic is of a known sensor{_listing(opened)}")
        static = _static_frames(opened)
    given = [_take(file, sensors, registry) for file in files]
    missing = {s.name: text for s in sensors if (text := _missing(s))}
    complete = [s for s in sensors if s.name not in missing]
    if not complete:
        lines = "".join(f"\n  {name}: {text}" for name, text in missing.items())
        raise InputError(
            f"{recording}: no sensor can be described{lines}\n"
            "give what is missing in a file of another tool: --from NAME=FILE"
        )
    root = _root(root, complete)
    forests = [_forest(*one, complete) for one in given]
    forests.append(_forest(TF_STATIC, static, {}, complete))
    poses, sources = poses_of(forests, root)
    entries = [
        Entry(s, poses.get(s.name), sources.get(s.name), missing.get(s.name)) for s in sensors
    ]
    text = rig_text(name, Path(recording), root, base_of(forests, root), entries, notes)
    parse_rig(yaml.safe_load(text), registry)
    return text


def _listing(recording: Recording) -> str:
    contents = recording.contents()
    if contents and all(topic.startswith(".") for topic in contents):
        return ": a folder of files has none; write its rig by hand, with `files` of each sensor"
    lines = [f"\n  {t}  {kind}  {count}" for t, (kind, count) in contents.items()]
    return "; it holds:" + "".join(lines) if lines else "; it is empty"


def _static_frames(recording: Recording) -> Imported:
    if recording.contents().get(TF_STATIC, ("", 0))[0] != TF_TYPE:
        return Imported()
    frames = {}
    for message in recording.read(Source(topic=TF_STATIC)):
        for one in message.value.transforms:
            t, q = one.transform.translation, one.transform.rotation
            R = se3.rotation_from_quaternion(np.array([q.x, q.y, q.z, q.w]))
            child, parent = (f.removeprefix("/") for f in (one.child_frame_id, one.header.frame_id))
            frames[child] = (parent, se3.transform(R, np.array([t.x, t.y, t.z])))
    return Imported(frames=frames)


def _take(
    file: FileOf, sensors: Sequence[Found], registry: Registry
) -> tuple[str, Imported, dict[str, Found]]:
    """What a file says and whose it is, its fields being given to their sensors."""
    content = import_file(file[0], registry)
    match = _match(file, content, sensors)
    for theirs, sensor in match.items():
        fields = content.sensors[theirs].items()
        own = {k: v for k, v in fields if k not in ("type", "topic")}
        sensor.fields.update(own)
        sensor.notes.append(f"{', '.join(own)} from {file[0].name}")
    return str(file[0]), content, match


def _match(file: FileOf, content: Imported, sensors: Sequence[Found]) -> dict[str, Found]:
    """Which sensor of the recording each of the file's is; ConfigError if none of them is one."""
    path, said = file
    known = [s.name for s in sensors]
    if said is not None:
        if said not in known:
            raise ConfigError(f"no sensor '{said}'{nearest_of(said, known)}")
        if len(content.sensors) != 1:
            raise ConfigError(
                f"{path}: it describes {len(content.sensors)} sensors, so it cannot be said "
                f"to be that of '{said}'; give it as `--from {path}`"
            )
    matches = {}
    for theirs, fields in content.sensors.items():
        found = next((s for s in sensors if _is(s, theirs, fields, said)), None)
        if found is None:
            continue
        if found.kind.name != fields.get("type", found.kind.name):
            raise ConfigError(
                f"{path}: it describes a {fields['type']}, and '{found.name}' "
                f"({found.topic}) is a {found.kind.name}"
            )
        matches[theirs] = found
    if content.sensors and not matches:
        raise ConfigError(
            f"{path}: none of the recording's sensors ({', '.join(known)}) has the topic or "
            f"name of what it describes ({', '.join(content.sensors)}); say whose it is: "
            f"--from NAME={path}"
        )
    return matches


def _is(sensor: Found, theirs: str, fields: Any, said: str | None) -> bool:
    if said is not None:
        return sensor.name == said
    if topic := fields.get("topic"):
        own = PurePosixPath(sensor.topic)
        return PurePosixPath(topic) in (own, *own.parents)
    return theirs in (sensor.name, sensor.frame)


def _missing(sensor: Found) -> str:
    """What its config lacks, in words; empty if nothing."""
    data = {"type": sensor.kind.name, "topic": sensor.topic, **sensor.fields}
    try:
        sensor.kind.config.model_validate(data)
    except ValidationError as error:
        return "; ".join(text for _, text in explain(error, sensor.kind.config, data))
    return ""


def _root(asked: str | None, complete: Sequence[Found]) -> str:
    known = [s.name for s in complete]
    if asked is None:
        return min(complete, key=lambda s: (s.kind.flat, s.kind.config.optical)).name
    if asked not in known:
        raise ConfigError(f"no sensor '{asked}' that could be the root{nearest_of(asked, known)}")
    return asked


def _forest(
    source: str, content: Imported, match: dict[str, Found], sensors: Sequence[Found]
) -> Forest:
    """The frames, and whose own each is: as matched, as messages say, or by name."""
    frames = content.frames
    there = {*frames, *(parent for parent, _ in frames.values())}
    sensor_of = {f: s.name for f, s in match.items() if f in there and s in sensors}
    for sensor in sensors:
        if sensor.name not in sensor_of.values():
            optical = sensor.kind.config.optical
            names = (sensor.frame, f"{sensor.name}_optical_frame" if optical else sensor.name)
            for name in [n for n in names if n in there and n not in sensor_of][:1]:
                sensor_of[name] = sensor.name
    return Forest(source, frames, sensor_of)
