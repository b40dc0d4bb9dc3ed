"""Maps of a solution with their quality flags, and threads over strips of rows."""

from collections.abc import Callable
from enum import IntFlag, StrEnum, auto
from itertools import pairwise
from os import cpu_count
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from blurmatte.checks import Bools, Box, Codes8, Floats, rows_columns
from blurmatte.compiling import in_threads
from blurmatte.streaks import Streak

# Light is stored as float32, so no value is known to better than about 1e-6 of full scale. The bound
# also keeps weights finite where image and plate have no noise.
MIN_VARIANCE = 1e-12
MAX_RANGE_STDS = 3.0  # standard deviations by which alpha may lie outside [0, 1]
MAX_CHI2 = 16.0  # of one degree of freedom: four standard deviations, 1 good pixel in 16,000


class Quality(IntFlag):
    """Quality flags of a pixel; 0 if there are none.

    Examples
    --------
    >>> flagged = (solution.quality & bm.matting.Quality.SATURATED) != 0
    >>> int(flagged.sum())
    0
    >>> bm.matting.Quality(24)
    <Quality.MISFIT|OUTSIDE: 24>
    """

    SATURATED = auto()  #: image or plate is clipped in a channel here, or missing
    PLATE_IN_MODEL = auto()  #: the plate has a color the object could have; alpha is not known
    OUT_OF_RANGE = auto()  #: alpha is outside [0, 1] by more than three sigma
    MISFIT = auto()  #: image, plate and model disagree beyond the noise
    OUTSIDE = auto()  #: nothing moved here: not part of the streak
    SHADOW = auto()  #: only darker than the plate: a shadow, or a black object
    OCCLUDED = auto()  #: a static object is in front; alpha is that behind it


class Grade(StrEnum):
    """How well alpha is known, by its calibrated error; a smaller error is a greater grade.

    Examples
    --------
    >>> solution.grade
    <Grade.CONFIRMED: 'confirmed'>
    >>> solution.grade >= bm.Grade.PLAUSIBLE
    True
    """

    CONFIRMED = "confirmed"  #: error of alpha at most 0.02, of its scale at most 3 %
    PLAUSIBLE = "plausible"  #: at most 0.05 and 10 %
    ASSUMED = "assumed"  #: more: a color or a shape had to be assumed

    def __lt__(self, other: object) -> bool:
        """Whether the error is larger; texts are in alphabetic order, which says nothing."""
        if not isinstance(other, Grade):
            return NotImplemented
        order = list(Grade)
        return order.index(self) > order.index(other)

    def __gt__(self, other: object) -> bool:
        """Whether the error is smaller."""
        return other < self if isinstance(other, Grade) else NotImplemented

    def __le__(self, other: object) -> bool:
        """Whether it is the same or the error is larger."""
        return not self > other if isinstance(other, Grade) else NotImplemented

    def __ge__(self, other: object) -> bool:
        """Whether it is the same or the error is smaller."""
        return not self < other if isinstance(other, Grade) else NotImplemented


class PixelMaps(NamedTuple):
    """Alpha, light, their errors and quality of each pixel; reuse it as `out=` for the next picture.

    alpha, alpha_std are (H, W) floats, premultiplied and premultiplied_std (H, W, 3) floats, and
    quality (H, W) uint8 with the bits of `Quality`.

    Examples
    --------
    >>> maps = bm.matting.PixelMaps.zeros(72, 128)
    >>> answer = bm.solve(image, plate, solution.model, bm.Pixelwise(), out=maps)
    >>> answer.alpha is maps.alpha
    True
    """

    alpha: Floats
    alpha_std: Floats
    premultiplied: Floats
    premultiplied_std: Floats
    quality: Codes8

    @classmethod
    def empty(cls, height: int, width: int, dtype: npt.DTypeLike = np.float32) -> "PixelMaps":
        """Maps of a size, not filled."""
        return cls._new(np.empty, height, width, dtype)

    @classmethod
    def zeros(cls, height: int, width: int, dtype: npt.DTypeLike = np.float32) -> "PixelMaps":
        """Maps of a size, 0 ± 0; pages that are never written take no memory."""
        return cls._new(np.zeros, height, width, dtype)

    @classmethod
    def _new(cls, new: Any, height: int, width: int, dtype: npt.DTypeLike) -> "PixelMaps":
        one, three = (height, width), (height, width, 3)
        light = new(three, dtype), new(three, dtype)
        return cls(new(one, dtype), new(one, dtype), *light, new(one, np.uint8))

    @property
    def copied(self) -> "PixelMaps":
        """A copy that does not share memory with larger maps."""
        return PixelMaps._make(values.copy() for values in self)

    def write(self, box: Box, maps: "PixelMaps") -> None:
        """Write the maps of a box (x0, y0, x1, y1)."""
        for target, values in zip(self.within(box), maps, strict=True):
            target[...] = values

    @property
    def solved(self) -> Streak:
        """Where alpha was estimated."""
        return Streak(~has_flag(self.quality, Quality.OUTSIDE))

    def within(self, box: Box) -> "PixelMaps":
        """Views of a box (x0, y0, x1, y1)."""
        return PixelMaps._make(values[rows_columns(box)] for values in self)


def has_flag(quality: Codes8, flags: Quality) -> Bools:
    """(H, W) True where any of the flags is set."""
    return np.asarray((quality & np.uint8(flags)) != 0)


def alpha_flags(alpha: Floats, alpha_std: Floats, max_alpha_std: float) -> Codes8:
    """PLATE_IN_MODEL where alpha is too uncertain, and OUT_OF_RANGE where it is not in [0, 1].

    `max_alpha_std` is the largest standard deviation of an alpha that counts as known.
    """
    outside = np.abs(alpha - 0.5) > 0.5 + MAX_RANGE_STDS * alpha_std
    uncertain = (alpha_std > max_alpha_std) * np.uint8(Quality.PLATE_IN_MODEL)
    return np.asarray(uncertain | outside * np.uint8(Quality.OUT_OF_RANGE), np.uint8)


def in_strips(job: Callable[[slice], None], height: int) -> None:
    """Run a job on strips of rows in threads."""
    in_threads(job, _strips(height))


def _strips(height: int) -> list[slice]:
    """Several strips of rows for each processor, so that all finish at about the same time."""
    edges = np.linspace(0, height, min(height, 8 * (cpu_count() or 1)) + 1).astype(int)
    return [slice(a, b) for a, b in pairwise(edges)]
