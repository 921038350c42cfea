"""The same solved by mrcal, which is a Debian package: runs in the system's Python, alone.

    /usr/bin/python3 mrcal_solve.py VIEWS.npz RESULT.npz REPEATS

VIEWS.npz holds grids (V, rows, columns, 3) of u, v, weight, ends (V, 2), K, square, and first poses
`T_cam_cam0` (5, 4, 4), `T_cam0_grid` (B, 4, 4) with boards 0..B-1; mrcal's board has its origin in
the first corner. RESULT.npz gets `T_cam_cam0` and the seconds of every repeat.
"""

import sys
import time

import mrcal
import numpy as np


def main(views, result, repeats):
    """Solve `repeats` times from the same start."""
    data = np.load(views)
    K = data["K"]
    ends = data["ends"].astype(np.int32)
    # Board by board, as mrcal wants it; its camera -1 is the reference.
    order = np.lexsort((ends[:, 0], ends[:, 1]))
    ends = ends[order]
    cameras = len(data["T_cam_cam0"])
    indices = np.stack([ends[:, 1], ends[:, 0], ends[:, 0] - 1], axis=1).astype(np.int32)
    first_cameras = np.array([rt_of(T) for T in data["T_cam_cam0"][1:]])
    first_boards = np.array([rt_of(T) for T in data["T_cam0_grid"]])
    seconds = []
    for _ in range(int(repeats)):
        extrinsics, frames = first_cameras.copy(), first_boards.copy()
        optimised = {
            "intrinsics": np.tile([K[0, 0], K[1, 1], K[0, 2], K[1, 2]], (cameras, 1)),
            "extrinsics_rt_fromref": extrinsics,
            "frames_rt_toref": frames,
            "points": None,
            "observations_board": data["grids"][order].copy(),
            "indices_frame_camintrinsics_camextrinsics": indices,
            "observations_point": None,
            "indices_point_camintrinsics_camextrinsics": None,
            "lensmodel": "LENSMODEL_PINHOLE",
            "imagersizes": np.tile(data["size"], (cameras, 1)).astype(np.int32),
            "calibration_object_spacing": float(data["square"]),
            "do_optimize_intrinsics_core": False,
            "do_optimize_intrinsics_distortions": False,
            "do_optimize_extrinsics": True,
            "do_optimize_frames": True,
            "do_optimize_calobject_warp": False,
            "do_apply_regularization": False,
            "do_apply_outlier_rejection": False,
            "verbose": False,
        }
        start = time.perf_counter()
        mrcal.optimize(**optimised)
        seconds.append(time.perf_counter() - start)
    T = np.stack([np.eye(4)] + [matrix_of(rt) for rt in extrinsics])
    np.savez(result, T_cam_cam0=T, seconds=seconds)


def rt_of(T):
    """Rotation vector and translation (6,)."""
    return np.concatenate([mrcal.r_from_R(np.ascontiguousarray(T[:3, :3])), T[:3, 3]])


def matrix_of(rt):
    """(4, 4)."""
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = mrcal.R_from_r(rt[:3]), rt[3:]
    return T


if __name__ == "__main__":
    main(*sys.argv[1:])
