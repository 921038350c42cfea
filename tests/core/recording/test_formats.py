"""Kinds of recordings that plugins bring."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from rigcal.errors import RecordingError
from rigcal.recording import BUILTIN_FORMATS, RecordingFormat, open_recording
from rigcal.recording.fingerprint import fingerprint
from rigcal.recording.message import Source


def _tape(accepts: Callable[[Path], bool], opened: Any = None, name: str = "tape") -> Any:
    def open_tape(path: Path, definitions: object) -> Any:
        if isinstance(opened, Exception):
            raise opened
        return opened

    return RecordingFormat(name, accepts, open_tape)


def _denied(path: Path) -> bool:
    raise PermissionError(13, "denied")


def test_a_plugins_format_goes_before_the_built_in_ones(tmp_path: Path) -> None:
    (tmp_path / "tape.bin").write_text("1")
    tape = object()
    formats = (*BUILTIN_FORMATS, _tape(lambda path: (path / "tape.bin").exists(), tape))
    assert open_recording(tmp_path, formats=formats) is tape
    (tmp_path / "tape.bin").rename(tmp_path / "1.csv")
    with open_recording(tmp_path, formats=formats) as folder:
        assert folder.contents() == {".csv": (".csv", 1)}


@pytest.mark.parametrize(
    ("formats", "message"),
    [
        ([_tape(lambda path: False)], r"'\.tape' file is not .* or what plugins read \(tape\)"),
        (
            [_tape(lambda path: True), _tape(lambda path: True, name="cassette")],
            "formats 'tape' and 'cassette' both take it for theirs; uninstall all but one",
        ),
        ([_tape(lambda path: 1 / 0)], "format 'tape' failed with ZeroDivisionError"),  # type: ignore
        ([_tape(_denied)], "cannot be read: denied"),
        ([_tape(lambda path: True, KeyError("x"))], "format 'tape' failed with KeyError"),
        ([_tape(lambda path: True, RecordingError("torn"))], "^torn$"),
        ([_tape(lambda path: True, PermissionError(13, "denied"))], "cannot be read: denied"),
    ],
)
def test_what_goes_wrong_names_the_format(tmp_path: Path, formats: Any, message: str) -> None:
    path = tmp_path / "a.tape"
    path.write_text("")
    with pytest.raises(RecordingError, match=message):
        open_recording(path, formats=(*BUILTIN_FORMATS, *formats))


def test_a_folder_with_topics_is_identified_by_all_its_files(tmp_path: Path) -> None:
    (tmp_path / "tape.bin").write_text("1")
    before = fingerprint(tmp_path, [Source(topic="/scan")])
    (tmp_path / "tape.bin").write_text("2")
    assert fingerprint(tmp_path, [Source(topic="/scan")]) != before
