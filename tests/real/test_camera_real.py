"""Fiducials in photographs that nobody here took; sources in the folders' READMEs.

acfr_vlp16: github.com/acfr/cam_lidar_calibration. euroc_aprilgrid: github.com/chutsu/yac (EuRoC MAV
sequences). opencv_stereo_chess: OpenCV's samples. caliscope_4cam_charuco:
github.com/mprib/caliscope.
"""

from __future__ import annotations

import os
import tomllib
from collections.abc import Iterable
from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml

from rigcal.geometry import se3
from rigcal.observation import Candidate
from rigcal.recording.message import Message
from rigcal.targets import BUILTIN_TARGETS
from rigcal.targets.target import Target
from rigcal_camera import CAMERA, CameraConfig

DATA = Path(os.environ.get("RIGCAL_DATA", Path(__file__).parents[2].parent / "shared" / "data"))
EUROC = DATA / "euroc_aprilgrid"
CHESS = DATA / "opencv_stereo_chess"
CALISCOPE = DATA / "caliscope_4cam_charuco/post_optimization"


def make_target(kind: str, **fields: object) -> Target:
    types = {target.name: target for target in BUILTIN_TARGETS}
    config = types[kind].config.model_validate({"type": kind, **fields})
    return types[kind].build("board", config)


def make_camera(width: int, height: int, K: object, **fields: object) -> CameraConfig:
    fx, fy, cx, cy = np.array(K, dtype=np.float64).ravel().tolist()
    return CameraConfig.model_validate(
        {
            "width_px": width,
            "height_px": height,
            "focal_px": (fx, fy),
            "principal_px": (cx, cy),
            **fields,
        }
    )


KALIBR = make_target(
    "apriltag_grid",
    columns=6,
    rows=6,
    tag_size_m=0.088,
    tag_spacing=0.3,
    border_cells=2,
    corner_squares=True,
)
ACFR = make_camera(
    1920,
    1208,
    [1176.93, 1177.72, 962.275, 612.725],
    model="fisheye",
    distortion=(-0.0540096, -0.0784275, 0.0959641, -0.0515253),
)
CHESS_LEFT = make_camera(
    640,
    480,
    [535.91573396163199, 535.91573396163199, 342.28315473308373, 235.57082909788173],
    distortion=(-0.266372609, -0.0385888989, 0.0017831947, -0.000281221, 0.238391531),
)
CHESS_RIGHT = make_camera(
    640,
    480,
    [534.80326845051309, 534.80326845051309, 334.55744527912015, 242.05324573376600],
    distortion=(-0.16916358306948096, -0.11214173641213163, 0.0, 0.0, 0.0),
)
EUROC_CAMERAS = (
    make_camera(
        752,
        480,
        [458.654, 457.296, 367.215, 248.375],
        distortion=(-0.28340811, 0.07395907, 0.00019359, 1.76187114e-05),
    ),
    make_camera(
        752,
        480,
        [457.587, 456.134, 379.999, 255.238],
        distortion=(-0.28368365, 0.07451284, -0.00010473, -3.55590700e-05),
    ),
)
D435I = make_camera(640, 480, [618.0, 618.0, 320.0, 240.0])
"""The file of this camera holds no intrinsics: rough ones are enough to complete the grid."""


def detect_files(
    paths: Iterable[Path], config: CameraConfig, target: Target
) -> dict[str, tuple[Candidate, ...]]:
    found = {}
    for path in sorted(paths):
        image = CAMERA.decode(Message(path.suffix, path, 0, None, str(path)), config)
        found[path.stem] = CAMERA.detect(image, config, target).candidates
    return found


def sigmas(found: dict[str, tuple[Candidate, ...]]) -> list[float]:
    return [float(c[0].measurement["sigma_px"]) for c in found.values() if c]


def test_acfr_checkerboard_in_fisheye_images() -> None:
    board = make_target(
        "checkerboard",
        columns=5,
        rows=7,
        square_size_m=0.095,
        width_m=0.61,
        height_m=0.85,
        offset_m=(0.002, 0),
    )
    found = detect_files((DATA / "acfr_vlp16/data/vlp/images").glob("*.png"), ACFR, board)
    seen = [candidates for candidates in found.values() if candidates]
    assert len(found) == 40
    assert len(seen) >= 38
    assert np.median(sigmas(found)) < 0.15
    for candidates in seen:
        # 5 x 7 inner corners look the same upside down.
        assert len(candidates) >= 2
        assert candidates[0].score == candidates[1].score


