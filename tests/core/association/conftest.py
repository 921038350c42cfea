"""Streams of geometry as detectors report it, of boards that are carried about and held still."""

from __future__ import annotations

import numpy as np
import pytest

from rigcal.association.rest import sightings_of
from rigcal.geometry import se3
from rigcal.geometry.shapes import plane_of_target
from rigcal.observation import Candidate, Detection, LineGeometry, PlaneGeometry, PoseGeometry
from rigcal.targets.target import Target, TargetConfig

HOLD_S, WAY_S = 2.0, 1.5


class World:
    """A board held still at random places for 2 s each, 1.5 s of way between; one sensor at 0."""

    def __init__(self, places: int, seed: int = 0, tremor_m: float = 0.0) -> None:
        self.rng = np.random.default_rng(seed)
        outline = np.array([[-0.6, -0.45], [0.6, -0.45], [0.6, 0.45], [-0.6, 0.45]])
        self.target = Target("board", TargetConfig(type="any"), outline, np.zeros((0, 3)))
        turn = self.rng.uniform(-0.5, 0.5, (places, 3))
        place = self.rng.uniform([-1, -0.4, 1.5], [1, 0.4, 3.0], (places, 3))
        flip = np.diag([1.0, -1.0, -1.0])
        self.T_s_t = se3.transform(se3.exp_so3(turn) @ flip, place)
        self.tremor_m = tremor_m
        self.holds = [(k * (HOLD_S + WAY_S), k * (HOLD_S + WAY_S) + HOLD_S) for k in range(places)]
        self.end_s = self.holds[-1][1]

    def at(self, time_s: float):
        k = min(int(time_s / (HOLD_S + WAY_S)), len(self.holds) - 1)
        share = np.clip((time_s - self.holds[k][1]) / WAY_S, 0, 1)
        if share == 0 or k + 1 == len(self.holds):
            T = self.T_s_t[k]
        else:
            T = self.T_s_t[k] @ se3.exp(
                share * se3.log(se3.inverse(self.T_s_t[k]) @ self.T_s_t[k + 1])
            )
        shake = np.concatenate([np.zeros(3), self.rng.normal(0, 1, 3) * self.tremor_m])
        return T @ se3.exp(shake)

    def times(self, rate_hz: float, phase_s: float = 0.0):
        return np.arange(phase_s, self.end_s, 1 / rate_hz)

    def stream(self, sensor, see, rate_hz=3.0, phase_s=0.0, jitter_s=0.005):
        """Sightings by a sensor whose `see(T_s_t)` gives geometries; stamps have jitter."""
        times = self.times(rate_hz, phase_s)
        detections = []
        for t in times:
            candidates = tuple(Candidate(g, {}) for g in see(self.at(t)))
            detections.append(Detection(candidates, "" if candidates else "nothing"))
        stamps = times + self.rng.uniform(-jitter_s, jitter_s, len(times))
        return sightings_of(sensor, stamps, detections, self.target)

    def pose(self, T, sigma=(0.001, 0.001)):
        s = np.repeat(sigma, 3)
        return PoseGeometry(T @ se3.exp(self.rng.normal(0, 1, 6) * s), np.diag(s**2))

    def plane(self, T, sigma=(0.003, 0.002)):
        tilt = np.append(self.rng.normal(0, sigma[0], 2), 0.0)
        moved = T @ se3.transform(se3.exp_so3(tilt), np.array([0, 0, self.rng.normal(0, sigma[1])]))
        n, d = plane_of_target(moved)
        variances = np.array([sigma[0], sigma[0], sigma[1]]) ** 2
        return PlaneGeometry(n, float(d), moved[:3, 3], np.diag(variances))

    def line(self, start, end, sigma_m=0.003):
        along = (end - start) / np.linalg.norm(end - start)
        across = np.array([-along[1], along[0], 0.0])
        noise = self.rng.normal(0, sigma_m, 2)
        block = sigma_m**2 * np.outer(across, across) + 1e-4 * np.outer(along, along)
        block += 1e-12 * np.eye(3)
        covariance = np.kron(np.eye(2), block)
        return LineGeometry(start + noise[0] * across, end + noise[1] * across, covariance)

    def cut(self, T, sigma_m=0.003):
        """The line in which the sensor's plane y = 0 cuts the board, laid into z = 0."""
        p = se3.apply(T, np.array([[-0.6, 0.0, 0.0], [0.6, 0.0, 0.0]]))
        start, end = (np.array([q[2], -q[0], 0.0]) for q in p)
        return self.line(start, end, sigma_m)


@pytest.fixture
def world():
    return World
