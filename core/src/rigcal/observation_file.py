"""Observations in one .npz file without pickle, compact, the same input giving the same bytes.

`header.json` holds what is text: the format, the caller's header, the observations' sensors,
exposures, stamps, origins and reasons. The arrays of all candidates are laid end to end, one
column per sensor, field, type and number of dimensions: `<n>.data` (flat) and `<n>.index` (rows of
candidate number and shape). `numpy.load` reads it.
"""

from __future__ import annotations

import io
import json
import zipfile
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigcal.errors import ObservationError
from rigcal.files import replacing
from rigcal.observation import (
    Candidate,
    Geometry,
    LineGeometry,
    Observation,
    PlaneGeometry,
    PointGeometry,
    PoseGeometry,
)

FORMAT = "rigcal-observations"
VERSION = 1
_HEADER = "header"
_GEOMETRIES: dict[str, type[Geometry]] = {
    "pose": PoseGeometry,
    "plane": PlaneGeometry,
    "line": LineGeometry,
    "point": PointGeometry,
}
_NAMES = {kind: name for name, kind in _GEOMETRIES.items()}
_SCALARS = {"d": float, "start_is_edge": bool, "end_is_edge": bool}
_OBSERVATION_KEYS = ("sensor", "exposure", "stamp_ns", "origin", "reason", "candidates")

Values = dict[str, NDArray[np.generic]]


@dataclass(frozen=True)
class _ColumnKey:
    """What the arrays of one column have in common."""

    sensor: str
    part: str
    field: str
    dtype: str
    dimensions: int


def save_observations(
    path: Path | str,
    observations: Sequence[Observation],
    header: Mapping[str, Any] | None = None,
) -> None:
    """Write observations, and `header` (plain strings, numbers, lists, mappings) beside them.

    ObservationError for measurements that are not arrays of booleans, integers or floats of at
    most 64 bits.
    """
    columns: dict[_ColumnKey, list[tuple[int, NDArray[np.generic]]]] = {}
    number = 0
    for o in observations:
        for candidate in o.candidates:
            for part, values in _parts(candidate).items():
                for field, value in values.items():
                    array = _checked(o, field, value)
                    key = _ColumnKey(o.sensor, part, field, array.dtype.str, array.ndim)
                    columns.setdefault(key, []).append((number, array))
            number += 1
    candidates = [c for o in observations for c in o.candidates]
    document = {
        "format": FORMAT,
        "version": VERSION,
        "header": dict(header or {}),
        "observations": {
            "sensor": [o.sensor for o in observations],
            "exposure": [o.exposure for o in observations],
            "stamp_ns": [int(o.stamp_ns) for o in observations],
            "origin": [o.origin for o in observations],
            "reason": [o.reason for o in observations],
            "candidates": [len(o.candidates) for o in observations],
            "frames": [list(map(int, o.frames)) for o in observations],
        },
        "geometry": [_NAMES[type(c.geometry)] for c in candidates],
        "columns": [vars(key) for key in columns],
    }
    try:
        text = json.dumps(document, allow_nan=False)
    except (TypeError, ValueError) as error:
        raise ObservationError(f"{path}: the header is not plain data: {error}") from error
    members: Values = {
        _HEADER: np.frombuffer(text.encode(), np.uint8),
        "score": np.array([c.score for c in candidates], np.float64),
    }
    for i, (key, items) in enumerate(columns.items()):
        members[f"{i}.data"] = np.concatenate([array.ravel() for _, array in items])
        index = [(owner, *array.shape) for owner, array in items]
        members[f"{i}.index"] = np.array(index, np.int64).reshape(-1, 1 + key.dimensions)
    _write(Path(path), members)


def load_observations(path: Path | str) -> tuple[tuple[Observation, ...], dict[str, Any]]:
    """The observations and the header that were saved; ObservationError for any other file."""
    path = Path(path)
    try:
        with path.open("rb") as file:
            if not zipfile.is_zipfile(file):
                raise ValueError("a single array, a file of another kind, or one that breaks off")
            file.seek(0)
            with np.load(file, allow_pickle=False) as archive:
                return _decode(archive)
    except ObservationError as error:
        raise ObservationError(f"{path}: {error}") from error
    except OSError as error:
        raise ObservationError(f"{path}: cannot be read: {error.strerror or error}") from error
    except Exception as error:
        # zipfile, zlib, json and numpy have a dozen exceptions for damaged bytes; damaged lengths
        # ask for more memory than there is.
        raise ObservationError(
            f"{path}: not a whole file of observations ({error}); write it again with "
            "`rigcal detect RIG RECORDING --out observations.npz`"
        ) from error


