"""Which parts of a clip's frame are the object's: where its own light shows (`color.light`)."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from blurmatte.checks import Bools
from blurmatte.color import ColorModel, energy, light_reader, only_light_lost
from blurmatte.radiometry import LinearImage
from blurmatte.streaks import Streak, find_streaks, widened, without_thin_parts

Array = npt.NDArray[np.floating]
Place = tuple[slice, ...]

_SURE, _POSSIBLE = 6.0, 2.5  # standard deviations of p, smoothed: it shows here; it belongs to that
_SMOOTHING = 1.5  # pixels
_FAINTEST = 0.1  # of a part's own strength: less is a reflection, or blocks of a codec
_LEAST_SHARE = 0.1  # of the energy of a frame's strongest part: less is not the object
_ONE, _SEVERAL = 3, 16  # parts of a frame that are looked at, for one object or for several
_RIM = 4  # pixels added where the edge fades below the noise
_JOIN = 3  # pixels: gaps that places of the object's own color in the plate leave
_EDGE = _JOIN + _RIM  # by which a mask reaches further than its part
_LEAST = 25  # pixels of a part
_QUARTILE = 0.6745  # of normal noise: the median of its size


@dataclass(frozen=True, eq=False)
class ObjectLight:
    """How light of one color is told from that of a plate.

    Parameters
    ----------
    m : (H, W, 3) float32
    weight : (H, W) float32
        As of `color.light`.
    std : (H, W) float32
        Of the weighted mean of p over neighbors, times the sum of the weights.
    """

    m: npt.NDArray[np.float32]
    weight: npt.NDArray[np.float32]
    std: npt.NDArray[np.float32]

    @classmethod
    def before(cls, plate: LinearImage, image: LinearImage, model: ColorModel) -> "ObjectLight":
        """For frames like this image, noise known, and a model of rank 1."""
        from scipy.ndimage import gaussian_filter

        m, weight = light_reader(image, plate, model)
        # The sum of squared Gaussian weights is that of a Gaussian of 1/√2 the scale.
        squares = gaussian_filter(weight, _SMOOTHING / np.sqrt(2)) / (4 * np.pi * _SMOOTHING**2)
        std = np.where(squares > 0, np.sqrt(squares), np.inf)  # far from what is known is nothing
        return cls(m, weight, std.astype(np.float32))

    def parts(self, image: LinearImage, several: bool) -> tuple[list[Streak], float]:
        """Where the light of one object or of several shows, and how noise hangs together.

        Returns
        -------
        parts : list of Streak
            The one with the largest energy of the object's light, Σ p², first; that is its
            `evidence`.
        coherence : float
            By what errors of sums over neighbors are larger than those of white noise, 1 or more.
        """
        from scipy import ndimage

        p = np.where(image.valid, np.einsum("hwc,hwc->hw", self.m, image.rgb), 0)
        strength = (
            ndimage.gaussian_filter(self.weight * p.astype(np.float32), _SMOOTHING) / self.std
        )
        usual = float(np.median(np.abs(strength[::4, ::4]))) / _QUARTILE
        coherence = max(usual, 1.0)
        strength /= coherence  # of video, no model knows the noise
        there = without_thin_parts(strength > _POSSIBLE)
        near = widened(there, _JOIN)
        labels, _ = ndimage.label(near, np.ones((3, 3)))
        places = ndimage.find_objects(labels)
        parts: list[tuple[float, Place, Bools]] = []
        for number in np.unique(labels[near & (strength > _SURE)]):
            place = places[number - 1]
            inside = np.where((labels[place] == number) & there[place], strength[place], 0)
            mask = _strong(inside)
            if mask is not None:
                place, mask = _within(p.shape, place, mask)
                parts.append((energy(p[place], self.weight[place], mask), place, mask))
        parts.sort(key=lambda part: -part[0])
        least = max(_LEAST_SHARE * parts[0][0], 0) if parts else 0.0
        clear = [part for part in parts if part[0] > least][: _most(several)]
        return [_streak(p.shape, *part) for part in clear], coherence


def _most(several: bool) -> int:
    return _SEVERAL if several else _ONE


def _strong(strength: Array) -> Bools | None:
    """What is not faint in a part, without holes and with a rim; None if that is next to nothing.

    It reaches `_EDGE` pixels further than the part on each side.
    """
    from scipy.ndimage import binary_fill_holes

    usual = float(np.quantile(strength[strength > 0], 0.9))
    strong = strength > max(_POSSIBLE, _FAINTEST * usual)
    if np.count_nonzero(strong) < _LEAST:
        return None
    filled = binary_fill_holes(widened(np.pad(strong, _EDGE), _JOIN))
    return widened(filled, _RIM - _JOIN)


def _within(shape: tuple[int, ...], place: Place, mask: Bools) -> tuple[Place, Bools]:
    """Where in a picture a mask lies that reaches further than a place, and the part of it there."""
    first = [s.start - _EDGE for s in place]
    ends = zip(first, mask.shape, shape, strict=True)
    inside = tuple(slice(max(at, 0), min(at + n, side)) for at, n, side in ends)
    cut = tuple(slice(s.start - at, s.stop - at) for s, at in zip(inside, first, strict=True))
    return inside, mask[cut]


def _streak(shape: tuple[int, ...], evidence: float, place: Place, mask: Bools) -> Streak:
    whole = np.zeros(shape, bool)
    whole[place] = mask
    return Streak(whole, evidence=evidence)


def moving_parts(image: LinearImage, plate: LinearImage, several: bool) -> list[Streak]:
    """What moved and is no shadow, for an object of several colors or of any, or several objects."""
    found = find_streaks(image, plate)[: _most(several)]
    return [streak for streak in found if not only_light_lost(image, plate, streak)]
