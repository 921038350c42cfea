"""Checks of what a type makes of several frames, and of a second look at one."""

from __future__ import annotations

import numpy as np

from rigcal.association.combine import mean_of
from rigcal.geometry import se3
from rigcal.geometry.se3 import Array
from rigcal.graph.selection import misfit
from rigcal.observation import Detection
from rigcal.plugin.answers import check_detection
from rigcal.plugin.contract import Frame
from rigcal.testing.capability import needs
from rigcal.testing.stage import Stage
from rigcal.testing.statistics import assert_chi_square

_FRAMES, _POSES = 8, 6
_NEAR_M = 0.1


class StillnessChecks(Stage):
    """Frames of a board at rest say together what they claim; a second look sees what is there."""

    @needs("combine", "candidates")
    def test_frames_together_know_more_and_not_too_much(self) -> None:
        """Their information grows, and the errors at the truth are not larger than it says."""
        assert self.sensor_type.combine is not None
        rng = np.random.default_rng(0)
        square, dof = 0.0, 0
        for T_s_t in self.poses(rng, _POSES):
            frames = [self.candidate(T_s_t, rng) for _ in range(_FRAMES)]
            mean = mean_of([c.geometry for c in frames])
            together = self.sensor_type.combine(frames, mean, self.config, self.target)
            check_detection(Detection((together,)))
            J = self.residual(together)(T_s_t)[1]
            alone = self.residual(frames[0])(T_s_t)[1]
            known = np.linalg.matrix_rank(J, rtol=1e-6)
            gain = float(np.trace(J.T @ J) / np.trace(alone.T @ alone))
            assert gain > 1.5, f"{_FRAMES} frames together say {gain:.2f} times as much as one"
            square += self._explained(J, self.residual(together)(T_s_t)[0], int(known))
            dof += int(known)
        assert_chi_square(square, dof, f"{_FRAMES} frames together", only_above=True)

    @needs("near", "frames")
    def test_second_look_finds_the_board_where_it_is(self) -> None:
        """The prediction is off by 2 cm and 1 degree; the answer is nearer to the truth."""
        rng = np.random.default_rng(0)
        for T_s_t in self.poses(rng, _POSES):
            found = self._near(self.frame(T_s_t, rng), _moved(T_s_t, rng))
            assert found.candidates, f"the board is in view near the prediction: {found.reason}"
            apart = misfit(found.candidates[0].geometry, T_s_t, self.target)
            assert apart < _NEAR_M / 2, f"the answer is {1e3 * apart:.0f} mm off"

    @needs("near", "simulate")
    def test_second_look_shows_nothing_where_nothing_is(self) -> None:
        """It answers with what the frame shows, never with the prediction."""
        rng = np.random.default_rng(0)
        for T_s_t in self.poses(rng, _POSES):
            away = T_s_t.copy()
            away[:3, 3] *= 1 + 0.6 / np.linalg.norm(away[:3, 3])
            for shown in (None, away):
                found = self._near(self.simulate(shown, self.config, rng), T_s_t)
                for candidate in found.candidates:
                    apart = misfit(candidate.geometry, T_s_t, self.target)
                    assert apart > _NEAR_M, "it answers with the prediction, which is not there"

    def _near(self, frame: Frame, T_s_t: Array) -> Detection:
        assert self.sensor_type.near is not None
        found = self.sensor_type.near(frame, self.config, self.target, T_s_t)
        check_detection(found)
        return found

    @staticmethod
    def _explained(J: Array, r: Array, known: int) -> float:
        """Sum of squares (dof `known`) of the part of r that a motion of the target explains."""
        Q = np.linalg.svd(J, full_matrices=False)[0][:, :known]
        return float(np.sum((Q.T @ r) ** 2))


def _moved(T_s_t: Array, rng: np.random.Generator) -> Array:
    turn, way = rng.normal(size=3), rng.normal(size=3)
    xi = [np.radians(1.0) * turn / np.linalg.norm(turn), 0.02 * way / np.linalg.norm(way)]
    result: Array = T_s_t @ se3.exp(np.concatenate(xi))
    return result
