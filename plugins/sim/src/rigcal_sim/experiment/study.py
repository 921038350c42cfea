"""All runs of the experiment, their tables, figures and text."""

from __future__ import annotations

import csv
import io
import json
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from rigcal.files import write_text
from rigcal.progress import Progress
from rigcal.workers import in_order
from rigcal_sim.experiment.claims import claims
from rigcal_sim.experiment.figures import write_figures
from rigcal_sim.experiment.run import Row, Run, SensorRow, Setting, run


@dataclass(frozen=True, eq=False)
class Study:
    """What came out of the runs."""

    rows: tuple[Row, ...]
    sensor_rows: tuple[SensorRow, ...]


def carry_out(
    setting: Setting, runs: Sequence[Run], jobs: int, progress: Progress | None = None
) -> Iterator[Study]:
    """The study so far, after each run; runs are spread over processes.

    The last is that of all. The result does not depend on the number of processes.
    """
    tell = progress or (lambda *_: None)
    study = Study((), ())
    tell("runs", 0, len(runs))
    for done, (rows, of_sensors) in enumerate(in_order(run, setting, runs, jobs), start=1):
        study = Study((*study.rows, *rows), (*study.sensor_rows, *of_sensors))
        yield study
        tell("runs", done, len(runs))


def write_tables(study: Study, folder: Path) -> list[Path]:
    """runs.csv and sensors.csv; returns their paths."""
    texts = {"runs.csv": _csv(study.rows), "sensors.csv": _csv(study.sensor_rows)}
    return _written(texts, folder)


def write_study(study: Study, folder: Path) -> list[Path]:
    """The tables, study.json, claims.txt and the figures; returns their paths."""
    lines = claims(study.rows)
    texts = {"study.json": _json(study, lines), "claims.txt": "\n".join(lines) + "\n"}
    tables = write_tables(study, folder)
    return [*tables, *_written(texts, folder), *write_figures(study.rows, folder)]


def _written(texts: Mapping[str, str], folder: Path) -> list[Path]:
    for name, text in texts.items():
        write_text(folder / name, text)
    return [folder / name for name in texts]


def _csv(rows: Sequence[Row] | Sequence[SensorRow]) -> str:
    text = io.StringIO()
    if rows:
        writer = csv.DictWriter(text, list(asdict(rows[0])), lineterminator="\n")
        writer.writeheader()
        writer.writerows(asdict(row) for row in rows)
    return text.getvalue()


def _json(study: Study, lines: Sequence[str]) -> str:
    content = {
        "claims": list(lines),
        "runs": [_plain(row) for row in study.rows],
        "sensors": [_plain(row) for row in study.sensor_rows],
    }
    return json.dumps(content, indent=1, allow_nan=False) + "\n"


def _plain(row: Row | SensorRow) -> dict[str, Any]:
    """NaN is no JSON."""
    return {
        k: None if isinstance(v, float) and not math.isfinite(v) else v
        for k, v in asdict(row).items()
    }
