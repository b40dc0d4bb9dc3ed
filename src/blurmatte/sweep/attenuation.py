"""Attenuation: how much of the plate's texture is seen through a sweep of an object of any colors.

In this file C is the image's linear light, B the plate's, α the sweep's alpha, P = C − (1 − α) B what
it leaves to the object, V its variance, p and b are the fine structure of P and B: all but α are of
each channel, (h, w, 3). Where α is off by δ the plate is seen in P, and p = −δ b but for what is
painted on the object, which has nothing to do with the plate. So over a place, with weights G,

    δ = −Σ G p·b/V / Σ G b·b/V,    Var δ = Σ G² (p b/V)² / (Σ G b·b/V)²,

less what noise of the plate feigns, which is in both. The variance is that of products of what is
there: of noise and of paint alike. So much is told whatever the colors are, and however fine: nothing
is fitted to them that could take up the plate instead.

Each place counts by 1 / (Var δ + τ² α²): without a scatter τ by which places are taken to differ, the
few strongest edges of a plate speak for all of the streak.
"""

import numpy as np
import numpy.typing as npt

from blurmatte.sweep.data import Data
from blurmatte.sweep.descent import State, light_of

Array = npt.NDArray[np.float64]

_FINE = 1.5  # pixels: what is finer is fine structure, of which smeared paint has little
_PLACE = 3.0  # places to a radius
_OWN = 1 - 1 / (4 * np.pi * _FINE**2)  # of a pixel's own noise, what is fine
_LEAST = 1e-6  # information of alpha that is any
_TINY = 1e-18


def attenuation(data: Data, state: State, scatter: float = 0.0) -> float:
    """By how much alpha of places is off, of alpha: root mean square, noise and paint included.

    Places are taken to differ by a scatter, of alpha. Infinite if nothing tells.
    """
    alpha = state.swept.alpha
    a = alpha[..., None]
    C, B, V_C, V_B = light_of(data)
    V = V_C + (1 - a) ** 2 * V_B + _TINY
    p, b = (_fine(light, _FINE) for light in (C - (1 - a) * B, B))
    use = (alpha > 0) & data.valid
    by_noise = use[..., None] * _OWN * V_B / V
    both = use[..., None] * p * b / V
    told = (use[..., None] * b**2 / V - by_noise).sum(axis=-1)
    size = max(float(state.shape[0]) / (_PLACE * data.scale), 1.0)
    information = _around(told, size)
    off = _around((both + (1 - a) * by_noise).sum(axis=-1), size)
    variance = _around((both**2).sum(axis=-1), size / np.sqrt(2)) / (4 * np.pi * size**2)
    usual = _around(alpha, size) / np.maximum(_around((alpha > 0).astype(float), size), _TINY)
    known = use & (information > _LEAST) & (variance > 0)
    if not known.any():
        return np.inf
    off, usual, information, variance = (m[known] for m in (off, usual, information, variance))
    counts = 1 / (variance + (scatter * usual * information) ** 2)
    return float(np.sqrt(np.sum(counts * off**2) / np.sum(counts * (usual * information) ** 2)))


def structure(data: Data) -> float:
    """Of the plate within the streak, finer than light of any colors changes: over its noise, RMS."""
    within = data.streak & data.valid
    fine = _fine(data.B, data.pitch / 2)[within]
    return float(np.sqrt(np.mean(fine**2) / max(data.B_variance[within].mean(), _TINY)))


def _fine(light: Array, width: float) -> Array:
    """What is finer than a Gaussian so many pixels wide."""
    from scipy.ndimage import gaussian_filter

    return np.asarray(light - gaussian_filter(light, (width, width, 0)))


def _around(values: Array, size: float) -> Array:
    """Means by a Gaussian."""
    from scipy.ndimage import gaussian_filter

    return np.asarray(gaussian_filter(values, size))
