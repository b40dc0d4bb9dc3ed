"""Swept: alpha from the sweep of a silhouette; what is left is the light, of the model's color."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from blurmatte.checks import Bools, Floats
from blurmatte.color import darker
from blurmatte.matting.light import light_given
from blurmatte.matting.pixelwise import PixelMaps
from blurmatte.matting.solution import Quality
from blurmatte.radiometry import LinearImage
from blurmatte.sweep import MAX_MISFIT, Sweep
from blurmatte.sweep.occluder import in_front, mean_of_neighbors
from blurmatte.sweep.verdict import OPAQUE

Array = npt.NDArray[np.float64]

_PATCH = 3.0  # times the usual mean χ² over a patch: noise of 2 in 9 pixels never exceeds it
_UNSOUND = np.uint8(Quality.PLATE_IN_MODEL | Quality.OUT_OF_RANGE | Quality.MISFIT)
_SURE = 0.1  # standard deviation of an alpha that may stand against that of the whole sweep
_ANOTHER = 0.5  # of the sweep's alpha: what differs by less may be in another light
_REACH = 3.0  # standard deviations of how far a file let colors run
_HALF_LIT = 0.6  # of the object's light: what has less lies in a shadow, what has more is no hole
_LIT = 0.98  # of the plate's light: what has less lies in the shadow that the object casts
_MEDIAN = 2.366  # of χ² of three


@dataclass(frozen=True)
class Swept:
    """Alpha from path and silhouette of the whole smear, found together with its color.

    Parameters
    ----------
    max_misfit : float
        How much more than noise the residuals within the streak may hang together: a sweep that
        leaves more does not explain the streak. 1 is perfect.

    Raises
    ------
    ValueError
        If `max_misfit` is below 1.
    """

    max_misfit: float = MAX_MISFIT

    def __post_init__(self) -> None:
        if not self.max_misfit >= 1:
            raise ValueError(f"max_misfit must be 1 or more, got {self.max_misfit}")

    def __call__(
        self,
        maps: PixelMaps,
        sweep: Sweep,
        image: LinearImage,
        plate: LinearImage,
        box: tuple[int, int, int, int],
    ) -> Bools:
        """Write the sweep's answer into maps of the closed form, where it explains the pixel.

        Whether it does is asked of colors as they were before a file let them run together. Where an
        object of one color went and the plate is seen unchanged, something still is in front:
        alpha is that behind it, OCCLUDED, and no light is known. Another patch that the sweep does not
        explain is marked MISFIT: there is a hole, a highlight, or something else. It stays as the
        pixels alone say, if most of them are explained by the object's color with an alpha of their own
        that is more than half more, or less than half, and with as much more or less light; others may
        as well be in another light. What is only darker beside the object is marked SHADOW too; it was
        not there. A shadow that was told with the sweep darkens the plate before which it is asked.

        Parameters
        ----------
        maps : PixelMaps
            Of the closed form with the sweep's color; changed in place.
        sweep : Sweep
        image, plate : LinearImage
            What is in the box, noise known.
        box : (int, int, int, int)
            Where to write: around streak and sweep.

        Returns
        -------
        (h, w) bool
            Where in the box the pixels were left as they are.
        """
        place = slice(box[1], box[3]), slice(box[0], box[2])
        alpha, alpha_std = sweep.within(box)
        lit, plate = plate, sweep.in_shadow(plate, box)
        P, P_std, chi2 = light_given(alpha, alpha_std, sweep.model, image, plate)
        before = sweep.before_bleeding(image, plate, box)
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
        if sweep.model.rank == 1 and not given.any():
            hidden = _hidden(alpha, P, image, plate)
        P[hidden], P_std[hidden & (alpha > 0)] = 0, np.inf
        odd = ~hidden & (mean_of_neighbors(np.where(hidden, 1, chi2)) > _PATCH)
        other_light = _in_other_light(alpha, P, maps.alpha[place], maps.premultiplied[place])
        sure = (quality & _UNSOUND) == 0
        sure &= ~other_light & (maps.alpha_std[place] < _SURE)
        off = _off(maps.alpha[place], alpha, _REACH * sweep.runs_by(image))
        sure &= off > np.maximum(3 * maps.alpha_std[place], _ANOTHER * alpha)
        ours = inside & ~(odd & (mean_of_neighbors(sure.astype(float)) > 0.5))
        for target, values in zip(maps, (alpha, alpha_std, P, P_std), strict=False):
            target[place][ours] = values[ours]
        flags = saturated * np.uint8(Quality.SATURATED) | (inside & odd) * np.uint8(Quality.MISFIT)
        flags |= (hidden & (alpha > 0)) * np.uint8(Quality.OCCLUDED)
        shaded = odd | np.any(plate.rgb < _LIT * lit.rgb, axis=-1)
        flags |= (inside & shaded & (alpha == 0) & darker(image, lit)) * np.uint8(Quality.SHADOW)
        theirs = (quality & ~np.uint8(Quality.OUTSIDE))[inside & ~ours]
        quality[ours] = flags[ours]
        quality[inside & ~ours] = theirs | np.uint8(Quality.MISFIT)
        return np.asarray(inside & ~ours)


def _hidden(alpha: Array, P: Array, image: LinearImage, plate: LinearImage) -> Bools:
    """Where something is in front of an object of light P."""
    use = image.valid & plate.valid
    weight = (alpha * use)[..., None]
    light = np.sum(weight * P, axis=(0, 1)) / max(float(np.sum(weight * alpha[..., None])), 1e-12)
    variance = np.maximum(image.variance + plate.variance, 1e-14)
    C, B = (np.asarray(picture.rgb, float) for picture in (image, plate))
    return in_front(alpha, light, C, B, np.asarray(variance, float), use)


def _off(pixels: Floats, alpha: Array, reach: float) -> Array:
    """How far pixels' alpha is from the sweep's, or from what a file let run there within `reach`."""
    from scipy.ndimage import maximum_filter, minimum_filter

    size = 2 * int(np.ceil(reach)) + 1
    most, least = maximum_filter(alpha, size), minimum_filter(alpha, size)
    return np.asarray(np.maximum(pixels - most, least - pixels))


def _in_other_light(alpha: Array, P: Array, pixels: Floats, light: Floats) -> Bools:
    """Where pixels alone find more or less alpha than the sweep, but not so much light.

    More alpha without its light is a shadow; less alpha with all of the light is a highlight, which
    before a gray plate looks as if that shone through.
    """
    usual = np.sum(alpha * P.sum(axis=-1)) / max(float(np.sum(alpha**2)), 1e-12)
    lit = light.sum(axis=-1) / (_HALF_LIT * usual)
    return np.asarray(((pixels > alpha) & (lit < pixels)) | ((pixels < alpha) & (lit > alpha)))


def _usual(chi2: Array) -> float:
    """How large χ² is, 1 or more: of JPEG, no model knows the noise."""
    return max(float(np.median(chi2)) * 3 / _MEDIAN, 1.0) if chi2.size else 1.0
