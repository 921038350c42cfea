"""Five cameras 72 degrees apart look at 120 board poses: corners, truth, first poses, bound."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from rigcal.geometry import se3
from rigcal.graph.edge import SensorTargetEdge
from rigcal.graph.information import information
from rigcal.plugin.registry import Registry
from rigcal.rig import build_targets, parse_rig
from rigcal_camera.lens import lens_of
from rigcal_camera.residual import ReprojectionResidual

CAMERAS, BOARDS, SIGMA_PX, LEAST_CORNERS = 5, 120, 0.2, 12
COLUMNS, ROWS, SQUARE_M = 12, 9, 0.09
CAMERA = {
    "type": "camera",
    "width_px": 1232,
    "height_px": 1024,
    "focal_px": [600.0, 600.0],
    "principal_px": [615.5, 511.5],
    "sigma_px": SIGMA_PX,
}


@dataclass(frozen=True)
class View:
    """One camera's corners: uv (N, 2) px of the board's points `index` (N,)."""

    camera: int
    board: int
    uv: np.ndarray
    index: np.ndarray


def make_rig():
    """The rig, its target and the registry; nothing in it tells where the cameras are."""
    registry = Registry.from_entry_points()
    board = {"type": "checkerboard", "columns": COLUMNS, "rows": ROWS, "square_size_m": SQUARE_M}
    sensors = {f"cam{i}": CAMERA | {"topic": f"/cam{i}"} for i in range(CAMERAS)}
    rig = {"version": 1, "root": "cam0", "targets": {"board": board}, "sensors": sensors}
    rig = parse_rig(rig, registry)
    return rig, build_targets(rig, registry)["board"], registry


def intrinsics():
    """K (3, 3)."""
    (fx, fy), (cx, cy) = CAMERA["focal_px"], CAMERA["principal_px"]
    return np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1.0]])


def truth(seed):
    """`T_cam0_cam` (5, 4, 4), `T_cam0_board` (120, 4, 4); boards stand where two cameras see."""
    rng = np.random.default_rng(seed)
    yaw = np.radians(72.0) * np.arange(CAMERAS)
    optical = se3.rotation_from_rpy(np.stack([0 * yaw - np.pi / 2, 0 * yaw, yaw - np.pi / 2], 1))
    place = 0.08 * np.stack([np.cos(yaw), np.sin(yaw), 0 * yaw], axis=1)
    T_rig_cam = se3.transform(optical, place)
    seams = np.radians(36 + 72 * rng.integers(CAMERAS, size=BOARDS))
    bearing = seams + np.radians(rng.uniform(-15, 15, BOARDS))
    facing = se3.rotation_from_rpy(
        np.stack([0 * bearing + np.pi / 2, 0 * bearing, bearing - np.pi / 2], axis=1)
    )
    tilt = se3.rotation_from_rpy(np.radians(rng.uniform(-35, 35, (BOARDS, 3))))
    radius = rng.uniform(1.6, 2.4, BOARDS)
    height = rng.uniform(-0.2, 0.2, BOARDS)
    p = np.stack([radius * np.cos(bearing), radius * np.sin(bearing), height], axis=1)
    T_0 = se3.inverse(T_rig_cam[0])
    return T_0 @ T_rig_cam, T_0 @ se3.transform(facing @ tilt, p)


def make_views(seed):
    """What the cameras see of the boards, with noise."""
    rig, target, _ = make_rig()
    lens, rng = lens_of(rig.sensors["cam0"]), np.random.default_rng([seed, 1])
    T_0_cam, T_0_board = truth(seed)
    views = []
    for (k, T_0_b), (i, T_0_c) in itertools.product(enumerate(T_0_board), enumerate(T_0_cam)):
        T_s_t = se3.inverse(T_0_c) @ T_0_b
        p_s = se3.apply(T_s_t, target.points)
        index = np.flatnonzero(lens.sees(p_s))
        if len(index) >= LEAST_CORNERS and se3.inverse(T_s_t)[2, 3] > 0:
            uv = lens.pixels_from_points(p_s[index])[0]
            views.append(View(i, k, uv + rng.normal(0, SIGMA_PX, uv.shape), index))
    return views


def save_views(path, views):
    """Write views as one .npz."""
    lengths = [len(v.index) for v in views]
    np.savez(
        path,
        ends=np.array([[v.camera, v.board] for v in views]),
        lengths=lengths,
        uv=np.concatenate([v.uv for v in views]),
        index=np.concatenate([v.index for v in views]),
    )


def load_views(path):
    """The views in a file of `save_views`."""
    with np.load(Path(path)) as data:
        cuts = np.cumsum(data["lengths"])[:-1]
        parts = np.split(data["uv"], cuts), np.split(data["index"], cuts)
        return [View(int(c), int(b), *p) for (c, b), *p in zip(data["ends"], *parts, strict=True)]


def first_poses(views, p_t, K):
    """`T_cam0_cam` (5, 4, 4) and `T_cam0_board` by number: PnP, then the middle of each chain link.

    The start that every solver gets.
    """
    T_c_b = {}
    for v in views:
        _, r, t = cv2.solvePnP(p_t[v.index], v.uv, K, None, flags=cv2.SOLVEPNP_IPPE)
        _, r, t = cv2.solvePnP(p_t[v.index], v.uv, K, None, r, t, useExtrinsicGuess=True)
        T_c_b[v.camera, v.board] = se3.transform(cv2.Rodrigues(r)[0], t.ravel())
    T_0_c = [np.eye(4)]
    for i in range(CAMERAS - 1):
        shared = [b for c, b in T_c_b if c == i and (i + 1, b) in T_c_b]
        links = np.stack([T_c_b[i, b] @ se3.inverse(T_c_b[i + 1, b]) for b in shared])
        middle = links[np.argmin(np.linalg.norm(links[:, None] - links, axis=(2, 3)).sum(axis=1))]
        T_0_c.append(T_0_c[-1] @ middle)
    T_0_b = {}
    for v in sorted(views, key=lambda v: -len(v.index)):
        T_0_b.setdefault(v.board, T_0_c[v.camera] @ T_c_b[v.camera, v.board])
    return np.stack(T_0_c), T_0_b


def edges_of(views, p_t, lens):
    """Our edges."""
    return [
        SensorTargetEdge(
            f"cam{v.camera}",
            str(v.board),
            ReprojectionResidual(lens, p_t[v.index], v.uv, SIGMA_PX),
        )
        for v in views
    ]


def bound(views, seed):
    """Cramer-Rao: expected sums of squares of rotation (rad^2) and translation (m^2) errors."""
    rig, target, _ = make_rig()
    T_0_cam, T_0_board = truth(seed)
    sensors = {f"cam{i}": T for i, T in enumerate(T_0_cam)}
    boards = {str(v.board): T_0_board[v.board] for v in views}
    edges = edges_of(views, target.points, lens_of(rig.sensors["cam0"]))
    info = information(edges, sensors, boards, frozenset({"cam0"}))
    return np.diagonal(info.covariance).reshape(-1, 2, 3).sum(axis=(0, 2))


def squared_errors(T_0_cam, seed):
    """Sums of squares of rotation (rad^2) and translation (m^2) errors over the four cameras."""
    e = se3.log(se3.inverse(truth(seed)[0]) @ T_0_cam)[1:]
    return np.array([np.sum(e[:, :3] ** 2), np.sum(e[:, 3:] ** 2)])
