"""`rigcal experiment`."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from rigcal.cli.detect import RigFile
from rigcal.cli.output import Jobs, Json, Quiet, make_folder, print_json, print_line
from rigcal.cli.progress import progress_bar

if TYPE_CHECKING:
    from rigcal.plugin import Registry
    from rigcal.progress import Progress
    from rigcal.rig import Rig
    from rigcal_sim.experiment.source import Source


def experiment(
    study: Annotated[
        Literal["msgcal"], typer.Argument(metavar="msgcal", help="The study to carry out.")
    ],
    rig_file: RigFile,
    out: Annotated[
        Path, typer.Option("--out", "-o", metavar="DIR", help="Folder for tables and figures.")
    ],
    scenario: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Scenario of the simulated runs.")
    ] = None,
    data: Annotated[
        Path | None,
        typer.Option(
            metavar="DATA", help="A recording or observations.npz, instead of simulation."
        ),
    ] = None,
    runs: Annotated[
        int, typer.Option(min=1, help="Runs at the level of features, or over a recording.")
    ] = 20,
    raw_runs: Annotated[
        int, typer.Option(min=0, help="Runs with simulated images, scans and clouds.")
    ] = 0,
    outliers: Annotated[
        float,
        typer.Option(min=0, max=0.9, help="Share of wrong detections; 0 is always tried too."),
    ] = 0.2,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the first run; the next count on.")] = 0,
    jobs: Jobs = None,
    quiet: Quiet = False,
    json: Json = False,
) -> None:
    """Repeat the study of MSG-Cal: pairs against graph, filtered or not, tree or identity."""
    from rigcal.plugin import Registry
    from rigcal.rig import load_rig
    from rigcal_sim.experiment.run import Run, Setting
    from rigcal_sim.experiment.study import carry_out, write_study, write_tables

    registry = Registry.from_entry_points()
    rig = load_rig(rig_file, registry)
    make_folder(out)
    processes = jobs or os.cpu_count() or 1
    with progress_bar(quiet or json) as progress:
        sources = _sources(rig, registry, scenario, data, raw_runs, progress, jobs)
        tasks = [
            Run(source, share, seed + i)
            for source, count in zip(range(len(sources)), (runs, raw_runs), strict=False)
            for share in sorted({0.0, outliers})
            for i in range(count)
        ]
        for result in carry_out(Setting(rig, registry, sources), tasks, processes, progress):
            # A study takes hours where runs are raw: what is done is not lost if it is ended.
            write_tables(result, out)
    paths = write_study(result, out)
    lines = (out / "claims.txt").read_text(encoding="utf-8").splitlines()
    if json:
        print_json({"files": [str(path) for path in paths], "claims": lines})
    elif not quiet:
        for line in lines:
            print_line(line)
        for path in paths:
            print_line(str(path))


def _sources(
    rig: Rig,
    registry: Registry,
    scenario_file: Path | None,
    data: Path | None,
    raw_runs: int,
    progress: Progress,
    jobs: int | None,
) -> tuple[Source, ...]:
    from rigcal.detection import detect
    from rigcal.errors import ConfigError
    from rigcal.observation_file import load_observations
    from rigcal.rig import build_targets
    from rigcal_sim.default import default_scenario
    from rigcal_sim.experiment.source import Features, Raw, Recorded, truth_of
    from rigcal_sim.scenario_file import load_scenario

    if data is not None:
        if scenario_file or raw_runs:
            raise ConfigError(
                "--data is studied as it is: leave out --scenario and --raw-runs, which simulate"
            )
        npz = data.suffix == ".npz"
        seen = load_observations(data)[0] if npz else detect(rig, registry, data, progress, jobs)
        return (Recorded(tuple(seen)),)
    silent = sorted(
        n for n, c in rig.sensors.items() if registry.sensor_type(c.type).observe is None
    )
    if silent or len(rig.targets) != 1:
        what = f"{', '.join(silent)} cannot" if silent else f"{len(rig.targets)} targets cannot"
        raise ConfigError(
            f"rig '{rig.name}': {what} be simulated at the level of features; a study needs one "
            "target and sensors whose types say what a flawless detector reports, or --data"
        )
    if scenario_file:
        scenario = load_scenario(scenario_file, rig, registry)
    else:
        (target,) = build_targets(rig, registry).values()
        scenario = default_scenario(rig, registry, target)
    truth = truth_of(rig)
    return (Features(scenario, truth), *((Raw(scenario, truth),) if raw_runs else ()))
