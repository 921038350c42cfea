"""`rigcal simulate` and `rigcal demo`."""

from __future__ import annotations

from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rigcal.cli.detect import RigFile
from rigcal.cli.output import Jobs, Json, Quiet, make_folder, print_json, print_line, print_table
from rigcal.cli.progress import progress_bar

if TYPE_CHECKING:
    from rigcal_sim.dataset import Summary

Seed = Annotated[int, typer.Option(min=0, help="Seed of the random numbers.")]


def simulate(
    rig_file: RigFile,
    out: Annotated[
        Path, typer.Option("--out", "-o", metavar="DIR", help="Folder for recording and truth.")
    ],
    poses: Annotated[
        int | None, typer.Option(min=1, metavar="N", help="Exposures; default: the scenario's.")
    ] = None,
    seed: Seed = 0,
    scenario: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE", help="Scenario; without it, boards are shown where the sensors look."
        ),
    ] = None,
    bag: Annotated[bool, typer.Option("--bag", help="Write recording.bag (ROS 1) too.")] = False,
    preview: Annotated[
        bool,
        typer.Option("--preview", help="Draw the rig, and what every sensor saw, in DIR/preview."),
    ] = False,
    jobs: Jobs = None,
    quiet: Quiet = False,
    json: Json = False,
) -> None:
    """Simulate a recording of a rig, with the truth, from the poses in the rig file."""
    silent = quiet or json
    summary = _simulate(rig_file, scenario, out, poses, seed, bag, jobs, silent)
    index = _preview(rig_file, summary, jobs, silent) if preview else None
    if json:
        print_json(_as_mapping(summary) | ({"preview": str(index)} if index else {}))
    elif not quiet:
        _show(summary)
        if index:
            print_line(f"{index}")


def demo(
    out: Annotated[Path, typer.Option("--out", "-o", metavar="DIR", help="Folder for all.")] = Path(
        "rigcal-demo"
    ),
    seed: Seed = 0,
    jobs: Jobs = None,
    quiet: Quiet = False,
    json: Json = False,
) -> None:
    """Simulate an example rig, calibrate it from the recording, compare with the truth."""
    from rigcal.cli.calibrate import calibrate
    from rigcal.cli.evaluate import evaluate
    from rigcal.files import write_text

    make_folder(out)
    for name in ("rig.yaml", "scenario.yaml"):
        text = files("rigcal_sim").joinpath("demo", name).read_text(encoding="utf-8")
        write_text(out / name, text)
    silent = quiet or json
    rig, scenario = out / "rig.yaml", out / "scenario.yaml"
    summary = _simulate(rig, scenario, out, None, seed, False, jobs, silent)
    if not silent:
        _show(summary)
    calibrate(rig, summary.recordings[0], out, seed=seed, jobs=jobs, quiet=silent)
    if not quiet:
        evaluate(out / "calibration.yaml", summary.truth, json=json)


def _simulate(
    rig_file: Path,
    scenario_file: Path | None,
    out: Path,
    poses: int | None,
    seed: int,
    bag: bool,
    jobs: int | None,
    silent: bool,
) -> Summary:
    from rigcal.plugin.registry import Registry
    from rigcal.rig import load_rig
    from rigcal_sim.dataset import simulate as write_recording
    from rigcal_sim.scenario_file import load_scenario

    registry = Registry.from_entry_points()
    rig = load_rig(rig_file, registry)
    scenario = load_scenario(scenario_file, rig, registry) if scenario_file else None
    formats = ("mcap", "bag") if bag else ("mcap",)
    with progress_bar(silent) as progress:
        return write_recording(
            rig, registry, scenario, seed, out, formats, progress, poses=poses, jobs=jobs
        )


def _preview(rig_file: Path, summary: Summary, jobs: int | None, silent: bool) -> Path:
    from rigcal.calibration_file import load_calibration
    from rigcal.plugin.registry import Registry
    from rigcal.rig import build_targets, load_rig
    from rigcal_sim.preview import write_preview

    registry = Registry.from_entry_points()
    rig = load_rig(rig_file, registry)
    target = build_targets(rig, registry)[summary.target]
    truth, folder = load_calibration(summary.truth), summary.truth.parent / "preview"
    with progress_bar(silent) as progress:
        return write_preview(
            rig, registry, target, summary.recordings[0], truth, folder, progress, jobs
        )


def _show(summary: Summary) -> None:
    print_table(
        _title(summary),
        ("<sensor", "board in view"),
        [(name, str(count)) for name, count in summary.seen.items()],
    )
    print_table(
        "",
        ("<topic", "messages"),
        [(topic, str(count)) for topic, count in summary.messages.items()],
    )
    for path in (*summary.recordings, summary.truth):
        print_line(f"{path}  {_size(path.stat().st_size)}")


def _size(count: int) -> str:
    return f"{count / 1e6:.1f} MB" if count >= 1e5 else f"{count / 1e3:.1f} kB"


def _title(summary: Summary) -> str:
    title = f"Simulated {summary.exposures} exposures"
    if summary.redrawn:
        title += f"; {summary.redrawn} poses were drawn again"
    if summary.unseen:
        title += f"; too few sensors saw the board at {summary.unseen} poses"
    return title


def _as_mapping(summary: Summary) -> dict[str, object]:
    return {
        "recordings": [str(path) for path in summary.recordings],
        "sizes_bytes": [path.stat().st_size for path in summary.recordings],
        "messages": dict(summary.messages),
        "truth": str(summary.truth),
        "exposures": summary.exposures,
        "redrawn": summary.redrawn,
        "unseen": summary.unseen,
        "seen": dict(summary.seen),
    }
