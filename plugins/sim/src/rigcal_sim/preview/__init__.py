"""Pictures of a simulated recording: the rig among its boards, and what every sensor saw."""

from rigcal_sim.preview.write import write_preview

__all__ = ["write_preview"]
