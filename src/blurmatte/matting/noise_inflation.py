"""Variance inflation of the noise within a streak.

In this file C is the image's light and B the plate's.
"""

from dataclasses import replace

import numpy as np
import numpy.typing as npt

from blurmatte.checks import Bools, Floats
from blurmatte.matting.evidence import Pixels, evidence_of
from blurmatte.matting.pixelwise import in_strips
from blurmatte.statistics import (
    block_squares,
    block_sums,
    core_mean_square,
    significant_inflation,
)

Array = npt.NDArray[np.float64]

BLOCK = 8  # pixels: width of the blocks of files, over which noise is correlated


def noise_inflation(pixels: Pixels, alpha: Floats) -> float:
    """Variance of noise summed over blocks, over that of independent pixels; 1 or more.

    Outside the streak it is measured from the difference of image and plate. Compression makes other
    noise where something moved. There, for a line l of colors, it is measured from the residual
    (l × B)·C, which does not depend on alpha. A plane of colors has no such residual; there the fine
    structure of alpha within the streak is compared with that outside. If the noise outside is
    independent, the noise within is taken to be so too: fine detail of alpha would look like noise.
    The parameters are those of `evidence_of`.
    """
    valid = pixels.image.valid & pixels.plate.valid
    still = replace(pixels, inside=~pixels.inside, use=valid & ~pixels.inside)
    if pixels.model.rank == 1:
        return max(_outside(still), _within(pixels, alpha, valid & pixels.inside))
    if pixels.model.rank == 3:
        return _outside(still)
    of_alpha = evidence_of(still, np.zeros(alpha.shape))
    inflation = _of_sums(*of_alpha, still.use)
    if inflation == 1:
        return inflation
    within, outside = (_fine_structure(*e) for e in (evidence_of(pixels, alpha), of_alpha))
    return inflation * max(within / outside, 1.0)


def _outside(pixels: Pixels) -> float:
    """Variance inflation of C − B outside the streak."""
    C, B, V_C, V_B = (a[pixels.use] for a in pixels.with_edges)
    e = np.zeros(pixels.image.rgb.shape, C.dtype)
    e[pixels.use] = (C - B) / np.sqrt(np.maximum(V_C + V_B, 1e-14))
    squares = block_squares(e, pixels.use, BLOCK).ravel()
    return significant_inflation(squares, len(squares))


def _within(pixels: Pixels, alpha: Floats, inside: Bools) -> float:
    """Variance inflation of the residual (l × B)·C within the streak.

    From differences of neighboring blocks: an error of l makes a residual common to all of them.
    """
    from blurmatte.matting.evidence_kernel import left_over  # numba takes half a second

    l, rest = pixels.model.basis[:, 0], np.empty((2, *inside.shape))

    def rows(strip: slice) -> None:
        light = (a[strip] for a in pixels.with_edges)
        left_over(*light, l, alpha[strip], inside[strip], rest[:, strip])

    in_strips(rows, len(inside))
    e, variance, count = (block_sums(m, BLOCK) for m in (*rest, inside.astype(float)))
    full = count > BLOCK**2 / 2
    squares = []
    for a, b in ((np.s_[1:], np.s_[:-1]), (np.s_[:, 1:], np.s_[:, :-1])):
        both = full[a] & full[b]
        squares.append((e[a] - e[b])[both] ** 2 / (variance[a] + variance[b])[both])
    return significant_inflation(np.concatenate(squares), int(np.count_nonzero(full)))


def _of_sums(information: Floats, pull: Floats, use: Bools) -> float:
    """Variance inflation of alpha's noise outside the streak."""
    variance, sums, count = (_window_sums(m) for m in (information, pull, use))
    full = (count > BLOCK**2 / 2) & (variance > 0)
    squares = sums[full] ** 2 / variance[full]
    return significant_inflation(squares, len(squares) // BLOCK**2)


def _window_sums(values: Floats | Bools) -> Array:
    """Sums over a block around each pixel, so that the result does not depend on a grid's origin."""
    from scipy.ndimage import uniform_filter

    return np.asarray(uniform_filter(values.astype(float), BLOCK, mode="constant") * BLOCK**2)


def _fine_structure(information: Floats, pull: Floats) -> float:
    """Mean square of mixed fourth differences of 2 by 2 means, over their variance.

    A smooth field has almost none. The result does not depend on the origin of a crop.
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
