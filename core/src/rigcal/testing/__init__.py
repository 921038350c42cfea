"""For authors of plugins: the conformance kit, and strategies for hypothesis.

Needs pytest and hypothesis: `pip install rigcal[testing]`.
"""

import pytest

# Before they are imported: failed assertions show their values.
_CHECKS = ("config", "estimate", "message", "refine", "residual", "simulator", "stillness")
pytest.register_assert_rewrite(
    *(f"rigcal.testing.{part}_checks" for part in _CHECKS),
    *(f"rigcal.testing.{part}" for part in ("conformance", "same", "stage", "statistics")),
)

from rigcal.testing import strategies  # noqa: E402
from rigcal.testing.conformance import SensorConformance  # noqa: E402

__all__ = ["SensorConformance", "strategies"]
