"""Does the result hold for exposures that it has not seen? Cross-validation and bootstrap."""

from rigcal.resampling.bootstrap import Bootstrap, Scatter, bootstrap
from rigcal.resampling.cross_validation import CrossValidation, Fold, HeldOut, cross_validate

__all__ = [
    "Bootstrap",
    "CrossValidation",
    "Fold",
    "HeldOut",
    "Scatter",
    "bootstrap",
    "cross_validate",
]
