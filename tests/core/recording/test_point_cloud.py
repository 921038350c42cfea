from __future__ import annotations

from collections.abc import Callable
from io import BytesIO
from pathlib import Path
from typing import Any

import lzf
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from plyfile import PlyData, PlyElement

from rigcal.errors import RecordingError
from rigcal.recording import Message, ros
from rigcal.recording.cloud import CLOUD_TYPES, POINT_CLOUD2, cloud_message, read_cloud

COUNT = 50


def _points() -> dict[str, np.ndarray[Any, Any]]:
    rng = np.random.default_rng(0)
    x, y, z = rng.normal(size=(3, COUNT)).astype(np.float32)
    x[3] = np.nan
    return {"x": x, "y": y, "z": z, "ring": np.arange(COUNT, dtype=np.uint16)}


def _structured() -> np.ndarray[Any, Any]:
    columns = _points()
    layout = np.dtype([(name, values.dtype) for name, values in columns.items()])
    points = np.zeros(COUNT, layout)
    for name, values in columns.items():
        points[name] = values
    return points


def _message(cloud: Any) -> Message:
    return Message(POINT_CLOUD2, cloud, 0, None, "r.mcap /points #3")


def _file(path: Path) -> Message:
    return Message(path.suffix, path, 0, "1", path.name)


def _assert_points(fields: dict[str, np.ndarray[Any, Any]], names: str = "x y z ring") -> None:
    for name in names.split():
        np.testing.assert_array_equal(fields[name], _points()[name])


def test_a_message_holds_what_was_put_in() -> None:
    cloud = cloud_message(_points(), 5 * 10**9 + 7, "lidar")
    fields = read_cloud(_message(cloud))
    _assert_points(fields)
    assert {name: v.dtype for name, v in fields.items()} == {
        name: v.dtype for name, v in _points().items()
    }
    assert (cloud.point_step, cloud.width, cloud.height, cloud.is_dense) == (14, COUNT, 1, False)
    assert (cloud.header.stamp.sec, cloud.header.stamp.nanosec) == (5, 7)


@given(
    gaps=st.lists(st.integers(0, 9), min_size=4, max_size=4),
    order=st.permutations(["x", "y", "z", "ring"]),
    row_padding=st.integers(0, 9),
    big_endian=st.booleans(),
    height=st.sampled_from([1, 2, 10]),
)
@settings(max_examples=30, deadline=None)
def test_any_layout(
    gaps: list[int], order: list[str], row_padding: int, big_endian: bool, height: int
) -> None:
    points = _points()
    offset, offsets = 0, {}
    for name, gap in zip(order, gaps, strict=True):
        offsets[name] = offset + gap
        offset = offsets[name] + points[name].itemsize
    end = ">" if big_endian else "<"
    layout = np.dtype(
        {
            "names": order,
            "formats": [points[name].dtype.newbyteorder(end) for name in order],
            "offsets": [offsets[name] for name in order],
            "itemsize": offset,
        }
    )
    packed = np.zeros(COUNT, layout)
    for name in order:
        packed[name] = points[name]
    width = COUNT // height
    rows = np.zeros((height, width * offset + row_padding), np.uint8)
    rows[:, : width * offset] = np.frombuffer(packed.tobytes(), np.uint8).reshape(height, -1)
    cloud = ros.make(
        POINT_CLOUD2,
        height=height,
        width=width,
        fields=[
            ros.make(
                "sensor_msgs/msg/PointField",
                name=name,
                offset=offsets[name],
                datatype=4 if name == "ring" else 7,
                count=1,
            )
            for name in order
        ],
        is_bigendian=big_endian,
        point_step=offset,
        row_step=rows.shape[1],
        data=rows,
    )
    fields = read_cloud(_message(cloud))
    _assert_points(fields)
    assert all(values.dtype.isnative for values in fields.values())


def test_an_empty_cloud_has_its_fields() -> None:
    empty = {name: values[:0] for name, values in _points().items()}
    fields = read_cloud(_message(cloud_message(empty, 0, "lidar")))
    assert {name: len(values) for name, values in fields.items()} == dict.fromkeys(_points(), 0)


