"""A folder of files as a recording: sensors name their files by glob, no manifest."""

from __future__ import annotations

import difflib
import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Self

from rigcal.errors import RecordingError
from rigcal.recording.message import Message, Source

_STAMP_DIGITS = (18, 19)
_NAMES_COMPARED = 1000
_BAGS = (".mcap", ".db3", ".bag")


def natural_key(name: str) -> tuple[tuple[int, int | str], ...]:
    """Sort key under which pose2 comes before pose10."""
    parts = re.split(r"(\d+)", name)
    return tuple((1, int(p)) if i % 2 else (0, p) for i, p in enumerate(parts))


def stamp_of(stem: str) -> int | None:
    """The stamp in ns that a file name carries: a number of 18 or 19 digits.

    Shorter numbers are never taken for stamps: 16 digits could be microseconds.
    """
    numbers = [n for n in re.findall(r"\d+", stem) if len(n) in _STAMP_DIGITS]
    return int(numbers[-1]) if numbers else None


def exposure_keys(stems: Sequence[str]) -> list[str]:
    """The exposure key of every file of one source.

    It is the last number in the stem that is not the same in all files (pose17_v2 -> 17,
    cam0_0017 -> 17, 17_cam0 -> 17), without leading zeros, so that 0017 and 17 agree. Stems that
    differ by more than numbers, or a single file: the last number. No number: the stem.
    """
    numbers = [re.findall(r"\d+", stem) for stem in stems]
    place = -1
    if len({re.sub(r"\d+", "#", stem) for stem in stems}) == 1 and len(stems) > 1:
        columns = list(zip(*numbers, strict=True))
        varying = [i for i, column in enumerate(columns) if len(set(column)) > 1]
        place = varying[-1] if varying else -1
    return [str(int(own[place])) if own else stem for stem, own in zip(stems, numbers, strict=True)]


class FolderRecording:
    """Files below `root`; `Source.files` is a glob relative to it."""

    def __init__(self, root: Path) -> None:
        self._root = root
        self._sources: dict[str, list[Message]] = {}
        if not any(root.iterdir()):
            raise RecordingError(
                f"{root}: the folder is empty; expected files that the sensors' `files` globs match"
            )

    def count(self, source: Source) -> int:
        """See `Recording`."""
        return len(self._messages(source))

    def times_ns(self, source: Source) -> list[int]:
        """See `TimedRecording`."""
        return [message.stamp_ns for message in self._messages(source)]

    def read(self, source: Source, first: int = 0, stop: int | None = None) -> Iterator[Message]:
        """See `Recording`; files come in natural order of their paths."""
        yield from self._messages(source)[first:stop]

    def contents(self) -> Mapping[str, tuple[str, int]]:
        """Suffix -> (suffix, count) of all files below the folder."""
        counts = Counter(p.suffix.lower() for p in self._files())
        return {suffix: (suffix, counts[suffix]) for suffix in sorted(counts)}

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exc: object) -> None:
        pass

    def matches(self, source: Source) -> list[Path]:
        """The files of a source in natural order; RecordingError if there are none."""
        if source.files is None:
            raise RecordingError(f"{self._root}: {self._advice_without_files(source)}")
        try:
            found = [p for p in self._root.glob(source.files) if p.is_file()]
        except (ValueError, NotImplementedError) as error:
            raise RecordingError(
                f"{self._root}: files: '{source.files}' is not a glob relative to the recording's "
                f"folder ({error}); write it like `files: images/*.png`"
            ) from error
        if not found:
            raise RecordingError(
                f"{self._root}: files: '{source.files}' matches nothing; {self._what_is_there()}"
                f"{self._nearest(source.files)}"
            )
        return sorted(found, key=lambda p: natural_key(self._relative(p)))

    def _messages(self, source: Source) -> list[Message]:
        if source.files is None or source.files not in self._sources:
            files = self.matches(source)
            self._sources[str(source.files)] = self._as_messages(files)
        return self._sources[str(source.files)]

    def _as_messages(self, files: list[Path]) -> list[Message]:
        stamps = [stamp_of(p.stem) for p in files]
        unstamped = [p for p, stamp in zip(files, stamps, strict=True) if stamp is None]
        keys = dict(zip(unstamped, exposure_keys([p.stem for p in unstamped]), strict=True))
        owners: dict[str, Path] = {}
        for path, key in keys.items():
            other = owners.setdefault(key, path)
            if other != path:
                raise RecordingError(
                    f"{self._root}: {self._relative(other)} and {self._relative(path)} both belong "
                    f"to exposure '{key}' by their names; narrow the sensor's `files` glob, or "
                    "number the files by exposure"
                )
        return [
            Message(p.suffix.lower(), p, stamp or 0, keys.get(p), self._relative(p))
            for p, stamp in zip(files, stamps, strict=True)
        ]

    def _relative(self, path: Path) -> str:
        return path.relative_to(self._root).as_posix()

    def _files(self) -> list[Path]:
        return [p for p in self._root.rglob("*") if p.is_file()]

    def _what_is_there(self) -> str:
        there = ", ".join(f"{count} {suffix or 'no suffix'}" for suffix, count in _counts(self))
        return f"the folder holds {there or 'no files'}"

    def _nearest(self, glob: str) -> str:
        names = [self._relative(p) for p in self._files()[:_NAMES_COMPARED]]
        near = difflib.get_close_matches(glob, names, 1, 0.4)
        return f"; the nearest name is '{near[0]}'" if near else ""

    def _advice_without_files(self, source: Source) -> str:
        topic = f"topic '{source.topic}'" if source.topic else "no source"
        bags = [p for p in sorted(self._root.iterdir()) if p.suffix in _BAGS]
        if bags:
            return (
                f"a folder of files has no topics, and the sensor has {topic}; the folder holds "
                f"{bags[0].name}: give that file as the recording (a ROS 2 bag folder without its "
                "metadata.yaml is mended by `ros2 bag reindex`)"
            )
        return (
            f"a folder of files has no topics, and the sensor has {topic}; add `files: GLOB` to it "
            f"({self._what_is_there()})"
        )


def _counts(folder: FolderRecording) -> list[tuple[str, int]]:
    return list(folder.contents().values())
