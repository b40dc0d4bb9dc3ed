"""Mixture prior: neighbors have a similar mixture of two colors, so that light determines alpha.

In this file C is the image's light, B the plate's, M (3, 2) an orthonormal basis of a plane of colors,
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

from blurmatte.checks import Array, Bools, Floats
from blurmatte.matting.evidence import FirstEstimate

# Settings of the mixture prior.
_LIGHT_STD_PX = 2.0  # standard deviation of the Gaussian over which light is averaged
_COLOR_STD_PX = 4.0  # of that over which colors are averaged
_FAR_WEIGHT = 1e-3  # of the mean over all pixels, which counts far from the object
_MIN_ALPHA_STDS = 2.0  # by which alpha must exceed 0 to contribute its color
_MAX_SCATTER = 0.5  # largest ρ


def with_mixture(
    first: FirstEstimate, information: Floats, pull: Floats
) -> tuple[Floats, Floats, Floats]:
    """Information and pull (h, w) of the closed form with the mixture of neighbors added.

    The first estimate has a plane of colors. Returns also the variance (h, w) that neighbors share.
    """
    pixels, kind = first.pixels, information.dtype
    M, inside = pixels.model.basis, pixels.inside
    C, B, V_C, V_B = (np.asarray(a, float) for a in pixels.with_edges)
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
    from scipy.ndimage import gaussian_filter

    stds = (std_px, std_px) + (0,) * (values.ndim - 2)
    return np.asarray(gaussian_filter(np.asarray(values, float), stds))
