"""Which data a result rests on: a hash over the content of a recording."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable
from pathlib import Path

from rigcal.errors import RecordingError
from rigcal.recording.message import Source
from rigcal.recording.open import is_bag_folder


def fingerprint(path: Path | str, sources: Iterable[Source] = ()) -> str:
    """`sha256:...` of a file (a recording, a rig, a file of observations) or of a folder.

    A file: over its content. A folder: over name, size and content, in the order of their names,
    of the files that the sources match; of all its files if no sources are given, if one of them
    has no `files`, or if it is a ROS 2 bag. RecordingError when it cannot be read or when a source
    matches nothing.
    """
    path = Path(path)
    digest = hashlib.sha256()
    try:
        if not path.is_dir():
            with path.open("rb") as file:
                return f"sha256:{hashlib.file_digest(file, 'sha256').hexdigest()}"
        for name, file_path in sorted(_files(path, tuple(sources)).items()):
            encoded = name.encode("utf-8", "surrogateescape")
            digest.update(b"%d %s %d\n" % (len(encoded), encoded, file_path.stat().st_size))
            with file_path.open("rb") as file:
                digest.update(hashlib.file_digest(file, "sha256").digest())
    except OSError as error:
        raise RecordingError(f"{path}: cannot be read: {error.strerror}") from error
    return f"sha256:{digest.hexdigest()}"


def _files(root: Path, sources: tuple[Source, ...]) -> dict[str, Path]:
    """Name relative to `root` -> file."""
    if sources and all(s.files for s in sources) and not is_bag_folder(root):
        from rigcal.recording.folder import FolderRecording

        folder = FolderRecording(root)
        found = [p for source in sources for p in folder.matches(source)]
    else:
        found = [p for p in root.rglob("*") if p.is_file()]
    return {p.relative_to(root).as_posix(): p for p in found}
