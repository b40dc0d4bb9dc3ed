"""Mixtures of two colors: neighbors have about the same, so that the light of a pixel tells its alpha.

In this file C is the image's light, B the plate's, M (3, 2) an orthonormal basis of a plane of colors,
q = Mᵀ(C − B), b = MᵀB, and c the color, in that basis, of what covered a pixel:

    q = α (c − b) + noise.

c is about that of the neighborhood: of its mean c̄ and covariance Σ, both weighted by α². So with
m = c̄ − b and ρ² = mᵀΣm / |m|⁴

    α = m·q / |m|²,    Var α = mᵀ(Var q)m / |m|⁴ + n ρ² s²,    s = |q̄| / |m|,

of which the first part is noise of the pixel, and n pixels err alike by the second: all over which c is
averaged. s is about alpha, but from the light alone, q̄ that of the neighborhood: where it is that of
the plate nothing was, however little the equation across the plane knows. Where c scatters over half
of the way to the plate's color nothing is told.

The noise of q is none of the closed form's, and c comes from its alpha: what neighbors have in common
is told by that. By ρ s they may all be off where the light tells most.
"""

import numpy as np
import numpy.typing as npt

from blurmatte.checks import Bools, Floats
from blurmatte.matting.shading import Told

Array = npt.NDArray[np.float64]

_NEAR = 2.0  # pixels, standard deviation of the neighborhoods that light is averaged over
_NEIGHBORHOOD = 2 * _NEAR  # of those that tell what a mixture is
_ALIKE = 4 * np.pi * _NEAR**2  # pixels that count in such an average
_ALL = 1e-3  # weight of all pixels together beside a neighborhood's: far from the object there are none
_SURE = 2.0  # standard deviations of alpha: there is something whose color can be told
_MOST = 0.5  # of the way from the plate's color, by which colors may scatter
_TINY = 1e-12


def with_mixture(told: Told, information: Floats, pull: Floats) -> tuple[Floats, Floats, Floats]:
    """Information and pull of each pixel, and what its light tells more.

    Parameters
    ----------
    told : Told
        Of a plane of colors.
    information, pull : (h, w) float
        Of the closed form.

    Returns
    -------
    information, pull : (h, w) float
    shared : (h, w) float
        Variance that neighbors have in common.
    """
    pixels, kind = told.pixels, information.dtype
    M, inside = pixels.model.basis, pixels.inside
    C, B, V_C, V_B = (np.asarray(a, float) for a in pixels.with_edges)
    q, b = ((C - B) * pixels.use[..., None]) @ M, B @ M
    V = told.weaker * (V_C + (1 - told.alpha[..., None]) ** 2 * V_B) @ M**2
    alpha = np.clip(told.alpha, 0, 1).astype(float)
    alpha[~pixels.use | (alpha**2 < _SURE**2 * told.variance)] = 0
    if not alpha.any():
        return information, pull, np.zeros_like(information)
    around = _smoothed(q, _NEAR) / np.maximum(_smoothed(1.0 * pixels.use, _NEAR), _TINY)[..., None]
    color, scatter = _colors(alpha, (alpha > 0)[..., None] * (alpha[..., None] * b + around))
    m = color - b
    apart = np.maximum(np.sum(m**2, axis=-1), _TINY)
    spread = np.einsum("yxi,yxij,yxj->yx", m, scatter, m) / apart**2
    size = np.sum(around**2, axis=-1) / apart
    variance = np.sum(m**2 * V, axis=-1) / apart**2 + _ALIKE * spread * size
    more = (pixels.use & (spread < _MOST**2)) / np.maximum(variance, _TINY)
    share = _smoothed(more, _NEIGHBORHOOD)
    share /= np.maximum(share + _smoothed(information, _NEIGHBORHOOD), _TINY)
    shared = inside * share**2 * np.minimum(spread, 1) * size
    alone = np.sum(m * q, axis=-1) / apart
    return (
        (information + more).astype(kind),
        (pull + more * alone).astype(kind),
        shared.astype(kind),
    )


def _colors(alpha: Array, light: Array) -> tuple[Array, Array]:
    """(h, w, 2) mean color of each neighborhood, (h, w, 2, 2) its covariance; of light, α c."""
    products = light[..., :, None] * light[..., None, :]
    sums = [alpha**2, alpha[..., None] * light, products]
    weight, first, second = (_smoothed(m, _NEIGHBORHOOD) + _ALL * m.mean(axis=(0, 1)) for m in sums)
    color = first / weight[..., None]
    return color, second / weight[..., None, None] - color[..., :, None] * color[..., None, :]


def _smoothed(values: Floats | Bools, size: float) -> Array:
    """Of each neighborhood of pixels, the mean."""
    from scipy.ndimage import gaussian_filter

    sizes = (size, size) + (0,) * (values.ndim - 2)
    return np.asarray(gaussian_filter(np.asarray(values, float), sizes))
