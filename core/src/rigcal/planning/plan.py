"""Predicted uncertainty, and the board poses that a recording lacks most."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from rigcal.belonging import check_calibration, check_observations
from rigcal.calibration import Calibration
from rigcal.errors import ConfigError
from rigcal.geometry.se3 import Array
from rigcal.graph.stages import given_poses
from rigcal.observation import Observation
from rigcal.planning.candidates import BoardPose, draw_candidates, vary
from rigcal.planning.choice import Judge, best, firm, typical
from rigcal.planning.gain import Pool, weigh
from rigcal.planning.joining import Joining
from rigcal.planning.recorded import Recorded, nothing_recorded, recorded
from rigcal.planning.result import Plan, Proposal
from rigcal.planning.site import Site, can_be_planned
from rigcal.planning.words import describe
from rigcal.plugin.registry import Registry
from rigcal.progress import Progress
from rigcal.rig import Rig

EXPOSURES = (10, 20, 40, 80)
# Candidates for all sensors alike, and as many again for those that are known least.
_CANDIDATES = 80
_LEAST_KNOWN = 0.5
_BATCH = 16
_DRAWS = 25
_PROPOSALS = 5
# The best candidate is varied, so often and in so many ways.
_ROUNDS, _VARIATIONS = 2, 8


def plan(
    rig: Rig,
    registry: Registry,
    observations: Sequence[Observation] | None = None,
    calibration: Calibration | None = None,
    exposures: Sequence[int] = EXPOSURES,
    seed: int = 0,
    progress: Progress | None = None,
) -> Plan:
    """How well the sensors will be known, and where to show the board next.

    Without observations: the standard deviations to expect of recordings of so many `exposures`,
    with board poses spread over the views of all sensors. With them: what they tell so far, and the
    five board poses that shrink the worst standard deviation most, chosen greedily so that they are
    good together; where nothing links all sensors, first those that join them.

    Poses of the sensors are those of `calibration`, or `pose` in the rig file; observations are
    calibrated first, and go before them. Of sensor types that simulate, residuals at simulated
    observations say what a board pose would tell; others are named in `Plan.unplanned`. Numbers
    that the rig asks to refine are unknown beside the poses. ConfigError for sensors whose pose
    nothing tells, for a calibration of another rig, and if no two sensors see a board at a common
    place; other errors as of `calibrate`. The same input and seed give the same plan.
    """
    if calibration is not None:
        check_calibration(rig, calibration)
    check_observations(rig, observations or ())
    if observations is None:
        so_far = nothing_recorded(rig, registry, calibration)
    else:
        so_far = recorded(rig, registry, observations, calibration, seed, progress)
    site = Site.of(rig, registry, so_far.T_root_s, so_far.boards)
    rng = np.random.default_rng(seed)
    pool = _pool(site, so_far, rng, progress or (lambda *_: None))
    planned = frozenset(s for pose in pool.poses for s in pose.seen_by)
    judge = _judge(rig, so_far, planned)
    if not judge.judged:
        raise ConfigError(
            f"the poses of all sensors that can be planned for ({', '.join(sorted(planned))}) are "
            "given: take `fixed` out of the rig file for what is to be calibrated"
        )
    predicted, examples = {}, so_far.boards
    if observations is None:
        known = so_far.information
        draws = [rng.permutation(len(pool.poses)) for _ in range(_DRAWS)]
        predicted = {
            n: typical(judge, [known + _of_recording(pool, draw, n) for draw in draws])
            for n in exposures
        }
        shown = [pool.poses[i] for i in draws[0][: min(exposures)]]
        examples = tuple((pose.target, pose.T_root_t) for pose in shown)
    return Plan(
        reference=rig.root if rig.root in judge.fixed else min(judge.fixed),
        T_root_s=so_far.T_root_s,
        predicted=predicted,
        recorded=None if observations is None else judge.sigmas(so_far.information),
        proposals=() if observations is None else _proposals(site, pool, judge, so_far, rng),
        boards=examples,
        unjoined=tuple(s for s in rig.sensors if any(s in group for group in so_far.loose)),
        unplanned=_unplanned(site, planned),
        up=site.up,
    )


def _pool(site: Site, so_far: Recorded, rng: np.random.Generator, tell: Progress) -> Pool:
    """Board poses to choose from, weighed; ConfigError if there are none."""
    poses = draw_candidates(site, _counts(site, so_far), rng)
    parts = []
    for start in range(0, len(poses), _BATCH):
        tell("board poses", start, len(poses))
        parts.append(weigh(site, poses[start : start + _BATCH], so_far.numbers, so_far.scales, rng))
    tell("board poses", len(poses), len(poses))
    kept = tuple(pose for part in parts for pose in part.poses)
    if not kept:
        raise ConfigError(
            f"no two sensors of rig '{site.rig.name}' see the board at a common place: check the "
            "poses of its sensors and the size of the board"
        )
    return Pool(kept, np.concatenate([part.information for part in parts]))


def _counts(site: Site, so_far: Recorded) -> dict[str, int]:
    """How many candidates are drawn in the view of each sensor that can be planned for."""
    _, fixed = given_poses(site.rig)
    names = [s for s in site.rig.sensors if can_be_planned(site.kinds[s])]
    sigmas = Judge(tuple(site.rig.sensors), fixed, frozenset()).sigmas(so_far.information)
    sizes = {s: sigmas[s].size for s in names if s in sigmas}
    most = max(sizes.values(), default=0.0)
    least = [s for s in sizes if sizes[s] >= _LEAST_KNOWN * most] or names
    share = {s: _CANDIDATES // len(least) * (s in least) for s in names}
    return {s: -(-_CANDIDATES // len(names)) + share[s] for s in names}


def _judge(rig: Rig, so_far: Recorded, planned: frozenset[str]) -> Judge:
    """Sensors are judged from the root and what is fixed to it, if any of those can be planned for
    or has been recorded; else from the first sensor that can.
    """
    _, fixed = given_poses(rig)
    at = {s: i for i, s in enumerate(rig.sensors)}
    told = {s for s in fixed if so_far.information[6 * at[s] : 6 * at[s] + 6].any()}
    if not fixed & planned and not told:
        fixed = frozenset({next(s for s in rig.sensors if s in planned)})
    return Judge(tuple(rig.sensors), fixed, planned - fixed)


def _of_recording(pool: Pool, order: NDArray[np.int64], exposures: int) -> Array:
    """Information (n, n) of the first exposures in an order; once through, all over again."""
    rounds, rest = divmod(exposures, len(pool.poses))
    total = pool.information[order[:rest]].sum(axis=0)
    result: Array = total + rounds * pool.information.sum(axis=0)
    return result


def _proposals(
    site: Site, pool: Pool, judge: Judge, so_far: Recorded, rng: np.random.Generator
) -> tuple[Proposal, ...]:
    loose = {s for group in so_far.loose for s in group}
    joining = Joining(so_far.T_root_s.keys() - loose, so_far.loose)
    known, taken, proposals = so_far.information, set[int](), list[Proposal]()
    for _ in range(min(_PROPOSALS, len(pool.poses))):
        left = [i for i in range(len(pool.poses)) if i not in taken]
        left = [i for i in left if joining.is_wanted(pool.poses[i])] or left
        i = left[best(judge, known, pool.information[left])]
        taken.add(i)
        start = Pool((pool.poses[i],), pool.information[i : i + 1])
        pose, gain = _varied(site, start, known, judge, joining, so_far, rng)
        joining.add(pose, firm(judge, gain))
        known = known + gain
        proposals.append(
            Proposal(
                pose.target, pose.T_root_t, pose.seen_by, describe(site, pose), judge.sigmas(known)
            )
        )
    return tuple(proposals)


def _varied(
    site: Site,
    start: Pool,
    known: Array,
    judge: Judge,
    joining: Joining,
    so_far: Recorded,
    rng: np.random.Generator,
) -> tuple[BoardPose, Array]:
    """The best of a pose and others like it, and its gain; what joins is varied into what does."""
    (pose,), (gain,) = start.poses, start.information
    must = joining.is_wanted(pose)
    for _ in range(_ROUNDS):
        like = vary(site, pose, _VARIATIONS, rng)
        near = weigh(site, like, so_far.numbers, so_far.scales, rng)
        kept = [k for k, other in enumerate(near.poses) if not must or joining.is_wanted(other)]
        poses = (pose, *(near.poses[k] for k in kept))
        gains = np.concatenate([gain[None], near.information[kept]])
        i = best(judge, known, gains)
        pose, gain = poses[i], gains[i]
    return pose, gain


def _unplanned(site: Site, planned: frozenset[str]) -> dict[str, str]:
    """Why no board pose is planned for a sensor."""
    reasons = {}
    for name, config in site.rig.sensors.items():
        if not can_be_planned(site.kinds[name]):
            reasons[name] = f"its type '{config.type}' does not simulate what it would see"
        elif name not in planned:
            reasons[name] = "no board pose was found that it sees together with another sensor"
    return reasons
