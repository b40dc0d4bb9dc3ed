"""One clipped channel: what the two others say of a pixel, if its colors form a line.

In this file C is the image's light, B the plate's, l the unit direction of the line of colors, and i, j
the channels that are not clipped. Of the two equations of a line one is left, that of the normal m in
the plane of i and j, m ∝ (−l_j, l_i):

    m (B − C) = α m B,      α = m (B − C) / m B,      Var α = s² / (m B)²,

with s² = Σ m² (σ_C² + (1 − α)² σ_B²). The light follows in the clipped channel as well, for it is k l,

    k = (C_i B_j − C_j B_i) / (l_i B_j − l_j B_i).

Of a plane of colors no equation is left, and nothing is there to check a line with.
"""

import numpy as np
import numpy.typing as npt

from blurmatte.checks import Bools, Floats
from blurmatte.color import ColorModel
from blurmatte.matting.pixelwise import LEAST_VARIANCE, PixelMaps
from blurmatte.matting.solution import Quality
from blurmatte.radiometry import LinearImage

_SIGMAS_OUT = 3.0
_UNTOLD = 1e-6  # of white: a plate no further off the line of colors tells nothing


def one_clipped(image: LinearImage, plate: LinearImage) -> Bools:
    """(H, W) True where exactly one channel of a pixel is clipped, in the image or the plate."""
    two_left = np.count_nonzero(image.usable & plate.usable, axis=-1) == 2
    return np.asarray(two_left)


def solve_clipped(
    maps: PixelMaps, image: LinearImage, plate: LinearImage, model: ColorModel, max_alpha_std: float
) -> None:
    """Write alpha and light of the pixels with one clipped channel into maps of the closed form.

    Parameters
    ----------
    maps : PixelMaps
        Changed in place; the bit SATURATED stays.
    image, plate : LinearImage
        Noise known.
    model : ColorModel
        A line of colors; of others nothing is written.
    max_alpha_std : float
        A pixel whose alpha is less certain is marked PLATE_IN_MODEL.
    """
    if model.rank != 1 or (image.valid & plate.valid).all():
        return
    where = one_clipped(image, plate)
    free = (maps.quality & np.uint8(Quality.OCCLUDED)) == 0
    y, x = np.nonzero(where & free)
    left = (image.usable & plate.usable)[y, x]
    pair = np.nonzero(left)[1].reshape(-1, 2)  # the channels i, j of each pixel

    def two(values: Floats) -> npt.NDArray[np.float64]:
        return np.take_along_axis(values[y, x].astype(float), pair, axis=1)

    C, B = two(image.rgb), two(plate.rgb)
    vC, vB = two(image.variance) + LEAST_VARIANCE, two(plate.variance) + LEAST_VARIANCE
    l = model.basis[:, 0][pair]
    m = np.stack([-l[:, 1], l[:, 0]], axis=1)
    mB = np.sum(m * B, axis=1)
    mB = np.where(np.abs(mB) > _UNTOLD, mB, np.nan)
    alpha = np.sum(m * (B - C), axis=1) / mB
    through = (1 - np.clip(alpha, 0, 1))[:, None]
    variance = vC + through**2 * vB
    alpha_std = np.sqrt(np.sum(m**2 * variance, axis=1)) / np.abs(mB)
    k = (C[:, 0] * B[:, 1] - C[:, 1] * B[:, 0]) / mB
    k_std = np.sqrt(np.sum(B[:, ::-1] ** 2 * variance, axis=1)) / np.abs(mB)
    _write(maps, (y, x), alpha, alpha_std, np.outer(k, model.basis[:, 0]),
           np.outer(k_std, np.abs(model.basis[:, 0])), max_alpha_std)  # fmt: skip


def _write(
    maps: PixelMaps,
    at: tuple[npt.NDArray[np.intp], npt.NDArray[np.intp]],
    alpha: Floats,
    alpha_std: Floats,
    P: Floats,
    P_std: Floats,
    max_alpha_std: float,
) -> None:
    told = np.isfinite(alpha)
    at = at[0][told], at[1][told]
    values = alpha[told], alpha_std[told], P[told], P_std[told]
    for target, some in zip(maps, values, strict=False):
        target[at] = some
    a, std = values[:2]
    beyond = np.abs(a - 0.5) > 0.5 + _SIGMAS_OUT * std
    kept = maps.quality[at] & np.uint8(Quality.SATURATED | Quality.OUTSIDE)
    maps.quality[at] = (
        kept
        | (std > max_alpha_std) * np.uint8(Quality.PLATE_IN_MODEL)
        | beyond * np.uint8(Quality.OUT_OF_RANGE)
    )
