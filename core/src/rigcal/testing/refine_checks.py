"""Checks of the numbers that a sensor's config can refine beside the poses."""

from __future__ import annotations

from typing import Any

import numpy as np

from rigcal.geometry import se3
from rigcal.plugin.refinable import Parameters
from rigcal.testing.capability import needs
from rigcal.testing.stage import Stage

_STEP = 1e-4
"""Of a number's tolerable error."""


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
            own: list[Any] = [self.residual(c, (name,)) for c in candidates]
            evaluate = type(own[0]).refined(own)
            r, J, J_values = evaluate(T_s_t, p.values)
            one_by_one = [f(T) for f, T in zip(own, T_s_t, strict=True)]
            scale = float(np.abs(J).max())
            np.testing.assert_allclose(r, np.concatenate([r for r, _ in one_by_one]), atol=1e-9)
            np.testing.assert_allclose(
                J, np.concatenate([J for _, J in one_by_one]), atol=1e-9 * scale
            )
            assert J_values.shape == (len(r), len(p.names))
            for i, step in enumerate(np.diag(_STEP / np.abs(p.effect).max(axis=0))):
                difference = evaluate(T_s_t, p.values + step)[0]
                difference = difference - evaluate(T_s_t, p.values - step)[0]
                largest = max(float(np.abs(J_values[:, i]).max()), 1e-300)
                expected = difference / (2 * step[i])
                np.testing.assert_allclose(J_values[:, i], expected, atol=1e-5 * largest)

    def _parameters(self, name: str) -> Parameters:
        return self.sensor_type.refinable[name].parameters(self.config)
