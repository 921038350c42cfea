"""Which global estimate is made of the observations."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

from rigcal.errors import ConfigError

Formulation = Literal["joint", "msgcal"]
Initial = Literal["tree", "identity"]


@dataclass(frozen=True)
class Method:
    """How the sensors' poses are estimated; ConfigError for a word that is not one of these.

    formulation  "joint": maximum likelihood over all measurements; "msgcal": the graph of MSG-Cal
                 (IROS 2015), over observed geometry
    filtered     whether outliers are left out. If not, the best-ranked candidate of every
                 observation is used
    initial      start of the sensors: the spanning tree of the pairs, or all of them at the root
    accept_weak  whether a result is given in which the data leave an axis of a sensor open
    """

    formulation: Formulation = "joint"
    filtered: bool = True
    initial: Initial = "tree"
    accept_weak: bool = False

    def __post_init__(self) -> None:
        for name, words in (("formulation", Formulation), ("initial", Initial)):
            value = getattr(self, name)
            if value not in get_args(words):
                known = " or ".join(get_args(words))
                raise ConfigError(f"{name} '{value}' is unknown, expected {known}")
