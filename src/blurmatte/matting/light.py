"""The light that an alpha leaves to the object.

In this file P is the premultiplied light, M (3, rank) a basis of the color model and V the noise
variance of C − (1 − α) B. Given α, the light within the model that fits best is

    P = M (MᵀV⁻¹M)⁻¹ MᵀV⁻¹ (C − (1 − α) B),    Var P = M (MᵀV⁻¹M)⁻¹ Mᵀ + (dP/dα)² Var α.
"""

import numpy as np
import numpy.typing as npt

from blurmatte.checks import Floats
from blurmatte.color import ColorModel
from blurmatte.radiometry import LinearImage

Array = npt.NDArray[np.float64]


def light_given(
    alpha: Floats, alpha_std: Floats, model: ColorModel, image: LinearImage, plate: LinearImage
) -> tuple[Array, Array, Array]:
    """P (h, w, 3), its standard deviation, and χ² of what is left; no light where alpha is 0."""
    M = model.basis
    through = (1 - np.asarray(alpha, float))[..., None]
    B = plate.rgb.astype(float)
    light = image.rgb - through * B
    weight = 1 / np.maximum(image.variance + through**2 * plate.variance, 1e-14)
    covariance = np.linalg.inv(np.einsum("ci,hwc,cj->hwij", M, weight, M))
    to_light = np.einsum("ci,hwij,dj,hwd->hwcd", M, covariance, M, weight)
    somewhere = alpha[..., None] != 0
    P = np.where(somewhere, np.einsum("hwcd,hwd->hwc", to_light, light), 0)
    slope = np.einsum("hwcd,hwd->hwc", to_light, B)
    variance = np.einsum("ci,hwij,cj->hwc", M, covariance, M) + (slope * alpha_std[..., None]) ** 2
    P_std = np.where(somewhere, np.sqrt(variance), 0)
    chi2 = np.sum((light - P) ** 2 * weight, axis=-1)
    # No light is free where nothing was; of any colors none is left where something was.
    chi2 /= np.where(alpha != 0, max(3 - model.rank, 1), 3)
    return P, P_std, chi2
