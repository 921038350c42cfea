"""The example script that turns synchronised videos into a folder recording."""

import importlib.util
from pathlib import Path
from types import ModuleType

import cv2
import numpy as np
import pytest

SCRIPT = Path(__file__).parents[3] / "examples" / "real" / "extract_video_frames.py"


@pytest.fixture(scope="module")
def script() -> ModuleType:
    spec = importlib.util.spec_from_file_location("extract_video_frames", SCRIPT)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def write_table(path: Path, rows: list[tuple[int, int, float]]) -> Path:
    lines = ["sync_index,cam_id,frame_index,frame_time"]
    lines += [f"{sync},{camera},0,{time}" for sync, camera, time in rows]
    path.write_text("\n".join(lines) + "\n")
    return path


def write_video(path: Path, greys: list[int]) -> Path:
    size = (32, 24)
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), 5, size)
    assert writer.isOpened()
    for grey in greys:
        writer.write(np.full((size[1], size[0], 3), grey, dtype=np.uint8))
    writer.release()
    return path


def test_frames_follow_time_and_not_the_order_of_rows(script: ModuleType, tmp_path: Path) -> None:
    table = write_table(
        tmp_path / "timestamps.csv", [(7, 0, 2.0), (3, 1, 1.0), (5, 0, 1.5), (3, 0, 1.0)]
    )
    assert script.frames_by_camera(table) == {0: [3, 5, 7], 1: [3]}


def test_images_are_named_by_their_common_instant(script: ModuleType, tmp_path: Path) -> None:
    video = write_video(tmp_path / "cam_0.avi", [20, 120, 220])
    assert script.extract(video, [3, 5, 9], tmp_path / "cam_0") == 3
    files = sorted((tmp_path / "cam_0").iterdir())
    assert [f.name for f in files] == ["frame_0003.png", "frame_0005.png", "frame_0009.png"]
    greys = [cv2.imread(str(f), cv2.IMREAD_UNCHANGED) for f in files]
    assert [g.shape for g in greys] == [(24, 32)] * 3
    assert [float(g.mean()) for g in greys] == pytest.approx([20, 120, 220], abs=6)


@pytest.mark.parametrize("listed", [[3, 5], [3, 5, 9, 10]])
def test_video_that_does_not_fit_its_table_is_refused(
    script: ModuleType, tmp_path: Path, listed: list[int]
) -> None:
    video = write_video(tmp_path / "cam_0.avi", [20, 120, 220])
    with pytest.raises(SystemExit, match=f"has 3 frames, timestamps.csv lists {len(listed)}"):
        script.extract(video, listed, tmp_path / "cam_0")


def test_empty_table_is_refused(script: ModuleType, tmp_path: Path) -> None:
    with pytest.raises(SystemExit, match="no frames listed"):
        script.frames_by_camera(write_table(tmp_path / "timestamps.csv", []))
