"""How many exposures, and which board poses next."""

from rigcal.planning.plan import EXPOSURES, plan
from rigcal.planning.result import Plan, Proposal, Sigma

__all__ = ["EXPOSURES", "Plan", "Proposal", "Sigma", "plan"]
