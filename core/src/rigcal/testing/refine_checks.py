"""Checks of the numbers that a sensor's config can refine beside the poses."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from rigcal.geometry import se3
from rigcal.geometry.se3 import Array
from rigcal.graph.numbers import bend_of
from rigcal.plugin.contract import Residual
from rigcal.plugin.refinable import Parameters
from rigcal.testing.capability import needs
from rigcal.testing.derivatives import MOTION, OF_MOTION, assert_derivative
from rigcal.testing.stage import Stage

_STEP = 1e-4
"""Of a number's tolerable error."""

_POSE_STEP = 1e-6
"""Of a pose, rad and m."""

_BEND = np.array([0.02, -0.01, 0.015])
"""Some millimetres at the rim of a board of one metre."""
_FAR_BENT = 20 * _BEND
"""Some centimetres."""


class RefineChecks(Stage):
    """The numbers are those of the config, and residuals depend on them as they claim."""

    @needs("refinable")
    def test_numbers_to_refine_are_described_one_by_one(self) -> None:
        for name in self.sensor_type.refinable:
            p = self._parameters(name)
            count = len(p.names)
            assert len(set(p.names)) == len(p.units) == count > 0
            assert p.values.shape == (count,)
            assert p.effect.shape[1:] == (count,)
            assert np.isfinite(p.effect).all()
            assert np.abs(p.effect).max(axis=0).min() > 0, "a number without effect"
            assert p.prior_sigma is None or (p.prior_sigma > 0).all()
            assert p.tolerable
            assert p.advice

    @needs("refinable")
    def test_numbers_to_refine_come_back_from_the_config_they_are_applied_to(self) -> None:
        for name, refinable in self.sensor_type.refinable.items():
            p = self._parameters(name)
            values = p.values + 0.1 / np.abs(p.effect).max(axis=0)
            applied = refinable.parameters(refinable.apply(self.config, values))
            np.testing.assert_allclose(applied.values, values, rtol=1e-12)
            same = refinable.parameters(refinable.apply(self.config, p.values))
            np.testing.assert_array_equal(same.values, p.values)

    @needs("refinable", "candidates")
    def test_residual_moves_with_the_numbers_to_refine_as_its_derivative_says(self) -> None:
        rng = np.random.default_rng(0)
        poses = self.poses(rng, 3)
        candidates = [self.candidate(T_s_t, rng) for T_s_t in poses]
        T_s_t = np.stack(list(poses)) @ se3.exp(rng.normal(0, 0.01, (3, 6)))
        for name in self.sensor_type.refinable:
            p = self._parameters(name)
            own = [self.residual(c, (name,)) for c in candidates]
            _check_derivatives(own, T_s_t, p.values, _steps(p), p.names)

    @needs("bends", "candidates")
    def test_residual_moves_with_the_bend_of_the_board_as_its_derivative_says(self) -> None:
        """From where it starts: a flat board, or one that is known to be bent."""
        rng = np.random.default_rng(0)
        poses = self.poses(rng, 3)
        candidates = [self.candidate(T_s_t, rng) for T_s_t in poses]
        T_s_t = np.stack(list(poses)) @ se3.exp(rng.normal(0, 0.01, (3, 6)))
        config = self.target.config.model_copy(update={"refine": ("bend",)})
        for bend in (np.zeros(3), _BEND):
            target = replace(self.target, config=config).bent(bend)
            own_names: list[str | None] = [None, *self.sensor_type.refinable]
            for name in own_names:
                first = [] if name is None else [self._parameters(name)]
                numbers = [*first, bend_of(target)]
                values = np.concatenate([*(p.values for p in first), bend])
                steps = np.concatenate([_steps(p) for p in numbers])
                names = [each for p in numbers for each in p.names]
                asked = () if name is None else (name,)
                own = [self.residual(c, asked, target) for c in candidates]
                _check_derivatives(own, T_s_t, values, steps, names)

    @needs("bends", "errors", "observe")
    def test_errors_are_those_against_the_bent_board(self) -> None:
        """Of a board bent by far more than the noise: not a flat one, nor one the other way."""
        poses, errors = self.poses(np.random.default_rng(0), 8), self.sensor_type.errors
        observe = self.sensor_type.observe
        assert errors is not None
        assert observe is not None
        rng, true = np.random.default_rng(1), self.target.bent(_FAR_BENT)
        seen = [(T, observe(T, self.config, true, rng)) for T in poses]
        sizes = []
        for bend in (_FAR_BENT, np.zeros(3), -_FAR_BENT):
            parts = [
                errors(c, self.config, self.target.bent(bend), T).ravel()
                for T, c in seen
                if c is not None
            ]
            sizes.append(float(np.sqrt(np.mean(np.concatenate(parts) ** 2))))
        bent, flat, other_way = sizes
        assert bent < 0.5 * flat
        assert flat < other_way

    def _parameters(self, name: str) -> Parameters:
        return self.sensor_type.refinable[name].parameters(self.config)


def _steps(p: Parameters) -> Array:
    """(P,) steps for differences."""
    result: Array = _STEP / np.abs(p.effect).max(axis=0)
    return result


def _check_derivatives(
    residuals: Sequence[Residual], T_s_t: Array, values: Array, steps: Array, names: Sequence[str]
) -> None:
    """Residuals of `values` (P,) are those of poses alone there, and their derivative is true."""
    kind: Any = type(residuals[0])
    evaluate = kind.refined(residuals)
    r, J, J_values = evaluate(T_s_t, values)
    one_by_one = [f(T) for f, T in zip(residuals, T_s_t, strict=True)]
    scale = float(np.abs(J).max())
    np.testing.assert_allclose(r, np.concatenate([r for r, _ in one_by_one]), atol=1e-9)
    np.testing.assert_allclose(J, np.concatenate([J for _, J in one_by_one]), atol=1e-9 * scale)
    assert J_values.shape == (len(r), len(values))
    by_values = [
        evaluate(T_s_t, values + s)[0] - evaluate(T_s_t, values - s)[0] for s in np.diag(steps)
    ]
    largest = np.maximum(np.abs(J_values).max(axis=0), 1e-300)
    numeric = np.transpose(by_values) / (2 * steps)
    assert_derivative(
        J_values, numeric, names, 1e-5 * largest, "the columns are the numbers to refine"
    )
    small = _POSE_STEP * np.eye(6)
    by_pose = [
        evaluate(T_s_t @ se3.exp(s), values)[0] - evaluate(T_s_t @ se3.exp(-s), values)[0]
        for s in small
    ]
    numeric = np.transpose(by_pose) / (2 * _POSE_STEP)
    assert_derivative(J, numeric, MOTION, 1e-6 * scale, OF_MOTION)
