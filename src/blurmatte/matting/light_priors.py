"""Priors from light: neighbors have similar brightness, or a similar mixture of two colors.

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

Of two paints the mixture is similar. Let M (3, 2) be an orthonormal basis of a plane of colors,
q = Mᵀ(C − B), b = MᵀB, and c the color, in that basis, of the object at a pixel:

    q = α (c − b) + noise.

c has the mean c̄ and covariance Σ of its neighborhood, both weighted by α². With m = c̄ − b and
ρ² = mᵀΣm / |m|⁴

    α = m·q / |m|²,    Var α = mᵀ(Var q)m / |m|⁴ + n ρ² s²,    s = |q̄| / |m|.

The first part is the pixel's noise. The second is shared by the n pixels over which c is averaged. s
approximates alpha from the light alone, with q̄ the mean of the neighborhood: where the light is the
plate's it is 0, however little the equation across the plane determines. Where ρ exceeds 1/2 the prior
is not used.

The noise of q is independent of that of the closed form. c comes from the closed form's alpha, which
determines the mean of neighbors; where the light dominates, they share the error ρ s.
"""

import numpy as np
import scipy

from blurmatte.checks import Array, Bools, Floats
from blurmatte.matting.evidence import FirstEstimate
from blurmatte.matting.maps import in_strips
from blurmatte.matting.smooth_field import BORDER, CellEvidence, sums_2x2, upsampled

# Settings of the mixture prior.
_LIGHT_STD_PX = 2.0  # standard deviation of the Gaussian over which light is averaged
_COLOR_STD_PX = 4.0  # of that over which colors are averaged
_FAR_WEIGHT = 1e-3  # of the mean over all pixels, which counts far from the object
_MIN_ALPHA_STDS = 2.0  # by which alpha must exceed 0 to contribute its color
_MAX_SCATTER = 0.5  # largest ρ


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

    def rows(strip: slice) -> None:
        """Fill some rows."""
        C, B, V_C, V_B = (a[strip] for a in first.pixels.arrays)
        m = l / (V_C + (1 - np.asarray(first.alpha[strip], float)[..., None]) ** 2 * V_B)
        variance = 1 / (m @ l)
        m *= variance[..., None]
        out[:, strip] = *((m * x).sum(axis=-1) for x in (C, B, m * V_B)), variance

    in_strips(rows, len(first.alpha))
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
    ones = np.ones(3)
    rows = scipy.ndimage.convolve1d(values, ones, 0, mode="constant")
    return np.asarray(scipy.ndimage.convolve1d(rows, ones, 1, mode="constant"), float)


def with_mixture(
    first: FirstEstimate, information: Floats, pull: Floats
) -> tuple[Floats, Floats, Floats]:
    """Information and pull (h, w) of the closed form with the mixture of neighbors added.

    The first estimate has a plane of colors. Returns also the variance (h, w) that neighbors share.
    """
    pixels, kind = first.pixels, information.dtype
    M, inside = pixels.model.basis, pixels.inside
    C, B, V_C, V_B = (np.asarray(a, float) for a in pixels.arrays)
    q, b = ((C - B) * pixels.use[..., None]) @ M, B @ M
    V = first.noise_factor * (V_C + (1 - first.alpha[..., None]) ** 2 * V_B) @ M**2
    alpha = np.clip(first.alpha, 0, 1).astype(float)
    alpha[~pixels.use | (alpha**2 < _MIN_ALPHA_STDS**2 * first.variance)] = 0
    if not alpha.any():
        return information, pull, np.zeros_like(information)
    used = np.maximum(_smoothed(1.0 * pixels.use, _LIGHT_STD_PX), 1e-12)
    around = _smoothed(q, _LIGHT_STD_PX) / used[..., None]
    color, scatter = _colors(alpha, (alpha > 0)[..., None] * (alpha[..., None] * b + around))
    m = color - b
    contrast = np.maximum(np.sum(m**2, axis=-1), 1e-12)
    spread = np.einsum("yxi,yxij,yxj->yx", m, scatter, m) / contrast**2
    size = np.sum(around**2, axis=-1) / contrast
    sharing = 4 * np.pi * _LIGHT_STD_PX**2  # effective number of pixels in an average
    variance = np.sum(m**2 * V, axis=-1) / contrast**2 + sharing * spread * size
    added = (pixels.use & (spread < _MAX_SCATTER**2)) / np.maximum(variance, 1e-12)
    share = _smoothed(added, _COLOR_STD_PX)
    share /= np.maximum(share + _smoothed(information, _COLOR_STD_PX), 1e-12)
    shared = inside * share**2 * np.minimum(spread, 1) * size
    by_light = np.sum(m * q, axis=-1) / contrast
    maps = information + added, pull + added * by_light, shared
    information, pull, shared = (values.astype(kind) for values in maps)
    return information, pull, shared


def _colors(alpha: Array, light: Array) -> tuple[Array, Array]:
    """(h, w, 2) mean color of each neighborhood, (h, w, 2, 2) its covariance; of light, α c."""
    products = light[..., :, None] * light[..., None, :]
    weight, first, second = (
        _smoothed(m, _COLOR_STD_PX) + _FAR_WEIGHT * m.mean((0, 1))
        for m in (alpha**2, alpha[..., None] * light, products)
    )
    color = first / weight[..., None]
    return color, second / weight[..., None, None] - color[..., :, None] * color[..., None, :]


def _smoothed(values: Floats | Bools, std_px: float) -> Array:
    """Gaussian means over neighborhoods of pixels."""
    stds = (std_px, std_px) + (0,) * (values.ndim - 2)
    return np.asarray(scipy.ndimage.gaussian_filter(np.asarray(values, float), stds))
