"""Swept: alpha from the sweep of a silhouette; what is left is the light, of the model's color."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from blurmatte.checks import Bools
from blurmatte.color import darker_pixels
from blurmatte.matting.averaging import AlphaEstimate
from blurmatte.matting.light import light_given
from blurmatte.matting.occlusion import in_front, mean_of_neighbors
from blurmatte.matting.pixelwise import PixelMaps
from blurmatte.matting.solution import Quality
from blurmatte.radiometry import LinearImage
from blurmatte.statistics import MEDIAN_3
from blurmatte.sweep import Sweep
from blurmatte.sweep.model.residuals import OPAQUE

Array = npt.NDArray[np.float64]

_PATCH = 3.0  # times the usual mean χ² over a patch: noise of 2 in 9 pixels never exceeds it
_LIT = 0.98  # of the plate's light: what has less lies in the shadow that the object casts


@dataclass(frozen=True)
class Swept:
    """Alpha from path and silhouette of the whole streak, found together with its color."""

    def __call__(
        self,
        maps: PixelMaps,
        sweep: Sweep,
        estimate: AlphaEstimate,
        image: LinearImage,
        plate: LinearImage,
        box: tuple[int, int, int, int],
    ) -> None:
        """Write the estimate into maps of the closed form, with the light that it leaves.

        Where an object of one color went and the plate is seen unchanged, something still is in front:
        alpha is that behind it, OCCLUDED, and no light is known. A patch that the sweep does not
        explain is marked MISFIT: there is a hole, a highlight, or something else. The light before the
        file blurred colors decides that. What is only darker than the plate outside the object is
        marked SHADOW too; it was not there.

        Parameters
        ----------
        maps : PixelMaps
            Of the closed form with the sweep's color; changed in place.
        sweep : Sweep
        estimate : AlphaEstimate
            Alpha in the box: the sweep's, or an average in which it has the largest weight.
        image, plate : LinearImage
            What is in the box, noise known.
        box : (int, int, int, int)
            Where to write: around streak and sweep.
        """
        place = slice(box[1], box[3]), slice(box[0], box[2])
        alpha, alpha_std = (np.asarray(x, float) for x in (estimate.alpha, estimate.alpha_std))
        lit, plate = plate, sweep.in_shadow(plate, box)
        P, P_std, chi2 = light_given(alpha, alpha_std, sweep.model, image, plate)
        before = sweep.before_file(image, plate, box)
        if before is not image:  # its light has more noise, and at rims no other color
            _, _, chi2 = light_given(alpha, alpha_std, sweep.model, before, plate)
        quality = maps.quality[place]
        saturated = (quality & np.uint8(Quality.SATURATED)) != 0
        saturated &= ~image.valid | (alpha < OPAQUE)
        given = (quality & np.uint8(Quality.OCCLUDED)) != 0
        inside = (alpha > 0) | ((quality & np.uint8(Quality.OUTSIDE)) == 0)
        # Codecs leave more of noise where something moves than beside it; shapes are asked elsewhere.
        parts = (alpha == 0) & ~inside, alpha > 0
        usual = max(_usual(chi2[part & ~saturated]) for part in parts)
        chi2 = np.where(saturated, 1, chi2 / usual)
        hidden = given
        if not given.any():
            hidden = _hidden(alpha, P, image, plate)
        P[hidden], P_std[hidden & (alpha > 0)] = 0, np.inf
        odd = ~hidden & (mean_of_neighbors(np.where(hidden, 1, chi2)) > _PATCH)
        for target, values in zip(maps, (alpha, alpha_std, P, P_std), strict=False):
            target[place][inside] = values[inside]
        flags = saturated * np.uint8(Quality.SATURATED) | (inside & odd) * np.uint8(Quality.MISFIT)
        flags |= (hidden & (alpha > 0)) * np.uint8(Quality.OCCLUDED)
        shaded = odd | np.any(plate.rgb < _LIT * lit.rgb, axis=-1)
        flags |= (inside & shaded & (alpha == 0) & darker_pixels(image, lit)) * np.uint8(
            Quality.SHADOW
        )
        quality[inside] = flags[inside]


def _hidden(alpha: Array, P: Array, image: LinearImage, plate: LinearImage) -> Bools:
    """Where something is in front of an object of light P."""
    use = image.valid & plate.valid
    weight = (alpha * use)[..., None]
    light = np.sum(weight * P, axis=(0, 1)) / max(float(np.sum(weight * alpha[..., None])), 1e-12)
    variance = np.maximum(image.variance + plate.variance, 1e-14)
    C, B = (np.asarray(picture.rgb, float) for picture in (image, plate))
    return in_front(alpha, light, C, B, np.asarray(variance, float), use)


def _usual(chi2: Array) -> float:
    """How large χ² is, 1 or more: of JPEG, no model knows the noise."""
    return max(float(np.median(chi2)) * 3 / MEDIAN_3, 1.0) if chi2.size else 1.0
