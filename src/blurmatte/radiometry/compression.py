"""Compression: what JPEG files and video codecs change in the code values written to them.

A JPEG file subsamples chroma, quantizes the coefficients of a cosine transform with steps stored in
it, and rounds to whole codes three times [T.81, T.871]. The effect on a picture is known by compressing
it in the same way. Noise decides in which direction each number is rounded, so the expected effect is a
mean over noise.

A video codec predicts each block, and transforms and quantizes the residual. Where nothing moves, later
frames repeat the block or refine it, so that the error is the same in all of them: no comparison of
frames shows it. In this file c is a coefficient of an orthonormal cosine transform in units of the
quantizer's step, l the integer that is coded for it, and σ the standard deviation of c. Encoders round
towards zero,

    l = floor(|c| + 1/3),

as reference encoders of H.264 do in key frames, and c has a Laplace distribution. Then E l² and the
error D = E (|c| − l)² are functions of σ: D tends to 1/9 where coefficients are many steps, and to σ²
where they are coded as zero (reverse water-filling; Berger, *Rate Distortion Theory*, 1971). The
decoded picture shows E l², and so D.
"""

import io
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cache
from typing import Literal

import numpy as np
import numpy.typing as npt
import scipy

from blurmatte.checks import Array, Codes8, Floats, Floats32, strips
from blurmatte.radiometry.transfer import LUMA_WEIGHTS_709, Transfer, ycbcr_matrix
from blurmatte.statistics import UNIFORM_VARIANCE, cell_means

Steps = tuple[tuple[int, ...], ...]

