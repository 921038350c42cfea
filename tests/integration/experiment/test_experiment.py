"""`rigcal experiment msgcal` from the command line."""

import csv
import json
from pathlib import Path

import pytest

from rigcal_sim.experiment import study
from rigcal_sim.experiment.run import Row

HERE = Path(__file__).parent
RIG = HERE.parent / "pipeline" / "cart.yaml"
SCENARIO = HERE.parent / "pipeline" / "scenario.yaml"


def test_a_study_of_one_run(tmp_path, command):
    given = ("--scenario", SCENARIO, "--runs", 1, "--outliers", 0, "--jobs", 1, "--json")
    ran = command("experiment", "msgcal", RIG, "--out", tmp_path, *given)
    assert ran.code == 0
    answer = json.loads(ran.out)
    assert all(Path(path).exists() for path in answer["files"])
    assert any("joint: scatter takes two runs or more" in claim for claim in answer["claims"])
    assert not any("nan" in claim for claim in answer["claims"])
    with (tmp_path / "runs.csv").open() as file:
        rows = {(r["formulation"], r["filtered"], r["initial"]): r for r in csv.DictReader(file)}
    assert len(rows) == 7
    for row in rows.values():
        assert not row["problem"]
        assert 0 < float(row["mean_translation_m"]) < 0.01
        assert float(row["graph_error_m2"]) > 0
    tree, start = (
        float(rows["joint", "True", i]["mean_translation_m"]) for i in ("tree", "identity")
    )
    assert start == pytest.approx(tree, rel=1e-2)
    with (tmp_path / "sensors.csv").open() as file:
        assert {r["sensor"] for r in csv.DictReader(file)} == {"left", "right", "scan"}


def test_a_study_that_is_ended_leaves_the_runs_that_are_done(tmp_path, command, monkeypatch):
    def run(setting, task):
        if task.seed == 2:
            raise KeyboardInterrupt
        return [Row("features", 0.0, task.seed, "pairwise", True, "tree", 1e-6)], []

    monkeypatch.setattr(study, "run", run)
    given = ("--scenario", SCENARIO, "--runs", 3, "--outliers", 0, "--jobs", 1, "-q")
    assert command("experiment", "msgcal", RIG, "--out", tmp_path, *given).code == 130
    with (tmp_path / "runs.csv").open() as file:
        assert [row["seed"] for row in csv.DictReader(file)] == ["0", "1"]
    assert not (tmp_path / "claims.txt").exists()


def test_a_recording_is_not_simulated(tmp_path, command):
    given = ("--data", tmp_path / "x.npz", "--raw-runs", 2, "--out", tmp_path)
    ran = command("experiment", "msgcal", RIG, *given)
    assert ran.code == 2
    assert "leave out --scenario and --raw-runs" in ran.err
