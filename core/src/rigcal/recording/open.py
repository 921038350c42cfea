"""Opens whatever the user calls a recording."""

from __future__ import annotations

from pathlib import Path

from rigcal.errors import RecordingError
from rigcal.recording.message import STANDARD, Definitions, Recording

BAG_SUFFIXES = (".mcap", ".db3", ".bag")
_KINDS = (
    "a folder of files, a ROS 2 bag (a folder with metadata.yaml, .mcap or .db3) "
    "or a ROS 1 bag (.bag)"
)


def open_recording(path: Path | str, definitions: Definitions = STANDARD) -> Recording:
    """The recording at `path`: a folder of files, a ROS 2 bag folder, .mcap, .db3 or .bag.

    It is opened for reading only, so several processes may hold the same one. `definitions` are of
    message types that a plugin brings, for bags that carry none. RecordingError when there is no
    recording, or none that can be read.
    """
    path = Path(path)
    try:
        if path.is_dir():
            if is_bag_folder(path):
                from rigcal.recording.bag import BagRecording

                return BagRecording(path, definitions)
            from rigcal.recording.folder import FolderRecording

            return FolderRecording(path)
        if not path.exists():
            raise RecordingError(f"{path}: there is no such file or folder; expected {_KINDS}")
        if path.suffix not in BAG_SUFFIXES:
            raise RecordingError(
                f"{path}: a '{path.suffix}' file is not a recording; expected {_KINDS}"
            )
        from rigcal.recording.bag import BagRecording

        return BagRecording(path, definitions)
    except OSError as error:
        raise RecordingError(f"{path}: cannot be read: {error.strerror}") from error


def is_bag_folder(path: Path) -> bool:
    """Whether `path` has a metadata.yaml of rosbag2 (other data sets have one too)."""
    metadata = path / "metadata.yaml"
    if not metadata.is_file():
        return False
    with metadata.open("rb") as file:
        return b"rosbag2_bagfile_information" in file.read(1 << 16)
