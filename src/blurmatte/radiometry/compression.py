"""Compression: the code values that a JPEG file returns for those written to it.

JPEG subsamples chroma, quantizes the coefficients of a cosine transform with steps stored in the file,
and rounds to whole codes three times [T.81, T.871]. The effect on a picture is known by compressing it
in the same way. Noise decides in which direction each number is rounded, so the expected effect is a
mean over noise.
"""

import io
from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from blurmatte.checks import Array, Codes8, Floats, Floats32

Steps = tuple[tuple[int, ...], ...]

BLOCK = 8  # pixels, width of a block of the cosine transform of JPEG files and clips
_NOISE_SHAPE = 16, 64, 64, 3  # draws and a tile of pixels, over which expected values are averaged
_SAMPLINGS = {(1, 1): "4:4:4", (2, 1): "4:2:2", (2, 2): "4:2:0"}


@dataclass(frozen=True)
class Compression:
    """Quantization and chroma subsampling of a JPEG file.

    Parameters
    ----------
    luma, chroma : 8 tuples of 8 ints
        Quantization steps of the coefficients, 1…255; rows are vertical frequencies.
    shared : (int, int)
        Horizontal and vertical chroma subsampling, 1 or 2.
    origin : (int, int)
        Position (x, y) of the first pixel relative to the corner of a block.

    Raises
    ------
    ValueError
        For steps that are not 8 by 8 or outside 1…255, and other subsampling.
    """

    luma: Steps
    chroma: Steps
    shared: tuple[int, int] = (1, 1)
    origin: tuple[int, int] = (0, 0)

    def __post_init__(self) -> None:
        for name, steps in (("luma", self.luma), ("chroma", self.chroma)):
            if np.shape(steps) != (BLOCK, BLOCK) or np.min(steps) < 1 or np.max(steps) > 255:
                raise ValueError(f"{name} must be 8 by 8 steps from 1 to 255, got {steps}")
        if not set(self.shared) <= {1, 2}:
            raise ValueError(f"1 or 2 by 1 or 2 pixels share chroma, got {self.shared}")

    @property
    def mcu(self) -> tuple[int, int]:
        """Width and height of a minimum coded unit, pixels."""
        return BLOCK * self.shared[0], BLOCK * self.shared[1]

    @property
    def spread(self) -> float:
        """Standard deviation of the blur of chroma, pixels.

        Subsampled chroma is a mean of two pixels, interpolated linearly. Without subsampling
        quantization removes fine structure, which blurs less.
        """
        return max(self.shared) / 2

    def cropped(self, x: int, y: int) -> "Compression":
        """Compression of the part of the picture from pixel (x, y)."""
        return replace(self, origin=(self.origin[0] + x, self.origin[1] + y))

    def transposed(self) -> "Compression":
        """Compression of the transposed picture."""
        luma, chroma = (tuple(zip(*steps, strict=True)) for steps in (self.luma, self.chroma))
        return Compression(luma, chroma, self.shared[::-1], self.origin[::-1])

    def mirrored(self, width: int) -> "Compression":
        """Compression of the picture mirrored left to right, of a width in pixels."""
        return replace(self, origin=(-self.origin[0] - width, self.origin[1]))

    def expected(self, codes: Floats, noise: float) -> Array:
        """(H, W, 3) mean of what the file returns for code values R'G'B', 0…1, with noise.

        The noise is a standard deviation of each channel, 0…1. The draws are seeded.
        """
        if self.shared not in _SAMPLINGS:
            turned = self.transposed().expected(np.swapaxes(codes, 0, 1), noise)
            return np.asarray(turned.swapaxes(0, 1))
        whole, place = self._whole(codes)
        total = np.zeros(whole.shape)
        for draw in _noise():
            times = *(-(-n // _NOISE_SHAPE[1]) for n in whole.shape[:2]), 1
            tiled = np.tile(draw, times)[: len(whole), : whole.shape[1]]
            total += self._written((whole + noise * tiled).astype(np.float32))
        return np.asarray(total[place] / (255 * _NOISE_SHAPE[0]))

    def once(self, codes: Floats) -> Array:
        """What the file returns for code values (H, W, 3), 0…1."""
        if self.shared not in _SAMPLINGS:
            turned = self.transposed().once(np.swapaxes(codes, 0, 1))
            return np.asarray(turned.swapaxes(0, 1))
        whole, place = self._whole(codes)
        return np.asarray(self._written(whole)[place] / 255)

    def _whole(self, codes: Floats) -> tuple[Floats32, tuple[slice, slice]]:
        """Codes padded to whole coded units, and the place of the codes in them."""
        h, w = codes.shape[:2]
        left, top = (o % n for o, n in zip(self.origin, self.mcu, strict=True))
        sides = (top, -(top + h) % self.mcu[1]), (left, -(left + w) % self.mcu[0]), (0, 0)
        whole = np.pad(np.asarray(codes, np.float32), sides, mode="edge")
        return whole, (slice(top, top + h), slice(left, left + w))

    def _written(self, whole: Floats32) -> Codes8:
        """Code values 0…255 read from a file of code values 0…1."""
        from PIL import Image

        tables = [[step for row in steps for step in row] for steps in (self.luma, self.chroma)]
        codes = np.rint(255 * np.clip(whole, 0, 1)).astype(np.uint8)
        file = io.BytesIO()
        sampling = _SAMPLINGS[self.shared]
        Image.fromarray(codes).save(file, "JPEG", qtables=tables, subsampling=sampling)
        with Image.open(file) as picture:
            return np.array(picture)


@cache
def _noise() -> Floats32:
    """Normal numbers of _NOISE_SHAPE."""
    return np.random.default_rng(0).standard_normal(_NOISE_SHAPE, dtype=np.float32)