def test_a_field_of_several_values_is_several_columns() -> None:
    cloud = cloud_message(_points(), 0, "lidar")
    cloud.fields[0].count = 3
    fields = read_cloud(_message(cloud))
    np.testing.assert_array_equal(fields["x_1"], _points()["y"])


@pytest.mark.parametrize(
    ("damage", "says"),
    [
        ({"width": 60}, "700 bytes of data in rows of 700; 1 x 60 points of 14 bytes need 840"),
        ({"height": 2}, "2 x 50 points of 14 bytes need 1400"),
        ({"point_step": 13}, "point field 'ring' ends at byte 14 of points of 13 bytes"),
        ({"row_step": 3}, "in rows of 3"),
    ],
)
def test_a_damaged_message_is_named(damage: dict[str, int], says: str) -> None:
    cloud = cloud_message(_points(), 0, "lidar")
    for name, value in damage.items():
        setattr(cloud, name, value)
    with pytest.raises(RecordingError, match=f"r.mcap /points #3: .*{says}"):
        read_cloud(_message(cloud))


def test_an_unknown_datatype_is_named() -> None:
    cloud = cloud_message(_points(), 0, "lidar")
    cloud.fields[1].datatype = 99
    with pytest.raises(RecordingError, match="field 'y' has datatype 99; expected 1 to 8"):
        read_cloud(_message(cloud))


@pytest.mark.parametrize(
    ("fields", "says"),
    [
        ([], "the cloud's points have no fields; expected x, y, z"),
        (["x", "x", "z"], "the cloud's fields make no layout"),
    ],
)
def test_points_without_a_layout_are_named(fields: list[str], says: str) -> None:
    cloud = cloud_message(_points(), 0, "lidar")
    cloud.fields = cloud.fields[: len(fields)]
    for field, name in zip(cloud.fields, fields, strict=True):
        field.name = name
    with pytest.raises(RecordingError, match=f"r.mcap /points #3: {says}"):
        read_cloud(_message(cloud))


def test_columns_that_no_message_can_hold() -> None:
    with pytest.raises(RecordingError, match=r"'t' is int64; PointCloud2 has int8.*convert it"):
        cloud_message({"x": np.zeros(2), "t": np.zeros(2, np.int64)}, 0, "lidar")
    with pytest.raises(RecordingError, match=r"must be \(N,\) of one N"):
        cloud_message({"x": np.zeros(2), "y": np.zeros(3)}, 0, "lidar")


def _pcd(data: str, points: int = COUNT) -> bytes:
    return (
        "# .PCD v0.7 - Point Cloud Data file format\nVERSION 0.7\nFIELDS x y _ z ring\n"
        "SIZE 4 4 1 4 2\nTYPE F F U F U\nCOUNT 1 1 3 1 1\n"
        f"WIDTH {points}\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS {points}\nDATA {data}\n"
    ).encode()


def _pcd_points() -> np.ndarray[Any, Any]:
    columns = _points()
    points = np.zeros(
        COUNT, [("x", "<f4"), ("y", "<f4"), ("_", "u1", 3), ("z", "<f4"), ("ring", "<u2")]
    )
    for name, values in columns.items():
        points[name] = values
    return points


def _write_pcd_ascii(path: Path) -> None:
    lines = [
        f"{float(p['x'])!r} {float(p['y'])!r} 0 0 0  {float(p['z'])!r} {p['ring']}"
        for p in _pcd_points()
    ]
    path.write_bytes(_pcd("ascii") + "\n".join(lines).encode())


def _write_pcd_binary(path: Path) -> None:
    path.write_bytes(_pcd("binary") + _pcd_points().tobytes())


def _write_pcd_compressed(path: Path) -> None:
    points = _pcd_points()
    raw = b"".join(np.ascontiguousarray(points[n]).tobytes() for n in points.dtype.names or ())
    packed = lzf.compress(raw, 2 * len(raw))
    sizes = np.array([len(packed), len(raw)], "<u4").tobytes()
    path.write_bytes(_pcd("binary_compressed") + sizes + packed)


