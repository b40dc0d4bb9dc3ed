"""Quantiles of the χ² distribution."""

import numpy as np
import numpy.typing as npt

MEDIAN_3 = 2.366  # median of χ² with three degrees of freedom, one for each channel
QUANTILE_999_3 = 16.27  # its 99.9 % quantile


def chi_square_quantile(
    probability: float, degrees_of_freedom: npt.ArrayLike
) -> npt.NDArray[np.float64]:
    """Value below which χ² of (...) degrees of freedom, above 0, lies with a probability."""
    from scipy.special import gammaincinv

    return np.asarray(2 * gammaincinv(np.asarray(degrees_of_freedom) / 2, probability))