BLOCK = 8  # pixels, width of a block of the cosine transform of JPEG files and clips
MACROBLOCK = 2 * BLOCK  # pixels, the same of luma and subsampled chroma together
_NOISE_SHAPE = 16, 64, 64, 3  # draws and a tile of pixels, over which expected values are averaged
_SAMPLINGS = {(1, 1): "4:4:4", (2, 1): "4:2:2", (2, 2): "4:2:0"}
_STRIP = 32  # rows of blocks that are transformed at a time: saves memory
# Blocks and frequencies over which E l² is averaged, and the rounding of encoders.
_ROUNDING = 1 / 3  # l = floor(|c| + this)
_ROUNDING_OF_MOVING = 1 / 6  # the same in reference encoders between key frames
_GROUP = 2  # frequencies, in both directions, of one σ
_WINDOW_BLOCKS = 9
# Coefficients that are not zero, at a frequency in all windows where all are zero: a bound of σ
_MIN_NONZERO = 0.5


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
    noise : float
        Standard deviation of the code values that are compressed, 0…1.

    Raises
    ------
    ValueError
        For steps that are not 8 by 8 or outside 1…255, and other subsampling.
    """

    luma: Steps
    chroma: Steps
    shared: tuple[int, int] = (1, 1)
    origin: tuple[int, int] = (0, 0)
    noise: float = 0.0

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
        return replace(
            self, luma=luma, chroma=chroma, shared=self.shared[::-1], origin=self.origin[::-1]
        )

    def mirrored(self, width: int) -> "Compression":
        """Compression of the picture mirrored left to right, of a width in pixels."""
        return replace(self, origin=(-self.origin[0] - width, self.origin[1]))

    def in_noise(self, light: Floats, variance: Floats, transfer: Transfer) -> "Compression":
        """Compression of pictures of this light and noise; what it removed hardly matters."""
        return replace(self, noise=float(np.median(np.sqrt(variance) / transfer.slope(light))))

    def seen(self, codes: Floats) -> Array:
        """(H, W, 3) mean of what the file returns for code values with its noise."""
        return self.expected(codes, self.noise)

    def expected(self, codes: Floats, noise: float) -> Array:
        """(H, W, 3) mean of what the file returns for code values R'G'B', 0…1, with noise.

        The noise is a standard deviation of each channel, 0…1. The draws are seeded.
        """
        whole, place = _in_units(np.asarray(codes, np.float32), self.origin, self.mcu)
        total = np.zeros(whole.shape)
        for draw in _noise():
            times = *(-(-n // _NOISE_SHAPE[1]) for n in whole.shape[:2]), 1
            tiled = np.tile(draw, times)[: len(whole), : whole.shape[1]]
            total += self._written((whole + noise * tiled).astype(np.float32))
        return np.asarray(total[place] / (255 * _NOISE_SHAPE[0]))

    def once(self, codes: Floats) -> Array:
        """What the file returns for code values (H, W, 3), 0…1."""
        whole, place = _in_units(np.asarray(codes, np.float32), self.origin, self.mcu)
        return np.asarray(self._written(whole)[place] / 255)

    def _written(self, whole: Floats) -> Codes8:
        """Code values 0…255 read from a file of code values 0…1."""
        from PIL import Image

        if self.shared not in _SAMPLINGS:
            return self.transposed()._written(whole.swapaxes(0, 1)).swapaxes(0, 1)
        tables = [[step for row in steps for step in row] for steps in (self.luma, self.chroma)]
        codes = np.rint(255 * np.clip(whole, 0, 1)).astype(np.uint8)
        file = io.BytesIO()
        sampling = _SAMPLINGS[self.shared]
        Image.fromarray(codes).save(file, "JPEG", qtables=tables, subsampling=sampling)
        with Image.open(file) as picture:
            return np.array(picture)


def _in_units(
    codes: Floats,
    origin: tuple[int, int],
    unit: tuple[int, int],
    mode: Literal["edge", "constant"] = "edge",
) -> tuple[Floats, tuple[slice, slice]]:
    """Codes (h, w, 3) padded to whole coded units, and the place of the codes in them."""
    (h, w), (left, top) = codes.shape[:2], (o % n for o, n in zip(origin, unit, strict=True))
    sides = (top, -(top + h) % unit[1]), (left, -(left + w) % unit[0]), (0, 0)
    return np.pad(codes, sides, mode), (slice(top, top + h), slice(left, left + w))


@cache
def _noise() -> Floats32:
    """Normal numbers of _NOISE_SHAPE."""
    return np.random.default_rng(0).standard_normal(_NOISE_SHAPE, dtype=np.float32)


@dataclass(frozen=True, eq=False)
class CodingError:
    """Variance of a clip's code values by quantization.

    Parameters
    ----------
    blocks : (h, w, 3) float32
        Of R'G'B' codes, white is 1, in rectangles that divide the picture evenly.
    size : (width, height)
        Of the picture, pixels.
    transfer : Transfer
        Of the code values.
    """

    blocks: Floats32
    size: tuple[int, int]
    transfer: Transfer

    def variance(
        self, light: Floats, channel: int, first_row: int = 0, first_column: int = 0
    ) -> Floats:
        """(n, m) variance of the light (n, m) of a channel in a box of the picture, light²."""
        (width, height), (h, w) = self.size, self.blocks.shape[:2]
        y = np.arange(first_row, first_row + len(light)) * h // height
        x = np.arange(first_column, first_column + light.shape[1]) * w // width
        slope = self.transfer.slope(np.clip(light, 0, 1))
        return np.asarray(self.blocks[..., channel][y][:, x] * slope**2)


@dataclass(frozen=True, eq=False)
class CodingErrors:
    """Errors of the frames of a clip.

    Parameters
    ----------
    still : CodingError
        Where nothing moves: that of the finest quantizers, which all frames share.
    moving : CodingError
        Where something moves, and blocks are quantized anew in each frame.
    moving_step : float
        Root mean squared step of those blocks, code values of which white is 1.
    """

    still: CodingError
    moving: CodingError
    moving_step: float


@dataclass(frozen=True, eq=False)
class FrameCoding:
    """Errors of one frame of a clip, found when they are first asked for, or of a part of it.

    Parameters
    ----------
    errors : callable
        The errors; None if they are not known.
    origin : (x, y)
        Position of the first pixel in the frame.
    """

    errors: Callable[[], CodingErrors | None]
    origin: tuple[int, int] = (0, 0)

    def cropped(self, x: int, y: int) -> "FrameCoding":
        """Errors of the part from pixel (x, y)."""
        return replace(self, origin=(self.origin[0] + x, self.origin[1] + y))

    def variance(self, light: Floats) -> Floats | None:
        """(H, W, 3) variance of moving blocks at each light, light²; None if not known."""
        errors = self.errors()
        if errors is None:
            return None
        x, y = self.origin
        channels = [errors.moving.variance(light[..., c], c, y, x) for c in range(3)]
        return np.stack(channels, axis=-1, dtype=np.float32)

    def lost(self, change: Array) -> Array | None:
        """(H, W, 3) what moving blocks lose of a change of R'G'B' codes; None if not known.

        The change is 0 around the pixels. Two pixels in each direction share their chroma.
        """
        errors, matrix = self.errors(), ycbcr_matrix(LUMA_WEIGHTS_709)
        if errors is None:
            return None
        whole, place = _in_units(change, self.origin, (MACROBLOCK, MACROBLOCK), "constant")
        Y, *chroma = np.moveaxis(whole @ matrix.T, -1, 0)
        step, pair = errors.moving_step, np.ones((2, 2))
        of_chroma = [np.kron(lost_change(cell_means(x, 2), step), pair) for x in chroma]
        lost = np.stack([lost_change(Y, step), *of_chroma], axis=-1)
        return np.asarray(lost @ np.linalg.inv(matrix).T)[place]


def lost_change(change: Floats, step: float) -> Array:
    """(h, w) what moving blocks lose of a change (h, w) of code values; h and w in whole blocks."""
    h, w = change.shape
    blocks = change.reshape(h // BLOCK, BLOCK, w // BLOCK, BLOCK).transpose(0, 2, 1, 3)
    c = scipy.fft.dctn(blocks, axes=(2, 3), norm="ortho") / step
    c -= np.copysign(np.floor(np.abs(c) + _ROUNDING_OF_MOVING), c)
    lost = scipy.fft.idctn(c * step, axes=(2, 3), norm="ortho")
    return np.asarray(lost.transpose(0, 2, 1, 3).reshape(h, w))


def quantization_variance(plane: npt.NDArray[np.generic], step: Floats) -> Array:
    """(h, w) mean square error of the code values of a decoded plane, for each block.

    Parameters
    ----------
    plane : (H, W)
        Code values.
    step : (h, w) float
        Of the quantizer of each block, in code values; h = ⌈H / 8⌉ and w = ⌈W / 8⌉.
    """
    (h, w) = step.shape
    group, n = _GROUP, BLOCK // _GROUP
    power = np.empty((h, w, n, n))
    for rows, residuals in _residuals(plane, h, w):
        levels = np.abs(residuals, out=residuals)
        levels /= step[rows, :, None, None].astype(np.float32)
        levels += np.float32(_ROUNDING)
        np.square(np.floor(levels, out=levels), out=levels)
        levels.reshape(-1, w, n, group, n, group).mean(axis=(3, 5), out=power[rows])
    side = _WINDOW_BLOCKS
    power = scipy.ndimage.uniform_filter(power, (side, side, 1, 1), mode="nearest")
    zero = power < _MIN_NONZERO / (group * side) ** 2
    coefficients = group**2 * np.maximum(zero.sum(axis=(0, 1)), 1)
    power = np.where(zero, _MIN_NONZERO / coefficients, power)
    known, error = _error_of_power()
    lost = np.asarray(np.interp(np.log(power), np.log(known), error))
    least = (UNIFORM_VARIANCE / step**2)[..., None, None]
    ratio = lost / least
    between = zero & (ratio > 1)  # the mean of σ² if log σ is uniform from there to the bound
    lost = np.where(between, (lost - least) / np.log(np.where(between, ratio, 2)), lost)
    return np.asarray(lost.mean(axis=(2, 3)) * step**2)


def _residuals(plane: npt.NDArray[np.generic], h: int, w: int) -> Iterator[tuple[slice, Floats32]]:
    """(n, w, 8, 8) coefficients of some rows of blocks; of the mean the difference to others.

    The mean of a block is predicted from those above and left.
    """
    above = np.zeros((0, w), np.float32)
    for rows in strips(h, _STRIP):
        part = plane[BLOCK * rows.start : BLOCK * rows.stop]
        sides = BLOCK * (rows.stop - rows.start), BLOCK * w
        more = [(0, side - given) for side, given in zip(sides, part.shape, strict=True)]
        whole = np.pad(part, more, mode="edge").astype(np.float32)
        blocks = whole.reshape(-1, BLOCK, w, BLOCK).transpose(0, 2, 1, 3)
        coefficients: Floats32 = scipy.fft.dctn(blocks, axes=(2, 3), norm="ortho")
        mean = coefficients[..., 0, 0].copy()
        rim = (1 - len(above), 0), (1, 0)
        padded = np.pad(np.concatenate([above, mean]), rim, mode="edge")
        coefficients[..., 0, 0] = mean - (padded[:-1, 1:] + padded[1:, :-1]) / 2
        above = mean[-1:]
        yield rows, coefficients


@cache
def _error_of_power() -> tuple[Array, Array]:
    """E l², increasing, and D of Laplace distributions.

    With b = σ / √2, tₖ = k − f and rounding f, P(l ≥ k) = exp(−tₖ / b), and

        E l² = Σ (2k − 1) exp(−tₖ / b),   E |c| l = Σ (tₖ + b) exp(−tₖ / b),   k = 1, 2, …
    """
    b, f = np.geomspace(0.015, 20, 200), _ROUNDING
    r, scale = np.exp(-1 / b), np.exp(f / b)
    power = scale * r * (1 + r) / (1 - r) ** 2
    product = scale * ((b - f) * r / (1 - r) + r / (1 - r) ** 2)
    return power, 2 * b**2 - 2 * product + power
