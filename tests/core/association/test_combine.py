"""Frames of one exposure as one candidate: is what it claims to know true?"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import chi2

from rigcal.association.combine import (
    combine_geometry,
    common_share,
    mean_of,
    nearest_to_mean,
)
from rigcal.geometry import se3
from rigcal.geometry.shapes import tangent_basis
from rigcal.observation import (
    Candidate,
    LineGeometry,
    PlaneGeometry,
    PointGeometry,
    PoseGeometry,
)

FRAMES, EXPOSURES, RECORDINGS = 10, 15, 2
POSE = se3.transform(se3.exp_so3(np.array([2.8, 0.3, -0.2])), np.array([0.3, -0.2, 2.5]))
COVARIANCE = np.diag([4e-6, 2e-6, 1e-6, 4e-6, 2e-6, 9e-6])


def pose(x):
    return PoseGeometry(POSE @ se3.exp(x), COVARIANCE)


def pose_error(g):
    return se3.log(se3.inverse(POSE) @ g.T_s_t), g.covariance


NORMAL = np.array([-0.6, 0.0, -0.8])
CENTER = np.array([1.2, 0.3, 1.6])


def plane(x):
    """Seen about a centre of its own: the returns differ from frame to frame."""
    tilt = tangent_basis(NORMAL) @ x[:2]
    n = NORMAL + np.cross(tilt, NORMAL)
    n /= np.linalg.norm(n)
    p = CENTER + x[2] * NORMAL
    return PlaneGeometry(n, -float(n @ p), p, COVARIANCE[:3, :3])


def plane_error(g):
    tilt = tangent_basis(g.normal).T @ np.cross(NORMAL, g.normal)
    return np.append(tilt, (g.center - CENTER) @ NORMAL), g.covariance


START, END, ACROSS = np.array([2.0, -0.5, 0.0]), np.array([2.0, 0.5, 0.0]), np.array([1.0, 0, 0])
LINE = np.kron(np.eye(2), np.diag([4e-6, 1e-4, 1e-12]))


def line(x):
    return LineGeometry(START + x[0] * ACROSS, END + x[3] * ACROSS, LINE, True, True)


def line_error(g):
    return np.array([(g.start - START)[0], (g.end - END)[0]]), g.covariance[::3, ::3]


def point(x):
    return PointGeometry(np.array([1.0, 2.0, 0.5]) + x[:3], COVARIANCE[:3, :3], np.zeros(3))


def point_error(g):
    return g.position - [1.0, 2.0, 0.5], g.covariance


KINDS = {
    "pose": (pose, pose_error, COVARIANCE),
    "plane": (plane, plane_error, COVARIANCE),
    "line": (line, line_error, LINE),
    "point": (point, point_error, COVARIANCE),
}


def nees(kind, own, shared):
    """NEES and degrees of freedom; own and shared errors' variances in units of the covariance."""
    make, error, covariance = KINDS[kind]
    L = np.linalg.cholesky(covariance)
    rng = np.random.default_rng(7)
    total, dof = 0.0, 0
    for _ in range(RECORDINGS):
        common = np.sqrt(shared) * rng.normal(size=(EXPOSURES, 1, 6))
        noise = np.sqrt(own) * rng.normal(size=(EXPOSURES, FRAMES, 6)) + common
        exposures = [[make(L @ z) for z in frames] for frames in noise]
        share = common_share(exposures)
        for frames in exposures:
            x, S = error(mean_of(frames, share).geometry)
            total += x @ np.linalg.solve(S, x)
            dof += len(x)
    return total, dof


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(
    ("own", "shared"),
    [(1.0, 0.0), (0.7, 0.3), (0.1, 0.9), (20.0, 0.0)],
    ids=["independent", "some in common", "nearly all in common", "trembling board"],
)
def test_covariance_of_the_mean_is_true(kind, own, shared):
    total, dof = nees(kind, own, shared)
    assert total < chi2.ppf(0.999, dof), f"too sure: NEES {total / dof:.2f} per dof"
    assert total > 0.6 * dof, f"too unsure: NEES {total / dof:.2f} per dof"


def test_exposures_of_one_frame_do_not_tell_what_frames_have_in_common():
    rng = np.random.default_rng(4)
    L = np.linalg.cholesky(0.4 * COVARIANCE)
    several = [[pose(L @ rng.normal(size=6)) for _ in range(FRAMES)] for _ in range(EXPOSURES)]
    assert common_share(several + 30 * [[pose(np.zeros(6))]]) == common_share(several) > 0.4
    assert common_share([[pose(np.zeros(6))]]) == 0


def test_a_detector_that_answers_now_with_a_pose_and_now_with_a_plane_is_told():
    with pytest.raises(TypeError, match="PoseGeometry and PlaneGeometry have no mean"):
        mean_of([plane(np.zeros(6)), pose(np.zeros(6)), plane(np.zeros(6))])


def test_four_times_as_many_frames_halve_the_error():
    rng = np.random.default_rng(1)
    L = np.linalg.cholesky(20 * COVARIANCE)
    few, many = (
        mean_of([pose(L @ rng.normal(size=6)) for _ in range(n)]).variance_ratio for n in (5, 20)
    )
    assert few / many == pytest.approx(4, rel=0.4)


def test_beams_end_at_the_same_place_in_every_scan():
    rng = np.random.default_rng(2)
    lines = [line(0.002 * rng.normal(size=6)) for _ in range(FRAMES)]
    S = mean_of(lines).geometry.covariance
    assert S[1, 1] == pytest.approx(1e-4, rel=0.01)
    assert S[0, 0] < 1e-6


def test_an_end_is_an_edge_if_most_frames_say_so():
    seen = [line(np.zeros(6))] * 3
    hidden = LineGeometry(START, END, LINE, False, True)
    assert mean_of([*seen, hidden]).geometry.start_is_edge
    assert not mean_of([line(np.zeros(6)), hidden, hidden]).geometry.start_is_edge


def test_types_without_a_way_of_their_own_get_the_mean_or_the_frame_nearest_to_it():
    offsets = np.array([0.0, 0.002, 0.011])[:, None] * np.ones(6)
    candidates = [Candidate(point(x), {"frame": np.array(i)}) for i, x in enumerate(offsets)]
    mean = mean_of([c.geometry for c in candidates])
    found = combine_geometry(candidates, mean).geometry
    np.testing.assert_allclose(found.position - [1.0, 2.0, 0.5], 0.013 / 3, rtol=1e-6)
    assert nearest_to_mean(candidates, mean).measurement["frame"] == 1
