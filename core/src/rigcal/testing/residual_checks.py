"""Checks of detector and residual: what is known of a residual at a known pose."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings

from rigcal.errors import RigcalError
from rigcal.geometry import se3
from rigcal.geometry.se3 import Array
from rigcal.graph.edge import SensorTargetEdge
from rigcal.graph.stack import EdgeStack
from rigcal.observation import Candidate, Observation
from rigcal.observation_file import load_observations, save_observations
from rigcal.plugin.answers import check_detection, check_residual
from rigcal.residual import residual_of_geometry
from rigcal.testing import strategies as st
from rigcal.testing.capability import needs
from rigcal.testing.derivatives import MOTION, OF_MOTION, assert_derivative
from rigcal.testing.same import assert_same
from rigcal.testing.stage import TOLERANCES, Stage
from rigcal.testing.statistics import assert_chi_square, assert_covariance, assert_white

_DRAWS, _POSES = 120, 6
_STEP = 1e-6


class ResidualChecks(Stage):
    """Residuals vanish at the truth, are whitened, and have the derivative that they claim."""

    @needs("frames")
    def test_frame_without_noise_is_explained_by_the_true_pose(self) -> None:
        unit = self.sensor_type.unit
        limit = TOLERANCES.get(unit) if self.tolerance is None else self.tolerance
        assert limit is not None, f"set `tolerance` in the test class, in the type's unit '{unit}'"
        rng = np.random.default_rng(0)
        for T_s_t in self.poses(rng, _POSES):
            candidate = self.detected(self.frame(T_s_t, rng, noise=False))
            _assert_explained(self.errors(candidate, T_s_t), limit, unit, "detect")

    @needs("observe")
    def test_observation_without_noise_is_explained_by_the_true_pose(self) -> None:
        rng = np.random.default_rng(0)
        for T_s_t in self.poses(rng, _POSES):
            candidate = self.candidate(T_s_t, rng, noise=False)
            errors, limit = self.errors(candidate, T_s_t), self.feature_tolerance
            _assert_explained(errors, limit, self.sensor_type.unit, "observe")

    @needs("errors", "measured_at")
    def test_errors_are_measured_on_the_board(self) -> None:
        rng = np.random.default_rng(0)
        for T_s_t in self.poses(rng, _POSES):
            candidate = self.candidate(T_s_t, rng, noise=False)
            assert self.sensor_type.measured_at is not None
            points = self.sensor_type.measured_at(candidate, self.config, self.target, T_s_t)
            assert points.shape == (len(self.errors(candidate, T_s_t)), 3)
            on_board = se3.apply(se3.inverse(T_s_t), points)
            half = np.ptp(self.target.outline, axis=0) / 2
            middle = self.target.outline.min(axis=0) + half
            assert np.all(np.abs(on_board[:, :2] - middle) < half + 0.02)
            assert np.all(np.abs(on_board[:, 2]) < 0.02)

    @needs("frames")
    def test_detection_is_whole_ordered_and_repeatable(self) -> None:
        rng = np.random.default_rng(0)
        (T_s_t,) = self.poses(rng, 1)
        frame = self.frame(T_s_t, np.random.default_rng(1))
        again = self.frame(T_s_t, np.random.default_rng(1))
        found = self.sensor_type.detect(frame, self.config, self.target)
        check_detection(found)
        scores = [candidate.score for candidate in found.candidates]
        assert scores == sorted(scores, reverse=True), "candidates come best first"
        assert_same(frame, again, where="the frame that detect was given")
        assert_same(found, self.sensor_type.detect(again, self.config, self.target))

    @needs("candidates")
    def test_residual_has_the_shape_that_it_announces(self) -> None:
        T_s_t, candidate = self._one()
        residual = self.residual(candidate)
        r, J = residual(T_s_t)
        check_residual(residual, r, J)
        assert r.dtype == J.dtype == np.float64, f"{r.dtype} and {J.dtype}: compute in float64"
        assert residual.block > 0, "`block` is the number of rows of one measurement"

    @needs("candidates")
    def test_residuals_evaluated_together_are_those_one_by_one(self) -> None:
        """By the class's `stack` where it has one."""
        rng = np.random.default_rng(6)
        poses = self.poses(rng, _POSES)
        own = [self.residual(self.candidate(T_s_t, rng)) for T_s_t in poses]
        T_s_t = np.stack(list(poses)) @ se3.exp(rng.normal(0, 0.05, (len(own), 6)))
        names = [str(k) for k in range(len(own))]
        edges = [SensorTargetEdge("s", k, residual) for k, residual in zip(names, own, strict=True)]
        blocks = EdgeStack(edges, ["s"], names).blocks(T_s_t)
        for residual, T, H, g in zip(own, T_s_t, blocks.H, blocks.g, strict=True):
            r, J = residual(T)
            scale = float(np.abs(J.T @ J).max())
            np.testing.assert_allclose(H, J.T @ J, rtol=1e-12, atol=1e-12 * scale)
            np.testing.assert_allclose(g, J.T @ r, rtol=1e-12, atol=1e-12 * scale)

    @needs("candidates")
    def test_jacobian_is_the_derivative(self) -> None:
        T_s_t, candidate = self._one()
        residual = self.residual(candidate)

        @settings(max_examples=25, deadline=None, derandomize=True, database=None)
        @given(st.motions())
        def check(xi: Array) -> None:
            T = T_s_t @ se3.exp(xi)
            step = _STEP * np.eye(6)
            difference = [residual(T @ se3.exp(d))[0] - residual(T @ se3.exp(-d))[0] for d in step]
            J = residual(T)[1]
            largest = max(float(np.abs(J).max()), 1.0)
            numeric = np.array(difference).T / (2 * _STEP)
            assert_derivative(J, numeric, MOTION, 1e-5 * largest, OF_MOTION)

        check()

    @needs("candidates")
    def test_residual_is_whitened(self) -> None:
        rows, count = self._rows_at_the_truth()
        assert_chi_square(sum(float(r @ r) for r in rows), count, "the residual at the truth")
        assert_white(rows)

    @needs("candidates")
    def test_covariance_of_the_geometry_is_true(self) -> None:
        """Pairs, gates for outliers and reports go by it, also beside a residual of its own."""
        rng = np.random.default_rng(5)
        poses = self.poses(rng, _DRAWS)
        rows = [residual_of_geometry(self.candidate(T_s_t, rng))(T_s_t)[0] for T_s_t in poses]
        r = np.concatenate(rows)
        assert_covariance(float(r @ r), len(r), "the geometry of candidates")

    @needs("candidates")
    def test_same_seed_gives_the_same_candidate(self) -> None:
        assert_same(self._one(7), self._one(7), where="the candidate")

    @needs("candidates")
    def test_order_of_measurements_does_not_matter(self) -> None:
        """Arrays of equal length hold a row for each measurement; rows are shuffled together."""
        T_s_t, candidate = self._one()
        T = T_s_t @ se3.exp(np.array([0.01, -0.02, 0.01, 0.01, 0.0, -0.02]))
        shuffled = _shuffled(candidate, np.random.default_rng(3))
        (r, J), (r2, J2) = (self.residual(c)(T) for c in (candidate, shuffled))
        scale = float(np.abs(J.T @ J).max())
        same = np.isclose(r2 @ r2, r @ r, rtol=1e-6, atol=0.0)
        same &= np.allclose(J2.T @ J2, J.T @ J, rtol=1e-6, atol=1e-6 * scale)
        count = _length(candidate)
        moved = [
            f"'{k}' {np.shape(v)}" for k, v in candidate.measurement.items() if _rows(v) == count
        ]
        assert same, (
            f"the rows of measurement {', '.join(moved)} were shuffled, all in the same way, and "
            f"the residual is another one (sum of squares {r2 @ r2:.6g}, before {r @ r:.6g}): "
            "arrays of equal length hold a row for each measurement, in any order. Store what must "
            f"keep its order as one row, (1, {count}), or say in an array of its own what each row "
            "belongs to"
        )

    @needs("candidates")
    def test_candidate_survives_its_file(self) -> None:
        T_s_t, candidate = self._one()
        path = self.folder / "observations.npz"
        save_observations(path, [Observation("sensor", "0", 1, "kit", (candidate,))])
        (read,) = load_observations(path)[0][0].candidates
        assert_same(self.residual(candidate)(T_s_t), self.residual(read)(T_s_t))

    @needs("candidates", "fit")
    def test_fit_of_its_own_measurements_finds_the_same(self) -> None:
        T_s_t, candidate = self._one()
        assert self.sensor_type.fit is not None
        found = self.sensor_type.fit(candidate.measurement, self.config, self.target)
        check_detection(found)
        cost, *others = (
            float(np.sum(self.residual(c)(T_s_t)[0] ** 2)) for c in (candidate, *found.candidates)
        )
        assert min(abs(other - cost) for other in others) < 0.01 * (1 + cost)

    @needs("candidates", "residual")
    @pytest.mark.parametrize("damage", ["empty", "truncated", "not finite", "wrong shape", "gone"])
    def test_damaged_measurement_is_an_error_or_a_whole_residual(self, damage: str) -> None:
        T_s_t, candidate = self._one()
        for name in candidate.measurement:
            measurement = dict(candidate.measurement) | {name: _damaged(candidate, name, damage)}
            if damage == "gone":
                del measurement[name]
            spoilt = Candidate(candidate.geometry, measurement, candidate.score)
            with np.errstate(all="ignore"):
                try:
                    residual = self.residual(spoilt)
                    check_residual(residual, *residual(T_s_t))
                except RigcalError:
                    continue
                except Exception as error:
                    raise AssertionError(
                        f"measurement '{name}' {damage}: the residual raised "
                        f"{type(error).__name__}; raise rigcal.errors.ObservationError"
                    ) from error

    def _one(self, seed: int = 0) -> tuple[Array, Candidate]:
        rng = np.random.default_rng(seed)
        (T_s_t,) = self.poses(rng, 1)
        return T_s_t, self.candidate(T_s_t, rng)

    def _rows_at_the_truth(self) -> tuple[list[Array], int]:
        rng = np.random.default_rng(5)
        residuals = []
        for T_s_t in self.poses(rng, _DRAWS):
            residual = self.residual(self.candidate(T_s_t, rng))
            residuals.append((residual(T_s_t)[0], residual.dof))
        return [r for r, _ in residuals], sum(dof for _, dof in residuals)


