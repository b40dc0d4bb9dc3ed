"""The light that an alpha leaves to the object.

In this file P is the premultiplied light, M (3, rank) a basis of the color model and V the noise
variance of C − (1 − α) B. Given α, the light within the model that fits best is

    P = M (MᵀV⁻¹M)⁻¹ MᵀV⁻¹ (C − (1 − α) B),    Var P = M (MᵀV⁻¹M)⁻¹ Mᵀ + (dP/dα)² Var α.

A clipped channel has no weight: its light is what the others make of the model, as long as there are
as many of them as the model has dimensions.
"""

import numpy as np
import numpy.typing as npt

from blurmatte.checks import Floats
from blurmatte.color import ColorModel
from blurmatte.radiometry import LinearImage

Array = npt.NDArray[np.float64]

_SINGULAR = 1e-9  # of the best told dimension


def light_given(
    alpha: Floats, alpha_std: Floats, model: ColorModel, image: LinearImage, plate: LinearImage
) -> tuple[Array, Array, Array]:
    """P (h, w, 3), its standard deviation, and χ² of what is left; no light where alpha is 0.

    Where too many channels are clipped P is 0, with an infinite standard deviation. χ² is 1 where no
    channel is left to check with.
    """
    M = model.basis
    through = (1 - np.asarray(alpha, float))[..., None]
    B = plate.rgb.astype(float)
    light = image.rgb - through * B
    usable = image.usable & plate.usable
    weight = usable / np.maximum(image.variance + through**2 * plate.variance, 1e-14)
    count = np.count_nonzero(usable, axis=-1)
    information = np.einsum("ci,hwc,cj->hwij", M, weight, M)
    told = count >= model.rank
    some = told & (count < 3)
    told[some] = _invertible(information[some])
    information[~told] = np.eye(model.rank)
    covariance = np.linalg.inv(information)
    to_light = np.einsum("ci,hwij,dj,hwd->hwcd", M, covariance, M, weight)
    somewhere = alpha[..., None] != 0
    P = np.where(somewhere & told[..., None], np.einsum("hwcd,hwd->hwc", to_light, light), 0)
    slope = np.einsum("hwcd,hwd->hwc", to_light, B)
    variance = np.einsum("ci,hwij,cj->hwc", M, covariance, M) + (slope * alpha_std[..., None]) ** 2
    P_std = np.where(somewhere, np.where(told[..., None], np.sqrt(variance), np.inf), 0)
    chi2 = np.sum((light - P) ** 2 * weight, axis=-1)
    # No light is free where nothing was; of any colors none is left where something was.
    left = np.where(alpha != 0, count - model.rank, count)
    full = (count == 3) & (model.rank == 3)
    chi2 = np.where((left > 0) | full, chi2 / np.maximum(left, 1), 1)
    return P, P_std, chi2


def _invertible(information: Array) -> npt.NDArray[np.bool_]:
    """Where the channels that are left tell all of the model's dimensions."""
    values = np.linalg.eigvalsh(information)
    return np.asarray(values[..., 0] > _SINGULAR * values[..., -1])
