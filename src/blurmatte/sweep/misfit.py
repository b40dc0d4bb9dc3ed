"""What a sweep and a color leave unexplained in each pixel, and its derivatives.

In this file l is the unit direction of the color, T (3, 2) two directions across it, V the noise
covariance of C − (1 − α) B, diagonal, and G that of its plate's part. Of the light P = C − (1 − α) B
nothing should lie across l: e = L⁻¹ TᵀP with LLᵀ = TᵀVT is noise of unit variance; and lᵀP may not
be more negative than noise can make it.

Both C and B are noisy. The derivative of |e|² by α is not only that of P but also that of V, which
comes to the same as replacing B by B + (1 − α) V⁻¹-weighted residuals: the best estimate of the
plate behind. Without it every sweep would be a little too large. The same holds for l, where lᵀP is
replaced by its best estimate given e.
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
    """

    e: Array
    by_alpha: Array
    by_color: Array

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
    along = P @ line
    k_e, k_f = whitened(V @ (t * line), V @ (u * line))
    light = along - k_e * e - k_f * f
    spread = np.sqrt(V @ (line * line))
    dark = along < -_NEGATIVE * spread
    zero = np.zeros_like(e)
    return Misfit(
        np.stack([e, f, np.where(dark, along / spread + _NEGATIVE, 0)]),
        np.stack([B_e, B_f, np.where(dark, data.B @ line / spread, 0)]),
        np.stack(
            [
                np.stack([-light / a, zero], axis=-1),
                np.stack([b * light / (a * c), -light / c], axis=-1),
                np.where(dark, 1 / spread, 0)[..., None] * np.stack([P @ t, P @ u], axis=-1),
            ]
        ),
    )
