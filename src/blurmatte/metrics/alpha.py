"""How far an estimated alpha is from the true one.

Both are (H, W) floats of the same size, as they are: nothing is clipped or stretched. What belongs
to the streak is measured over the streak only, where the true alpha is above 0, so that the size of
the picture around it changes nothing; what is wrong elsewhere, `false_alpha` tells.
"""

import numpy as np
import numpy.typing as npt

from blurmatte.checks import Floats
from blurmatte.metrics.inputs import check_alphas

Array = npt.NDArray[np.float64]

_SIGMA, _REACH = 1.4, 4  # pixels: width of the benchmark's Gaussian, and where it cuts it off


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
    """(Σα̂ − Σα) / Σα over the streak: the part of the alpha that is too much or, negative, lost.

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
    error = _error(estimated, true)
    return float(np.sum(error) / np.sum(true[true > 0], dtype=float))


def alpha_gradient_error(estimated: Floats, true: Floats) -> float:
    """Sum over the streak of (|∇α̂| − |∇α|)²: edges that are too soft, too sharp or misplaced.

    The gradient error of Rhemann et al., "A perceptually motivated online benchmark for image
    matting", CVPR 2009. ∇ is the first derivative of a Gaussian of σ = 1.4 pixels, cut off at 4
    pixels, each of the two kernels (9, 9) scaled to a sum of squares of 1; the picture goes on
    beyond its border with the values there. Customary code stretches each alpha to fill 0…1 first.
    That is left out, for it would hide that a faint streak is wrong in strength; where both alphas
    fill 0…1 anyway, the numbers are the customary ones.

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
    streak = check_alphas(estimated, true)
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
    from scipy.ndimage import distance_transform_edt

    streak = check_alphas(estimated, true)
    if not margin >= 0:
        raise ValueError(f"margin must be 0 or more pixels, got {margin}")
    outside = distance_transform_edt(~streak) > margin
    if not outside.any():
        raise ValueError(f"no pixel is further than {margin:g} pixels from the streak of true")
    return float(np.sqrt(np.mean(estimated[outside].astype(float) ** 2)))


def _error(estimated: Floats, true: Floats) -> Array:
    """(n,) error of alpha at the pixels of the streak."""
    streak = check_alphas(estimated, true)
    return np.asarray(estimated[streak].astype(float) - true[streak])


def _gradient_magnitude(alpha: Floats) -> Array:
    from scipy.ndimage import correlate1d

    x = np.arange(-_REACH, _REACH + 1)
    gauss = np.exp(-(x**2) / (2 * _SIGMA**2))
    across, along = (kernel / np.linalg.norm(kernel) for kernel in (gauss, x * gauss))
    smooth = [correlate1d(alpha.astype(float), across, axis, mode="nearest") for axis in (0, 1)]
    dx, dy = (correlate1d(smooth[i], along, 1 - i, mode="nearest") for i in (0, 1))
    return np.asarray(np.hypot(dx, dy))
