"""The board in a room, in a person's hands, as the scans that look one way only see it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from rigcal.geometry import se3
from rigcal.geometry.se3 import Array
from rigcal.observation import PlaneGeometry
from rigcal.ranging import RangeEffects
from rigcal.scene import Scene
from rigcal.targets.target import Target
from rigcal_lrf3d import LRF3D, Lrf3dConfig
from rigcal_lrf3d.detector import detect
from rigcal_lrf3d.feature import observe
from rigcal_lrf3d.simulator import simulate

MakeScene = Callable[[Array, Target], Scene]
SENSORS: dict[str, dict[str, Any]] = {
    "rosette": {"scan": {"pattern": "rosette", "fov_deg": 70.4}, "sigma_m": 0.015},
    "depth": {"scan": {"pattern": "depth_camera"}, "sigma_m": 0.002, "sigma_per_m2": 0.0025},
}
SPOILT = RangeEffects(divergence_deg=0.2, outliers=0.01, dropout=0.05, quantisation_m=0.005)


def poses(count: int, seed: int) -> list[Array]:
    """Boards ahead, 1.9 to 2.7 m away."""
    rng = np.random.default_rng(seed)
    facing = np.array([[0.0, 0, -1], [-1, 0, 0], [0, 1, 0]])
    return [
        se3.transform(
            se3.rotation_from_rpy(np.radians(rng.uniform(-30, 30, 3))) @ facing,
            np.array([rng.uniform(1.9, 2.7), *rng.uniform(-0.1, 0.1, 2)]),
        )
        for _ in range(count)
    ]


@pytest.mark.parametrize("effects", [RangeEffects(), SPOILT], ids=["clean", "spoilt"])
@pytest.mark.parametrize("sensor", SENSORS)
def test_the_board_is_found_in_a_persons_hands(
    sensor: str, effects: RangeEffects, board: Target, room: MakeScene
) -> None:
    config = Lrf3dConfig.model_validate(SENSORS[sensor])
    for k, T_s_t in enumerate(poses(4, 5)):
        cloud = simulate(np.eye(4), room(T_s_t, board), config, np.random.default_rng(k), effects)
        found = detect(cloud, config, board)
        assert found.candidates, found.reason
        plane = found.candidates[0].geometry
        assert isinstance(plane, PlaneGeometry)
        assert plane.normal @ T_s_t[:3, 2] > np.cos(np.radians(0.5))
        assert abs(plane.normal @ T_s_t[:3, 3] + plane.d) < 0.005


@pytest.mark.parametrize("pattern", ["multibeam", "depth"])
def test_noise_that_grows_with_the_range_is_whitened(pattern: str, board: Target) -> None:
    """chi-square of the residual at the truth over boards near and far; 3 rows each."""
    config = Lrf3dConfig.model_validate(
        {"scan": {"pattern": "depth_camera", "width_px": 96, "height_px": 72, "focal_px": 87}}
        if pattern == "depth"
        else {"scan": {"pattern": "multibeam", "elevations_deg": list(range(-20, 21, 2))}}
    )
    noise = {"sigma_m": 0.002, "sigma_per_m": 0.004, "sigma_per_m2": 0.002}
    config = config.model_copy(update=noise)
    chi2, errors = [], []
    for k, T_s_t in enumerate(poses(150, 7)):
        T_s_t[:3, 3] *= 1 + k % 3 / 2
        candidate = observe(T_s_t, config, board, np.random.default_rng(k))
        assert candidate is not None
        r, _ = LRF3D.residual(candidate, config, board)(T_s_t)  # type: ignore[misc]
        chi2.append(float(r @ r))
        e = LRF3D.errors(candidate, config, board, T_s_t)  # type: ignore[misc]
        measured = np.linalg.norm(np.asarray(candidate.measurement["points"]), axis=1)
        errors.append(e / config.noise.of(measured - e))
    assert np.mean(chi2) == pytest.approx(3.0, abs=4 * np.sqrt(6 / 150))
    assert np.std(np.concatenate(errors)) == pytest.approx(1.0, abs=0.01)
