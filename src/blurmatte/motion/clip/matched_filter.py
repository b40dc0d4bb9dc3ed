"""Detection of an object of known color in a frame: a matched filter for its light (`color.light`)."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np
import scipy

from blurmatte.checks import Bools, Box, Floats, Floats32, rows_columns
from blurmatte.color.model import ColorModel
from blurmatte.color.shadows import may_be_shadow
from blurmatte.color.streak import projected_energy, projection_vectors, projection_weights
from blurmatte.radiometry import LinearImage
from blurmatte.statistics import MAD_TO_STD
from blurmatte.streaks import Streak, dilated, find_streaks, grown_part, opened

# Hysteresis thresholds of the filter, and the parts of a frame that are kept.
_SMOOTHING_PX = 1.5  # standard deviation of the Gaussian
_DETECTION_STD = 6.0  # standard deviations of the smoothed light p: a part exists
_EXTENT_STD = 2.5  # the same: a pixel belongs to a part
_MIN_STRENGTH_FRACTION = 0.1  # of a part's own: less is a reflection, or coding blocks
_MIN_AREA_PX = 25
_CLOSING_PX = 3  # gaps where the plate has the object's own color
_MARGIN_PX = 4  # where the edge fades below the noise
_STRIP_ROWS = 256  # that are filtered at a time
_TRUNCATION_STD = 4.0  # standard deviations at which SciPy truncates a Gaussian


@dataclass(frozen=True, eq=False)
class MatchedFilter:
    """Filter for light of one color before a plate.

    Parameters
    ----------
    plate : LinearImage
    model : ColorModel
        Of rank 1.
    weight : (H, W) float32
        As of `projection_weights`.
    std : (H, W) float32
        Of the weighted mean of p over neighbors, times the sum of the weights.
    inflation : float
        Ratio of the error of sums over neighbors to that of white noise, at least 1.
    """

    plate: LinearImage
    model: ColorModel
    weight: Floats32
    std: Floats32
    inflation: float = 1.0

    @classmethod
    def of(
        cls,
        plate: LinearImage,
        image_in: Callable[[Box], LinearImage],
        model: ColorModel,
        strip: int = _STRIP_ROWS,
    ) -> "MatchedFilter":
        """For frames with the noise of an image, which is given in boxes; strips save memory.

        strip: rows that are filtered at a time, a multiple of 4, the grid of the noise.
        """
        weight = np.empty(plate.valid.shape, np.float32)
        for rows, box, _ in _strips(plate.size, strip, 0):
            part = plate.crop(box)
            weight[rows] = projection_weights(image_in(box), part, projection_vectors(part, model))
        # The sum of squared Gaussian weights is that of a Gaussian of 1/√2 the scale.
        std = scipy.ndimage.gaussian_filter(weight, _SMOOTHING_PX / np.sqrt(2))
        std /= 4 * np.pi * _SMOOTHING_PX**2
        np.sqrt(std, out=std)
        std[std == 0] = np.inf  # far from known pixels
        white = cls(plate, model, weight, std)
        strengths, margin = [], int(_TRUNCATION_STD * _SMOOTHING_PX + 0.5)
        for _, box, inner in _strips(plate.size, strip, margin):
            there = white.within(box)
            strength = there._strength(there._light(image_in(box)))
            strengths.append(np.abs(strength[inner][::4, ::4]))
        # Noise of video is correlated.
        inflation = max(MAD_TO_STD * float(np.median(np.concatenate(strengths))), 1.0)
        return replace(white, inflation=inflation)

    def within(self, box: Box) -> "MatchedFilter":
        """The filter in a box (x0, y0, x1, y1) of the picture; views."""
        place = rows_columns(box)
        return replace(
            self, plate=self.plate.crop(box), weight=self.weight[place], std=self.std[place]
        )

    def _light(self, image: LinearImage) -> Floats32:
        """(H, W) p."""
        m = projection_vectors(self.plate, self.model)
        p = np.where(image.valid, np.einsum("hwc,hwc->hw", m, image.rgb), 0)
        return p.astype(np.float32)

    def _strength(self, p: Floats32) -> Floats32:
        """(H, W) smoothed light in standard deviations."""
        smooth = scipy.ndimage.gaussian_filter(self.weight * p, _SMOOTHING_PX)
        return np.asarray(smooth / (self.inflation * self.std), np.float32)

    def parts(self, image: LinearImage) -> list[Streak]:
        """Parts of a frame with light of the object's color.

        Their `evidence` is the energy of the object's light, Σ p².
        """
        p = self._light(image)
        strength = self._strength(p)
        there = opened(strength > _EXTENT_STD)
        near = dilated(there, _CLOSING_PX)
        labels, _ = scipy.ndimage.label(near, np.ones((3, 3)))
        places, parts = scipy.ndimage.find_objects(labels), list[Streak]()
        for number in np.unique(labels[near & (strength > _DETECTION_STD)]):
            place = places[number - 1]
            inside = np.where((labels[place] == number) & there[place], strength[place], 0)
            strong = _strong(inside)
            if np.count_nonzero(strong) >= _MIN_AREA_PX:
                mask = grown_part(strong, place, p.shape, _CLOSING_PX, _MARGIN_PX)
                parts.append(Streak(mask, evidence=projected_energy(p, self.weight, mask)))
        return parts


def _strips(size: tuple[int, int], rows: int, margin: int) -> Iterator[tuple[slice, Box, slice]]:
    """Strips of some rows, boxes with a margin of rows around them, and their rows in the boxes."""
    width, height = size
    for top in range(0, height, rows):
        end, first = min(top + rows, height), max(top - margin, 0)
        inner = slice(top - first, end - first)
        yield slice(top, end), (0, first, width, min(end + margin, height)), inner


def _strong(strength: Floats) -> Bools:
    """Mask of the strong pixels of a part."""
    usual = float(np.quantile(strength[strength > 0], 0.9))
    return np.asarray(strength > max(_EXTENT_STD, _MIN_STRENGTH_FRACTION * usual))


def moving_parts(image: LinearImage, plate: LinearImage) -> list[Streak]:
    """Streaks that are no shadows, for an object of several colors or of any."""
    return [one for one in find_streaks(image, plate) if not may_be_shadow(image, plate, one)]
