"""rig.yaml as a person would write it, with comments on what is left to do."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from rigcal.proposal.sensors import Found

_TARGET = """\
targets:
  # FILL IN the board that was recorded, as it is printed: measure it with a ruler.
  # Other types: apriltag_poster, charuco, checkerboard. `rigcal schema` describes their keys.
  board:
    type: apriltag_grid
    family: tag36h11
    columns: 6
    rows: 6
    tag_size_m: 0.088        # outer edge of the black border
    tag_gap_m: 0.0264        # between two tags
    first_id: 0
    width_m: 0.8             # the board itself, as lasers see it
    height_m: 0.8
"""


@dataclass(frozen=True)
class Entry:
    """A sensor, its pose with the source of it, and what its config lacks, if anything."""

    sensor: Found
    pose: dict[str, Any] | None
    source: str | None
    missing: str | None


def rig_text(
    name: str,
    recording: Path,
    root: str,
    base: tuple[dict[str, Any], str] | None,
    entries: Sequence[Entry],
    notes: Sequence[str],
) -> str:
    """The file called `name`."""
    lines = [
        f"# Written by `rigcal init` from {recording.name}. FILL IN the target, remove what is not "
        "to be calibrated, then:",
        f"#     rigcal calibrate {name} {recording.name} --out result",
        *(f"# {note}" for note in notes),
        "version: 1",
        f"name: {_flow(recording.stem)}",
        f"root: {root}",
    ]
    if base:
        lines.append(f"base: {_flow(base[0])}  # the root in the robot, from {base[1]}")
    lines += [*_TARGET.splitlines(), "sensors:"]
    if any(entry.pose for entry in entries):
        lines += [
            "  # Poses are those of frames that messages name (frame_id; of a camera the optical",
            "  # one). No pose is needed; `initial: pose` beside one starts the estimate from it.",
        ]
    for entry in entries:
        lines += _sensor_lines(entry)
    return "\n".join(lines) + "\n"


def _sensor_lines(entry: Entry) -> Iterator[str]:
    sensor = entry.sensor
    mark = "# " if entry.missing else ""
    if entry.missing:
        yield f"  # FILL IN, then remove the marks: {entry.missing}"
    for note in sensor.notes:
        yield f"  # {' '.join(note.split())}"
    yield f"  {mark}{sensor.name}:  # {sensor.count} x {sensor.message_type}"
    fields = {"type": sensor.kind.name, "topic": sensor.topic, **sensor.fields}
    for key, value in fields.items():
        yield f"  {mark}  {key}: {_flow(value)}"
    if entry.pose:
        yield f"  {mark}  pose: {_flow(entry.pose)}  # from {entry.source}"


def _flow(value: object) -> str:
    """A value in one line of YAML."""
    text = yaml.safe_dump(
        [value], default_flow_style=True, sort_keys=False, width=10**9, allow_unicode=True
    )
    return text.strip()[1:-1]
