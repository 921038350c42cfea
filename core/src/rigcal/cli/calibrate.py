"""`rigcal calibrate`: recording or observations -> calibration.yaml and report.html."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from rigcal.cli.detect import RigFile
from rigcal.cli.output import Jobs, Json, Quiet, make_folder, print_json, print_line
from rigcal.cli.progress import progress_bar
from rigcal.cli.provenance import identity, versions
from rigcal.graph.method import Formulation, Initial, Method

if TYPE_CHECKING:
    from rigcal.calibration import Calibration
    from rigcal.observation import Observation
    from rigcal.plugin.registry import Registry
    from rigcal.progress import Progress
    from rigcal.rig import Rig


def calibrate(
    rig_file: RigFile,
    data: Annotated[
        Path,
        typer.Argument(metavar="DATA", help="A recording, or observations.npz made by `detect`."),
    ],
    out: Annotated[
        Path,
        typer.Option(
            "--out",
            "-o",
            metavar="DIR",
            help="Folder for the results; replaces those of an earlier run.",
        ),
    ],
    seed: Annotated[int, typer.Option(min=0, help="Seed of the random sampling.")] = 0,
    formulation: Annotated[
        Formulation,
        typer.Option(
            metavar="joint|msgcal",
            help="Maximum likelihood over all measurements, or the graph of MSG-Cal.",
        ),
    ] = "joint",
    no_filter: Annotated[
        bool, typer.Option("--no-filter", help="Use all data, outliers too.")
    ] = False,
    initial: Annotated[
        Initial,
        typer.Option(
            metavar="tree|identity",
            help="Start from the spanning tree of the pairs, or with all at the root.",
        ),
    ] = "tree",
    second_look: Annotated[
        bool | None,
        typer.Option(
            "--second-look/--no-second-look",
            help="Search a recording again where sensors should have seen the target and did not; "
            "default: if it is continuous.",
        ),
    ] = None,
    accept_weak: Annotated[
        bool,
        typer.Option("--accept-weak", help="Give a result although the data leave it open."),
    ] = False,
    report: Annotated[bool, typer.Option(help="Write report.html.")] = True,
    jobs: Jobs = None,
    quiet: Quiet = False,
    json: Json = False,
) -> None:
    """Estimate where the sensors are."""
    from rigcal.errors import InputError
    from rigcal.estimation import calibrate as estimate
    from rigcal.exposures import association_of
    from rigcal.observation_file import save_observations
    from rigcal.plugin.registry import Registry
    from rigcal.rig import load_rig
    from rigcal.second_look import found_again, look_again

    if second_look and data.suffix == ".npz":
        raise InputError(
            f"--second-look searches a recording again, and {data} holds observations; give the "
            "recording that they were made of"
        )
    make_folder(out)
    registry = Registry.from_entry_points()
    rig = load_rig(rig_file, registry)
    method = Method(formulation, not no_filter, initial, accept_weak)
    if data.exists():  # a mistyped name costs nobody a result
        _clear(out, data)
    with progress_bar(quiet or json) as progress, _verdict_of_failure(out):
        observations, about = _observations(rig, registry, rig_file, data, out, progress, jobs)
        calibration = estimate(rig, registry, observations, seed, progress, method)
        if second_look is None:
            second_look = association_of(rig.association, observations) == "still"
        if second_look and data.suffix != ".npz":
            again = look_again(rig, registry, data, observations, calibration, progress, jobs)
            if added := found_again(observations, again):
                calibration = estimate(rig, registry, again, seed, progress, method)
                observations, about = again, {**about, "second_look": added}
                header = {"versions": versions(rig, registry), **about}
                save_observations(out / "observations.npz", observations, header)
        made_from = {"versions": versions(rig, registry), **about}
        calibration = replace(calibration, provenance={**calibration.provenance, **made_from})
        recording = data if data.suffix != ".npz" else None
        files = _write_results(
            out, calibration, observations, rig, registry, report, recording, progress
        )
    if json:
        verdict = calibration.verdict and calibration.verdict.as_mapping()
        print_json({"files": files, "verdict": verdict, **_as_mapping(calibration)})
    elif not quiet:
        from rigcal.cli.result_tables import print_calibration

        print_calibration(calibration)
        for name, path in files.items():
            print_line(f"{name:13} {path}")


def _clear(out: Path, data: Path) -> None:
    """Remove the results of an earlier run: if this one fails, however it does, they would pass for
    its own.
    """
    from rigcal.errors import InputError

    for name in ("calibration.yaml", "observations.npz", "report.html", "verdict.yaml"):
        path = out / name
        if path.exists() and not path.samefile(data):
            try:
                path.unlink()
            except OSError as error:
                raise InputError(f"{path}: cannot be replaced: {error.strerror}") from error


@contextmanager
def _verdict_of_failure(out: Path) -> Iterator[None]:
    """Write why there is no result, if so."""
    from rigcal.diagnosis.verdict_file import save_verdict, verdict_of_error
    from rigcal.errors import CalibrationError

    try:
        yield
    except CalibrationError as error:
        save_verdict(out / "verdict.yaml", verdict_of_error(error))
        raise


def _write_results(
    out: Path,
    calibration: Calibration,
    observations: Sequence[Observation],
    rig: Rig,
    registry: Registry,
    report: bool = True,
    recording: Path | None = None,
    progress: Progress | None = None,
) -> dict[str, str]:
    """Write the files of a calibration into a folder; returns their paths by what they hold."""
    from rigcal.calibration_file import save_calibration
    from rigcal.diagnosis.verdict_file import save_verdict

    files = {"calibration": out / "calibration.yaml", "observations": out / "observations.npz"}
    save_calibration(files["calibration"], calibration)
    if calibration.verdict is not None:
        files["verdict"] = out / "verdict.yaml"
        save_verdict(files["verdict"], {"result": "given", **calibration.verdict.as_mapping()})
    if report:
        from rigcal.report import write_report

        files["report"] = out / "report.html"
        write_report(files["report"], calibration, observations, rig, registry, recording, progress)
    return {name: str(path) for name, path in files.items()}


def _observations(
    rig: Rig,
    registry: Registry,
    rig_file: Path,
    data: Path,
    out: Path,
    progress: Progress,
    jobs: int | None,
) -> tuple[Sequence[Observation], dict[str, Any]]:
    """Observations from a file or a recording, and what they were made of.

    They are saved at once: when the estimate fails, it can be tried again without detecting.
    """
    from rigcal.detection import detect
    from rigcal.observation_file import load_observations, save_observations

    if data.suffix == ".npz":
        loaded, about = load_observations(data)
        origin = about.get("inputs", {}).get("recording")
        source = {"recording": origin} if origin else {"observations": identity(data)}
        observations: Sequence[Observation] = loaded
    else:
        observations = detect(rig, registry, data, progress, jobs)
        source, about = {"recording": identity(data, rig)}, {}
    inputs = {"rig": identity(rig_file), **source}
    made = {"inputs": inputs}
    if "second_look" in about:
        made["second_look"] = about["second_look"]
    about = about or {"versions": versions(rig, registry), "inputs": inputs}
    save_observations(out / "observations.npz", observations, about)
    return observations, made


def _as_mapping(calibration: Calibration) -> dict[str, Any]:
    import yaml

    from rigcal.calibration_text import calibration_text

    content: dict[str, Any] = yaml.safe_load(calibration_text(calibration))
    return content
