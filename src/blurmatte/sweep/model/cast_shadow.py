"""The shadow that a disc casts on a flat background behind it, and that moves with it.

In this file o is the coverage of the disc at a moment, and s, from 0 to 1, the darkness of its shadow:
the disc, moved by an offset and blurred, for lamps are extended. Over the exposure the part t S of the
plate's light is missing, S = ∫ (1 − o) s, with t the part of each channel's light that comes from the
lamp: C = P + (1 − α − t S) B. This equals a darker plate, B (1 − t S / (1 − α)).
"""

from dataclasses import dataclass
from typing import Annotated, ClassVar

import numpy as np
import scipy
from annotated_types import Interval

from blurmatte.checks import MAX_PX, Array
from blurmatte.compiling import njit
from blurmatte.sweep.model.path import PathFamily
from blurmatte.sweep.model.pixels import Pixels

# Fractions of the plate's light, of the channel that loses most
_MIN_STRENGTH = 0.04  # less is not visible
_MAX_STRENGTH = 0.95  # other light reaches the plate, too
_MIN_STRENGTH_RATIO = 0.5  # smallest over largest of the channels: lamps are about white


_Coordinate = Annotated[float, Interval(ge=-MAX_PX, le=MAX_PX)]
_Fraction = Annotated[float, Interval(ge=0, le=1)]


@dataclass(frozen=True)
class CastShadow:
    """A shadow that a disc casts.

    Parameters
    ----------
    offset : (float, float)
        x, y from the disc's center to that of its shadow, pixels.
    softness : float
        Standard deviation of its blur, pixels.
    strength : three floats
        t of each channel: the part of its light that the shadow takes at its darkest, 0…1.
    """

    size: ClassVar[int] = 6  # parameters

    offset: tuple[_Coordinate, _Coordinate]
    softness: Annotated[float, Interval(ge=0, le=MAX_PX)]
    strength: tuple[_Fraction, _Fraction, _Fraction]

    @property
    def is_possible(self) -> bool:
        """True if a lamp that is white, but not the only light, can cast it."""
        least, most = min(self.strength), max(self.strength)
        visible = _MIN_STRENGTH <= most <= _MAX_STRENGTH
        return visible and least >= _MIN_STRENGTH_RATIO * most

    def missing(self, family: PathFamily, path: Array, radius: float, pixels: Pixels) -> Array:
        """(h, w) S of a disc of a radius (pixels of the picture) that moves along a path."""
        centers = _centers_of(family, path, pixels)
        scale = pixels.scale
        offset, radius = np.array(self.offset) / scale, radius / scale
        profile, step = _profile(radius, self.softness / scale)
        S = np.zeros(pixels.shape)
        _add_shadow(centers, offset, radius, profile, step, S)
        return S

    def on(self, B: Array, S: Array, alpha: Array) -> Array:
        """(h, w, 3) the plate in this shadow, as it is visible around the object."""
        left = 1 - S[..., None] * self.strength / np.maximum(1 - alpha, 1e-9)[..., None]
        return np.asarray(B * np.clip(left, 0, 1))


def _centers_of(family: PathFamily, path: Array, pixels: Pixels) -> Array:
    """(T, 2) centers on a path at 33 to 257 equally spaced times, about one a pixel."""
    curve = family.curve(path)
    length = float(np.linalg.norm(np.diff(curve, axis=0), axis=1).sum())
    count = int(np.clip(length / pixels.scale, 33, 257))
    times = (np.arange(count) + 0.5) / count
    centers = family.at(path, times)[0] - np.array(pixels.origin)
    return np.asarray(centers / pixels.scale)


def _profile(radius: float, softness: float) -> tuple[Array, float]:
    """Darkness of the shadow at 65 distances from its center, and their step, pixels.

    It is the distribution function of a noncentral χ² with two degrees of freedom.
    """
    at = np.linspace(0, radius + 3.5 * softness, 65)
    dark = scipy.special.chndtr((radius / softness) ** 2, 2, (at / softness) ** 2)
    return np.where(np.isfinite(dark), dark, at < radius), float(at[1])


@njit()
def _add_shadow(centers, offset, radius, profile, step, S):  # type: ignore[no-untyped-def]
    """Add to S (h, w) the mean darkness over all centers (T, 2) where the disc does not cover it.

    The shadow's center is at `offset` from the disc's; `profile` (n,) is its darkness every `step`
    pixels from its center. Pixels at the rim are covered in part.
    """
    h, w = S.shape
    reach, per_step, part = step * (len(profile) - 1), 1 / step, 1 / len(centers)
    inner, outer = max(radius - 0.5, 0.0) ** 2, (radius + 0.5) ** 2  # of the disc's rim
    for i in range(len(centers)):
        cx, cy = centers[i, 0], centers[i, 1]
        x0, y0 = cx + offset[0], cy + offset[1]
        for y in range(max(int(np.ceil(y0 - reach)), 0), min(int(y0 + reach) + 1, h)):
            half = np.sqrt(max(reach * reach - (y - y0) ** 2, 0.0))
            for x in range(max(int(np.ceil(x0 - half)), 0), min(int(x0 + half) + 1, w)):
                from_disc = (x - cx) ** 2 + (y - cy) ** 2
                if from_disc <= inner:
                    continue
                at = np.sqrt((x - x0) ** 2 + (y - y0) ** 2) * per_step
                before = int(at)
                if before >= len(profile) - 1:
                    continue
                dark = profile[before] + (at - before) * (profile[before + 1] - profile[before])
                if from_disc < outer:
                    dark *= np.sqrt(from_disc) - radius + 0.5
                S[y, x] += part * dark
