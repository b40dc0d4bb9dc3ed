"""Student's t distribution of residuals: normal noise with occasional outliers."""

import numpy as np

from blurmatte.checks import Array

DEGREES_OF_FREEDOM = 6.0
VARIANCE = (
    1.129  # of an estimate over its inverse curvature with these weights, for normal residuals
)


def loss(chi2: Array) -> Array:
    """Minus the log likelihood of squared residuals of unit variance, in three dimensions."""
    scale = (DEGREES_OF_FREEDOM + 3) / 2
    return np.asarray(np.log1p(chi2 / DEGREES_OF_FREEDOM) * scale)


def student_weight(chi2: Array) -> Array:
    """Weight of squared residuals in iteratively reweighted least squares: twice the loss's slope."""
    return np.asarray((DEGREES_OF_FREEDOM + 3) / (DEGREES_OF_FREEDOM + chi2))
