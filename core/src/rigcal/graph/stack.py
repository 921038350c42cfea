"""All edges of a graph evaluated together: one block of normal equations per edge."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rigcal.geometry import se3
from rigcal.geometry.se3 import Array
from rigcal.graph.edge import SensorTargetEdge
from rigcal.graph.family import Family
from rigcal.graph.numbers import NO_NUMBERS, Numbers

Index = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Blocks:
    """Normal equations of E edges, each in its own `T_s_t` (right perturbation) and all Q numbers.

    H (E, 6 + Q, 6 + Q) = J^T J, g (E, 6 + Q) = J^T r, and chi2 (E,) = r^T r or the robust loss.
    """

    H: Array
    g: Array
    chi2: Array


class EdgeStack:
    """Edges between `sensors` and `exposures`; `sensor` and `exposure` (E,) number their ends.

    The order of the edges is kept everywhere; what is evaluated by one call is a `Family`. Methods
    take the `numbers` at their present values, laid out as those it was made with.
    """

    def __init__(
        self,
        edges: Sequence[SensorTargetEdge],
        sensors: Sequence[str],
        exposures: Sequence[str],
        numbers: Numbers = NO_NUMBERS,
    ) -> None:
        at_s = {name: i for i, name in enumerate(sensors)}
        at_t = {name: i for i, name in enumerate(exposures)}
        self.sensor: Index = np.array([at_s[e.sensor] for e in edges], dtype=np.int64)
        self.exposure: Index = np.array([at_t[e.exposure] for e in edges], dtype=np.int64)
        members: dict[tuple[str, type, int], list[int]] = {}
        for i, e in enumerate(edges):
            members.setdefault((e.sensor, type(e.residual), e.residual.block), []).append(i)
        self._families = [
            (np.array(own), entries, Family([edges[i] for i in own], len(entries)))
            for (sensor, _, _), own in members.items()
            for entries in [numbers.of(sensor)]
        ]
        self._scale = np.array([numbers.scaled.get(e.sensor, -1) for e in edges], dtype=np.int64)

    def relative(self, T_root_s: Array, T_root_t: Array) -> Array:
        """`T_s_t` (E, 4, 4) from the poses of all sensors (S, 4, 4) and exposures (K, 4, 4)."""
        result: Array = se3.inverse(T_root_s)[self.sensor] @ T_root_t[self.exposure]
        return result

    def blocks(
        self, T_s_t: Array, huber_k: float = np.inf, numbers: Numbers = NO_NUMBERS
    ) -> Blocks:
        """Normal equations at `T_s_t` (E, 4, 4), with Huber's loss beyond `huber_k` sigmas.

        PluginError names sensor and exposure if a residual breaks its contract.
        """
        seen, count = self._seen(T_s_t, numbers), len(numbers)
        total = np.zeros((len(self.sensor), 7 + count, 7 + count))
        for own, entries, family in self._families:
            part = family.normal_equations(seen[own], numbers.values[entries], huber_k)
            place = [*range(6), *(6 + i for i in entries), 6 + count]
            total[np.ix_(own, place, place)] = part
        if count:
            unit = np.concatenate([np.ones(6), numbers.unit, np.ones(1)])
            total = _scaled(total * np.outer(unit, unit), T_s_t, self._scale, numbers)
        return Blocks(total[:, :-1, :-1], total[:, :-1, -1], total[:, -1, -1])

    def sizes(self, T_s_t: Array, numbers: Numbers = NO_NUMBERS) -> list[Array]:
        """Per edge, the rms (blocks,) of every block of rows, in sigmas."""
        seen = self._seen(T_s_t, numbers)
        result: list[Array] = [np.empty(0)] * len(self.sensor)
        for own, entries, family in self._families:
            sizes = family.sizes(seen[own], numbers.values[entries])
            for i, size in zip(own, sizes, strict=True):
                result[i] = size
        return result

    def check(self, T_s_t: Array, numbers: Numbers = NO_NUMBERS) -> None:
        """PluginError if a residual is not finite at `T_s_t`."""
        seen = self._seen(T_s_t, numbers)
        for own, entries, family in self._families:
            family.check(seen[own], numbers.values[entries])

    def _seen(self, T_s_t: Array, numbers: Numbers) -> Array:
        """The poses at which the residuals, made for targets of nominal size, are evaluated."""
        if not numbers.scaled:
            return T_s_t
        seen = T_s_t.copy()
        for own, _, family in self._families:
            seen[own] = numbers.seen(family.sensor, T_s_t[own])
        return seen


def _scaled(total: Array, T_s_t: Array, scale: Index, numbers: Numbers) -> Array:
    """Normal equations in what was seen, chained to the true `T_s_t` and the target's scale.

    With t the translation: `d(t / s) = R v / s - t ds / s^2`, in the target's axes
    `v / s - R^T t ds / s^2`.
    """
    own = np.flatnonzero(scale >= 0)
    s, entry = numbers.values[scale[own]], 6 + scale[own]
    chain = np.tile(np.eye(total.shape[1]), (len(own), 1, 1))
    chain[:, [3, 4, 5], [3, 4, 5]] = 1 / s[:, None]
    t_t = np.einsum("eji,ej->ei", T_s_t[own, :3, :3], T_s_t[own, :3, 3])
    ds = numbers.unit[scale[own]] / s**2
    chain[np.arange(len(own))[:, None], [[3, 4, 5]], entry[:, None]] = -t_t * ds[:, None]
    total[own] = np.swapaxes(chain, 1, 2) @ total[own] @ chain
    return total


def poses_of(poses: Mapping[str, Array]) -> Array:
    """(N, 4, 4) poses by name as one array."""
    return np.array(list(poses.values())).reshape(-1, 4, 4)
