"""Which of many exposures make the sensors known best, and how well they are known then.

An exposure adds its information to that of the others. Poses are chosen one after the other, each
as the one that shrinks the worst standard deviation most beside those before it (greedy
augmentation of an experiment's design: V. V. Fedorov, Theory of Optimal Experiments, 1972, ch. 3).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rigcal.diagnosis.observability import OPEN, WEAK
from rigcal.geometry.se3 import Array
from rigcal.planning.result import Sigma

# In units of what is weak: what is known of a direction beforehand, in effect nothing.
_UNKNOWN = 100.0
# The worst is the norm of this order over the variances: near the maximum, but with a slope where
# several sensors are equally open and no single exposure joins them all.
_ORDER = 4
# An exposure fixes a pose if its least known direction is known to this share of the best.
_FIRM = 1e-6


@dataclass(frozen=True, eq=False)
class Judge:
    """Judges information (..., 6 S + Q, 6 S + Q) of the poses of all `sensors` and of Q numbers in
    units, the poses of those named in `fixed` being known.

    `judged` sensors count for what is worst.
    """

    sensors: tuple[str, ...]
    fixed: frozenset[str]
    judged: frozenset[str]

    @property
    def free(self) -> tuple[str, ...]:
        """The sensors that are not fixed."""
        return tuple(s for s in self.sensors if s not in self.fixed)

    def sigmas(self, information: Array) -> dict[str, Sigma]:
        """How well each free sensor is known as seen from the fixed ones."""
        variances = self._variances(information)
        is_open = (variances > (OPEN / WEAK) ** 2).reshape(-1, 2, 3).any(axis=2)
        unit = np.array([WEAK[0], WEAK[3]])
        sizes = np.where(is_open, np.inf, np.sqrt(_parts(variances)) * unit)
        return {s: Sigma(float(t), float(r)) for s, (r, t) in zip(self.free, sizes, strict=True)}

    def badness(self, information: Array) -> Array:
        """(...,) how large the worst sigma of the judged sensors is, in units of what is weak."""
        own = np.array([s in self.judged for s in self.free], dtype=bool)
        parts = _parts(self._variances(information))[..., own, :]
        result: Array = np.sum(parts**_ORDER, axis=(-1, -2)) ** (0.5 / _ORDER)
        return result

    def _variances(self, information: Array) -> Array:
        """(..., S, 6) of the free sensors, in units of what is weak."""
        numbers, poses = information.shape[-1] - 6 * len(self.sensors), 6 * len(self.free)
        kept = np.repeat([s not in self.fixed for s in self.sensors], 6)
        kept = np.append(kept, np.ones(numbers, dtype=bool))
        unit = np.append(np.tile(WEAK, len(self.free)), np.ones(numbers))
        own = information[..., kept, :][..., kept] * np.outer(unit, unit)
        inverse = np.linalg.inv(own + np.eye(len(unit)) / _UNKNOWN**2)
        variances = np.diagonal(inverse, axis1=-2, axis2=-1)[..., :poses]
        result: Array = variances.reshape(*variances.shape[:-1], len(self.free), 6)
        return result


def best(judge: Judge, known: Array, offered: Array) -> int:
    """Which of the exposures offered (K, n, n) is best beside what is `known` (n, n)."""
    return int(np.argmin(judge.badness(known + offered)))


def firm(judge: Judge, exposure: Array) -> set[str]:
    """The sensors whose pose the information (n, n) of one exposure fixes to the others in it."""
    found = set()
    for i, name in enumerate(judge.sensors):
        own = exposure[6 * i : 6 * i + 6, 6 * i : 6 * i + 6] * np.outer(WEAK, WEAK)
        values = np.linalg.eigvalsh(own)
        if values[0] > _FIRM * max(values[-1], 1e-300):
            found.add(name)
    return found


def typical(judge: Judge, draws: Sequence[Array]) -> dict[str, Sigma]:
    """The median of each sigma over the information (n, n) of several recordings."""
    found = [judge.sigmas(information) for information in draws]
    return {
        s: Sigma(
            float(np.median([f[s].translation_m for f in found])),
            float(np.median([f[s].rotation_rad for f in found])),
        )
        for s in judge.free
    }


def _parts(variances: Array) -> Array:
    """(..., S, 2) of rotation and translation, the three axes of each summed."""
    result: Array = variances.reshape(*variances.shape[:-1], 2, 3).sum(axis=-1)
    return result
