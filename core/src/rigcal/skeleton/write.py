"""Writes the template under another name. It is a working plugin of its own, called `skeleton`."""

from __future__ import annotations

import re
import shutil
import tempfile
from importlib.resources import as_file, files
from pathlib import Path

from rigcal.errors import InputError

_NAME = re.compile(r"[a-z][a-z0-9]*([_-][a-z0-9]+)*")
_LEFT_OUT = shutil.ignore_patterns("__pycache__", ".*")


def new_plugin(name: str, folder: Path | str | None = None) -> Path:
    """Write a plugin for a sensor type `name`: code, tests and README; returns its folder.

    `folder` is made (default: `rigcal-NAME` here). It has a config, decoder, detector, simulator
    and the tests of the conformance kit, which pass; its README says what to change where.
    InputError for a name that cannot be one, or when the folder is there already.
    """
    own = name.removeprefix("rigcal")[1:]
    if name.startswith(("rigcal-", "rigcal_")) and _NAME.fullmatch(own):
        raise InputError(
            f"'{name}' is the name of a distribution; give that of the sensor type, as rig files "
            f"will have it after `type:`: '{own}'"
        )
    if not _NAME.fullmatch(name):
        raise InputError(
            f"'{name}' is no name for a sensor type: use small letters and digits, and - or _ "
            "between words, as in 'sonar' or 'side-scan'"
        )
    folder = Path(folder if folder is not None else f"rigcal-{name}")
    if folder.exists():
        raise InputError(f"{folder} is there already; give another folder, or remove it")
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(prefix=".new-plugin.", dir=folder.parent) as temporary:
            made = Path(temporary) / folder.name
            _write(made, name)
            made.rename(folder)
    except OSError as error:
        raise InputError(f"{folder}: cannot be written: {error.strerror}") from error
    return folder


def _write(folder: Path, name: str) -> None:
    with as_file(files("rigcal.skeleton") / "template") as template:
        shutil.copytree(template, folder, ignore=_LEFT_OUT)
    module = name.replace("-", "_")
    words = {
        "rigcal-skeleton": f"rigcal-{name}",
        "rigcal_skeleton": f"rigcal_{module}",
        "test_skeleton": f"test_{module}",
        "SKELETON": module.upper(),
        "Skeleton": "".join(word.capitalize() for word in module.split("_")),
        "skeleton": name,
    }
    # Deepest first: a folder is renamed after what is in it.
    for path in sorted(folder.rglob("*"), reverse=True):
        if path.is_file():
            path.write_text(_renamed(path.read_text("utf-8"), words), "utf-8", newline="\n")
        path.rename(path.with_name(_renamed(path.name, words)))


def _renamed(text: str, words: dict[str, str]) -> str:
    return re.sub("|".join(words), lambda match: words[match[0]], text)
