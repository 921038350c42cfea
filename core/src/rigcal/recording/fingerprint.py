"""Which recording a result came from."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable
from pathlib import Path

from rigcal.recording.message import Source


def fingerprint(path: Path | str, sources: Iterable[Source] = ()) -> str:
    """sha256 (hex) of a recording: of the file, or of names and contents of a folder's files.

    In a folder of files only those that the sources' globs match count.
    """
    path = Path(path)
    digest = hashlib.sha256()
    for file in _files(path, sources):
        if path.is_dir():
            digest.update(file.relative_to(path).as_posix().encode() + b"\0")
        with file.open("rb") as stream:
            digest.update(hashlib.file_digest(stream, "sha256").digest())
    return digest.hexdigest()


def _files(path: Path, sources: Iterable[Source]) -> list[Path]:
    if path.is_file():
        return [path]
    globs = ["*"] if (path / "metadata.yaml").is_file() else [s.files for s in sources if s.files]
    return sorted({p for glob in globs for p in path.glob(glob) if p.is_file()})
