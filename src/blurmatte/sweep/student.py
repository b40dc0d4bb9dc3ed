"""Student's t distribution of residuals: noise, and now and then something else."""

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

_FREEDOM = 6.0  # degrees of freedom

# How much larger the variance of an estimate is than the inverse curvature with these weights says,
# for pairs of residuals that are normal noise: doubt costs some precision, and flattens the true cost.
VARIANCE = 1.11


def loss(chi2: Array) -> Array:
    """Minus the log likelihood of squared residuals, unit variance."""
    return np.asarray(np.log(1 + chi2 / _FREEDOM) * ((_FREEDOM + 2) / 2))


def belief(chi2: Array) -> Array:
    """How much squared residuals are taken for noise; twice the slope of the loss."""
    return np.asarray((_FREEDOM + 2) / (_FREEDOM + chi2))


def bend(chi2: Array) -> Array:
    """By how much the loss bends down along its residuals, as a part of its slope squared.

    Half its curvature by residuals e is belief(χ²) times 1 − e bend(χ²) eᵀ [Triggs et al. 2000].
    Beyond χ² = 6 the loss is no longer convex; there it is taken for flat along e.
    """
    return np.asarray(1 / np.maximum(chi2, (_FREEDOM + chi2) / 2))
