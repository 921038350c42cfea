"""YAML that people write: what no mapping of keys can be read from is refused in one line."""

from __future__ import annotations

from pathlib import Path

import pytest

from rigcal.calibration_file import load_calibration
from rigcal.errors import ConfigError


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("--- ~\n", ": found nothing, expected a calibration: a mapping of keys"),
        ("--- word\n", ": found 'word', expected a calibration: a mapping of keys"),
        ("format: {a: 1}\n", ":1: format: found a mapping, expected 'rigcal-calibration'"),
        ("a: \x07\n", ": not valid YAML: unacceptable character #x0007"),
        ("a: 1\n? [b, c]\n: d\n", ":2: found a list or mapping as a key, expected a word"),
        ("- &a [*a]\n", ": found lists or mappings that go too deep, expected a calibration;"),
        ("a: 1\nb: [0, 2024-13-01]\n", ":2: b[1]: YAML cannot read 2024-13-01 as timestamp (month"),
        ("a: 1\n2024-13-01: b\n", ":2: YAML cannot read 2024-13-01 as timestamp (month"),
        ("a: !!bool word\n", ":1: a: YAML cannot read word as bool ("),
        ("a: !!timestamp word\n", ":1: a: YAML cannot read word as timestamp ("),
    ],
)
def test_file_that_holds_no_keys_and_values_is_refused(
    tmp_path: Path, text: str, message: str
) -> None:
    path = tmp_path / "calibration.yaml"
    path.write_text(text)
    with pytest.raises(ConfigError) as caught:
        load_calibration(path)
    assert str(caught.value).startswith(f"{path}{message}")


def test_empty_entry_is_found_to_be_nothing(tmp_path: Path) -> None:
    path = tmp_path / "calibration.yaml"
    path.write_text("format: rigcal-calibration\nversion: 1\nroot: a\nsensors:\n  b:\n")
    with pytest.raises(ConfigError, match=r":5: sensors\.b: found nothing, expected a mapping"):
        load_calibration(path)
