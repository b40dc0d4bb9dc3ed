"""Quantiles of the χ² distribution."""

import numpy as np
import numpy.typing as npt

MEDIAN_3 = 2.366  # median of χ² with three degrees of freedom, one for each channel
QUANTILE_999_3 = 16.27  # its 99.9 % quantile


def chi_square_quantile(
    probability: float, degrees_of_freedom: npt.ArrayLike
) -> npt.NDArray[np.float64]:
    """Value below which χ² lies with a probability.

    Parameters
    ----------
    probability : float
        0…1.
    degrees_of_freedom : (...) float
        Above 0.

    Returns
    -------
    (...) float
    """
    from scipy.special import gammaincinv

    return np.asarray(2 * gammaincinv(np.asarray(degrees_of_freedom) / 2, probability))
