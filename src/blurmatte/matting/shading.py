"""Shading: neighbors are about as bright, so that the light of a pixel tells its alpha.

In this file C is the image's light, B the plate's, l the unit direction of a line of colors, V the
variance of C − (1 − α) B and m = V⁻¹l / lᵀV⁻¹l, so that the noise of m·C is independent of that of the
equations across the line. With the brightness k of what covered a pixel

    q = m·(C − B) = α (k − m·B) + noise,    Var q = 1 / lᵀV⁻¹l,

so that a known k tells alpha, where the plate is dark, or of the object's own hue, and the closed form
knows little, and again where that knows much. k is what makes both tell the same alpha in the mean, in
cells of many sizes and the eight around them. By how much it differs there between a cell and its
neighbors, beyond noise, is the error of saying so of places between: of all sizes that with the least
error counts. Pixels err alike by it. With n of them in want of it within the same cells, and σ² its
variance,

    Var α = (Var q + α² n σ²) / (k − m·B)²

of which n pixels together know as much as k does, and not more. The noise of q is none of the closed
form's, so the differences between pixels are told twice; what they have in common is told by the closed
form, and through k by nothing else.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from blurmatte.checks import Floats
from blurmatte.matting.evidence import Pixels
from blurmatte.matting.pixelwise import in_strips
from blurmatte.matting.smooth_prior import (
    BORDER,
    Evidence,
    in_larger_cells,
    map_in_smaller_cells,
)

Array = npt.NDArray[np.float64]

_TINY = 1e-30
_UNKNOWN = 1e6  # variance of k: nothing is known
_SURE = 3.0  # standard deviations of alpha: there is something whose brightness can be told
_ROUNDS = 3  # to weigh cells by what they scatter


@dataclass(frozen=True, eq=False)
class Told:
    """What is known before the shading.

    Parameters
    ----------
    pixels : Pixels
    alpha, variance : (h, w) float
        About what alpha is, and how well that is known.
    weaker : float
        Times the noise's variance.
    """

    pixels: Pixels
    alpha: Floats
    variance: Floats
    weaker: float

    def along(self) -> tuple[Floats, Floats, Floats, Floats]:
        """(h, w) each: m·C, m·B, m·V_B m and Var q, of a line of colors."""
        from blurmatte.matting.evidence_kernel import along  # numba takes half a second

        l = self.pixels.model.basis[:, 0]
        l = l * np.sign(l.sum())
        out = np.empty((4, *self.alpha.shape), self.pixels.image.rgb.dtype)
        alpha = np.asarray(self.alpha, out.dtype)

        def rows(strip: slice) -> None:
            light = (a[strip] for a in self.pixels.with_edges)
            along(*light, l, alpha[strip], out[:, strip])

        in_strips(rows, len(alpha))
        C, B, feigned, variance = out
        return C, B, feigned, self.weaker * variance


def with_shading(told: Told, information: Floats, pull: Floats) -> tuple[Floats, Floats]:
    """Information and pull of each pixel, and what its light tells more.

    Parameters
    ----------
    told : Told
        Of a line of colors.
    information, pull : (h, w) float
        Of the closed form.
    """
    C, B, feigned, variance = told.along()
    alpha, inside = told.alpha, told.pixels.inside
    sure = inside & (alpha**2 > _SURE**2 * told.variance)
    # With the closed form's alpha: one that is smooth would be smaller at its peaks, and k too large.
    agreed = sure * alpha * pull
    light = sure * alpha * information * (C - B) + agreed * B
    usual = light.sum() / max(agreed.sum(), _TINY)
    if not usual > 0:
        return information, pull
    apart = (usual - B) ** 2
    noise = information * variance + apart  # of k, times information and alpha²
    known = sure * information * alpha**2 / noise
    k, shared = _brightness(
        Evidence(
            np.pad(known, BORDER),
            np.pad(usual * known + (light - usual * agreed) / noise, BORDER),
            np.pad(inside, BORDER),
            np.zeros_like(np.pad(known, BORDER)),
        ),
        np.pad(inside * apart / noise, BORDER),
    )
    apart = k - B
    more = apart**2 / (variance + (alpha**2 + told.variance) * shared) * told.pixels.use
    alone = (apart * (C - B) - (1 - alpha) * feigned) / np.maximum(apart**2, _TINY)
    kind = information.dtype
    return (information + more).astype(kind), (pull + more * alone).astype(kind)


def _brightness(known: Evidence, needy: Floats) -> tuple[Floats, Floats]:
    """Of each pixel k, and n σ²: of all sizes of cells those with the least error there."""
    levels, wanting = [known], [np.asarray(needy)]
    while min(levels[-1].mask.shape) > 4 * BORDER:
        levels.append(levels[-1].coarser())
        wanting.append(in_larger_cells(wanting[-1]))
    best = _of_size(levels[-1], wanting[-1])
    for level, sharing in zip(levels[-2:0:-1], wanting[-2:0:-1], strict=True):
        coarse = np.stack([map_in_smaller_cells(m, level.mask.shape) for m in best])
        here = _of_size(level, sharing)
        best = np.where(here[1] < coarse[1], here, coarse)
    best = np.stack([map_in_smaller_cells(m, known.mask.shape) for m in best])
    k, variance, n = best[:, BORDER:-BORDER, BORDER:-BORDER]
    return k, variance * np.maximum(n, 1)


def _of_size(level: Evidence, needy: Floats) -> Floats:
    """(3, h, w) k in and around cells, the variance of what it is in one, and how many share it."""
    I, p, n = (_three_by_three(m) for m in (level.information, level.pull, needy))
    I = np.maximum(I, _TINY)
    return np.stack([p / I, _scatter(level) + 1 / I, n]).astype(level.information.dtype)


def _scatter(level: Evidence) -> float:
    """By how much, squared, k of a cell is another than that of the cells around it."""
    own, around = level.information, _three_by_three(level.information) - level.information
    both = (own > 0) & (around > _TINY)
    if not both.any():
        return _UNKNOWN
    p = level.pull
    apart = (p[both] / own[both] - (_three_by_three(p) - p)[both] / around[both]) ** 2
    noise = 1 / own[both] + 1 / around[both]
    scatter = 0.0
    for _ in range(_ROUNDS):
        weight = 1 / (noise + scatter)
        scatter = max(float(np.sum(weight * (apart - noise)) / np.sum(weight)), 0.0)
    return scatter


def _three_by_three(values: Floats) -> Array:
    from scipy.ndimage import convolve1d

    ones = np.ones(3)
    rows = convolve1d(values, ones, 0, mode="constant")
    return np.asarray(convolve1d(rows, ones, 1, mode="constant"), float)
