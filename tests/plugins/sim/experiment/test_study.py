"""The study of MSG-Cal: what is drawn, what the tables and the text say of it."""

import csv
import json
from dataclasses import replace

import numpy as np
import pytest

from rigcal.observation import Candidate, Observation, PointGeometry
from rigcal_sim.experiment.claims import claims
from rigcal_sim.experiment.run import METHODS, Row, of_method
from rigcal_sim.experiment.source import Recorded
from rigcal_sim.experiment.study import Study, write_study
from rigcal_sim.features import with_outliers


def seen(sensor, exposure):
    place = np.array([float(exposure), 0.0, 0.0])
    candidate = Candidate(PointGeometry(place, np.eye(3), np.zeros(3)), {})
    return Observation(sensor, str(exposure), 0, f"{sensor}{exposure}", (candidate,), "")


OBSERVATIONS = tuple(seen(s, k) for k in range(40) for s in "ab")


def test_outliers_are_what_the_same_sensor_saw_in_another_exposure():
    changed = with_outliers(OBSERVATIONS, 0.2, np.random.default_rng(0))
    for sensor in "ab":
        wrong = [
            (o.exposure, o.candidates[0].geometry.position[0])
            for o in changed
            if o.sensor == sensor and o.candidates[0].geometry.position[0] != float(o.exposure)
        ]
        assert len(wrong) == 8
        assert {float(k) for k, _ in wrong} == {place for _, place in wrong}
    assert [(o.sensor, o.exposure) for o in changed] == [
        (o.sensor, o.exposure) for o in OBSERVATIONS
    ]
    assert with_outliers(OBSERVATIONS, 0.0, np.random.default_rng(0)) == OBSERVATIONS


def test_runs_over_a_recording_use_different_exposures_and_the_same_for_a_seed():
    source = Recorded(OBSERVATIONS)
    first, again, other = (source.draw(None, None, seed) for seed in (1, 1, 2))
    assert first == again
    assert len({o.exposure for o in first}) == 27
    assert {o.exposure for o in first} != {o.exposure for o in other}


def rows_of(runs, errors, outliers=0.0, source="features"):
    """Rows with errors (m) drawn about a mean per variant; None for a variant that failed."""
    rows = []
    for seed in range(runs):
        rng = np.random.default_rng(seed)
        head = Row(source, outliers, seed, "pairwise", True, "tree")
        for row in (head, *(of_method(head, m) for m in METHODS)):
            mean, spread = errors.get((row.formulation, row.filtered), (0.001, 1e-6))
            if mean is None:
                rows.append(replace(row, problem="did not converge"))
                continue
            error = mean + spread * rng.standard_normal()
            rows.append(
                replace(
                    row, graph_error_m2=error, mean_translation_m=error, mean_axis_rad=error,
                    mean_rotation_rad=error,
                )
            )  # fmt: skip
    return rows


PAIRS = {("pairwise", True): (0.002, 1e-4)}


def test_claims_that_hold():
    text = "\n".join(claims(rows_of(10, PAIRS | {("msgcal", False): (0.01, 1e-3)}, 0.2)))
    assert "features, 20 % outliers, 10 runs" in text
    for claim in ("i", "ii", "iii", "iv"):
        assert f"({claim}) msgcal: holds" in text
    assert "(iv) joint: DOES NOT HOLD" in text


def test_claims_that_do_not():
    rows = rows_of(10, {("pairwise", True): (0.0005, 1e-6), ("joint", False): (None, 0)}, 0.2)
    text = "\n".join(claims(rows))
    assert "(i) msgcal: DOES NOT HOLD" in text
    assert "(ii) joint: DOES NOT HOLD" in text
    assert "unfiltered none of 10 converged" in text


def test_runs_without_a_result_do_not_count():
    rows = [
        replace(r, graph_error_m2=float("nan"), problem="no minimum")
        if (r.formulation, r.seed) == ("joint", 0)
        else replace(r, graph_error_m2=1.0)
        if (r.formulation, r.seed) == ("pairwise", 0)
        else r
        for r in rows_of(10, PAIRS)
    ]
    text = "\n".join(claims(rows))
    assert "joint: runs that gave no result and do not count: 1" in text
    # The pairwise error of 1 m^2 in that run is not held against the nine graphs.
    assert "(ii) joint: holds: pairwise 19" in text or "(ii) joint: holds: pairwise 20" in text


def test_without_outliers_there_is_nothing_to_filter():
    assert "(iv)" not in "\n".join(claims(rows_of(10, PAIRS)))


def test_a_start_that_fails_is_counted():
    rows = [
        replace(r, mean_translation_m=float("nan"), problem="elsewhere")
        if r.initial == "identity" and r.seed < 3
        else r
        for r in rows_of(10, PAIRS)
    ]
    text = "\n".join(claims(rows))
    assert "3 of 10 did not converge from the identity, and said so" in text
    assert "(iii) msgcal: DOES NOT HOLD" in text


def test_outliers_are_held_against_the_runs_without():
    rows = rows_of(10, PAIRS) + rows_of(10, PAIRS | {("joint", False): (0.02, 1e-3)}, 0.2)
    (line,) = [x for x in claims(rows) if "outliers over none, joint" in x]
    filtered, unfiltered = (float(x.split()[1]) for x in line.split(": ")[1].split(", "))
    assert filtered == pytest.approx(1.0, abs=0.05)
    assert unfiltered == pytest.approx(20.0, rel=0.05)


@pytest.mark.parametrize(("truth", "names"), [(True, "abce"), (False, "df")])
def test_files_of_a_study(truth, names, tmp_path):
    rows = rows_of(4, PAIRS | {("joint", False): (None, 0)})
    if not truth:
        nan = float("nan")
        rows = [replace(r, mean_translation_m=nan, mean_axis_rad=nan) for r in rows]
    paths = write_study(Study(tuple(rows), ()), tmp_path)
    assert {p.name[0] for p in paths if p.suffix == ".svg"} >= set(names)
    for svg in (p for p in paths if p.suffix == ".svg"):
        assert svg.with_suffix(".png").read_bytes()[:4] == b"\x89PNG"
    with (tmp_path / "runs.csv").open() as file:
        table = list(csv.DictReader(file))
    assert len(table) == len(rows)
    content = json.loads((tmp_path / "study.json").read_text())
    assert len(content["runs"]) == len(rows)
    assert content["claims"] == (tmp_path / "claims.txt").read_text().splitlines()
    first = {p.name: p.read_bytes() for p in paths}
    assert first == {p.name: p.read_bytes() for p in write_study(Study(tuple(rows), ()), tmp_path)}
