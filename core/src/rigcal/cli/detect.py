"""`rigcal detect`: recording -> observations.npz."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from rigcal.cli.output import Jobs, Json, Quiet, make_folder, print_json, print_line, print_table
from rigcal.cli.progress import progress_bar
from rigcal.cli.provenance import identity, versions

if TYPE_CHECKING:
    from rigcal.observation import Observation

RigFile = Annotated[Path, typer.Argument(metavar="RIG", help="The rig file (YAML).")]


def detect(
    rig_file: RigFile,
    recording: Annotated[
        Path, typer.Argument(metavar="RECORDING", help="A bag, an MCAP file or a folder of files.")
    ],
    out: Annotated[
        Path, typer.Option("--out", "-o", metavar="FILE", help="The observations (.npz).")
    ],
    jobs: Jobs = None,
    quiet: Quiet = False,
    json: Json = False,
) -> None:
    """Find the target in the frames of a recording.

    Of a continuous one, in those in which it stands still.
    """
    from rigcal.detection import detect as detect_all
    from rigcal.observation_file import save_observations
    from rigcal.plugin.registry import Registry
    from rigcal.rig import load_rig

    registry = Registry.from_entry_points()
    rig = load_rig(rig_file, registry)
    make_folder(out.parent)
    with progress_bar(quiet or json) as progress:
        observations = detect_all(rig, registry, recording, progress, jobs)
        inputs = {"rig": identity(rig_file), "recording": identity(recording, rig)}
    save_observations(out, observations, {"versions": versions(rig, registry), "inputs": inputs})
    counts = count_detected(observations)
    if json:
        print_json({"observations": str(out), "sensors": counts})
    elif not quiet:
        rows = [(n, str(c["frames"]), str(c["detected"])) for n, c in counts.items()]
        print_table("", ("<sensor", "frames", "target found"), rows)
        for name, count in counts.items():
            for reason, times in count["reasons"].items():
                print_line(f"{name}: {times} without: {reason}")
        print_line(f"observations  {out}")


def count_detected(observations: Sequence[Observation]) -> dict[str, dict[str, Any]]:
    """Per sensor: frames, frames with a candidate, and how often each reason why there is none."""
    counts: dict[str, dict[str, Any]] = {}
    for o in observations:
        count = counts.setdefault(o.sensor, {"frames": 0, "detected": 0, "reasons": {}})
        frames = max(len(o.frames), 1)
        count["frames"] += frames
        if o.candidates:
            count["detected"] += frames
        else:
            count["reasons"][o.reason] = count["reasons"].get(o.reason, 0) + frames
    return counts
