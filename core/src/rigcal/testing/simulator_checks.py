"""Checks of the simulator: noise, visibility, frames of reference."""

from __future__ import annotations

import numpy as np

from rigcal.geometry import se3
from rigcal.geometry.se3 import Array
from rigcal.graph.board import center_of
from rigcal.residual import residual_of_geometry
from rigcal.testing.capability import needs
from rigcal.testing.same import assert_same
from rigcal.testing.stage import Stage
from rigcal.testing.statistics import assert_chi_square, assert_covariance

_FRAMES = 30


class SimulatorChecks(Stage):
    """The simulated world is the one that the config describes."""

    @needs("simulate")
    def test_same_seed_gives_the_same_frame(self) -> None:
        (T_s_t,) = self.poses(np.random.default_rng(0), 1)
        first, second, other = (
            self.simulate(T_s_t, self.config, np.random.default_rng(seed)) for seed in (4, 4, 5)
        )
        assert_same(first, second)
        try:
            assert_same(first, other)
        except AssertionError:
            return
        raise AssertionError("another seed gives the same frame: draw the noise from `rng`")

    @needs("simulate")
    def test_noise_of_frames_is_the_configured_one(self) -> None:
        """Through the detector: whitened residuals, the covariance of what it reports, and raw
        errors where `raw_sigma` is known.
        """
        rng = np.random.default_rng(11)
        whitened, dof, raw, geometry = 0.0, 0, [], []
        for T_s_t in self.poses(rng, _FRAMES):
            candidate = self.detected(self.simulate(T_s_t, self.config, rng))
            residual = self.residual(candidate)
            whitened += float(np.sum(residual(T_s_t)[0] ** 2))
            dof += residual.dof
            raw.append(np.ravel(self.errors(candidate, T_s_t)))
            geometry.append(residual_of_geometry(candidate)(T_s_t)[0])
        bound = not self.raw_noise_is_configured
        assert_chi_square(whitened, dof, "whitened residuals of frames", only_above=bound)
        r = np.concatenate(geometry)
        assert_covariance(float(r @ r), len(r), "the geometry of detections", only_above=bound)
        if self.raw_sigma is not None and self.sensor_type.errors is not None:
            errors = np.concatenate(raw)
            chi2 = float(errors @ errors) / self.raw_sigma**2
            assert_chi_square(chi2, len(errors), "raw errors of frames", only_above=bound)

    @needs("simulate", "sees")
    def test_board_out_of_view_leaves_no_trace(self) -> None:
        rng = np.random.default_rng(2)
        for T_s_t in self._poses_out_of_view(rng, 10):
            seeds = [np.random.default_rng(9) for _ in range(2)]
            shown, empty = (
                self.simulate(T, self.config, seed)
                for T, seed in zip((T_s_t, None), seeds, strict=True)
            )
            assert_same(shown, empty, where=f"the frame of a board out of view, T_s_t =\n{T_s_t}\n")

    @needs("observe", "sees")
    def test_board_out_of_view_is_not_observed(self) -> None:
        assert self.sensor_type.observe is not None
        rng = np.random.default_rng(2)
        for T_s_t in self._poses_out_of_view(rng, 10):
            assert self.sensor_type.observe(T_s_t, self.config, self.target, rng) is None

    @needs("simulate", "sees")
    def test_board_in_view_is_in_the_frame(self) -> None:
        rng = np.random.default_rng(3)
        for T_s_t in self.poses(rng, 5):
            assert self.in_view(T_s_t).all(), "`poses` are poses in view"
            self.detected(self.simulate(T_s_t, self.config, rng))

    @needs("simulate")
    def test_moving_sensor_and_scene_together_changes_nothing(self) -> None:
        rng = np.random.default_rng(0)
        for T_s_t in self.poses(rng, 3):
            T_w_s = se3.exp(rng.normal(size=6))
            here, there = (
                self.simulate(T_s_t, self.config, np.random.default_rng(8), T)
                for T in (np.eye(4), T_w_s)
            )
            moved = "the frame depends on where the sensor stands: simulate it by T_w_s"
            assert_same(here, there, 1e-9, where=moved)

    @needs("candidates")
    def test_board_straight_ahead_is_seen_straight_ahead(self) -> None:
        T_s_t = self.facing(float(np.mean(self.distances_m)))
        assert self.in_view(T_s_t).any(), "straight ahead is x (`optical`: z) of the frame"
        rng = np.random.default_rng(0)
        place = center_of(self.candidate(T_s_t, rng).geometry)
        ahead = self.forward[:, 0]
        across = place - (place @ ahead) * ahead
        half = float(np.linalg.norm(self.target.size)) / 2
        assert place @ ahead > 0, f"the board ahead is reported at {place}"
        assert np.linalg.norm(across) < half, f"the board ahead is reported at {place}"

    def _poses_out_of_view(self, rng: np.random.Generator, count: int) -> Array:
        """Boards of which no point is in view: far to the side, behind, too far away."""
        found: list[Array] = []
        far = 3 * (getattr(self.config, "range_max_m", None) or 7.0)
        for _ in range(2000):
            place = rng.normal(size=3)
            place *= rng.choice([self.distances_m[1], far]) / np.linalg.norm(place)
            T_s_t = se3.transform(se3.exp_so3(rng.normal(size=3)), place)
            if not self.in_view(T_s_t).any():
                found.append(T_s_t)
            if len(found) == count:
                break
        assert found, "`sees` says yes to everything around the sensor"
        return np.stack(found)
