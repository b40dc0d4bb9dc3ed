"""The light that an alpha leaves to the object.

In this file P is the premultiplied light, M (3, rank) a basis of the color model and V the noise
variance of C − (1 − α) B. Given α, the light within the model that fits best is

    P = M (MᵀV⁻¹M)⁻¹ MᵀV⁻¹ (C − (1 − α) B),    Var P = M (MᵀV⁻¹M)⁻¹ Mᵀ + (dP/dα)² Var α.

A clipped channel has no weight: its light is what the others make of the model, as long as there are
as many of them as the model has dimensions. One of the plate matters only where it is seen.
"""

import numpy as np
import numpy.typing as npt

from blurmatte.checks import Floats
from blurmatte.color import ColorModel
from blurmatte.matting.pixelwise import in_strips
from blurmatte.radiometry import LinearImage
from blurmatte.sweep.model.residuals import OPAQUE

Array = npt.NDArray[np.float64]


def light_given(
    alpha: Floats, alpha_std: Floats, model: ColorModel, image: LinearImage, plate: LinearImage
) -> tuple[Array, Array, Array]:
    """P (h, w, 3), its standard deviation, and χ² of what is left; no light where alpha is 0.

    Where too many channels are clipped P is 0, with an infinite standard deviation. χ² is 1 where no
    channel is left to check with.
    """
    from blurmatte.matting.light_kernel import light  # numba takes half a second

    M = np.zeros((3, 3))
    M[:, : model.rank] = model.basis
    whole = (image.valid & plate.valid).all()
    seen = np.asarray(alpha < OPAQUE)[..., None]  # of the plate
    usable = np.ones(image.rgb.shape, bool) if whole else image.usable & (plate.usable | ~seen)
    alpha, alpha_std = (np.ascontiguousarray(a, float) for a in (alpha, alpha_std))
    kind = np.result_type(image.rgb, plate.rgb)
    given = image.rgb, plate.rgb, image.variance, plate.variance
    C, B, V_C, V_B = (np.ascontiguousarray(a, kind) for a in given)
    P, P_std, chi2 = np.empty(C.shape), np.empty(C.shape), np.empty(alpha.shape)
    known = C, B, V_C, V_B, usable, alpha, alpha_std
    found = P, P_std, chi2

    def rows(strip: slice) -> None:
        light(*(m[strip] for m in known), M, model.rank, *(m[strip] for m in found))

    in_strips(rows, len(alpha))
    return found
