"""Compression: what a JPEG file makes of the code values that go into it.

Pixels share chroma, coefficients are rounded to multiples of steps that the file tells, and what comes
out of it is rounded to whole codes three times [T.81, T.871]. What a picture becomes is known if it is
compressed in the same way; but noise decides to which side each number is rounded, and a mean over
noise tells what a file holds on average.
"""

import io
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
import numpy.typing as npt

from blurmatte.checks import Floats

Array = npt.NDArray[np.float64]
Steps = tuple[tuple[int, ...], ...]

_BLOCK = 8
_DRAWS, _TILE = 16, 64  # of noise, pixels
_SAMPLINGS = {(1, 1): "4:4:4", (2, 1): "4:2:2", (2, 2): "4:2:0"}


@dataclass(frozen=True)
class Compression:
    """How a JPEG file holds its picture.

    Parameters
    ----------
    luma, chroma : 8 tuples of 8 ints
        Steps of the coefficients, 1…255; those of one row are of one vertical frequency.
    shared : (int, int)
        Width and height of the pixels that share chroma, 1 or 2.
    origin : (int, int)
        Where the first pixel of the picture lies (x, y), counted from the corner of a block.

    Raises
    ------
    ValueError
        For steps that are not 8 by 8 or outside 1…255, and other numbers of pixels that share chroma.
    """

    luma: Steps
    chroma: Steps
    shared: tuple[int, int] = (1, 1)
    origin: tuple[int, int] = (0, 0)

    def __post_init__(self) -> None:
        for name, steps in (("luma", self.luma), ("chroma", self.chroma)):
            if np.shape(steps) != (_BLOCK, _BLOCK) or np.min(steps) < 1 or np.max(steps) > 255:
                raise ValueError(f"{name} must be 8 by 8 steps from 1 to 255, got {steps}")
        if not set(self.shared) <= {1, 2}:
            raise ValueError(f"1 or 2 by 1 or 2 pixels share chroma, got {self.shared}")

    @property
    def mcu(self) -> tuple[int, int]:
        """Width and height in pixels of what is compressed by itself, chroma and all."""
        return _BLOCK * self.shared[0], _BLOCK * self.shared[1]

    @property
    def spread(self) -> float:
        """Pixels by which chroma runs, a standard deviation.

        It is the mean of two pixels, and interpolated linearly between those means; or runs because
        its fine structure is rounded away, which is less.
        """
        return max(self.shared) / 2

    def cropped(self, x: int, y: int) -> "Compression":
        """Of the part of the picture that begins there."""
        return replace(self, origin=(self.origin[0] + x, self.origin[1] + y))

    def transposed(self) -> "Compression":
        """Of the picture with its axes exchanged."""
        luma, chroma = (tuple(zip(*steps, strict=True)) for steps in (self.luma, self.chroma))
        return Compression(luma, chroma, self.shared[::-1], self.origin[::-1])

    def mirrored(self, width: int) -> "Compression":
        """Of the picture, so wide, with left and right exchanged."""
        return replace(self, origin=(-self.origin[0] - width, self.origin[1]))

    def expected(self, codes: Floats, noise: float) -> Array:
        """What the file holds on average of code values to which noise comes.

        Parameters
        ----------
        codes : (H, W, 3) float
            R'G'B', 0…1.
        noise : float
            Standard deviation in each channel, 0…1. Its draws are always the same.

        Returns
        -------
        (H, W, 3) float
        """
        if self.shared not in _SAMPLINGS:
            turned = self.transposed().expected(np.swapaxes(codes, 0, 1), noise)
            return np.asarray(turned.swapaxes(0, 1))
        whole, place = self._whole(codes)
        total = np.zeros(whole.shape)
        for draw in _noise():
            times = *(-(-n // _TILE) for n in whole.shape[:2]), 1
            tiled = np.tile(draw, times)[: len(whole), : whole.shape[1]]
            total += self._written((whole + noise * tiled).astype(np.float32))
        return np.asarray(total[place] / (255 * _DRAWS))

    def once(self, codes: Floats) -> Array:
        """What the file holds of code values (H, W, 3), 0…1, that have their noise already."""
        if self.shared not in _SAMPLINGS:
            turned = self.transposed().once(np.swapaxes(codes, 0, 1))
            return np.asarray(turned.swapaxes(0, 1))
        whole, place = self._whole(codes)
        return np.asarray(self._written(whole)[place] / 255)

    def _whole(self, codes: Floats) -> tuple[npt.NDArray[np.float32], tuple[slice, slice]]:
        """Codes with the rest of their blocks, and where in them they are."""
        h, w = codes.shape[:2]
        left, top = (o % n for o, n in zip(self.origin, self.mcu, strict=True))
        sides = (top, -(top + h) % self.mcu[1]), (left, -(left + w) % self.mcu[0]), (0, 0)
        whole = np.pad(np.asarray(codes, np.float32), sides, mode="edge")
        return whole, (slice(top, top + h), slice(left, left + w))

    def _written(self, whole: npt.NDArray[np.float32]) -> npt.NDArray[np.uint8]:
        """What is read of code values, 0…1, that were written."""
        from PIL import Image

        tables = [[step for row in steps for step in row] for steps in (self.luma, self.chroma)]
        codes = np.rint(255 * np.clip(whole, 0, 1)).astype(np.uint8)
        file = io.BytesIO()
        sampling = _SAMPLINGS[self.shared]
        Image.fromarray(codes).save(file, "JPEG", qtables=tables, subsampling=sampling)
        with Image.open(file) as picture:
            return np.array(picture)


@cache
def _noise() -> npt.NDArray[np.float32]:
    """(draws, 64, 64, 3) normal numbers."""
    shape = _DRAWS, _TILE, _TILE, 3
    return np.random.default_rng(0).standard_normal(shape, dtype=np.float32)
