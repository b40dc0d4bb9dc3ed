"""Robust mean of a clip: the mode of each pixel, and sums of the frames that agree with it.

In this file x is the light of a frame over its gain, m the mode of a pixel over the samples, and S the
sum of x − m over the n free frames of a batch, a pixel being free in the frames that agree with m.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from itertools import pairwise
from os import cpu_count

import numpy as np
import scipy

from blurmatte.background import robust_mean_kernel as kernel
from blurmatte.background.samples import Samples, fit_gain, gain_grid, size_error
from blurmatte.checks import AnyArray, Codes8, Floats, Indices, Ints32
from blurmatte.radiometry import LinearImage

# Mode of the samples, and the frames that are summed.
VARIANCE_WINDOW_PX = 5  # over which the variance of a frame is averaged, and its inflation λ
_MAX_RESTLESSNESS = 25.0  # λ: five times the noise; beyond it, something moves
_STRIP_ROWS = 8  # whose samples are in memory at a time
_BATCHES = 8  # of consecutive frames, for the correlation of noise in time
_MIN_MODE_FRACTION = 0.5  # of the largest `near`, at pixels that determine the gain
MAX_BITS = 31  # of an int32 without its sign: frames of which a pixel knows whether they are free


@dataclass(frozen=True, eq=False)
class Modes:
    """Mode of the samples, pixel by pixel."""

    # (H, W, 3) float32: mean of the largest set of samples that agree, and of the next; the rival
    # is -1 if none
    light: Floats
    rival: Floats
    near: Ints32  # (H, W) int32: number of samples in the largest set
    # (H, W, 3) float32: variance of one frame, light²: noise times the inflation λ at restless
    # places, such as edges in video
    variance: Floats


def find_restlessness(samples: Samples) -> Floats:
    """(H, W) float32 inflation λ of the noise of a frame at each pixel.

    That of the differences of samples, or if it is larger, that of the errors of a codec: frames repeat
    a block, until it is quantized anew.
    """
    width, height = samples.light.size
    restless, noise = np.empty((height, width), np.float32), _coefficients(samples)
    coded = np.ones((height, width), np.float32)

    def inflation(rows: slice, flat: Floats) -> None:
        """Noise inflation of some rows with light (frames, pixels, 3)."""
        kernel.find_restlessness(flat, noise, restless[rows].reshape(-1))
        if samples.coding is not None:
            light = flat[len(flat) // 2].reshape(-1, width, 3)
            noise_variance = samples.noise.variance(light)
            for c in range(3):
                variance = samples.coding.variance(light[..., c], c, rows.start)
                coded[rows] += variance / (3 * noise_variance[..., c])

    _over_strips(samples, slice(0, height), inflation)
    restless = scipy.ndimage.uniform_filter(restless, VARIANCE_WINDOW_PX)
    return np.asarray(np.maximum(np.clip(restless, 1, _MAX_RESTLESSNESS), coded))


def find_modes(samples: Samples, restless: Floats, rows: slice) -> Modes:
    """Mode of each pixel in some rows."""
    shape = (rows.stop - rows.start, samples.light.size[0])
    light, rival = np.empty((2, *shape, 3), np.float32)
    near = np.empty(shape, np.int32)

    def mode(strip: slice, flat: Floats) -> None:
        """Mode, its rival, and the number of samples near it, of a strip."""
        to = slice(strip.start - rows.start, strip.stop - rows.start)
        results = light[to].reshape(-1, 3), rival[to].reshape(-1, 3), near[to].reshape(-1)
        kernel.find_modes(flat, _coefficients(samples), restless[strip].reshape(-1), *results)

    _over_strips(samples, rows, mode)
    return Modes(light, rival, near, samples.noise.variance(light) * restless[rows][..., None])


def gains_of_samples(samples: Samples, restless: Floats) -> list[Floats]:
    """(3,) gain of each sample against the modes, from the pixels of `gain_grid`."""
    there = restless[gain_grid(restless.shape)].reshape(-1)
    light, rival = np.empty((2, len(there), 3), np.float32)
    near = np.empty(len(there), np.int32)
    flat = np.moveaxis(samples.few, 1, -1) / samples.gain[:, None]
    flat = np.ascontiguousarray(flat, np.float32)
    kernel.find_modes(flat, _coefficients(samples), there, light, rival, near)
    sure = near >= _MIN_MODE_FRACTION * near.max()
    variance = samples.noise.variance(light) * there[:, None]
    static, variance = (a[sure].T.astype(float) for a in (light, variance))
    return [fit_gain(x[:, sure], static, variance) for x in samples.few]


def _coefficients(samples: Samples) -> tuple[np.float32, ...]:
    return tuple(samples.noise.coefficients.astype(np.float32).ravel())


def _over_strips(samples: Samples, rows: slice, work: Callable[[slice, Floats], None]) -> None:
    """Do some work on strips of rows and their light (frames, pixels, 3), at a common exposure."""
    gain, (width, _) = samples.gain.astype(np.float32), samples.light.size
    height, count = _STRIP_ROWS, cpu_count() or 1

    def every(first: int) -> None:
        """The work of a thread, in one buffer."""
        light = np.empty((len(gain), height, width, 3), np.float32)
        for start in range(first, rows.stop, count * height):
            strip = slice(start, min(start + height, rows.stop))
            part = light if strip.stop - start == height else light[:, : strip.stop - start].copy()
            for k, (to, g) in enumerate(zip(part, gain, strict=True)):
                samples.light.write(k, strip, g, to)
            work(strip, part.reshape(len(gain), -1, 3))

    with ThreadPoolExecutor(count) as pool:
        list(pool.map(every, [rows.start + height * k for k in range(count)]))


@dataclass(frozen=True, eq=False)
class Sums:
    """Sums over the free frames of each pixel, accumulated frame by frame."""

    # (H, W, 3) float32: sums of x − m and of its squares
    total: Floats
    squares: Floats
    # (H, W, 3) float32: Σ S² and Σ S n over the batches
    batch_squares: Floats
    batch_products: Floats
    batch_counts: Floats  # (H, W) float32: Σ n²
    # (H, W, 7) int32: free frames of the batch and of the clip; clipped ones of these, and ones
    # very close to the mode; frames very close to the rival; frames that show the pixel; a bit for
    # each of the first `MAX_BITS` frames that is free
    counts: Ints32
    batch: Floats  # (H, W, 3) float32: S of the current batch
    gain: list[Floats]  # list of (3,) float: of each frame

    @classmethod
    def empty(cls, shape: tuple[int, ...]) -> "Sums":
        """Sums over no frames, for pictures of shape (H, W, 3)."""
        total, squares, batch_squares, products, batch = (
            np.zeros(shape, np.float32) for _ in range(5)
        )
        batch_counts = np.zeros(shape[:2], np.float32)
        counts = np.zeros((*shape[:2], 7), np.int32)
        return cls(total, squares, batch_squares, products, batch_counts, counts, batch, [])

    def mean(self, modes: Modes) -> Floats:
        """(H, W, 3) of the free frames of each pixel."""
        return modes.light + self.total / np.maximum(self.counts[..., 1:2], 1)

    def close_batch(self) -> None:
        """End the current batch and begin another."""
        kernel.close_batch(
            *(a.reshape(-1, a.shape[-1]) for a in (self.batch, self.counts, self.total)),
            *(a.reshape(-1, 3) for a in (self.batch_squares, self.batch_products)),
            self.batch_counts.reshape(-1),
        )


def sum_frames(
    frames: Iterable[LinearImage],
    modes: Modes,
    count: int,
    gains: Sequence[Floats] | None = None,
) -> Sums:
    """Sum all frames, of expected number `count`; their gains are found if not given.

    Raises ValueError if their sizes differ.
    """
    sums, precision = Sums.empty(modes.light.shape), 1 / modes.variance
    static, variance, place = _gain_pixels(modes)
    length = max(1, -(-count // _BATCHES))
    with ThreadPoolExecutor(cpu_count() or 1) as pool:
        for number, frame in enumerate(_prefetched(frames)):
            if frame.rgb.shape != modes.light.shape:
                raise ValueError(size_error(frame, number, modes.near.shape[::-1]))
            gain = None if gains is None else gains[number]
            if gain is None:
                gain = fit_gain(frame.rgb[place].T.astype(float), static, variance)
            sums.gain.append(gain)
            _add(sums, frame, modes, precision, pool)
            if (number + 1) % length == 0:
                sums.close_batch()
    sums.close_batch()
    return sums


def _prefetched(frames: Iterable[LinearImage]) -> Iterator[LinearImage]:
    """The same frames; a thread reads the next one while the last is in use."""
    source = iter(frames)
    with ThreadPoolExecutor(1) as reader:
        coming = reader.submit(next, source, None)
        while (frame := coming.result()) is not None:
            coming = reader.submit(next, source, None)
            yield frame


def _gain_pixels(modes: Modes) -> tuple[Floats, Floats, tuple[Indices, ...]]:
    """(3, n) static light, its variance in a frame, and the pixels' indices."""
    part = gain_grid(modes.near.shape)
    y, x = np.mgrid[: modes.near.shape[0], : modes.near.shape[1]][(slice(None), *part)]
    sure = modes.near[part] >= _MIN_MODE_FRACTION * modes.near.max()
    place = (y[sure], x[sure])
    return (*(a[place].T.astype(float) for a in (modes.light, modes.variance)), place)


