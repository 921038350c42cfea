"""The same views solved by rigcal, pycolmap and OpenCV, from the same first poses.

Every `solve_...` takes views, points (P, 3), K and the first poses, and returns `T_cam0_cam`
(5, 4, 4) and the seconds of the solver itself: what comes before it is filling its structures.
"""

from __future__ import annotations

import time

import cv2
import numpy as np
from camera.problem import CAMERA, CAMERAS, SIGMA_PX, edges_of, first_poses, make_rig

from rigcal.geometry import se3


def solve_rigcal(views, p_t, K, T_0_c, T_0_b):
    """`rigcal.graph.joint.solve`; the seconds include stacking the edges."""
    from rigcal.graph.joint import solve
    from rigcal_camera.lens import lens_of

    rig, _, _ = make_rig()
    edges = edges_of(views, p_t, lens_of(rig.sensors["cam0"]))
    sensors = {f"cam{i}": T for i, T in enumerate(T_0_c)}
    boards = {str(b): T for b, T in T_0_b.items()}
    start = time.perf_counter()
    sensors, *_ = solve(edges, sensors, boards, frozenset({"cam0"}))
    return np.stack(list(sensors.values())), time.perf_counter() - start


def solve_pycolmap(views, p_t, K, T_0_c, T_0_b):
    """Rig bundle adjustment: the board's points are constant, its poses are those of the rig."""
    import pycolmap

    model = pycolmap.Reconstruction()
    rig = pycolmap.Rig(rig_id=1)
    for c in range(CAMERAS):
        model.add_camera(_pycolmap_camera(pycolmap, c, K))
        sensor = pycolmap.sensor_t(pycolmap.SensorType.CAMERA, c + 1)
        if c == 0:
            rig.add_ref_sensor(sensor)
        else:
            rig.add_sensor(sensor, _rigid(pycolmap, se3.inverse(T_0_c[c])))
    model.add_rig(rig)
    board_point = [model.add_point3D(p, pycolmap.Track()) for p in p_t]
    config = pycolmap.BundleAdjustmentConfig()
    for b, T in T_0_b.items():
        own = [(i, v) for i, v in enumerate(views, 1) if v.board == b]
        frame = pycolmap.Frame(frame_id=b + 1, rig_id=1)
        for i, v in own:
            camera = pycolmap.sensor_t(pycolmap.SensorType.CAMERA, v.camera + 1)
            frame.add_data_id(pycolmap.data_t(camera, i))
        frame.rig_from_world = _rigid(pycolmap, T)
        model.add_frame(frame)
        for i, v in own:
            # In COLMAP the centre of the top-left pixel is (0.5, 0.5).
            image = pycolmap.Image(f"{i}", v.uv + 0.5, v.camera + 1, i)
            image.frame_id = b + 1
            model.add_image(image)
            for k, p in enumerate(v.index):
                model.add_observation(board_point[p], pycolmap.TrackElement(i, k))
            config.add_image(i)
        model.register_frame(b + 1)
    for c in range(CAMERAS):
        config.set_constant_cam_intrinsics(c + 1)
    for point in board_point:
        config.add_constant_point(point)
    options = pycolmap.BundleAdjustmentOptions(refine_sensor_from_rig=True, print_summary=False)
    start = time.perf_counter()
    pycolmap.create_default_bundle_adjuster(options, config, model).solve()
    seconds = time.perf_counter() - start
    T_c_0 = np.tile(np.eye(4), (CAMERAS, 1, 1))
    for c in range(1, CAMERAS):
        sensor = pycolmap.sensor_t(pycolmap.SensorType.CAMERA, c + 1)
        T_c_0[c, :3] = model.rig(1).sensor_from_rig(sensor).matrix()
    return se3.inverse(T_c_0), seconds


def _pycolmap_camera(pycolmap, c, K):
    return pycolmap.Camera(
        camera_id=c + 1,
        model="PINHOLE",
        width=CAMERA["width_px"],
        height=CAMERA["height_px"],
        params=[K[0, 0], K[1, 1], K[0, 2] + 0.5, K[1, 2] + 0.5],
    )


def _rigid(pycolmap, T):
    return pycolmap.Rigid3d(T[:3])


def solve_opencv(views, p_t, K, T_0_c, T_0_b):
    """stereoCalibrate of neighbours with fixed intrinsics, chained: it has no graph."""
    seen = {(v.camera, v.board): v for v in views}
    result, seconds = [np.eye(4)], 0.0
    for c in range(CAMERAS - 1):
        points, first, second = [], [], []
        for b in [b for camera, b in seen if camera == c and (c + 1, b) in seen]:
            one, two = seen[c, b], seen[c + 1, b]
            index, i, j = np.intersect1d(one.index, two.index, return_indices=True)
            if len(index) >= 4:
                points.append(p_t[index].astype(np.float32))
                first.append(one.uv[i].astype(np.float32))
                second.append(two.uv[j].astype(np.float32))
        size = CAMERA["width_px"], CAMERA["height_px"]
        zero, flags = np.zeros(5), cv2.CALIB_FIX_INTRINSIC
        stop = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_MAX_ITER, 100, 1e-9)
        start = time.perf_counter()
        R, t = cv2.stereoCalibrate(
            points, first, second, K, zero, K, zero, size, flags=flags, criteria=stop
        )[5:7]
        seconds += time.perf_counter() - start
        result.append(result[-1] @ se3.inverse(se3.transform(R, t.ravel())))
    return np.stack(result), seconds


def whole_rigcal(views):
    """What a user runs: pairs, spanning tree, robust stage, noise, inliers, covariances."""
    from rigcal.estimation import calibrate
    from rigcal.observation import Candidate, Observation, PoseGeometry
    from rigcal_camera.lens import lens_of
    from rigcal_camera.pose import fit_poses

    rig, target, registry = make_rig()
    lens = lens_of(rig.sensors["cam0"])
    observations = []
    for v in views:
        fit = fit_poses(lens, target.points[v.index], v.uv)[0]
        geometry = PoseGeometry(fit.T_s_t, np.linalg.inv(fit.information) * SIGMA_PX**2)
        measurement = {"uv": v.uv[fit.inliers], "index": v.index[fit.inliers]}
        candidate = Candidate(geometry, measurement)
        observations.append(Observation(f"cam{v.camera}", str(v.board), 0, "", (candidate,)))
    result = calibrate(rig, registry, observations)
    return np.stack([s.T_parent_sensor for s in result.sensors.values()])


def whole(name, views, p_t, K):
    """`T_cam0_cam` from views, first poses included."""
    if name == "rigcal, everything":
        return whole_rigcal(views)
    return SOLVERS[name](views, p_t, K, *first_poses(views, p_t, K))[0]


SOLVERS = {"rigcal": solve_rigcal, "pycolmap": solve_pycolmap, "OpenCV, pairs": solve_opencv}
