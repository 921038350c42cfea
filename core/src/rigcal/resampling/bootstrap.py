"""How much the result scatters when exposures are drawn anew from those that were recorded."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from rigcal.diagnosis.observability import leaves_open
from rigcal.errors import CalibrationError, ConfigError
from rigcal.estimation import prepare, solved
from rigcal.geometry import se3
from rigcal.geometry.se3 import Array
from rigcal.graph import joint
from rigcal.graph.edge import SensorTargetEdge
from rigcal.graph.information import SensorInformation
from rigcal.graph.method import Method
from rigcal.graph.solve import Solution
from rigcal.graph.stack import poses_of
from rigcal.observation import Observation
from rigcal.plugin.registry import Registry
from rigcal.progress import Progress
from rigcal.rig import Rig

_LEAST_DRAWS = 20


@dataclass(frozen=True, eq=False)
class Scatter:
    """Covariances (6, 6) of a sensor's pose in the root, over [rotation rad, translation m].

    `covariance` by the scatter over draws, `reported` by the noise of the measurements; right
    perturbation, in the sensor's frame.
    """

    covariance: Array
    reported: Array


@dataclass(frozen=True)
class Bootstrap:
    """Scatter per sensor over `draws`; `failed` more had no answer."""

    sensors: Mapping[str, Scatter]
    draws: int
    failed: int


def bootstrap(
    rig: Rig,
    registry: Registry,
    observations: Sequence[Observation],
    draws: int = 100,
    seed: int = 0,
    progress: Progress | None = None,
) -> Bootstrap:
    """The joint estimate of as many exposures as were used, drawn from them with replacement.

    (B. Efron, Bootstrap methods: another look at the jackknife, 1979.) It sees what the residuals
    of single measurements do not tell: errors that all measurements of an exposure share, such as a
    board that bends or moves. Inliers, noise and first poses are those of the calibration of all.
    ConfigError for fewer than 20 draws; errors as of `calibrate`, and CalibrationError if less than
    half of the draws have an answer.
    """
    if draws < _LEAST_DRAWS:
        raise ConfigError(f"{draws} draws tell no scatter; expected {_LEAST_DRAWS} or more")
    tell = progress or (lambda *_: None)
    tell("bootstrap", 0, draws)
    stages = prepare(rig, registry, observations, seed)
    estimate, _ = solved(stages, Method())
    full = estimate.solution
    by_exposure: dict[str, list[SensorTargetEdge]] = {}
    for e in full.edges:
        by_exposure.setdefault(e.exposure, []).append(e)
    rng, poses = np.random.default_rng(seed), list[dict[str, Array]]()
    for draw in range(draws):
        chosen = rng.choice(list(by_exposure), len(by_exposure))
        found = _drawn(full, [by_exposure[str(name)] for name in chosen], stages.fixed)
        poses += [found] if found else []
        tell("bootstrap", draw + 1, draws)
    if 2 * len(poses) < draws:
        raise CalibrationError(
            f"{draws - len(poses)} of {draws} draws from the {len(by_exposure)} exposures leave "
            "the rig undetermined: too much rests on single exposures; record more"
        )
    sensors = {
        s: Scatter(
            _scatter(np.stack([p[s] for p in poses]), full.sensors[s]),
            full.information.covariance_of(s),
        )
        for s in full.information.sensors
    }
    return Bootstrap(sensors, len(poses), draws - len(poses))


def _drawn(
    full: Solution, drawn: Sequence[Sequence[SensorTargetEdge]], fixed: frozenset[str]
) -> dict[str, Array] | None:
    """The sensors' poses; None if a sensor was not drawn, or if they leave a pose open.

    An axis that nothing tells stays where it was, and would make the scatter too small.
    """
    edges, boards = [], {}
    for i, own in enumerate(drawn):
        # An exposure that is drawn twice is two, each with a board of its own.
        name = f"{i}: {own[0].exposure}"
        boards[name] = full.targets[own[0].exposure]
        edges += [replace(e, exposure=name) for e in own]
    if {e.sensor for e in edges} != {e.sensor for e in full.edges}:
        return None
    try:
        found = joint.solve(edges, full.sensors, boards, fixed, full.numbers)
    except CalibrationError:
        return None
    told = SensorInformation(edges, found.sensors, list(boards), fixed, found.numbers)
    matrix, _ = told.at(poses_of(found.targets))
    free = sum(s not in fixed for s in found.sensors)
    return None if leaves_open(matrix, free, len(found.numbers)) else found.sensors


def _scatter(T: Array, center: Array) -> Array:
    """(6, 6) covariance of poses (N, 4, 4) about their mean."""
    covariance: Array = np.cov(se3.log(se3.inverse(center) @ T), rowvar=False)
    return covariance
