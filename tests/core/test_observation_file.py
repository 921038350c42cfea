from __future__ import annotations

import io
import json
import zipfile
from collections.abc import Callable
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from rigcal.errors import ObservationError
from rigcal.observation import (
    Candidate,
    Geometry,
    LineGeometry,
    Observation,
    PlaneGeometry,
    PointGeometry,
    PoseGeometry,
)
from rigcal.observation_file import load_observations, save_observations

_FLOATS = st.floats(allow_nan=True, allow_infinity=True)


def _floats(*shape: int) -> st.SearchStrategy[Any]:
    return hnp.arrays(np.float64, shape, elements=_FLOATS)


_GEOMETRY: st.SearchStrategy[Geometry] = st.one_of(
    st.builds(PoseGeometry, _floats(4, 4), _floats(6, 6)),
    st.builds(
        PlaneGeometry,
        _floats(3),
        st.floats(allow_nan=False),
        _floats(3),
        _floats(3, 3),
        st.integers(0, 5).flatmap(lambda k: _floats(k, 3)),
    ),
    st.builds(LineGeometry, _floats(3), _floats(3), _floats(6, 6), st.booleans(), st.booleans()),
    st.builds(PointGeometry, _floats(3), _floats(3, 3), _floats(3)),
)
_DTYPES = st.sampled_from(["?", "i1", "u2", "i4", "i8", "u8", "f2", "f4", "f8"])
_MEASUREMENT = st.dictionaries(
    st.text(min_size=1, max_size=4),
    _DTYPES.flatmap(
        lambda dtype: hnp.arrays(
            np.dtype(dtype), hnp.array_shapes(min_dims=0, min_side=0, max_side=3)
        )
    ),
    max_size=3,
)
_OBSERVATION = st.builds(
    Observation,
    sensor=st.sampled_from(["cam0", "lidar", "söñar/1"]),
    exposure=st.text(max_size=5),
    stamp_ns=st.integers(-(2**63), 2**63 - 1),
    origin=st.text(max_size=5),
    candidates=st.lists(
        st.builds(Candidate, _GEOMETRY, _MEASUREMENT, st.floats(allow_nan=False)), max_size=3
    ).map(tuple),
    reason=st.text(max_size=5),
)


def _assert_same_array(a: Any, b: Any) -> None:
    a = np.asarray(a)
    assert isinstance(b, np.ndarray)
    assert a.dtype == b.dtype
    assert a.shape == b.shape
    assert a.tobytes() == b.tobytes()


def _assert_same(a: Observation, b: Observation) -> None:
    for name in ("sensor", "exposure", "stamp_ns", "origin", "reason"):
        assert getattr(a, name) == getattr(b, name)
    for left, right in zip(a.candidates, b.candidates, strict=True):
        assert left.score == right.score
        assert type(left.geometry) is type(right.geometry)
        for f in fields(left.geometry):
            value, read = getattr(left.geometry, f.name), getattr(right.geometry, f.name)
            if isinstance(value, np.ndarray):
                _assert_same_array(value, read)
            else:
                assert type(value) is type(read)
                assert value == read
        assert set(left.measurement) == set(right.measurement)
        for key, array in left.measurement.items():
            _assert_same_array(array, right.measurement[key])


@given(st.lists(_OBSERVATION, max_size=4).map(tuple))
@settings(
    max_examples=15,
    deadline=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)
def test_what_is_saved_is_loaded(tmp_path: Path, observations: tuple[Observation, ...]) -> None:
    header = {"sensors": {"cam0": "camera"}, "inputs": {"recording.mcap": "sha256:00"}, "seed": 1}
    save_observations(tmp_path / "o.npz", observations, header)
    loaded, loaded_header = load_observations(tmp_path / "o.npz")
    assert loaded_header == header
    assert len(loaded) == len(observations)
    for a, b in zip(observations, loaded, strict=True):
        _assert_same(a, b)


def _plane(k: int, **measurement: Any) -> Observation:
    rng = np.random.default_rng(k)
    geometry = PlaneGeometry(
        np.array([0.0, 0, 1]), 2.0, rng.normal(size=3), np.eye(3), rng.normal(size=(4, 3))
    )
    points = {"points": rng.normal(size=(10 + k, 3)), **measurement}
    return Observation("lidar", f"{k:04d}", k, f"#{k}", (Candidate(geometry, points, 0.5),))


def test_the_same_observations_give_the_same_bytes(tmp_path: Path) -> None:
    observations = [_plane(k) for k in range(5)]
    save_observations(tmp_path / "a.npz", observations, {"seed": 1})
    save_observations(tmp_path / "b.npz", observations, {"seed": 1})
    assert (tmp_path / "a.npz").read_bytes() == (tmp_path / "b.npz").read_bytes()


def test_the_number_of_arrays_does_not_grow_with_the_observations(tmp_path: Path) -> None:
    sizes = []
    for count in (2, 200):
        save_observations(tmp_path / "o.npz", [_plane(k) for k in range(count)])
        with zipfile.ZipFile(tmp_path / "o.npz") as archive:
            sizes.append(len(archive.namelist()))
    assert sizes[0] == sizes[1] < 20


