"""Opens whatever the user calls a recording."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from rigcal.errors import RecordingError, RigcalError
from rigcal.recording.format import RecordingFormat
from rigcal.recording.message import STANDARD, Definitions, Recording

BAG_SUFFIXES = (".mcap", ".db3", ".bag")
_KINDS = (
    "a folder of files, a ROS 2 bag (a folder with metadata.yaml, .mcap or .db3) "
    "or a ROS 1 bag (.bag)"
)


def is_bag(path: Path) -> bool:
    """Whether `path` is a ROS bag: a file by its suffix, or a folder."""
    return is_bag_folder(path) if path.is_dir() else path.suffix in BAG_SUFFIXES


def is_bag_folder(path: Path) -> bool:
    """Whether `path` has a metadata.yaml of rosbag2 (other data sets have one too)."""
    metadata = path / "metadata.yaml"
    if not metadata.is_file():
        return False
    with metadata.open("rb") as file:
        return b"rosbag2_bagfile_information" in file.read(1 << 16)


def _open_bag(path: Path, definitions: Definitions) -> Recording:
    from rigcal.recording.bag import BagRecording

    return BagRecording(path, definitions)


def _open_folder(path: Path, definitions: Definitions) -> Recording:
    from rigcal.recording.folder import FolderRecording

    return FolderRecording(path)


BUILTIN_FORMATS = (
    RecordingFormat("bag", is_bag, _open_bag),
    RecordingFormat("folder", Path.is_dir, _open_folder),
)


def open_recording(
    path: Path | str,
    definitions: Definitions = STANDARD,
    formats: Sequence[RecordingFormat] = BUILTIN_FORMATS,
) -> Recording:
    """The recording at `path`: a folder of files, a ROS 2 bag folder, .mcap, .db3 or .bag.

    It is opened for reading only, so several processes may hold the same one. `definitions` are of
    message types that a plugin brings, for bags that carry none. `formats` are those to choose
    from (`registry.recording_formats.values()`); one of a plugin goes before the built-in ones.
    RecordingError when there is no recording, or none that can be read.
    """
    path = Path(path)
    if not path.exists():
        raise RecordingError(f"{path}: there is no such file or folder; expected {_KINDS}")
    accepting = [form for form in formats if _accepts(form, path)]
    others = [form for form in accepting if form not in BUILTIN_FORMATS]
    if len(others) > 1:
        names = " and ".join(f"'{form.name}'" for form in others)
        raise RecordingError(
            f"{path}: recording formats {names} both take it for theirs; uninstall all but one"
        )
    if not accepting:
        brought = [form.name for form in formats if form not in BUILTIN_FORMATS]
        more = f", or what plugins read ({', '.join(brought)})" if brought else ""
        raise RecordingError(
            f"{path}: a '{path.suffix}' file is not a recording; expected {_KINDS}{more}"
        )
    chosen = (others or accepting)[0]
    try:
        return chosen.open(path, definitions)
    except (RigcalError, MemoryError):
        raise
    except OSError as error:
        raise RecordingError(f"{path}: cannot be read: {error.strerror}") from error
    except (Exception, SystemExit) as error:
        raise _failure(chosen, path, error) from error


def _accepts(form: RecordingFormat, path: Path) -> bool:
    try:
        return bool(form.accepts(path))
    except OSError as error:
        raise RecordingError(f"{path}: cannot be read: {error.strerror}") from error
    except (Exception, SystemExit) as error:
        raise _failure(form, path, error) from error


def _failure(form: RecordingFormat, path: Path, error: BaseException) -> RecordingError:
    return RecordingError(
        f"{path}: recording format '{form.name}' failed with {type(error).__name__}: {error}"
    )