def _assert_explained(errors: Array, limit: float, unit: str, by: str) -> None:
    rms = float(np.sqrt(np.mean(np.square(errors))))
    assert rms < limit, (
        f"without noise the errors of what `{by}` reports are {rms:.3g} {unit} rms at the true "
        f"pose, expected below {limit:g} {unit}: it is biased, or a frame, unit or the place of a "
        "point on the target is another one than in the simulator; if noise is left, set "
        "`noise_free_config` or `noise_free_effects` in the test class"
    )


def _rows(value: Any) -> int | None:
    """The length of an array; None for a number."""
    return len(value) if np.ndim(value) else None


def _length(candidate: Candidate) -> int:
    """How many measurements: the first length that most of the arrays share."""
    lengths = [len(v) for v in candidate.measurement.values() if np.ndim(v)]
    return max(set(lengths), key=lengths.count) if lengths else 0


def _shuffled(candidate: Candidate, rng: np.random.Generator) -> Candidate:
    order = rng.permutation(_length(candidate))
    measurement = {
        name: v[order] if _rows(v) == len(order) else v for name, v in candidate.measurement.items()
    }
    return Candidate(candidate.geometry, measurement, candidate.score)


def _damaged(candidate: Candidate, name: str, damage: str) -> Any:
    value = np.asarray(candidate.measurement[name])
    match damage:
        case "empty":
            return value[:0] if value.ndim else np.zeros(0)
        case "truncated":
            return value[: len(value) // 2] if value.ndim else value
        case "not finite":
            return np.full(value.shape, np.nan)
        case "wrong shape":
            return np.stack([value, value], axis=-1)
    return value
