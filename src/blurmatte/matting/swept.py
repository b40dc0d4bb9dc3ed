"""Write alpha from the sweep of a silhouette; the light follows from alpha and the color model."""

import numpy as np

from blurmatte.checks import Array, Bools, Box
from blurmatte.color.shadow_test import darker_pixels
from blurmatte.matting.averaging import AlphaEstimate
from blurmatte.matting.maps import PixelMaps, Quality, has_flag
from blurmatte.matting.object_light import light_given
from blurmatte.radiometry import LinearImage
from blurmatte.radiometry.image import VARIANCE_FLOOR
from blurmatte.statistics import MEDIAN_3
from blurmatte.sweep.assess.occlusion import mean_of_neighbors, occluded
from blurmatte.sweep.model.silhouette import OPAQUE
from blurmatte.sweep.sweep import Sweep


def write_swept(
    maps: PixelMaps,
    sweep: Sweep,
    estimate: AlphaEstimate,
    image: LinearImage,
    plate: LinearImage,
    box: Box,
) -> None:
    """Write the estimate and its light into maps of the closed form.

    Occluded pixels keep their alpha and have no light. Patches that the sweep does not fit (a hole,
    a highlight) are marked MISFIT, by the light before chroma subsampling. Pixels outside the
    object that are only darker than the plate are marked SHADOW.

    maps: of the closed form with the sweep's color; changed in place.
    estimate: alpha in the box: the sweep's, or an average in which it has the largest weight.
    image, plate: within the box, noise known.
    box: around streak and sweep.
    """
    maps = maps.within(box)
    alpha, alpha_std = (np.asarray(x, float) for x in (estimate.alpha, estimate.alpha_std))
    lit, plate = plate, sweep.in_shadow(plate, box)
    P, P_std, chi2 = light_given(alpha, alpha_std, sweep.model, image, plate)
    before = sweep.before_file(image, plate, box)
    if before is not image:  # only for the test of fit: its light has more noise
        _, _, chi2 = light_given(alpha, alpha_std, sweep.model, before, plate)
    saturated = has_flag(maps.quality, Quality.SATURATED) & (~image.valid | (alpha < OPAQUE))
    hidden = has_flag(maps.quality, Quality.OCCLUDED)
    inside = (alpha > 0) | ~has_flag(maps.quality, Quality.OUTSIDE)
    # Codecs leave more noise where something moves, so χ² is relative to its typical value.
    parts = (alpha == 0) & ~inside, alpha > 0
    chi2 = np.where(saturated, 1, chi2 / max(_typical(chi2[p & ~saturated]) for p in parts))
    if not hidden.any():
        hidden = _occluded(alpha, P, image, plate)
    P[hidden], P_std[hidden & (alpha > 0)] = 0, np.inf
    # Three times the mean χ² over a patch of nine: noise in two of them never exceeds it.
    odd = ~hidden & (mean_of_neighbors(np.where(hidden, 1, chi2)) > 3.0)
    for target, values in zip(maps, (alpha, alpha_std, P, P_std), strict=False):
        target[inside] = values[inside]
    flags = saturated * np.uint8(Quality.SATURATED) | (inside & odd) * np.uint8(Quality.MISFIT)
    flags |= (hidden & (alpha > 0)) * np.uint8(Quality.OCCLUDED)
    shaded = odd | np.any(plate.rgb < 0.98 * lit.rgb, axis=-1)  # the object's own shadow
    shaded &= inside & (alpha == 0) & darker_pixels(image, lit)
    flags |= shaded * np.uint8(Quality.SHADOW)
    maps.quality[inside] = flags[inside]


def _occluded(alpha: Array, P: Array, image: LinearImage, plate: LinearImage) -> Bools:
    """Where a static object is in front of an object of light P."""
    use = image.valid & plate.valid
    weight = (alpha * use)[..., None]
    light = np.sum(weight * P, axis=(0, 1)) / max(float(np.sum(weight * alpha[..., None])), 1e-12)
    variance = np.maximum(image.variance + plate.variance, VARIANCE_FLOOR)
    C, B = (np.asarray(picture.rgb, float) for picture in (image, plate))
    return occluded(alpha, light, C, B, np.asarray(variance, float), use)


def _typical(chi2: Array) -> float:
    """Scale of reduced χ² from its median, 1 or more; no noise model describes JPEG files."""
    return max(float(np.median(chi2)) * 3 / MEDIAN_3, 1.0) if chi2.size else 1.0
