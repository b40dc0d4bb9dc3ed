"""Brightness prior: neighbors have similar brightness, so that a pixel's light determines its alpha.

In this file C is the image's light, B the plate's, l the unit direction of a line of colors, V the
variance of C − (1 − α) B and m = V⁻¹l / lᵀV⁻¹l, so that the noise of m·C is independent of that of the
equations across the line. With the brightness k of the object at a pixel

    q = m·(C − B) = α (k − m·B) + noise,    Var q = 1 / lᵀV⁻¹l,

so that a known k determines alpha where the plate is dark or of the object's own hue, and the closed
form has little information. k is the ratio that makes both agree in the mean, in cells of several sizes
and the eight around each. Its error is the scatter, beyond noise, between a cell and its neighbors; the
size of cells with the least error is used. Pixels share this error. If n pixels in the same cells need
k, and its variance is σ²,

    Var α = (Var q + α² n σ²) / (k − m·B)²,

with which n pixels together have the information of k once. The noise of q is independent of that of
the closed form, so both inform differences between pixels; only the closed form informs the mean.
"""

import numpy as np

from blurmatte.checks import Array, Floats
from blurmatte.matting.evidence import FirstEstimate
from blurmatte.matting.evidence_kernel import along
from blurmatte.matting.maps import in_strips
from blurmatte.matting.pyramid import BORDER, CellEvidence, sums_2x2, upsampled


def with_brightness(
    first: FirstEstimate, information: Floats, pull: Floats
) -> tuple[Floats, Floats]:
    """Information and pull (h, w) of the closed form with the brightness of neighbors added.

    The first estimate has a line of colors.
    """
    C, B, bias, variance = _along_line(first)
    alpha, inside = first.alpha, first.pixels.inside
    covered = inside & (alpha**2 > 3.0**2 * first.variance)  # alpha is 3 sigma above 0
    # With the closed form's alpha: a smoothed one is too small at its peaks, and k would be too large.
    own = covered * alpha * pull
    light = covered * alpha * information * (C - B) + own * B
    mean = light.sum() / max(own.sum(), 1e-30)
    if not mean > 0:
        return information, pull
    contrast = (mean - B) ** 2
    # Of k, times information and alpha²; positive where a pixel of the mean color has no information.
    noise = np.maximum(information * variance + contrast, 1e-30)
    known = covered * information * alpha**2 / noise
    k, shared = _brightness(
        CellEvidence(
            np.pad(known, BORDER),
            np.pad(mean * known + (light - mean * own) / noise, BORDER),
            np.pad(inside, BORDER),
            np.zeros_like(np.pad(known, BORDER)),
        ),
        np.pad(inside * contrast / noise, BORDER),
    )
    difference = k - B
    added = difference**2 / (variance + (alpha**2 + first.variance) * shared) * first.pixels.use
    by_light = (difference * (C - B) - (1 - alpha) * bias) / np.maximum(difference**2, 1e-30)
    kind = information.dtype
    return (information + added).astype(kind), (pull + added * by_light).astype(kind)


def _along_line(first: FirstEstimate) -> tuple[Floats, Floats, Floats, Floats]:
    """(h, w) each: m·C, m·B, m·V_B m and Var q."""
    l = first.pixels.model.basis[:, 0]
    l = l * np.sign(l.sum())
    out = np.empty((4, *first.alpha.shape), first.pixels.image.rgb.dtype)
    alpha = np.asarray(first.alpha, out.dtype)

    def rows(strip: slice) -> None:
        """Fill some rows."""
        light = (a[strip] for a in first.pixels.with_edges)
        along(*light, l, alpha[strip], out[:, strip])

    in_strips(rows, len(alpha))
    C, B, bias, variance = out
    return C, B, bias, first.noise_factor * variance


def _brightness(known: CellEvidence, need: Floats) -> tuple[Floats, Floats]:
    """(h, w) k and n σ² of each pixel, from the size of cells with the least error there.

    `known` is the evidence on k, `need` (h, w) the share of a pixel's information that k would add.
    """
    levels, needs = [known], [np.asarray(need)]
    while min(levels[-1].mask.shape) > 4 * BORDER:
        levels.append(levels[-1].coarser())
        needs.append(sums_2x2(needs[-1]))
    best = _of_size(levels[-1], needs[-1])
    for level, sharing in zip(levels[-2:0:-1], needs[-2:0:-1], strict=True):
        coarse = np.stack([upsampled(m, level.mask.shape) for m in best])
        here = _of_size(level, sharing)
        best = np.where(here[1] < coarse[1], here, coarse)
    best = np.stack([upsampled(m, known.mask.shape) for m in best])
    k, variance, n = best[:, BORDER:-BORDER, BORDER:-BORDER]
    return k, variance * np.maximum(n, 1)


def _of_size(level: CellEvidence, need: Floats) -> Floats:
    """(3, h, w) k of cells with the eight around, its variance, and how many pixels share it."""
    I, p, n = (_three_by_three(m) for m in (level.information, level.pull, need))
    I = np.maximum(I, 1e-30)
    return np.stack([p / I, _scatter(level) + 1 / I, n]).astype(level.information.dtype)


def _scatter(level: CellEvidence) -> float:
    """Variance of k between a cell and the cells around it, beyond noise."""
    own, around = level.information, _three_by_three(level.information) - level.information
    both = (own > 0) & (around > 1e-30)
    if not both.any():
        return 1e6  # no information on k
    p = level.pull
    squares = (p[both] / own[both] - (_three_by_three(p) - p)[both] / around[both]) ** 2
    noise = 1 / own[both] + 1 / around[both]
    scatter = 0.0
    for _ in range(3):  # the weights depend on the scatter
        weight = 1 / (noise + scatter)
        scatter = max(float(np.sum(weight * (squares - noise)) / np.sum(weight)), 0.0)
    return scatter


def _three_by_three(values: Floats) -> Array:
    """Sums over a cell and the eight around it."""
    from scipy.ndimage import convolve1d

    ones = np.ones(3)
    rows = convolve1d(values, ones, 0, mode="constant")
    return np.asarray(convolve1d(rows, ones, 1, mode="constant"), float)
