"""Variance inflation by correlated noise, around and within a streak.

The noise inflation is the variance of a sum over a block divided by that of independent pixels. In this
file C is the image's light and B the plate's.
"""

from dataclasses import replace

import numpy as np

from blurmatte.checks import Bools, Floats
from blurmatte.matting.evidence import PixelPairs, evidence_of
from blurmatte.matting.evidence_kernel import residual
from blurmatte.matting.maps import in_strips
from blurmatte.radiometry.image import VARIANCE_FLOOR
from blurmatte.statistics import (
    block_squares,
    block_sums,
    core_mean_square,
    significant_inflation,
    window_sums,
)

BLOCK_PX = 8  # width of blocks: the correlation length of noise in compressed files


def noise_inflation(pixels: PixelPairs, alpha: Floats) -> float:
    """Factor by which correlation raises the variance of sums of noise over blocks, 1 or more.

    Around the streak it follows from the difference of image and plate. Within the streak, compression
    leaves other noise. For a line l of colors it follows there from the equation without alpha,
    (l × B)·C = 0. For a plane it follows from the fine structure of the pixels' alpha, compared with
    that around the streak. If noise around the streak is independent, it is assumed so within:
    otherwise true fine structure of alpha would count as noise. The parameters are those of
    `evidence_of`.
    """
    valid = pixels.image.valid & pixels.plate.valid
    still = replace(pixels, inside=~pixels.inside, use=valid & ~pixels.inside)
    if pixels.model.rank == 1:
        return max(_around_streak(still), _within_streak(pixels, alpha, valid & pixels.inside))
    if pixels.model.rank == 3:
        return _around_streak(still)
    of_alpha = evidence_of(still, np.zeros(alpha.shape))
    inflation = _of_alpha(*of_alpha, still.use)
    if inflation == 1:
        return inflation
    within, around = (_fine_structure(*e) for e in (evidence_of(pixels, alpha), of_alpha))
    return inflation * max(within / around, 1.0)


def _around_streak(pixels: PixelPairs) -> float:
    """Noise inflation from the difference of image and plate."""
    C, B, V_C, V_B = (a[pixels.use] for a in pixels.with_edges)
    e = np.zeros(pixels.image.rgb.shape, C.dtype)
    e[pixels.use] = (C - B) / np.sqrt(np.maximum(V_C + V_B, VARIANCE_FLOOR))
    squares = block_squares(e, pixels.use, BLOCK_PX).ravel()
    return significant_inflation(squares, len(squares))


def _within_streak(pixels: PixelPairs, alpha: Floats, inside: Bools) -> float:
    """Noise inflation from the equation without alpha, for a line of colors.

    Differences of neighboring blocks are used: they cancel the residual of a slightly wrong color.
    """
    l, rest = pixels.model.basis[:, 0], np.empty((2, *inside.shape))

    def rows(strip: slice) -> None:
        """Fill some rows."""
        light = (a[strip] for a in pixels.with_edges)
        residual(*light, l, alpha[strip], inside[strip], rest[:, strip])

    in_strips(rows, len(inside))
    e, variance, count = (block_sums(m, BLOCK_PX) for m in (*rest, inside.astype(float)))
    full = count > BLOCK_PX**2 / 2
    squares = []
    for a, b in ((np.s_[1:], np.s_[:-1]), (np.s_[:, 1:], np.s_[:, :-1])):
        both = full[a] & full[b]
        squares.append((e[a] - e[b])[both] ** 2 / (variance[a] + variance[b])[both])
    return significant_inflation(np.concatenate(squares), int(np.count_nonzero(full)))


def _of_alpha(information: Floats, pull: Floats, use: Bools) -> float:
    """Noise inflation from the pixels' own alpha around the streak.

    Over windows around each pixel, independent of the position of a grid of blocks.
    """
    variance, sums, count = (window_sums(m, BLOCK_PX, "constant") for m in (information, pull, use))
    full = (count > BLOCK_PX**2 / 2) & (variance > 0)
    squares = sums[full] ** 2 / variance[full]
    return significant_inflation(squares, len(squares) // BLOCK_PX**2)


def _fine_structure(information: Floats, pull: Floats) -> float:
    """Mean square of mixed fourth differences of means over 2 by 2 pixels, over their variance.

    A smooth field contributes little to them, and the result does not depend on how pictures are cut.
    """
    I, p = (m[:-1, :-1] + m[1:, :-1] + m[:-1, 1:] + m[1:, 1:] for m in (information, pull))
    with np.errstate(divide="ignore", invalid="ignore"):
        variance = np.where(I > 0, 1 / I, np.nan)
    e = p * variance
    for _ in range(2):  # down, then across
        e = (e[:-4] - 2 * e[2:-2] + e[4:]).T
        variance = (variance[:-4] + 4 * variance[2:-2] + variance[4:]).T
    known = np.isfinite(variance)
    return core_mean_square(e[known] ** 2 / variance[known])