def _add(
    sums: Sums, frame: LinearImage, modes: Modes, precision: Floats, pool: ThreadPoolExecutor
) -> None:
    """Add a frame at the pixels that agree with the mode and are not in the rim of a moving object."""
    gain, light = sums.gain[-1].astype(np.float32), np.asarray(frame.rgb, np.float32)
    off, number = np.empty(frame.valid.shape, np.uint8), len(sums.gain) - 1
    bit = np.int32(1 << number if number < MAX_BITS else 0)

    def flat(rows: slice, *arrays: AnyArray) -> list[AnyArray]:
        """Rows of arrays, with one axis for all pixels."""
        return [a[rows].reshape(-1, *a.shape[2:]) for a in arrays]

    def mark(rows: slice) -> None:
        """Mark the pixels of some rows that are not near their mode."""
        x, m, p, to = flat(rows, light, modes.light, precision, off)
        kernel.mark_off(x, gain, m, p, to)

    def gather(rows: slice) -> None:
        """Add the pixels of some rows to the sums."""
        x, valid, *marks = flat(rows, light, frame.valid, off, near)
        of_modes = tuple(flat(rows, modes.light, precision, modes.rival))
        sums_of = flat(rows, sums.batch, sums.squares, sums.counts)
        kernel.gather(x, gain, valid, of_modes, *marks, bit, *sums_of)

    edges = np.linspace(0, len(off), (cpu_count() or 1) + 1).astype(int)
    strips = [slice(a, b) for a, b in pairwise(edges)]
    list(pool.map(mark, strips))
    near = _rims(off)
    list(pool.map(gather, strips))


def _rims(off: Codes8) -> Codes8:
    """(H, W) 1 at most `RIM_PX` from a pixel whose 3 x 3 neighborhood mostly disagrees with the mode.

    The rim of a blurred object is fainter than the noise.
    """
    rows = off[:-2] + off[1:-1] + off[2:]
    around = rows[:, :-2] + rows[:, 1:-1] + rows[:, 2:]
    # The majority of 9, which noise alone does not reach.
    moving = np.zeros_like(off)
    moving[1:-1, 1:-1] = off[1:-1, 1:-1] & (around >= 5)
    side = 2 * kernel.RIM_PX + 1
    return np.asarray(scipy.ndimage.maximum_filter(moving, side, mode="constant"))
