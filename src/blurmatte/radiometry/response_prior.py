"""What curves cameras have: an empirical model of response, in the manner of EMoR.

Grossberg and Nayar (*Modeling the Space of Camera Response Functions*, PAMI 2004) found that the curves
of 201 films and cameras lie near a space of few dimensions. The family here is made of formulas
instead: curves of standards and logarithms, with and without the S shape that cameras and films add.
And it is a space of the logarithm of the slope, h(v) = log dg/dv of g(v), the light of code value v:
any h belongs to a curve that rises.

Between the codes of an 8-bit file h is constant; there are CELLS such steps.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import numpy.typing as npt

from blurmatte.radiometry.transfer import REC709, SRGB, Curve, gamma

Array = npt.NDArray[np.float64]

CELLS = 255
_GAMMAS = np.arange(1.0, 3.01, 0.2)
_LOG_RANGES = 10.0 ** np.arange(1, 4.1, 0.5)  # light at white over light where the toe ends
_CONTRASTS = 2.0, 3.5, 5.0, 6.5  # of the S; 0 is none, 6.5 a very hard one
_MIDDLES = 0.3, 0.45, 0.6  # code value where the S is steepest
_POWERS = 1.2, 1.5  # of the S that is flat at its ends
_FILMS = [(n, s) for n in (1.0, 1.3, 1.6) for s in (0.15, 0.4, 1.0)]
_WIGGLE, _WIDTH = 0.1, 0.08  # what no formula knows: slopes off by a tenth, over this much of v
_NEGLIGIBLE = 1e-3  # of full scale, at one standard deviation: components below are left out


@dataclass(frozen=True, eq=False)
class ResponsePrior:
    """h = mean + basis @ z, where the z are independent and have the variance 1.

    Parameters
    ----------
    mean : (CELLS,) float
    basis : (CELLS, rank) float
    members : (N, rank) float
        z of each curve of the family.
    """

    mean: Array
    basis: Array
    members: Array


@lru_cache(maxsize=1)
def response_prior() -> ResponsePrior:
    """Mean, principal components and members of the family."""
    slopes = np.array([_log_slope(curve) for curve in _family()])
    mean = slopes.mean(axis=0)
    v = (np.arange(CELLS) + 0.5) / CELLS
    wiggle = _WIGGLE**2 * np.exp(-(((v[:, None] - v) / _WIDTH) ** 2) / 2)
    covariance = np.cov(slopes.T) + wiggle
    # Components are ranked by what they do to light: a slope matters as far as it is steep.
    weight = np.sqrt(np.mean(np.exp(2 * slopes), axis=0))
    values, vectors = np.linalg.eigh(weight[:, None] * covariance * weight)
    kept = values > _NEGLIGIBLE**2 * CELLS
    scale = np.sqrt(values[kept])
    members = (slopes - mean) * weight @ vectors[:, kept] / scale
    return ResponsePrior(mean, vectors[:, kept] * scale / weight[:, None], members)


def _family() -> Iterator[Curve]:
    bases = [SRGB.decode, REC709.decode, *(gamma(x).decode for x in _GAMMAS)]
    logs = [_logarithmic(reach) for reach in _LOG_RANGES]
    yield from (*bases, *logs)
    for base in bases[::2] + logs[:3]:
        for contrast in _CONTRASTS:
            for middle in _MIDDLES:
                yield _with_logistic(base, contrast, middle)
        for power in _POWERS:
            yield _with_power_s(base, power)
    for exponent, half in _FILMS:
        yield _film(exponent, half)


def _log_slope(curve: Curve) -> Array:
    light = np.asarray(curve(np.arange(CELLS + 1) / CELLS), dtype=float)
    rise = np.diff(light) / (light[-1] - light[0])
    return np.asarray(np.log(np.maximum(rise * CELLS, 1e-6)))


def _logarithmic(reach: float) -> Curve:
    """Code value ∝ log(1 + reach · light)."""
    return lambda v: np.expm1(v * np.log1p(reach)) / reach


def _with_logistic(base: Curve, contrast: float, middle: float) -> Curve:
    """A base curve whose code values then went through a logistic S."""
    low, high = (1 / (1 + np.exp(-contrast * (end - middle))) for end in (0, 1))

    def decode(v: Array) -> Array:
        s = low + v * (high - low)
        inner = middle + np.log(s / (1 - s)) / contrast
        return np.asarray(base(np.clip(inner, 0, 1)))

    return decode


def _with_power_s(base: Curve, power: float) -> Curve:
    """A base curve whose code values then went through v^p / (v^p + (1 - v)^p): flat at both ends."""

    def decode(u: Array) -> Array:
        above, below = u ** (1 / power), (1 - u) ** (1 / power)
        return np.asarray(base(above / (above + below)))

    return decode


def _film(exponent: float, half: float) -> Curve:
    """Code value ∝ E^n / (E^n + half^n), the saturation of Naka and Rushton, as films show it."""
    top = 1 / (1 + half**exponent)
    return lambda v: half * (v * top / (1 - v * top)) ** (1 / exponent)
