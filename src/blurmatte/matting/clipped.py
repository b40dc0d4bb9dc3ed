"""Pixels with one clipped channel: alpha from the two others, if the colors form a line.

In this file C is the image's light, B the plate's, l the unit direction of the line of colors, and i, j
the channels that are not clipped. Of the two equations of a line one remains, that of the normal m in
the plane of i and j, m ∝ (−l_j, l_i):

    m (B − C) = α m B,      α = m (B − C) / m B,      Var α = s² / (m B)²,

with s² = Σ m² (σ_C² + (1 − α)² σ_B²). The light is k l in all channels, the clipped one included, with

    k = (C_i B_j − C_j B_i) / (l_i B_j − l_j B_i).

A plane of colors has no equation left. For a line, none remains to test the fit.
"""

import numpy as np

from blurmatte.checks import Array, Bools, Floats
from blurmatte.color.model import ColorModel
from blurmatte.matting.maps import MIN_VARIANCE, PixelMaps, Quality, alpha_flags, has_flag
from blurmatte.radiometry import LinearImage


def one_clipped(image: LinearImage, plate: LinearImage) -> Bools:
    """(H, W) True where exactly one channel of a pixel is clipped, in the image or the plate."""
    two_left = np.count_nonzero(image.usable & plate.usable, axis=-1) == 2
    return np.asarray(two_left)


def solve_clipped(
    maps: PixelMaps, image: LinearImage, plate: LinearImage, model: ColorModel, max_alpha_std: float
) -> None:
    """Write alpha and light of pixels with one clipped channel into maps of the closed form.

    maps: changed in place; the bit SATURATED stays.
    image, plate: noise known.
    model: a line of colors; for others nothing is written.
    max_alpha_std: a pixel with a larger standard deviation of alpha is marked PLATE_IN_MODEL.
    """
    if model.rank != 1 or (image.valid & plate.valid).all():
        return
    y, x = np.nonzero(one_clipped(image, plate) & ~has_flag(maps.quality, Quality.OCCLUDED))
    unclipped = (image.usable & plate.usable)[y, x]
    pair = np.nonzero(unclipped)[1].reshape(-1, 2)  # the channels i, j of each pixel

    def two(values: Floats) -> Array:
        """(n, 2) values of the channels that are not clipped."""
        return np.take_along_axis(values[y, x].astype(float), pair, axis=1)

    C, B = two(image.rgb), two(plate.rgb)
    vC, vB = two(image.variance) + MIN_VARIANCE, two(plate.variance) + MIN_VARIANCE
    l = model.basis[:, 0][pair]
    m = np.stack([-l[:, 1], l[:, 0]], axis=1)
    mB = np.sum(m * B, axis=1)
    mB = np.where(np.abs(mB) > 1e-6, mB, np.nan)  # a plate on the line of colors: no information
    alpha = np.sum(m * (B - C), axis=1) / mB
    through = (1 - np.clip(alpha, 0, 1))[:, None]
    variance = vC + through**2 * vB
    alpha_std = np.sqrt(np.sum(m**2 * variance, axis=1)) / np.abs(mB)
    k = (C[:, 0] * B[:, 1] - C[:, 1] * B[:, 0]) / mB
    k_std = np.sqrt(np.sum(B[:, ::-1] ** 2 * variance, axis=1)) / np.abs(mB)
    color = model.basis[:, 0]
    known = np.isfinite(alpha)
    at = y[known], x[known]
    values = alpha, alpha_std, np.outer(k, color), np.outer(k_std, np.abs(color))
    for target, some in zip(maps, values, strict=False):
        target[at] = some[known]
    kept = maps.quality[at] & np.uint8(Quality.SATURATED | Quality.OUTSIDE)
    maps.quality[at] = kept | alpha_flags(alpha[known], alpha_std[known], max_alpha_std)
