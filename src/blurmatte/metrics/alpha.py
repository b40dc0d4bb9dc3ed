"""Errors of an estimated alpha, calibration of standard deviations, and checks of all arguments.

Estimate and truth are (H, W) floats of the same size; nothing is clipped or stretched. Errors of the
streak are measured where the true alpha is above 0, so that the size of the picture has no effect.
Errors outside are measured by `false_alpha`.

z is (estimate − truth) / std, which has mean 0 and spread 1 if std is correct.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import scipy

from blurmatte.checks import Array, Bools, Floats, as_array, check_map, check_same_size
from blurmatte.layer import Layer, check_layer


def check_all_finite(name: str, value: Floats) -> None:
    """Raise if `value` holds NaN or infinite numbers, and say how many."""
    lost = int(np.sum(~np.isfinite(value)))
    if lost:
        raise ValueError(f"{name} must be finite, got {lost} NaN or infinite of {value.size}")


def checked_alphas(estimated: Floats, true: Floats) -> tuple[Floats, Floats, Bools]:
    """Both, finite float (H, W) of one size, and the streak, (H, W) bool; raises unless they are so."""
    pair = []
    for name, given in (("estimated", estimated), ("true", true)):
        alpha = check_map(name, given)
        if alpha.ndim != 2:
            raise ValueError(f"{name} must have the shape (height, width), got {alpha.shape}")
        check_all_finite(name, alpha)
        pair.append(alpha)
    check_same_size("estimated", picture_size(pair[0]), "true", picture_size(pair[1]))
    return pair[0], pair[1], streak_of(pair[1])


def check_finite_layer(name: str, value: Layer) -> None:
    """Raise unless `value` is a Layer of finite numbers."""
    check_layer(name, value)
    check_all_finite(f"the alpha of {name}", value.alpha)
    check_all_finite(f"the premultiplied light of {name}", value.premultiplied)


def streak_of(alpha: Floats) -> Bools:
    """(H, W) True where the true alpha is above 0; ValueError if that is nowhere."""
    streak: Bools = alpha > 0
    if not streak.any():
        raise ValueError(f"true must hold a streak, got alpha up to {np.max(alpha):g}")
    return streak


def picture_size(picture: Floats) -> tuple[int, int]:
    """(width, height) of an (H, W, ...) array."""
    height, width = picture.shape[:2]
    return width, height


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


@dataclass(frozen=True)
class Calibration:
    """Statistics of z = (estimate − truth) / std.

    Parameters
    ----------
    count : int
        Number of values.
    mean : float
        Of z; 0 if there is no bias.
    spread : float
        Root mean square of z about its mean; 1 if std is correct, more if it is too small.
    robust_spread : float
        Median of |z| over that of a normal distribution: `spread` for an unbiased estimate, insensitive
        to a few outliers.
    within_1, within_2, within_3 : float
        Fraction of |z| below 1, 2 and 3; 0.683, 0.954 and 0.997 for normal errors of the given std.
    """

    count: int
    mean: float
    spread: float
    robust_spread: float
    within_1: float
    within_2: float
    within_3: float


def calibration(
    estimate: npt.ArrayLike, std: npt.ArrayLike, truth: npt.ArrayLike, where: Bools | None = None
) -> Calibration:
    """Compare the errors of estimates with their reported standard deviations.

    Values with an infinite, zero or NaN std are ignored; `count` is the number of the others.

    Parameters
    ----------
    estimate, std, truth : (...) float
        Estimates, their reported standard deviations and the true values; one shape.
    where : bool, optional
        Values to use: the same shape, or its first axes (a pixel, for all three channels).

    Returns
    -------
    Calibration

    Raises
    ------
    TypeError, ValueError
        If the shapes differ, a std is negative, an estimate with a usable std or its truth is not
        finite, or nothing remains.
    """
    x, s, t = (
        np.asarray(as_array(name, value), dtype=float)
        for name, value in (("estimate", estimate), ("std", std), ("truth", truth))
    )
    for name, value in (("std", s), ("truth", t)):
        if value.shape != x.shape:
            raise ValueError(
                f"{name} must have the shape of estimate, {x.shape}, got {value.shape}"
            )
    if where is not None:
        where = check_map("where", where, x.shape[: np.ndim(where)], kinds="b")
        x, s, t = x[where], s[where], t[where]
    if np.any(s < 0):
        raise ValueError(f"std must not be negative, got {int(np.sum(s < 0))} that are")
    usable = np.isfinite(s) & (s > 0)
    if not usable.any():
        raise ValueError(f"std must be finite and above 0 somewhere, got none in {s.size} values")
    check_all_finite("estimate", x[usable])
    check_all_finite("truth", t[usable])
    return _summary((x[usable] - t[usable]) / s[usable])


def _summary(z: Array) -> Calibration:
    from statistics import NormalDist

    size = np.abs(z)
    within = (float(np.mean(size < limit)) for limit in (1, 2, 3))
    robust = float(np.median(size)) / NormalDist().inv_cdf(0.75)  # the median of |z|
    return Calibration(z.size, float(z.mean()), float(z.std()), robust, *within)
