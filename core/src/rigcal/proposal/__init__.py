"""A first rig.yaml from a recording and the files of other tools."""

from rigcal.proposal.propose import propose_rig

__all__ = ["propose_rig"]