def _parts(candidate: Candidate) -> dict[str, dict[str, Any]]:
    geometry = candidate.geometry
    return {
        "geometry": {f.name: getattr(geometry, f.name) for f in fields(geometry)},
        "measurement": dict(candidate.measurement),
    }


def _checked(o: Observation, field: str, value: Any) -> NDArray[np.generic]:
    array: NDArray[np.generic] = np.asarray(value)
    if array.dtype.kind not in "biuf" or array.dtype.itemsize > 8:
        raise ObservationError(
            f"sensor '{o.sensor}', exposure '{o.exposure}': '{field}' is {array.dtype}; a file of "
            "observations holds booleans, integers and floats of at most 64 bits"
        )
    return array.astype(array.dtype.newbyteorder("<"), copy=False)


def _write(path: Path, members: Mapping[str, NDArray[np.generic]]) -> None:
    """An .npz as numpy writes it, but with a fixed time stamp in every member."""
    with replacing(path) as temporary, zipfile.ZipFile(temporary, "w") as archive:
        for name, array in members.items():
            info = zipfile.ZipInfo(f"{name}.npy", date_time=(1980, 1, 1, 0, 0, 0))
            info.compress_type = zipfile.ZIP_DEFLATED
            buffer = io.BytesIO()
            np.lib.format.write_array(buffer, array, allow_pickle=False)
            archive.writestr(info, buffer.getvalue())


def _decode(
    archive: Mapping[str, NDArray[Any]],
) -> tuple[tuple[Observation, ...], dict[str, Any]]:
    document = _document(archive)
    kinds: list[str] = document["geometry"]
    scores = archive["score"]
    geometries: list[Values] = [{} for _ in kinds]
    measurements: list[Values] = [{} for _ in kinds]
    for i, column in enumerate(document["columns"]):
        target = {"geometry": geometries, "measurement": measurements}[column["part"]]
        for owner, array in _arrays(archive[f"{i}.data"], archive[f"{i}.index"]):
            target[owner][column["field"]] = array
    candidates = [
        Candidate(_geometry(kind, own), measurement, float(score))
        for kind, own, measurement, score in zip(
            kinds, geometries, measurements, scores, strict=True
        )
    ]
    return _observations(document["observations"], candidates), document["header"]


def _document(archive: Mapping[str, NDArray[Any]]) -> dict[str, Any]:
    if _HEADER not in archive:
        raise ObservationError(
            f"this .npz holds {', '.join(sorted(archive)[:5]) or 'nothing'}; expected a file that "
            "`rigcal detect` wrote"
        )
    document = json.loads(archive[_HEADER].tobytes())
    if document["format"] != FORMAT:
        raise ObservationError(f"format '{document['format']}', expected '{FORMAT}'")
    if document["version"] != VERSION:
        raise ObservationError(
            f"version {document['version']} of the format, this rigcal reads version {VERSION}; "
            "use the rigcal that wrote it, or detect again"
        )
    return dict(document)


def _arrays(
    data: NDArray[Any], index: NDArray[np.int64]
) -> Iterable[tuple[int, NDArray[np.generic]]]:
    sizes = np.prod(index[:, 1:], axis=1, dtype=np.int64)
    if sizes.sum() != data.size or (index < 0).any():
        raise ValueError(f"the index of a column asks for {sizes.sum()} of {data.size} values")
    ends = np.cumsum(sizes)
    for (owner, *shape), end, size in zip(index.tolist(), ends, sizes, strict=True):
        # A copy: small arrays must not keep the whole column alive, and 0-d stays an array.
        yield owner, data[end - size : end].reshape(shape).copy()


def _geometry(kind: str, values: Values) -> Geometry:
    arguments: dict[str, Any] = {
        name: _SCALARS[name](value[()]) if name in _SCALARS else value
        for name, value in values.items()
    }
    return _GEOMETRIES[kind](**arguments)


def _observations(
    columns: Mapping[str, list[Any]], candidates: Sequence[Candidate]
) -> tuple[Observation, ...]:
    # Files of earlier versions do not say which frames.
    frames = columns.get("frames") or [()] * len(columns["sensor"])
    rows = zip(*(columns[key] for key in _OBSERVATION_KEYS), frames, strict=True)
    result = []
    first = 0
    for sensor, exposure, stamp_ns, origin, reason, count, own_frames in rows:
        own = tuple(candidates[first : first + count])
        result.append(
            Observation(sensor, exposure, stamp_ns, origin, own, reason, tuple(own_frames))
        )
        first += count
    if first != len(candidates):
        raise ValueError(f"the observations have {first} candidates, the file {len(candidates)}")
    return tuple(result)