def test_arrays_of_other_byte_order_or_memory_order_keep_their_values(tmp_path: Path) -> None:
    values = np.arange(6, dtype=">f4").reshape(2, 3)
    save_observations(
        tmp_path / "o.npz", [_plane(0, big=values, fortran=np.asfortranarray(values))]
    )
    ((observation,), _) = load_observations(tmp_path / "o.npz")
    measurement = observation.candidates[0].measurement
    np.testing.assert_array_equal(measurement["big"], values)
    np.testing.assert_array_equal(measurement["fortran"], values)


@pytest.mark.parametrize("value", ["text", np.array(["a"]), np.array([None]), np.array([1j])])
def test_other_data_are_refused_with_sensor_and_field(tmp_path: Path, value: Any) -> None:
    with pytest.raises(ObservationError, match=r"sensor 'lidar', exposure '0003': 'bad' is"):
        save_observations(tmp_path / "o.npz", [_plane(3, bad=value)])
    assert list(tmp_path.iterdir()) == []


def test_a_header_that_is_not_plain_data_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ObservationError, match="header is not plain data"):
        save_observations(tmp_path / "o.npz", [], {"rig": object()})


def test_every_truncation_and_every_flipped_byte_is_noticed(tmp_path: Path) -> None:
    path = tmp_path / "o.npz"
    save_observations(path, [_plane(k) for k in range(2)])
    whole = path.read_bytes()
    for length in range(0, len(whole), 211):
        path.write_bytes(whole[:length])
        with pytest.raises(ObservationError, match=r"o\.npz"):
            load_observations(path)
    rng = np.random.default_rng(0)
    for position in rng.integers(0, len(whole), 60):
        broken = bytearray(whole)
        broken[position] ^= 0xFF
        path.write_bytes(bytes(broken))
        try:
            loaded, _ = load_observations(path)
        except ObservationError:
            continue
        # Some bytes of a zip file's directory carry nothing; then the content is unharmed.
        for a, b in zip([_plane(0), _plane(1)], loaded, strict=True):
            _assert_same(a, b)


def test_other_npz_files_and_versions_are_named(tmp_path: Path) -> None:
    np.savez(tmp_path / "other.npz", corners=np.zeros(3))
    with pytest.raises(ObservationError, match="holds corners; expected a file that `rigcal"):
        load_observations(tmp_path / "other.npz")
    text = json.dumps({"format": "rigcal-observations", "version": 2}).encode()
    np.savez(tmp_path / "newer.npz", header=np.frombuffer(text, np.uint8))
    with pytest.raises(ObservationError, match="version 2 of the format, this rigcal reads"):
        load_observations(tmp_path / "newer.npz")
    np.save(tmp_path / "single.npy", np.zeros(3))
    with pytest.raises(ObservationError, match="single array"):
        load_observations(tmp_path / "single.npy")
    (tmp_path / "text.npz").write_text("sensors: {}")
    with pytest.raises(ObservationError, match="a file of another kind"):
        load_observations(tmp_path / "text.npz")


def test_a_missing_file_is_an_error_in_words(tmp_path: Path) -> None:
    with pytest.raises(ObservationError, match=r"none\.npz: cannot be read: No such file"):
        load_observations(tmp_path / "none.npz")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda m, d: d.update(format="rigcal-rigs"), "format 'rigcal-rigs', expected 'rigcal-obs"),
        (lambda m, d: m.update({"0.data": m["0.data"][:-1]}), "asks for 6 of 5 values"),
        (lambda m, d: d["observations"].update(candidates=[1, 0]), "have 1 candidates, the file 2"),
        (lambda m, d: d["observations"]["reason"].pop(), "not a whole file of observations"),
    ],
)
def test_a_file_that_contradicts_itself_is_refused(
    tmp_path: Path, change: Callable[[dict[str, Any], dict[str, Any]], object], message: str
) -> None:
    """As programs leave it that write such files themselves."""
    path = tmp_path / "o.npz"
    save_observations(path, [_plane(k) for k in range(2)])
    with np.load(path) as archive:
        members = dict(archive)
    document = json.loads(members["header"].tobytes())
    change(members, document)
    members["header"] = np.frombuffer(json.dumps(document).encode(), np.uint8)
    np.savez(path, **members)
    with pytest.raises(ObservationError, match=message):
        load_observations(path)


def test_a_length_that_asks_for_too_much_memory_is_a_damaged_file(tmp_path: Path) -> None:
    path = tmp_path / "o.npz"
    save_observations(path, [_plane(0)])
    with zipfile.ZipFile(path) as archive:
        members = {name: archive.read(name) for name in archive.namelist()}
    start = io.BytesIO()
    np.lib.format.write_array_header_1_0(
        start, {"descr": "<f8", "fortran_order": False, "shape": (10**15,)}
    )
    members["score.npy"] = start.getvalue()
    with zipfile.ZipFile(path, "w") as archive:
        for name, data in members.items():
            archive.writestr(name, data)
    with pytest.raises(ObservationError, match=r"not a whole file of observations \(Unable to all"):
        load_observations(path)