def _write_ply(path: Path, *, text: bool) -> None:
    vertices = PlyElement.describe(_structured(), "vertex")
    face = np.array([([0, 1, 2],)], dtype=[("vertex_indices", "i4", (3,))])
    PlyData([vertices, PlyElement.describe(face, "face")], text=text).write(str(path))


def _write_csv(path: Path, header: str, delimiter: str) -> None:
    columns = np.column_stack(list(_points().values()))
    text = (header + "\n" if header else "") + "\n".join(
        delimiter.join(repr(float(v)) for v in row) for row in columns
    )
    path.write_text(text)


WRITERS: dict[str, tuple[str, Callable[[Path], object]]] = {
    "pcd ascii": (".pcd", _write_pcd_ascii),
    "pcd binary": (".pcd", _write_pcd_binary),
    "pcd compressed": (".pcd", _write_pcd_compressed),
    "ply ascii": (".ply", lambda p: _write_ply(p, text=True)),
    "ply binary": (".ply", lambda p: _write_ply(p, text=False)),
    "npy structured": (".npy", lambda p: np.save(p, _structured())),
    "csv": (".csv", lambda p: _write_csv(p, "X, y ,z_m,ring", ",")),
    "csv, commented names": (".csv", lambda p: _write_csv(p, "# x y z ring", " ")),
    "csv, semicolons": (".csv", lambda p: _write_csv(p, '"x";"y";"z";"ring"', ";")),
}


@pytest.mark.parametrize("kind", list(WRITERS))
def test_files_with_named_fields(tmp_path: Path, kind: str) -> None:
    suffix, write = WRITERS[kind]
    write(tmp_path / f"cloud{suffix}")
    fields = read_cloud(_file(tmp_path / f"cloud{suffix}"))
    assert list(fields) == ["x", "y", "z", "ring"]
    _assert_points(fields)


def test_files_without_names(tmp_path: Path) -> None:
    columns = np.column_stack(list(_points().values()))
    np.save(tmp_path / "cloud.npy", columns)
    np.savetxt(tmp_path / "cloud.csv", columns, fmt="%.17g", delimiter="\t")
    columns.astype("<f4").tofile(tmp_path / "cloud.bin")
    names = {".npy": "column_4", ".csv": "column_4", ".bin": "intensity"}
    for suffix, fourth in names.items():
        fields = read_cloud(_file(tmp_path / f"cloud{suffix}"))
        assert list(fields) == ["x", "y", "z", fourth]
        _assert_points(fields, "x y z")
        np.testing.assert_array_equal(fields[fourth], _points()["ring"])


def test_a_csv_of_one_point_and_of_none(tmp_path: Path) -> None:
    path = tmp_path / "cloud.csv"
    path.write_text("x,y,z\n1,2,3\n")
    assert read_cloud(_file(path))["z"].tolist() == [3.0]
    path.write_text("x,y,z\n")
    assert read_cloud(_file(path))["z"].tolist() == []


@pytest.mark.parametrize("kind", [k for k in WRITERS if not k.startswith("csv")])
def test_every_truncation_is_noticed(tmp_path: Path, kind: str) -> None:
    suffix, write = WRITERS[kind]
    path = tmp_path / f"cloud{suffix}"
    write(path)
    whole = path.read_bytes()
    for length in np.linspace(0, len(whole) * 0.9, 7).astype(int):
        path.write_bytes(whole[:length])
        with pytest.raises(RecordingError, match=rf"^cloud{suffix}: not a whole {suffix} point"):
            read_cloud(_file(path))


def _archive() -> bytes:
    file = BytesIO()
    np.savez(file, x=np.zeros(2))
    return file.getvalue()


def _huge() -> bytes:
    """An array whose header asks for more memory than there is."""
    file = BytesIO()
    np.save(file, np.zeros((5, 3)))
    return file.getvalue().replace(b"(5, 3), }" + b" " * 12, b"(5" + b"0" * 12 + b", 3), }")


_PCD = (
    b"VERSION .7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH 1\nHEIGHT 1\n"
    b"POINTS 1\nDATA ascii\n1 2 3\n"
)


