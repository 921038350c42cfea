"""Observations by hand: what arrays say of the target, and how well they say it."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import rigcal
from rigcal.errors import ObservationError
from rigcal.geometry import se3
from rigcal.geometry.shapes import tangent_basis
from rigcal.observation import (
    Candidate,
    Detection,
    LineGeometry,
    Observation,
    PlaneGeometry,
    PointGeometry,
    PoseGeometry,
)
from rigcal.residual import residual_of_geometry
from rigcal.testing.statistics import assert_chi_square

T_S_T = se3.transform(se3.rotation_from_rpy(np.array([1.5, 0.2, 1.2])), np.array([2.0, 0.3, -0.1]))
DRAWS = 200


def _plane(rng: np.random.Generator) -> PlaneGeometry:
    on_board = np.column_stack([rng.uniform(-0.5, 0.5, (50, 2)), rng.normal(0, 0.01, 50)])
    return PlaneGeometry.through(se3.apply(T_S_T, on_board), 0.01)


def _line(rng: np.random.Generator) -> LineGeometry:
    n = T_S_T[:3, 2]
    across = n[:2] / np.linalg.norm(n[:2])
    foot = across * (n @ T_S_T[:3, 3]) / np.linalg.norm(n[:2])
    along = np.array([-across[1], across[0]])
    s = np.sort(rng.uniform(-0.4, 0.4, 40))
    noise = rng.normal(0, 0.01, 40)
    return LineGeometry.through(foot + s[:, None] * along + noise[:, None] * across, 0.01)


def _point(rng: np.random.Generator) -> PointGeometry:
    known = np.array([0.3, -0.2, 0.05])
    return PointGeometry.at(se3.apply(T_S_T, known) + rng.normal(0, 0.02, 3), known, 0.02)


def _pose(rng: np.random.Generator) -> PoseGeometry:
    noise = rng.normal(size=6) * ([0.01] * 3 + [0.02] * 3)
    return PoseGeometry.of(T_S_T @ se3.exp(-noise), 0.01, 0.02)


@pytest.mark.parametrize("make", [_plane, _line, _point, _pose])
def test_covariance_is_that_of_the_noise(make: Callable[[np.random.Generator], Any]) -> None:
    rng = np.random.default_rng(4)
    residuals = [residual_of_geometry(Candidate(make(rng), {})) for _ in range(DRAWS)]
    rows = [r(T_S_T)[0] for r in residuals]
    total, count = sum(float(r @ r) for r in rows), sum(len(r) for r in rows)
    assert_chi_square(total, count, make.__name__)


def test_plane_looks_to_the_sensor_and_lies_at_the_points_centre() -> None:
    plane = _plane(np.random.default_rng(0))
    assert plane.d > 0
    assert abs(plane.normal @ plane.center + plane.d) < 1e-12
    turned = np.abs(tangent_basis(plane.normal).T @ T_S_T[:3, 2])
    assert turned.max() < 0.02


def test_line_keeps_the_order_of_its_points() -> None:
    points = np.column_stack([np.full(9, 2.0), np.linspace(0.4, -0.4, 9)])
    line = LineGeometry.through(points, 0.01)
    np.testing.assert_allclose(line.start, [2.0, 0.4, 0.0], atol=1e-12)
    np.testing.assert_allclose(line.end, [2.0, -0.4, 0.0], atol=1e-12)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: PlaneGeometry.through(np.zeros((9, 2)), 0.01), r"shape \(9, 2\), expected \(N, 3"),
        (lambda: PlaneGeometry.through(np.eye(3)[:2], 0.01), r"\(2, 3\).* with N >= 3"),
        (
            lambda: PlaneGeometry.through(np.linspace([1, 0, 0], [1, 1, 1], 9), 0.01),
            "the points do not span a plane",
        ),
        (lambda: PlaneGeometry.through(np.full((9, 3), np.nan), 0.01), "not finite"),
        (lambda: LineGeometry.through(np.ones((9, 2)), 0.01), "the points do not span a line"),
        (lambda: PointGeometry.at([1, 2], [0, 0, 0], 0.01), "position is .*, expected three"),
        (lambda: PointGeometry.at([1, 2, 3], [0, 0, np.inf], 0.01), "target_point is .*, expected"),
        (lambda: PoseGeometry.of(np.eye(3), 0.01, 0.01), r"T_s_t has shape \(3, 3\)"),
        (lambda: PoseGeometry.of(T_S_T.T, 0.01, 0.01), r"shape \(4, 4\) is no pose.*target's coor"),
        (lambda: PoseGeometry.of(2 * T_S_T, 0.01, 0.01), r"is no pose; expected \[\[R, t\], \[0"),
        (lambda: PoseGeometry.of(np.diag([2, 1, 1, 1]), 0.01, 0.01), "is no pose.*R a rotation"),
        (lambda: PoseGeometry.of(T_S_T[:3], 0.01, 0.01), r"shape \(3, 4\) is no pose"),
        (lambda: Detection(()), "must say why in `reason`"),
        (lambda: PoseGeometry.of(T_S_T, 0.0, 0.01), "sigma_rad is 0.0, expected a finite number"),
        (lambda: PlaneGeometry.through(np.eye(3), -0.01), "sigma_m is -0.01, expected .* above 0"),
        (lambda: LineGeometry.through(np.eye(2), np.nan), "sigma_m is nan"),
        (lambda: PointGeometry.at([1, 2, 3], [0, 0, 0], 0), "sigma_m is 0"),
        (lambda: Observation.of("cam", "3"), "sensor 'cam', exposure '3': no geometry"),
        (lambda: Observation.of("cam", "3", 5), "'3': found int, expected a PoseGeometry, Plane"),
        (
            lambda: Observation.of("cam", 3, PointGeometry.at([1, 2, 3], [0, 0, 0], 1)),
            "sensor 'cam', exposure 3: found int, expected the exposure's name as text",
        ),
    ],
)
def test_what_cannot_be_used_is_named(make: Callable[[], object], message: str) -> None:
    with pytest.raises(ObservationError, match=message):
        make()


def test_observation_survives_its_file_as_made_by_hand(tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    given = Observation.of("lidar", "7", _plane(rng), _plane(rng), stamp_ns=5)
    rigcal.save_observations(tmp_path / "o.npz", [given])
    ((read,), _) = rigcal.load_observations(tmp_path / "o.npz")
    assert (read.sensor, read.exposure, read.stamp_ns, read.origin) == ("lidar", "7", 5, "by hand")
    assert [c.by_hand for c in read.candidates] == [True, True]
    first, second = read.candidates
    assert first.score > second.score
