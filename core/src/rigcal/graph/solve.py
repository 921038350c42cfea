"""From chosen candidates to the final estimate: robust stage, noise scale, chi-square inliers."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rigcal.geometry.se3 import Array
from rigcal.graph import joint
from rigcal.graph.edge import SensorTargetEdge
from rigcal.graph.information import EdgeFit, Information, information
from rigcal.graph.numbers import NO_NUMBERS, Numbers, check_determined
from rigcal.graph.stack import EdgeStack, poses_of
from rigcal.progress import Progress

# A true observation falls outside with this probability.
_SIGNIFICANCE = 1e-4
_BLOCK_SIGMAS = 5.0
_MOST_ROUNDS = 6
# Below so many redundant rows a sensor's noise cannot be told from its configured value.
_ENOUGH_ROWS = 20.0
# Real noise is seldom below this share of the configured one.
_WIDE_OPEN = 10.0
TURN_IS_OPEN = (
    "no sensor that counts here tells how the board is turned in its own plane, and so which way "
    "it is bent; record it where a sensor that identifies the print (a camera) sees it too, or "
    "take `bend` out of the target's `refine`"
)


@dataclass(frozen=True, eq=False)
class Solution:
    """Poses in the root, the edges that count and their statistics; reasons for those dropped.

    `scales` is the estimated over the configured noise per sensor. `numbers` is what was refined
    beside the poses.
    """

    sensors: Mapping[str, Array]
    targets: Mapping[str, Array]
    edges: tuple[SensorTargetEdge, ...]
    information: Information
    dropped: Mapping[tuple[str, str], str]
    scales: Mapping[str, float]
    numbers: Numbers = NO_NUMBERS


def estimate(
    edges: Sequence[SensorTargetEdge],
    sensors: Mapping[str, Array],
    targets: Mapping[str, Array],
    fixed: frozenset[str],
    progress: Progress | None = None,
    *,
    estimate_noise: bool = True,
    reject: bool = True,
    anchored: bool = False,
    numbers: Numbers = NO_NUMBERS,
) -> Solution:
    """Maximum likelihood on the inliers.

    A robust stage (Huber) first; then rounds of: the noise of every sensor from its residuals, a
    chi-square test of every edge and block, a solution on what remains, until that stays the same.
    With `estimate_noise` false the configured noise weighs the edges, and the estimated one is
    only reported. Without `reject` no edge is tested, masked or weighed down for being far off.
    With `anchored`, sensors stay near their first poses in directions that are open.
    `numbers` are held in a first robust solution and free from then on.
    NotConvergedError if a solution is not reached; NotDeterminedError if the data leave numbers
    open.
    """
    tell = progress or (lambda *_: None)
    tell("global estimate", 0, _MOST_ROUNDS + 1)
    first = joint.solve_robust if reject else joint.solve
    anchor = sensors if anchored else None
    poses, boards, _ = first(edges, sensors, targets, fixed, anchor=anchor)
    if len(numbers):
        # What is wide open, at the configured noise, would lead the solution astray.
        info = information(edges, poses, boards, fixed, numbers=numbers)
        check_determined(numbers, info.covariance_of_numbers, _WIDE_OPEN)
        poses, boards, numbers = first(edges, poses, boards, fixed, numbers, anchor)
    info = information(edges, poses, boards, fixed, numbers=numbers)
    alive, dropped, scales = list(edges), dict[tuple[str, str], str](), _scales(info.fits, {})
    for round_ in range(_MOST_ROUNDS):
        tell("global estimate", round_ + 1, _MOST_ROUNDS + 1)
        before = _signature(alive)
        weights = scales if estimate_noise else dict.fromkeys(scales, 1.0)
        judged = {(e.sensor, e.exposure) for e in edges}
        if reject:
            alive, refused = _inliers(edges, alive, poses, boards, fixed, weights, numbers)
        else:
            alive, refused = [replace(e, scale=weights[e.sensor]) for e in edges], {}
        # Exposures that lost all their edges in an earlier round keep the reason given then.
        dropped = {name: why for name, why in dropped.items() if name not in judged} | refused
        used = {e.exposure for e in alive}
        boards = {k: T for k, T in boards.items() if k in used}
        edges = [e for e in edges if e.exposure in used]
        poses, boards, numbers = joint.solve(alive, poses, boards, fixed, numbers, anchor)
        info = information(alive, poses, boards, fixed, numbers=numbers)
        scales = _scales(info.fits, scales)
        settled = not estimate_noise or all(
            abs(scales[e.sensor] / e.scale - 1) < 0.01 for e in alive
        )
        if _signature(alive) == before and settled:
            break
    tell("global estimate", _MOST_ROUNDS + 1, _MOST_ROUNDS + 1)
    check_determined(numbers, info.covariance_of_numbers)
    return Solution(poses, boards, tuple(alive), info, dropped, scales, numbers)


def _signature(edges: Sequence[SensorTargetEdge]) -> set[tuple[str, str, bytes]]:
    return {
        (e.sensor, e.exposure, b"" if e.keep is None or e.keep.all() else e.keep.tobytes())
        for e in edges
    }


def _scales(fits: Sequence[EdgeFit], before: Mapping[str, float]) -> dict[str, float]:
    """Noise over configured noise, per sensor.

    Each edge's residual splits into what its own freedom cannot explain (the scatter of pixels or
    beams) and its disagreement with the other sensors. Both have the same scale when the noise is
    as modelled. Where they disagree more than they scatter (lens models, biased ranges, motion)
    the larger counts: it is what the estimate rests on. Robust when `before` is empty.
    """
    result, by_sensor = dict(before), dict[str, list[EdgeFit]]()
    for fit in fits:
        by_sensor.setdefault(fit.edge.sensor, []).append(fit)
    for sensor, own in by_sensor.items():
        square = np.array([f.edge.scale**2 for f in own])
        inner = square * [f.chi2 - f.misfit for f in own]
        outer = square * [f.misfit for f in own]
        inner_dof = np.array([float(f.edge.rows - f.misfit_dof) for f in own])
        outer_dof = np.array([max(f.misfit_dof - f.leverage, 0.0) for f in own])
        estimator = _mean_scale if before else _median_scale
        result[sensor] = _larger_scale(estimator, inner, inner_dof, outer, outer_dof)
    return result


def _larger_scale(
    estimator: Callable[[Array, Array], float],
    inner: Array,
    inner_dof: Array,
    outer: Array,
    outer_dof: Array,
) -> float:
    """The pooled scale, or that of the disagreement where an F-test says that it is larger."""
    from scipy.stats import f as law

    if inner_dof.sum() + outer_dof.sum() < _ENOUGH_ROWS:
        return 1.0
    if outer_dof.sum() < _ENOUGH_ROWS:
        return max(estimator(inner, inner_dof), 1e-3)
    if inner_dof.sum() < _ENOUGH_ROWS:
        return max(estimator(outer, outer_dof), 1e-3)
    ratio = (estimator(outer, outer_dof) / max(estimator(inner, inner_dof), 1e-3)) ** 2
    if ratio > law.isf(1e-3, outer_dof.sum(), inner_dof.sum()):
        return max(estimator(outer, outer_dof), 1e-3)
    pooled = (inner.sum() + outer.sum()) / (inner_dof.sum() + outer_dof.sum())
    return max(float(np.sqrt(pooled)), 1e-3)


def _mean_scale(chi2: Array, dof: Array) -> float:
    return float(np.sqrt(chi2.sum() / dof.sum()))


def _median_scale(chi2: Array, dof: Array) -> float:
    """The scale at which half of the edges lie below the median of their chi-square law."""
    from scipy.stats import chi2 as law

    enough = dof > min(0.3, float(np.median(dof)))
    return float(np.sqrt(np.median(chi2[enough] / law.median(dof[enough]))))


def _inliers(
    edges: Sequence[SensorTargetEdge],
    alive: Sequence[SensorTargetEdge],
    sensors: Mapping[str, Array],
    targets: Mapping[str, Array],
    fixed: frozenset[str],
    scales: Mapping[str, float],
    numbers: Numbers,
) -> tuple[list[SensorTargetEdge], dict[tuple[str, str], str]]:
    """The edges that pass, with their outlier blocks masked, and why the others do not.

    All edges are judged again at the present solution, which rests on those `alive`, so that a
    good one can come back.
    """
    from scipy.stats import chi2 as law

    rescaled = [replace(e, scale=scales[e.sensor]) for e in edges]
    masked = _masked(rescaled, sensors, targets, numbers)
    kept, dropped = [], {}
    names = {(e.sensor, e.exposure) for e in alive}
    used = [e for e in masked if (e.sensor, e.exposure) in names]
    others = [e for e in masked if (e.sensor, e.exposure) not in names]
    limits = np.asarray(law.isf(_SIGNIFICANCE, np.arange(7)))
    for fit in information(used, sensors, targets, fixed, others, numbers).fits:
        edge, name = fit.edge, (fit.edge.sensor, fit.edge.exposure)
        blocks = 1.0 if edge.keep is None else float(edge.keep.mean())
        limit = float(limits[max(fit.misfit_dof, 1)])
        if blocks < 0.5:
            dropped[name] = f"{100 * (1 - blocks):.0f} % of its measurements are outliers"
        elif fit.misfit > limit:
            dropped[name] = (
                "disagrees with the other sensors: chi-square "
                f"{fit.misfit:.1f} > {limit:.1f} ({fit.misfit_dof} degrees of freedom)"
            )
        else:
            kept.append(edge)
    count = Counter(e.exposure for e in kept)
    turned = {e.exposure for e in kept if e.in_plane or e.sensor not in numbers.bent}
    for edge in kept:
        if count[edge.exposure] < 2:
            dropped[edge.sensor, edge.exposure] = "no other sensor's data is left in this exposure"
        elif edge.exposure not in turned:
            dropped[edge.sensor, edge.exposure] = TURN_IS_OPEN
    return [e for e in kept if (e.sensor, e.exposure) not in dropped], dropped


def _masked(
    edges: Sequence[SensorTargetEdge],
    sensors: Mapping[str, Array],
    targets: Mapping[str, Array],
    numbers: Numbers,
) -> list[SensorTargetEdge]:
    """Masks blocks beyond `_BLOCK_SIGMAS` in edges of many; one of few stands or falls whole."""
    plain = [replace(e, keep=None) for e in edges]
    stack = EdgeStack(plain, list(sensors), list(targets), numbers)
    sizes = stack.sizes(stack.relative(poses_of(sensors), poses_of(targets)), numbers)
    result = []
    for edge, size in zip(plain, sizes, strict=True):
        keep: NDArray[np.bool_] = size < _BLOCK_SIGMAS
        whole = len(size) < 4 or bool(keep.all())
        result.append(edge if whole else replace(edge, keep=keep))
    return result