@pytest.mark.parametrize(
    ("suffix", "content", "says"),
    [
        (".pcd", _pcd("binary").partition(b"DATA")[0], "no line DATA"),
        (".pcd", _pcd("zipped"), "DATA zipped; expected ascii"),
        (".pcd", _pcd("ascii") + b"1 2 0 0 0 3 4\n", "says 50 points, the file holds 1"),
        (".pcd", _PCD.replace(b"SIZE 4 4 4\n", b""), "the header has no line SIZE"),
        (".pcd", _PCD.replace(b"WIDTH 1", b"WIDTH -1"), "WIDTH -1 is negative"),
        (".pcd", _PCD.replace(b"SIZE 4 4 4", b"SIZE 4 4"), "have different lengths"),
        (".pcd", _PCD.replace(b"TYPE F F F", b"TYPE F F X"), "z has TYPE X; expected F, I or U"),
        (".pcd", b"\x89PNG\r\n\x1a\n" * 9, "which PCD does not know"),
        (".bin", bytes(33), "33 bytes are not a multiple of 16"),
        (".csv", b"", "it is empty"),
        (".ply", b"ply\nformat ascii 1.0\nelement face 0\nend_header\n", "no element 'vertex'"),
        (".npy", _huge(), "Unable to allocate"),
        (".npy", _archive(), "an archive of several arrays; expected one"),
        (".csv", b"1,2\n3,4\n", "2 columns; expected x, y, z"),
        (".csv", b"x,y,z\n1,2,3\n1,2\n", "columns"),
        (".csv", b"x,y,z\n1,2,three\n", "three"),
        (".csv", b"x,x,z\n1,2,3\n", "two columns are named 'x'"),
        (".csv", b"x,y\n1,2,3\n", "2 names stand above 3 columns"),
        (".csv", b"\xff\xfe\x00", "decode"),
    ],
)
def test_other_files_under_these_suffixes(
    tmp_path: Path, suffix: str, content: bytes, says: str
) -> None:
    (tmp_path / f"cloud{suffix}").write_bytes(content)
    with pytest.raises(RecordingError, match=f"cloud{suffix}: not a whole .*{says}"):
        read_cloud(_file(tmp_path / f"cloud{suffix}"))


def test_an_npy_that_is_no_cloud_or_needs_pickle(tmp_path: Path) -> None:
    np.save(tmp_path / "cloud.npy", np.zeros((5, 2)))
    with pytest.raises(RecordingError, match=r"holds float64 \(5, 2\); expected numbers \(N, 3"):
        read_cloud(_file(tmp_path / "cloud.npy"))
    np.save(tmp_path / "cloud.npy", np.array([{"x": 1}], dtype=object))
    with pytest.raises(RecordingError, match="allow_pickle"):
        read_cloud(_file(tmp_path / "cloud.npy"))


def test_a_missing_file_and_another_type(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match=r"none\.ply: cannot be read: No such file"):
        read_cloud(_file(tmp_path / "none.ply"))
    with pytest.raises(RecordingError, match=r"a \.png is not a point cloud; expected one of sens"):
        read_cloud(_file(tmp_path / "image.png"))
    assert CLOUD_TYPES == (POINT_CLOUD2, ".pcd", ".ply", ".npy", ".csv", ".bin")


def test_a_pcd_of_no_points_and_one_of_vectors(tmp_path: Path) -> None:
    path = tmp_path / "cloud.pcd"
    path.write_bytes(_PCD.replace(b"WIDTH 1", b"WIDTH 0").replace(b"POINTS 1\n", b""))
    assert len(read_cloud(_file(path))["x"]) == 0
    vectors = _PCD.replace(b"x y z", b"x y z n").replace(b"4 4 4", b"4 4 4 4")
    vectors = vectors.replace(b"F F F", b"F F F F").replace(b"1 1 1", b"1 1 1 2")
    path.write_bytes(vectors.replace(b"1 2 3\n", b"1 2 3 0.5 0.25\n"))
    cloud = read_cloud(_file(path))
    assert (cloud["n_0"].tolist(), cloud["n_1"].tolist()) == ([0.5], [0.25])