@pytest.mark.parametrize(
    ("side", "config", "sigma"), [("left", CHESS_LEFT, 0.2), ("right", CHESS_RIGHT, 0.6)]
)
def test_opencv_checkerboards(side: str, config: CameraConfig, sigma: float) -> None:
    board = make_target("checkerboard", columns=9, rows=6, square_size_m=0.025)
    found = detect_files(CHESS.glob(f"{side}[0-9]*.jpg"), config, board)
    assert len(found) == 13
    assert all(len(candidates) == 1 for candidates in found.values())
    assert np.median(sigmas(found)) < sigma


def test_euroc_stereo_pair_gives_the_published_pose() -> None:
    """Kalibr's grid, every corner, and all six numbers of one camera's pose in the other.

    One pair of images knows them to 0.5 mm (scatter over halves of the tags); the rest is what the
    given lenses lack.
    """
    poses = []
    for i, config in enumerate(EUROC_CAMERAS):
        (candidates,) = detect_files(
            (EUROC / "calib/stereo").glob(f"cam{i}_*.png"), config, KALIBR
        ).values()
        (candidate,) = candidates
        assert len(candidate.measurement["index"]) >= 140
        assert candidate.measurement["sigma_px"] < 0.12
        poses.append(candidate.geometry.T_s_t)  # type: ignore[union-attr]
    published = yaml.safe_load((EUROC / "calib/imu_april/config.yaml").read_text())["T_cam0_cam1"]
    T_0_1, T_0_1_published = poses[0] @ se3.inverse(poses[1]), np.reshape(published["data"], (4, 4))
    assert np.linalg.norm(T_0_1[:3, 3] - T_0_1_published[:3, 3]) < 0.0031
    turn = se3.log(se3.inverse(T_0_1_published) @ T_0_1)[:3]
    assert np.degrees(np.linalg.norm(turn)) < 0.14


def test_d435i_corners_agree_with_another_detector() -> None:
    images = EUROC / "mocap_data/cam0/data"
    found = detect_files(images.glob("*.jpg"), D435I, KALIBR)
    assert len(found) == 30
    assert sum(bool(candidates) for candidates in found.values()) >= 29
    differences, recalled, total = [], 0, 0
    for stem, candidates in found.items():
        table = np.loadtxt(EUROC / f"mocap_data/grid0/cam0/data/{stem}.csv", delimiter=",")
        theirs = {4 * int(row[10]) + int(row[11]): row[5:7] for row in table}
        total += len(theirs)
        for candidate in candidates[:1]:
            index, uv = candidate.measurement["index"], candidate.measurement["uv"]
            common = [k for k, i in enumerate(index.tolist()) if i in theirs]
            recalled += len(common)
            differences += [uv[k] - theirs[int(index[k])] for k in common]
    difference = np.array(differences)
    assert recalled >= 0.95 * total
    assert np.abs(difference.mean(axis=0)).max() < 0.02
    assert np.median(np.abs(difference)) < 0.07


@pytest.mark.parametrize(("camera", "frames"), [(0, 55), (1, 45), (2, 47), (3, 37)])
def test_caliscope_inverted_charuco_in_videos(camera: int, frames: int) -> None:
    entry = tomllib.loads((CALISCOPE / "camera_array.toml").read_text())["cameras"][str(camera)]
    K = np.array(entry["matrix"])
    config = make_camera(
        1280,
        720,
        [K[0, 0], K[1, 1], K[0, 2], K[1, 2]],
        distortion=tuple(entry["distortions"]),
    )
    board = make_target(
        "charuco",
        columns=4,
        rows=5,
        square_size_m=0.054,
        marker_size_m=0.0405,
        dictionary="DICT_4X4_1000",
        inverted=True,
    )
    video = cv2.VideoCapture(str(CALISCOPE / f"calibration/extrinsic/cam_{camera}.mp4"))
    found = {}
    while (frame := video.read())[0]:
        image = cv2.cvtColor(frame[1], cv2.COLOR_BGR2GRAY)
        found[str(len(found))] = CAMERA.detect(image, config, board).candidates
    assert len(found) == 57
    assert len(sigmas(found)) >= frames
    assert np.median(sigmas(found)) < 0.2
