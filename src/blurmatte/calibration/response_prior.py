"""An empirical prior of camera response curves, similar to EMoR.

Grossberg and Nayar (*Modeling the Space of Camera Response Functions*, PAMI 2004) found that the curves
of 201 films and cameras lie near a space of few dimensions. Here the samples are formulas: curves of
standards and logarithms, with and without the S-shaped tone curves of cameras and films. The space is
that of the log slope h(v) = log dg/dv, where g(v) is the light of code value v: every h belongs to an
increasing curve. h is constant between the codes of an 8-bit file, in CELLS cells.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from itertools import product

import numpy as np

from blurmatte.checks import Array
from blurmatte.radiometry import REC709, SRGB, gamma
from blurmatte.radiometry.transfer import Curve

CELLS = 255


@dataclass(frozen=True, eq=False)
class ResponsePrior:
    """h = mean + basis @ z, where the z are independent and have the variance 1."""

    mean: Array  # (CELLS,) float
    basis: Array  # (CELLS, rank) float
    members: Array  # (N, rank) float: z of each curve of the family


@lru_cache(maxsize=1)
def response_prior() -> ResponsePrior:
    """Mean, principal components and members of the family.

    To their covariance that of a smooth deviation is added: slopes off by 10 %, correlated over 8 % of
    the range. Components that change light by less than 0.1 % of full scale are dropped.
    """
    slopes = np.array([_log_slope(curve) for curve in _family()])
    mean = slopes.mean(axis=0)
    v = (np.arange(CELLS) + 0.5) / CELLS
    deviation = 0.1**2 * np.exp(-(((v[:, None] - v) / 0.08) ** 2) / 2)
    covariance = np.cov(slopes.T) + deviation
    # Components are ranked by their effect on light, which is proportional to the slope.
    weight = np.sqrt(np.mean(np.exp(2 * slopes), axis=0))
    values, vectors = np.linalg.eigh(weight[:, None] * covariance * weight)
    kept = values > 1e-3**2 * CELLS
    scale = np.sqrt(values[kept])
    members = (slopes - mean) * weight @ vectors[:, kept] / scale
    return ResponsePrior(mean, vectors[:, kept] * scale / weight[:, None], members)


def _family() -> Iterator[Curve]:
    """Standard, power and log curves; these with tone curves of some contrasts; curves of film."""
    bases = [SRGB.decode, REC709.decode]
    bases += [gamma(exponent).decode for exponent in np.arange(1.0, 3.01, 0.2)]
    logs = [_logarithmic(reach) for reach in 10.0 ** np.arange(1, 4.1, 0.5)]
    yield from (*bases, *logs)
    for base in bases[::2] + logs[:3]:
        for contrast, middle in product((2.0, 3.5, 5.0, 6.5), (0.3, 0.45, 0.6)):
            yield _with_logistic(base, contrast, middle)
        for power in (1.2, 1.5):
            yield _with_power_s(base, power)
    for exponent, half in product((1.0, 1.3, 1.6), (0.15, 0.4, 1.0)):
        yield _film(exponent, half)


def _log_slope(curve: Curve) -> Array:
    """(CELLS,) h of a curve."""
    light = np.asarray(curve(np.arange(CELLS + 1) / CELLS), dtype=float)
    rise = np.diff(light) / (light[-1] - light[0])
    return np.asarray(np.log(np.maximum(rise * CELLS, 1e-6)))


def _logarithmic(reach: float) -> Curve:
    """Code value ∝ log(1 + reach · light); `reach` is white over the light where the toe ends."""
    return lambda v: np.expm1(v * np.log1p(reach)) / reach


def _with_logistic(base: Curve, contrast: float, middle: float) -> Curve:
    """A base curve followed by a logistic tone curve, steepest at code value `middle`."""
    low, high = (1 / (1 + np.exp(-contrast * (end - middle))) for end in (0, 1))

    def decode(v: Array) -> Array:
        """Light of codes in the middle part of a logistic curve."""
        s = low + v * (high - low)
        inner = middle + np.log(s / (1 - s)) / contrast
        return np.asarray(base(np.clip(inner, 0, 1)))

    return decode


def _with_power_s(base: Curve, power: float) -> Curve:
    """A base curve followed by the tone curve v^p / (v^p + (1 − v)^p), flat at both ends."""

    def decode(u: Array) -> Array:
        """Light of codes of an S-shaped curve."""
        above, below = u ** (1 / power), (1 - u) ** (1 / power)
        return np.asarray(base(above / (above + below)))

    return decode


def _film(exponent: float, half: float) -> Curve:
    """Code value ∝ E^n / (E^n + half^n): saturation of film (Naka and Rushton)."""
    top = 1 / (1 + half**exponent)
    return lambda v: half * (v * top / (1 - v * top)) ** (1 / exponent)
