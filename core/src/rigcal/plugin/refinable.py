"""Numbers of a sensor that the data may refine together with the poses."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Protocol, Self

from rigcal.geometry.se3 import Array


@dataclass(frozen=True, eq=False)
class Parameters:
    """P numbers under one name, where they start, and how well they must become known.

    names        (P,) of each, as its maker's papers call it: "fx"
    units        (P,) "px"; "" for a pure number
    values       (P,) where the estimate starts
    effect       (M, P) what a change of each does to measurements at M places all over the sensor's
                 view, in shares of what would be too much. The numbers count as determined if no
                 entry of `effect @ error` has a standard deviation above 1
    tolerable    what one share is, in words: "1 % of the image's width anywhere in the image"
    advice       what to record, or to ask for, when the data leave them open
    prior_sigma  (P,) standard deviations known beforehand (inf: none); None: nothing is known
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    values: Array
    effect: Array
    tolerable: str
    advice: str
    prior_sigma: Array | None = None


@dataclass(frozen=True)
class Refinable:
    """One name that `refine:` of a sensor may list.

    parameters  (config) -> Parameters
    apply       (config, values (P,)) -> the config with these values, for `errors`
    """

    parameters: Callable[[Any], Parameters]
    apply: Callable[[Any, Array], Any]


Refined = Callable[[Array, Array], tuple[Array, Array, Array]]
"""K residuals as one function of poses and numbers: `T_s_t` (K, 4, 4), values (P,) -> r (N,),
J (N, 6) and the derivative by the values (N, P)."""


class RefinableResidual(Protocol):
    """A residual that depends on what `refine` of its sensor's config asks for.

    The type's `residual` is given that config, so it can make another kind of residual, with more
    rows, than without `refine`. Called with a pose alone, the numbers are where they start. A
    residual without `refined` does not depend on the numbers.
    """

    @classmethod
    def refined(cls, residuals: Sequence[Self]) -> Refined:
        """One function for residuals of one sensor; values in the order of `config.refine`, then
        the three of the target's bend where its config asks for that.
        """
        ...
