"""What a sweep and a color leave unexplained in each pixel, and its derivatives.

In this file l is the unit direction of the color, T (3, 2) two directions across it, V the noise
covariance of C − (1 − α) B, diagonal, and G that of its plate's part. Of the light P = C − (1 − α) B
nothing should lie across l: e = L⁻¹ TᵀP with LLᵀ = TᵀVT is noise of unit variance; and lᵀP may not
be more negative than noise can make it.

Both C and B are noisy. The derivative of |e|² by α is not only that of P but also that of V, which
comes to the same as replacing B by B + (1 − α) V⁻¹-weighted residuals: the best estimate of the
plate behind. Without it every sweep would be a little too large.

The same holds for l: turning it by φ towards t changes e by −φ L⁻¹Tᵀt k, where k is the light along
l, of which k̂ = lᵀV⁻¹P / lᵀV⁻¹l is a noisy estimate of variance V_k = 1 / lᵀV⁻¹l. Where the object
hardly was, that is nothing but noise, and a whole picture of it would drown what the streak says. As
k is about α times some brightness τ, its best estimate is g k̂ with g = α²τ² / (α²τ² + V_k), and its
variance g V_k. That is the same as asking, besides, for (1 − g) k̂² / V_k to be small.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from blurmatte.sweep.data import Data

Array = npt.NDArray[np.float64]

_NEGATIVE = 4.0  # standard deviations by which light may seem negative


@dataclass(frozen=True, eq=False)
class Misfit:
    """Residuals of unit variance, and their derivatives.

    Parameters
    ----------
    e : (3, h, w) float
        Two across the color, and what is too negative along it.
    by_alpha : (3, h, w) float
        Their derivatives by alpha.
    by_color : (3, h, w, 2) float
        Their derivatives by turning l towards the two directions of T.
    by_turning : (2, h, w, 2) float
        Derivatives of the first two for light of 1 along l.
    light, light_variance : (h, w) float
        k̂ and V_k.
    kept : (h, w) float
        g, the part of k̂ that is no noise.
    """

    e: Array
    by_alpha: Array
    by_color: Array
    by_turning: Array
    light: Array
    light_variance: Array
    kept: Array

    @property
    def chi2(self) -> Array:
        """(h, w) sum of squares; of two degrees of freedom where all is well."""
        return np.asarray((self.e**2).sum(axis=0))


def across(line: Array) -> Array:
    """T (3, 2), orthonormal directions across a unit vector (3,)."""
    return np.asarray(np.linalg.svd(line[:, None])[0][:, 1:])


def misfit(data: Data, alpha: Array, line: Array, T: Array) -> Misfit:
    """Residuals of a sweep's alpha (h, w) and a color's direction."""
    through = (1 - alpha)[..., None]
    P = data.C - through * data.B
    G = through**2 * data.B_variance
    V = data.C_variance + G
    t, u = T[:, 0], T[:, 1]
    # L = [[a, 0], [b, c]]
    a = np.sqrt(V @ (t * t))
    b = V @ (t * u) / a
    c = np.sqrt(V @ (u * u) - b**2)

    def whitened(x: Array, y: Array) -> tuple[Array, Array]:
        first = x / a
        return first, (y - b * first) / c

    e, f = whitened(P @ t, P @ u)
    B_e, B_f = whitened(data.B @ t, data.B @ u)
    # L⁻¹ TᵀGT L⁻ᵀ e / (1 − α): rows first, then columns.
    G_te, G_tf = whitened(G @ (t * t), G @ (t * u))
    G_ue, G_uf = whitened(G @ (t * u), G @ (u * u))
    M_ee, M_ef = whitened(G_te, G_ue)
    _, M_ff = whitened(G_tf, G_uf)
    glass = np.maximum(1 - alpha, 1e-6)
    B_e, B_f = B_e + (M_ee * e + M_ef * f) / glass, B_f + (M_ef * e + M_ff * f) / glass
    light, light_variance = light_along(P, V, line)
    kept = _kept(data, alpha, light, light_variance)
    along = P @ line
    spread = np.sqrt(V @ (line * line))
    dark = along < -_NEGATIVE * spread
    zero = np.zeros_like(e)
    turning = np.stack(
        [np.stack([-1 / a, zero], axis=-1), np.stack([b / (a * c), -1 / c], axis=-1)]
    )
    by_dark = np.where(dark, 1 / spread, 0)[..., None] * np.stack([P @ t, P @ u], axis=-1)
    return Misfit(
        np.stack([e, f, np.where(dark, along / spread + _NEGATIVE, 0)]),
        np.stack([B_e, B_f, np.where(dark, data.B @ line / spread, 0)]),
        np.concatenate([turning * (kept * light)[..., None], by_dark[None]]),
        turning,
        light,
        light_variance,
        kept,
    )


def light_along(P: Array, V: Array, line: Array) -> tuple[Array, Array]:
    """k̂ (h, w) and its variance V_k."""
    variance = 1 / ((1 / V) @ (line * line))
    return ((P / V) @ line) * variance, variance


def _kept(data: Data, alpha: Array, light: Array, light_variance: Array) -> Array:
    """g: how much of the light can be more than noise, 0…1."""
    sure = data.weight * alpha**2
    spread = np.sum(sure * np.maximum(light**2 - light_variance, 0)) / max(
        np.sum(sure * alpha**2), 1e-30
    )
    expected = alpha**2 * spread
    return np.asarray(expected / (expected + light_variance))
