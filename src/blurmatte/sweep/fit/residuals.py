"""Statistics of the residuals of a sweep: correlation, outliers, explained change, noise."""

import numpy as np

from blurmatte.checks import Array, Bools
from blurmatte.statistics import (
    MEDIAN_3,
    block_squares,
    chi_square_quantile,
    mean_of_blocks,
    trimmed_mean,
)
from blurmatte.sweep.model.observation import BlockStatistics
from blurmatte.sweep.model.silhouette import OPAQUE
from blurmatte.sweep.model.state import State

# Median outside the streak, over that of noise, of codecs that repeat static parts
_MAX_REPEATED_CHI2 = 0.3 / MEDIAN_3
_MAX_NOISE_RATIO = 0.3  # standard deviation of noise over the rms change of a pixel


def hue_inflation(state: State) -> float:
    """As `State.variance_inflation`, the larger of both axes of hue, also over blocks of chroma."""
    inside, _ = state.places
    e = state.weighted_residuals[..., 1:]
    sizes = *BlockStatistics.sizes_px, BlockStatistics.chroma_px
    squares = (block_squares(e, inside, size) for size in sizes)
    return max(1.0, *(float(s.mean(axis=0).max()) for s in squares if len(s)), 1.0)


def residual_excess(state: State) -> float:
    """Correlation of residuals within the sweep over that of the noise outside; about 1 if it fits.

    Each is the variance of block sums over that of pixels: an error of the noise level cancels. Few
    blocks of one channel exceed 1 by chance: what they exceed in one of twenty cases counts as 1.
    """
    e, n = state.weighted_residuals, state.observation.channels
    inside, outside = state.places
    blocks = BlockStatistics
    ratios = [
        _correlation(e, inside, blocks.trimmed_inside, size, n)
        / max(_correlation(e, outside, blocks.trimmed_outside, size, n), 1.0)
        for size in BlockStatistics.sizes_px
    ]
    excess = float(np.exp(np.mean(np.log(np.maximum(ratios, 1e-6)))))
    if n > 1 or excess <= 1:
        return excess
    independent = max(np.count_nonzero(inside) / max(blocks.sizes_px) ** 2, 1.0)
    return max(1.0, excess / float(chi_square_quantile(0.95, independent) / independent))


def explained_fraction(state: State) -> float:
    """Fraction of the change in streak and sweep that the sweep explains, noise apart; 0 to 1."""
    observation, alpha = state.observation, state.swept.alpha
    use = (observation.streak | (alpha > 0)) & observation.valid
    variance = observation.C_variance + observation.B_variance
    noise = observation.channels * np.count_nonzero(use)
    change = float(((observation.C - observation.B) ** 2 / variance)[use].sum()) - noise
    left = float(state.chi2[use].sum()) - noise
    return float(np.clip(1 - left / change, 0, 1)) if change > 0 else 0.0


def outlier_fraction(state: State) -> float:
    """Fraction of the sweep's pixels whose χ² exceeds the 99.9 % quantile of noise."""
    inside = (state.swept.alpha > 0) & state.observation.valid
    limit = chi_square_quantile(0.999, state.observation.channels)
    return float(np.mean(state.chi2[inside] > limit)) if inside.any() else 1.0


def noise_inflation(state: State) -> float:
    """Variance of the noise within a sweep over the one that was measured, 1 or more.

    Codecs of clips repeat static parts, whose noise is then less than that of moving parts. 1 if the
    noise outside the streak is not repeated, and if the residuals are too large compared with the
    change to be noise.
    """
    observation, alpha = state.observation, state.swept.alpha
    _, outside = state.places
    inside = (alpha > 0) & (alpha < OPAQUE) & observation.valid
    if not (inside.any() and outside.any()):
        return 1.0
    median = float(chi_square_quantile(0.5, observation.channels))
    if np.median(state.chi2[outside]) >= _MAX_REPEATED_CHI2 * median:
        return 1.0
    inflation = float(np.median(state.chi2[inside])) / median
    variance = (observation.C_variance + observation.B_variance)[inside]
    change = float(np.mean((observation.C - observation.B)[inside] ** 2))
    explains = inflation * float(np.mean(variance)) < _MAX_NOISE_RATIO**2 * change
    return inflation if inflation > 1 and explains else 1.0


def colors_are_correlated(state: State) -> bool:
    """True if the noise of color is correlated between pixels, which chroma subsampling causes.

    Blur by a lens does not correlate noise, and slow variation of light has no influence.
    """
    observation = state.observation
    _, outside = state.places
    variance = observation.C_variance + observation.B_variance
    e = (observation.C - observation.B) / np.sqrt(variance)
    color = e - e.mean(axis=-1, keepdims=True)
    near, far = (_squared_differences(color, outside, apart) for apart in (1, 2))
    return bool(near < _MAX_INDEPENDENT_RATIO * far)


# Of squared differences of neighbors over those of pixels two apart: 1 for independent noise, 0.8 where
# pairs of pixels share their color; chance makes it 1 ± 0.02 of 3000 pixels.
_MAX_INDEPENDENT_RATIO = 0.9


def _squared_differences(values: Array, use: Bools, apart: int) -> float:
    """Sum of squared differences of pixels so far apart, 1 or 2, of three in a row or column."""
    total = 0.0
    for x, known in ((values, use), (values.swapaxes(0, 1), use.T)):
        all_three = known[2:] & known[1:-1] & known[:-2]
        total += float(np.sum((x[apart:][: len(all_three)] - x[:-2])[all_three] ** 2))
    return total


def _correlation(e: Array, use: Bools, trimmed: float, size: int, channels: int) -> float:
    """Mean square of block sums over that of pixels; 1 if there are no pixels."""
    if not use.any():
        return 1.0
    pixels = trimmed_mean((e**2).sum(axis=-1)[use] / channels, trimmed)
    return mean_of_blocks(e, use, size, channels, trimmed) / pixels if pixels > 0 else 1.0
