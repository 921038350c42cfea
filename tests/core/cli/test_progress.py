"""Progress is for terminals."""

from __future__ import annotations

import pytest

from rigcal.cli.progress import progress_bar


def test_nothing_where_nobody_watches(capsys: pytest.CaptureFixture[str]) -> None:
    with progress_bar() as progress:
        progress("detecting", 1, 2)
    captured = capsys.readouterr()
    assert (captured.out, captured.err) == ("", "")


def test_bar_on_a_terminal(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("FORCE_COLOR", "1")
    with progress_bar() as progress:
        progress("detecting", 1, 2)
        progress("detecting", 2, 2)
        progress("estimating", 3, 3)
    captured = capsys.readouterr()
    assert captured.out == ""
    for what, done in (("detecting", "2/2"), ("estimating", "3/3")):
        *_, last = (line for line in captured.err.splitlines() if what in line)
        assert done in last


def test_quiet_on_a_terminal(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("FORCE_COLOR", "1")
    with progress_bar(quiet=True) as progress:
        progress("detecting", 1, 2)
    assert capsys.readouterr().err == ""
