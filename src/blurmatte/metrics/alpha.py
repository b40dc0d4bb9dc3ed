"""Errors of an estimated alpha.

Estimate and truth are (H, W) floats of the same size; nothing is clipped or stretched. Errors of the
streak are measured where the true alpha is above 0, so that the size of the picture has no effect.
Errors outside are measured by `false_alpha`.
"""

import numpy as np
import scipy

from blurmatte.checks import Array, Floats
from blurmatte.metrics.inputs import checked_alphas


def alpha_rmse(estimated: Floats, true: Floats) -> float:
    """Root mean square error of alpha over the streak.

    Parameters
    ----------
    estimated, true : (H, W) float

    Returns
    -------
    float
        Alpha; 0 is perfect.

    Raises
    ------
    TypeError, ValueError
        If an argument is not (H, W) float, the sizes differ, a number is not finite, or the true
        alpha is above 0 nowhere.
    """
    error = _error(estimated, true)
    return float(np.sqrt(np.mean(error**2)))


def alpha_sad(estimated: Floats, true: Floats) -> float:
    """Sum of absolute differences of alpha over the streak.

    Parameters
    ----------
    estimated, true : (H, W) float

    Returns
    -------
    float
        Alpha summed over pixels; matting benchmarks print a thousandth of it. 0 is perfect.

    Raises
    ------
    TypeError, ValueError
        If an argument is not (H, W) float, the sizes differ, a number is not finite, or the true
        alpha is above 0 nowhere.
    """
    return float(np.sum(np.abs(_error(estimated, true))))


def alpha_sum_bias(estimated: Floats, true: Floats) -> float:
    """(Σα̂ − Σα) / Σα over the streak: the relative excess of alpha, negative if some is missing.

    Parameters
    ----------
    estimated, true : (H, W) float

    Returns
    -------
    float
        A fraction; 0 is perfect.

    Raises
    ------
    TypeError, ValueError
        If an argument is not (H, W) float, the sizes differ, a number is not finite, or the true
        alpha is above 0 nowhere.
    """
    estimated, true, streak = checked_alphas(estimated, true)
    error = estimated[streak].astype(float) - true[streak]
    return float(np.sum(error) / np.sum(true[streak], dtype=float))


def alpha_gradient_error(estimated: Floats, true: Floats) -> float:
    """Sum over the streak of (|∇α̂| − |∇α|)²: edges that are too soft, too sharp or misplaced.

    The gradient error of Rhemann et al., "A perceptually motivated online benchmark for image
    matting", CVPR 2009. ∇ is the first derivative of a Gaussian of σ = 1.4 pixels, cut off at 4
    pixels, each of the two kernels (9, 9) scaled to a sum of squares of 1; border values are repeated
    outside the picture. Common code first stretches each alpha to 0…1. That would hide errors in the
    strength of a faint streak and is omitted; if both alphas fill 0…1, the numbers are the same.

    Parameters
    ----------
    estimated, true : (H, W) float

    Returns
    -------
    float
        Summed over pixels; matting benchmarks print a thousandth of it. 0 is perfect.

    Raises
    ------
    TypeError, ValueError
        If an argument is not (H, W) float, the sizes differ, a number is not finite, or the true
        alpha is above 0 nowhere.
    """
    estimated, true, streak = checked_alphas(estimated, true)
    error = _gradient_magnitude(estimated) - _gradient_magnitude(true)
    return float(np.sum(error[streak] ** 2))


def false_alpha(estimated: Floats, true: Floats, margin: float = 0) -> float:
    """Root mean square of the estimated alpha where the object never was.

    Parameters
    ----------
    estimated, true : (H, W) float
    margin : float
        Pixels no further than this from the streak are left out, >= 0.

    Returns
    -------
    float
        Alpha; 0 is perfect.

    Raises
    ------
    TypeError, ValueError
        If an alpha is not (H, W) float, the sizes differ, a number is not finite, the true alpha is
        above 0 nowhere, nothing lies outside, or the margin is negative.
    """
    estimated, true, streak = checked_alphas(estimated, true)
    if not margin >= 0:
        raise ValueError(f"margin must be 0 or more pixels, got {margin}")
    outside = scipy.ndimage.distance_transform_edt(~streak) > margin
    if not outside.any():
        raise ValueError(f"no pixel is further than {margin:g} pixels from the streak of true")
    return float(np.sqrt(np.mean(estimated[outside].astype(float) ** 2)))


def _error(estimated: Floats, true: Floats) -> Array:
    """(n,) error of alpha at the pixels of the streak."""
    estimated, true, streak = checked_alphas(estimated, true)
    return np.asarray(estimated[streak].astype(float) - true[streak])


def _gradient_magnitude(alpha: Floats) -> Array:
    x = np.arange(-4, 5)  # pixels
    gauss = np.exp(-(x**2) / (2 * 1.4**2))
    across, along = (kernel / np.linalg.norm(kernel) for kernel in (gauss, x * gauss))
    smooth = [
        scipy.ndimage.correlate1d(alpha.astype(float), across, axis, mode="nearest")
        for axis in (0, 1)
    ]
    dx, dy = (scipy.ndimage.correlate1d(smooth[i], along, 1 - i, mode="nearest") for i in (0, 1))
    return np.asarray(np.hypot(dx, dy))
