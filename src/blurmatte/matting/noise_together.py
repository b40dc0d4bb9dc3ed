"""By how much more noise adds up within a streak than if each pixel had its own.

In this file C is the image's light and B the plate's.
"""

from dataclasses import replace

import numpy as np
import numpy.typing as npt

from blurmatte.checks import Bools, Floats
from blurmatte.matting.evidence import Pixels, evidence_of
from blurmatte.matting.pixelwise import in_strips
from blurmatte.radiometry import block_squares, block_sums

Array = npt.NDArray[np.float64]

BLOCK = 8  # pixels: noise that hangs together does so over less, or over such blocks
_KEPT, _MEAN_OF_KEPT = 0.9, 0.606  # the lower part of χ² of one
_CHANCE = 2.5  # standard deviations of a mean of squares


def noise_together(pixels: Pixels, alpha: Floats) -> float:
    """By how much more noise adds up over blocks than if each pixel had its own, 1 or more.

    Beside the streak it shows in the difference of image and plate. Compression leaves other noise
    where something moved than where nothing did; there a line l of colors tells it, by the equation
    that it leaves over, (l × B)·C = 0, in which there is no alpha. A plane leaves none; there the fine
    structure of alpha tells, by how much it is stronger within the streak than beside it. Where noise
    beside it is each pixel's own, so is that within: fine alphas would be taken for it. The parameters
    are those of `evidence_of`.
    """
    valid = pixels.image.valid & pixels.plate.valid
    still = replace(pixels, inside=~pixels.inside, use=valid & ~pixels.inside)
    if pixels.model.rank == 1:
        return max(_beside(still), _left_over(pixels, alpha, valid & pixels.inside))
    if pixels.model.rank == 3:
        return _beside(still)
    of_alpha = evidence_of(still, np.zeros(alpha.shape))
    together = _of_sums(*of_alpha, still.use)
    if together == 1:
        return together
    within, without = (_fine_structure(*e) for e in (evidence_of(pixels, alpha), of_alpha))
    return together * max(within / without, 1.0)


def _beside(pixels: Pixels) -> float:
    """What noise adds up to beside the streak."""
    C, B, V_C, V_B = (a[pixels.use] for a in pixels.with_edges)
    e = np.zeros(pixels.image.rgb.shape, C.dtype)
    e[pixels.use] = (C - B) / np.sqrt(np.maximum(V_C + V_B, 1e-14))
    squares = block_squares(e, pixels.use, BLOCK).ravel()
    return _beyond_chance(squares, len(squares))


def _left_over(pixels: Pixels, alpha: Floats, inside: Bools) -> float:
    """What the equation left over adds up to within the streak.

    Of differences of neighboring blocks: a color that is a little wrong leaves something in all.
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
    return _beyond_chance(np.concatenate(squares), int(np.count_nonzero(full)))


def _of_sums(information: Floats, pull: Floats, use: Bools) -> float:
    """What noise of alpha adds up to beside the streak."""
    variance, sums, count = (_window_sums(m) for m in (information, pull, use))
    full = (count > BLOCK**2 / 2) & (variance > 0)
    squares = sums[full] ** 2 / variance[full]
    return _beyond_chance(squares, len(squares) // BLOCK**2)


def _window_sums(values: Floats | Bools) -> Array:
    """Sums over blocks around each pixel: those of a grid would change with where it begins."""
    from scipy.ndimage import uniform_filter

    return np.asarray(uniform_filter(values.astype(float), BLOCK, mode="constant") * BLOCK**2)


def _fine_structure(information: Floats, pull: Floats) -> float:
    """Mean square of second differences of second differences of 2 by 2 pixels, over their variance.

    A field that is smooth has hardly any of those. Wherever the picture is cut, it is the same.
    """
    I, p = (m[:-1, :-1] + m[1:, :-1] + m[:-1, 1:] + m[1:, 1:] for m in (information, pull))
    with np.errstate(divide="ignore", invalid="ignore"):
        variance = np.where(I > 0, 1 / I, np.nan)
    e = p * variance
    for _ in range(2):  # down, then across
        e = (e[:-4] - 2 * e[2:-2] + e[4:]).T
        variance = (variance[:-4] + 4 * variance[2:-2] + variance[4:]).T
    known = np.isfinite(variance)
    return _mean_of_kept(e[known] ** 2 / variance[known])


def _beyond_chance(squares: Array, independent: int) -> float:
    """Mean of squares of spread 1 but for a factor; 1 if it may be so by chance.

    The worst of them do not count.
    """
    if independent == 0 or len(squares) == 0:
        return 1.0
    factor = _mean_of_kept(squares)
    return factor if factor > 1 + _CHANCE * np.sqrt(2 / independent) else 1.0


def _mean_of_kept(squares: Array) -> float:
    """Mean of squares of spread 1 but for a factor, the worst left out; 1 if there are none."""
    if len(squares) == 0:
        return 1.0
    last = int(np.ceil(_KEPT * len(squares)))
    return float(np.partition(squares, last - 1)[:last].mean()) / _MEAN_OF_KEPT
