"""The search for bands in the residuals of an alignment; see `match`."""

from dataclasses import replace

import numpy as np
import scipy

from blurmatte.background.alignment import (
    Alignment,
    ComparedPair,
    fit_level,
    gain_score,
    log_likelihood_gains,
)
from blurmatte.background.match import Bands, coordinates_across, functions_of_bands
from blurmatte.background.warp import to_centered
from blurmatte.checks import Array

MIN_PERIODS = 0.75  # in the picture; fewer are a smooth field
MIN_PERIOD_CELLS = 16  # of the level: four of its points
PERIOD_STEP = 0.25  # of the numbers of periods that are compared
MAX_HARMONICS = 4
PARTS = 12  # of a picture, across the bands
FIRST_ROW = 7  # of the coefficients in `Fit.light`


def bands_of(fit: Alignment, axis: int, frequency: float) -> Bands:
    """The bands of a fit on a level with bands."""
    coefficients = fit.light[FIRST_ROW:]
    per_channel, many = len(fit.rows), len(coefficients)
    covariance = fit.covariance()
    ends = [len(covariance) - k * per_channel for k in (2, 1, 0)]
    blocks = [covariance[end - many : end, end - many : end] for end in ends]
    return Bands(axis, frequency, coefficients, np.stack(blocks))


def with_bands(level: ComparedPair, axis: int, frequency: float, harmonics: int) -> ComparedPair:
    """A level without bands, and the functions of bands."""
    functions = functions_of_bands(level.basis[:, 2 - axis], frequency, harmonics)
    return replace(level, basis=np.concatenate([level.basis, functions], axis=1))


def strongest_bands(fit: Alignment) -> tuple[float, int, float]:
    """The most likely bands of one harmonic: log likelihood that they gain, axis, and frequency.

    The gain is that of one step from `fit`, which is without bands, in most parts of the picture.
    """
    level, found, parts = fit.level, (-np.inf, 0, 1.0), np.zeros(PARTS)
    scores = gain_score(fit)
    for axis in (0, 1):
        place = level.xy[:, 1 - axis]
        S, A = (np.stack([np.bincount(place, x[:, c]) for c in range(3)]) for x in scores)
        t = coordinates_across(level.size, axis)[: S.shape[1]]
        part = np.arange(len(t)) * PARTS // level.size[1 - axis]
        for frequency in _frequencies(level, axis):
            X = np.column_stack([np.ones(len(t)), functions_of_bands(t, frequency, 1)])
            normal = np.einsum("ni,cn,nj->cij", X, A, X) + 1e-9 * np.eye(3)
            step = np.linalg.solve(normal, (S @ X)[..., None])[..., 0] @ X.T
            step -= (S.sum(axis=1) / normal[:, 0, 0])[:, None]  # beyond a mean alone
            gains = np.sum(S * step - A * step**2 / 2, axis=0)
            if gains.sum() > found[0]:
                found = float(gains.sum()), axis, float(frequency)
                parts = np.asarray(np.bincount(part, gains, PARTS), float)
    return _of_most(parts), *found[1:]


def _of_most(gains: Array) -> float:
    """Sum of the gains of parts across the bands, if each gained as much as the median one.

    A streak changes some of them, bands change most.
    """
    return float(len(gains) * np.median(gains))


def _frequencies(level: ComparedPair, axis: int) -> Array:
    """ω of all numbers of periods."""
    cells = level.size[1 - axis]
    numbers = np.arange(MIN_PERIODS, cells / MIN_PERIOD_CELLS, PERIOD_STEP)
    return np.asarray(2 * np.pi * numbers / (cells * to_centered(level.size)[0, 0]))


def refined(level: ComparedPair, start: Alignment, axis: int, frequency: float) -> float:
    """The most likely frequency of one harmonic near another; level and start are without bands."""
    reach = PERIOD_STEP / MIN_PERIODS * _frequencies(level, axis)[0]
    rough = fit_bands(level, start, axis, frequency, 1)

    def cost(omega: float) -> float:
        """Log likelihood at the rough frequency over that at another."""
        fit = fit_bands(level, rough, axis, omega, 1)
        return float(log_likelihood_gains(fit, rough).sum())

    bounds = frequency - reach, frequency + reach
    found = scipy.optimize.minimize_scalar(
        cost, bounds=bounds, method="bounded", options={"xatol": 0.01 * reach}
    )
    return float(found.x)


def fit_bands(
    level: ComparedPair, start: Alignment, axis: int, frequency: float, harmonics: int
) -> Alignment:
    """Fit of gain, bands and what else is free in the model of `start`, which may have fewer bands."""
    banded = with_bands(level, axis, frequency, harmonics)
    light = banded.identity.light
    light[: len(start.light)] = start.light
    first = replace(banded.identity, h=start.h, light=light)
    return fit_level(banded, first, (start.model[0], max(start.model[1], 1)))


def gain_of_bands(level: ComparedPair, before: Alignment, after: Alignment, axis: int) -> float:
    """Log likelihood gained by bands in most parts of the picture."""
    part = level.xy[:, 1 - axis] * PARTS // level.size[1 - axis]
    return _of_most(np.bincount(part, log_likelihood_gains(before, after), PARTS).astype(float))
