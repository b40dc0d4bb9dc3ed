"""Light of the object, given alpha.

In this file P is the premultiplied light, M (3, rank) a basis of the color model and V the noise
variance of C − (1 − α) B. The light within the model that fits best is

    P = M (MᵀV⁻¹M)⁻¹ MᵀV⁻¹ (C − (1 − α) B),    Var P = M (MᵀV⁻¹M)⁻¹ Mᵀ + (dP/dα)² Var α.

A clipped channel has no weight: its light follows from the other channels and the model, if at least
as many channels remain as the model has dimensions. A clipped plate matters only where it is visible.
"""

import numpy as np

from blurmatte.checks import Array, Floats
from blurmatte.color.model import ColorModel
from blurmatte.matting.maps import in_strips
from blurmatte.radiometry import LinearImage
from blurmatte.sweep.model.silhouette import OPAQUE


def light_given(
    alpha: Floats, alpha_std: Floats, model: ColorModel, image: LinearImage, plate: LinearImage
) -> tuple[Array, Array, Array]:
    """P (h, w, 3), its standard deviation, and reduced χ² (h, w) of the residuals.

    P is 0 where alpha is 0. Where too many channels are clipped P is 0 with an infinite standard
    deviation. χ² is 1 where no degree of freedom remains.
    """
    from blurmatte.matting.object_light_kernel import light  # numba takes half a second

    M = np.zeros((3, 3))
    M[:, : model.rank] = model.basis
    whole = (image.valid & plate.valid).all()
    visible = np.asarray(alpha < OPAQUE)[..., None]  # the plate
    usable = np.ones(image.rgb.shape, bool) if whole else image.usable & (plate.usable | ~visible)
    alpha, alpha_std = (np.ascontiguousarray(a, float) for a in (alpha, alpha_std))
    kind = np.result_type(image.rgb, plate.rgb)
    given = image.rgb, plate.rgb, image.variance, plate.variance
    C, B, V_C, V_B = (np.ascontiguousarray(a, kind) for a in given)
    P, P_std, chi2 = np.empty(C.shape), np.empty(C.shape), np.empty(alpha.shape)
    known = C, B, V_C, V_B, usable, alpha, alpha_std
    found = P, P_std, chi2

    def rows(strip: slice) -> None:
        """Fill some rows."""
        light(tuple(m[strip] for m in known), M, model.rank, tuple(m[strip] for m in found))

    in_strips(rows, len(alpha))
    return found
