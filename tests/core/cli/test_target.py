"""`rigcal target`: the page, and why there is none."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

Command = Callable[..., Any]


def _write_two_targets() -> None:
    cover = "  cover: {type: checkerboard, columns: 3, rows: 2, square_size_m: 0.1}\n"
    text = Path("rig.yaml").read_text().replace("sensors:", f"{cover}sensors:")
    Path("two.yaml").write_text(text.replace("files:", "target: board, files:"))


def test_target_writes_the_page_and_says_how_large_it_is(place: Path, command: Command) -> None:
    ran = command("target", "rig.yaml", "--out", "new/board.pdf")
    assert ran.code == 0
    assert Path("new/board.pdf").read_bytes().startswith(b"%PDF")
    assert "'board' of 800 x 600 mm on a page of 830 x" in ran.out
    _write_two_targets()
    ran = command("target", "two.yaml", "--target", "cover", "-o", "cover.svg", "--json")
    assert ran.code == 0
    answer = json.loads(ran.out)
    assert answer["target"] == "cover"
    assert answer["board_mm"] == [400, 300]
    assert answer["page_mm"][0] == 430
    assert Path(answer["page"]).read_text().startswith("<?xml")
    assert command("target", "rig.yaml", "--out", "b.svg", "--quiet") == (0, "", "")


def test_target_needs_the_type_of_the_board_only(place: Path, command: Command) -> None:
    text = Path("rig.yaml").read_text().replace("sonar", "radar")
    Path("radar.yaml").write_text(text)
    assert command("target", "radar.yaml", "--out", "b.svg", "--quiet") == (0, "", "")
    Path("disc.yaml").write_text(text.replace("checkerboard", "disc").replace("root:", "rot:"))
    code, _, err = command("target", "disc.yaml", "--out", "c.svg")
    assert code == 2
    assert "disc.yaml:2: rot: unknown key, did you mean 'root'?" in err
    assert "disc.yaml:4: targets.board.type: no target type 'disc' (installed: " in err


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["two.yaml", "-o", "b.pdf"], "several targets; add `--target NAME`, one of board, cover"),
        (["two.yaml", "-o", "b.pdf", "--target", "bord"], "target 'bord', did you mean 'board'?"),
        (["rig.yaml", "-o", "b.doc"], "found suffix '.doc', expected one of .pdf, .ps, .svg, .png"),
        (["rig.yaml", "-o", "rig.yaml/b.pdf"], "rig.yaml/b.pdf: cannot be written"),
        (["rig.yaml", "-o", "b.png", "--px-per-mm", "100"], "too many pixels at 100 px/mm; use 23"),
    ],
)  # fmt: skip
def test_target_that_cannot_be_written_says_why(
    arguments: list[str], message: str, place: Path, command: Command
) -> None:
    _write_two_targets()
    ran = command("target", *arguments)
    assert ran.code == 2
    assert message in ran.err
