"""Residuals of a pixel, of unit variance in each channel, under Student's t distribution."""

from blurmatte import statistics
from blurmatte.checks import Array

DEGREES_OF_FREEDOM = 6.0  # the variance is finite, and whatever else moved has little influence
# Of an estimate over its inverse curvature with these weights, for normal residuals
VARIANCE = 1.129


def loss(chi2: Array, channels: int) -> Array:
    """Minus the log likelihood of squared residuals, see `statistics.student_loss`."""
    return statistics.student_loss(chi2, DEGREES_OF_FREEDOM, channels)


def student_weight(chi2: Array, channels: int) -> Array:
    """Weight of squared residuals, see `statistics.student_weight`."""
    return statistics.student_weight(chi2, DEGREES_OF_FREEDOM, channels)
