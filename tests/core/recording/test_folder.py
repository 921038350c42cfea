from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from rigcal.errors import RecordingError
from rigcal.recording import Source, open_recording
from rigcal.recording.fingerprint import fingerprint
from rigcal.recording.folder import exposure_keys, stamp_of


def _folder(root: Path, *names: str) -> Path:
    for name in names:
        path = root / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(name.encode())
    return root


def test_files_come_in_natural_order_with_exposure_and_origin(tmp_path: Path) -> None:
    _folder(tmp_path, "img/pose10.PNG", "img/pose9.PNG", "img/pose1.PNG", "img/notes.txt")
    with open_recording(tmp_path) as recording:
        source = Source(files="img/pose*")
        assert recording.count(source) == 3
        messages = list(recording.read(source))
    assert [m.exposure for m in messages] == ["1", "9", "10"]
    assert [m.origin for m in messages] == ["img/pose1.PNG", "img/pose9.PNG", "img/pose10.PNG"]
    assert {(m.type, m.stamp_ns) for m in messages} == {(".png", 0)}
    assert messages[0].value == tmp_path / "img/pose1.PNG"


def test_slices(tmp_path: Path) -> None:
    _folder(tmp_path, *(f"{i}.npy" for i in range(12)))
    with open_recording(tmp_path) as recording:
        source = Source(files="*.npy")
        assert [m.exposure for m in recording.read(source, 3, 5)] == ["3", "4"]
        assert [m.exposure for m in recording.read(source, 10)] == ["10", "11"]
        assert list(recording.read(source, 12)) == []


def test_contents_are_by_suffix(tmp_path: Path) -> None:
    _folder(tmp_path, "a/1.png", "a/2.PNG", "b/1.pcd")
    with open_recording(tmp_path) as recording:
        assert dict(recording.contents()) == {".pcd": (".pcd", 1), ".png": (".png", 2)}


@pytest.mark.parametrize(
    ("stems", "keys"),
    [
        (["pose17_full", "pose18_full"], ["17", "18"]),
        (["left03", "left10"], ["3", "10"]),
        (["0017"], ["17"]),
        (["cam0_0017", "cam0_0018"], ["17", "18"]),
        (["17_cam0", "18_cam0"], ["17", "18"]),
        (["pose17_v2", "pose18_v2"], ["17", "18"]),
        (["near", "far"], ["near", "far"]),
        (["a1", "b2_3"], ["1", "3"]),
    ],
)
def test_the_key_is_the_number_that_tells_the_files_apart(
    stems: list[str], keys: list[str]
) -> None:
    assert exposure_keys(stems) == keys


@pytest.mark.parametrize(
    ("stem", "stamp"),
    [
        ("1403709395937837056", 1403709395937837056),
        ("cam0_1403709395937837056", 1403709395937837056),
        ("1403709395937837", None),  # microseconds, most likely
        ("pose17", None),
        ("", None),
    ],
)
def test_a_stamp_has_18_or_19_digits(stem: str, stamp: int | None) -> None:
    assert stamp_of(stem) == stamp


def test_a_stamped_file_has_no_key(tmp_path: Path) -> None:
    _folder(tmp_path, "cam0_1403709395937837056.png")
    with open_recording(tmp_path) as recording:
        (message,) = recording.read(Source(files="*.png"))
    assert (message.stamp_ns, message.exposure) == (1403709395937837056, None)


def test_two_files_of_one_exposure_are_refused(tmp_path: Path) -> None:
    _folder(tmp_path, "pose1_full.pcd", "pose1_target.pcd", "pose2_full.pcd")
    with open_recording(tmp_path) as recording:
        with pytest.raises(RecordingError, match="both belong to exposure '1'") as error:
            recording.count(Source(files="*.pcd"))
        assert recording.count(Source(files="*_full.pcd")) == 2
    assert "pose1_full.pcd and pose1_target.pcd" in str(error.value)
    assert "narrow the sensor's `files` glob" in str(error.value)


def test_a_glob_that_matches_nothing_names_what_is_there(tmp_path: Path) -> None:
    _folder(tmp_path, "data/images/pose1.png", "data/images/pose2.png", "readme")
    with open_recording(tmp_path) as recording, pytest.raises(RecordingError) as error:
        recording.count(Source(files="images/pose*.png"))
    assert str(error.value) == (
        f"{tmp_path}: files: 'images/pose*.png' matches nothing; the folder holds 1 no suffix, "
        "2 .png; the nearest name is 'data/images/pose2.png'"
    )


@pytest.mark.parametrize("glob", ["", "/data/*.png"])
def test_a_glob_that_is_none(tmp_path: Path, glob: str) -> None:
    _folder(tmp_path, "a.png")
    with (
        open_recording(tmp_path) as recording,
        pytest.raises(RecordingError, match="is not a glob relative to the recording's folder"),
    ):
        recording.count(Source(files=glob))


def test_a_sensor_with_a_topic_only_is_told_to_add_files(tmp_path: Path) -> None:
    _folder(tmp_path, "a.png")
    with open_recording(tmp_path) as recording, pytest.raises(RecordingError) as error:
        recording.count(Source(topic="/cam0/image_raw"))
    assert "the sensor has topic '/cam0/image_raw'; add `files: GLOB`" in str(error.value)


def test_an_empty_folder(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match="the folder is empty; expected files that"):
        open_recording(tmp_path)


def test_the_metadata_of_another_data_set_do_not_make_a_bag(tmp_path: Path) -> None:
    _folder(tmp_path, "1.png", "metadata.yaml")
    with open_recording(tmp_path) as recording:
        assert recording.count(Source(files="*.png")) == 1


def test_the_fingerprint_of_a_folder_is_that_of_the_files_that_count(tmp_path: Path) -> None:
    sources = [Source(files="*.png"), Source(files="*.pcd")]
    _folder(tmp_path, "1.png", "1.pcd")
    before = fingerprint(tmp_path, sources)
    assert before.startswith("sha256:")
    _folder(tmp_path, "notes.txt")
    assert fingerprint(tmp_path, sources) == before == fingerprint(tmp_path, sources[::-1])
    (tmp_path / "1.png").rename(tmp_path / "2.png")
    renamed = fingerprint(tmp_path, sources)
    assert renamed != before
    (tmp_path / "1.pcd").write_bytes(b"other")
    assert fingerprint(tmp_path, sources) not in (before, renamed)


def test_the_fingerprint_of_a_bag_is_that_of_its_bytes(
    tmp_path: Path, make_bag: Callable[[str], Path]
) -> None:
    path = make_bag("mcap")
    first = fingerprint(path, [Source(topic="/front/scan")])
    assert first == fingerprint(path.rename(tmp_path / "other.mcap"))
    folder = make_bag("sqlite3 folder")
    before = fingerprint(folder, [Source(topic="/front/scan")])
    (folder / "bag.db3").write_bytes((folder / "bag.db3").read_bytes() + b"x")
    assert fingerprint(folder) != before
    with pytest.raises(RecordingError, match="cannot be read: No such file"):
        fingerprint(tmp_path / "none")
