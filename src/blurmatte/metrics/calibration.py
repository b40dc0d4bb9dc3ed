"""Calibration of reported standard deviations.

In this file z = (estimate − truth) / std, which has mean 0 and spread 1 if std is correct.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from blurmatte.checks import Array, Bools, as_array, check_map
from blurmatte.metrics.inputs import check_all_finite


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
