"""All frames where they show the free scene: their sums, from which the plate and its error come.

In this file m is the mode of a pixel's frames, x the light of a frame over its gain, and S the sum of
x − m over a batch: the n free ones of some frames in a row.
"""

from collections.abc import Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from itertools import pairwise
from os import cpu_count
from typing import Any

import numpy as np
import numpy.typing as npt

from blurmatte.background.mode import Modes
from blurmatte.background.samples import fit_gain, grid, other_size
from blurmatte.checks import Floats
from blurmatte.radiometry import LinearImage

_BATCHES = 8
_REACH = 2  # pixels around what moved that are not used: its rim is fainter than the noise
_GAIN_PIXELS = 1e4
_SURE_SHARE = 0.5  # of the samples agree on the mode: such pixels tell the gain


@dataclass(frozen=True, eq=False)
class Sums:
    """What the frames say of each pixel while it is free. All arrays are filled frame by frame.

    Parameters
    ----------
    total, squares : (H, W, 3) float32
        Sums of x − m, and of its squares.
    batch_squares, batch_products : (H, W, 3) float32
        Σ S² and Σ S n over the batches.
    batch_counts : (H, W) float32
        Σ n².
    counts : (H, W, 5) int32
        Frames that show the mode: in the batch, and in all; those of them that are clipped, and that
        are close to it; and frames that are close to the rival.
    batch : (H, W, 3) float32
        The batch's S.
    gain : list of (3,) float
        Of each frame.
    """

    total: Floats
    squares: Floats
    batch_squares: Floats
    batch_products: Floats
    batch_counts: Floats
    counts: npt.NDArray[np.int32]
    batch: Floats
    gain: list[Floats]

    @classmethod
    def empty(cls, shape: tuple[int, ...]) -> "Sums":
        """Of no frame, for pictures of a shape (H, W, 3)."""
        total, squares, batch_squares, products, batch = (
            np.zeros(shape, np.float32) for _ in range(5)
        )
        return cls(
            *(total, squares, batch_squares, products, np.zeros(shape[:2], np.float32)),
            *(np.zeros((*shape[:2], 5), np.int32), batch, []),
        )

    def close_batch(self) -> None:
        """End a batch and begin another."""
        from blurmatte.background import kernel

        kernel.close_batch(
            *(a.reshape(-1, a.shape[-1]) for a in (self.batch, self.counts, self.total)),
            *(a.reshape(-1, 3) for a in (self.batch_squares, self.batch_products)),
            self.batch_counts.reshape(-1),
        )


def sum_frames(frames: Iterable[LinearImage], modes: Modes, count: int) -> Sums:
    """Run through all frames; `count` is how many there seem to be.

    Raises
    ------
    ValueError
        If their sizes differ.
    """
    sums, precision = Sums.empty(modes.light.shape), 1 / modes.variance
    still, variance, place = _still(modes)
    length = max(1, -(-count // _BATCHES))
    with ThreadPoolExecutor(cpu_count() or 1) as pool:
        for number, frame in enumerate(_ahead(frames)):
            if frame.rgb.shape != modes.light.shape:
                raise ValueError(other_size(frame, number, modes.near.shape[::-1]))
            sums.gain.append(fit_gain(frame.rgb[place].T.astype(float), still, variance))
            _add(sums, frame, modes, precision, pool)
            if (number + 1) % length == 0:
                sums.close_batch()
    sums.close_batch()
    return sums


def _ahead(frames: Iterable[LinearImage]) -> Iterator[LinearImage]:
    """The same frames; the next one is read while the last is worked on."""
    source = iter(frames)
    with ThreadPoolExecutor(1) as reader:
        coming = reader.submit(next, source, None)
        while (frame := coming.result()) is not None:
            coming = reader.submit(next, source, None)
            yield frame


def _still(modes: Modes) -> tuple[Floats, Floats, tuple[npt.NDArray[np.intp], ...]]:
    """(3, n) light that does not move, its noise variance in a frame, and where that is."""
    part = grid(modes.near.shape, _GAIN_PIXELS)
    y, x = np.mgrid[: modes.near.shape[0], : modes.near.shape[1]][(slice(None), *part)]
    sure = modes.near[part] >= _SURE_SHARE * modes.near.max()
    place = (y[sure], x[sure])
    return (*(a[place].T.astype(float) for a in (modes.light, modes.variance)), place)


def _add(
    sums: Sums, frame: LinearImage, modes: Modes, precision: Floats, pool: ThreadPoolExecutor
) -> None:
    """Add a frame where it agrees with the mode, and no rim of what moved is near."""
    from blurmatte.background import kernel

    gain, light = sums.gain[-1].astype(np.float32), np.asarray(frame.rgb, np.float32)
    off, near = np.empty((2, *frame.valid.shape), np.uint8)

    def flat(rows: slice, *arrays: npt.NDArray[Any]) -> list[npt.NDArray[Any]]:
        return [a[rows].reshape(-1, *a.shape[2:]) for a in arrays]

    def mark(rows: slice) -> None:
        x, m, p, to = flat(rows, light, modes.light, precision, off)
        kernel.mark_off(x, gain, m, p, to)

    def gather(rows: slice) -> None:
        x, *rest = flat(rows, light, frame.valid, modes.light, precision, modes.rival, off, near)
        kernel.gather(x, gain, *rest, *flat(rows, sums.batch, sums.squares, sums.counts))

    strips = _strips(len(off))
    list(pool.map(mark, strips))
    kernel.mark_rims(off, _REACH, near)
    list(pool.map(gather, strips))


def _strips(rows: int) -> list[slice]:
    edges = np.linspace(0, rows, (cpu_count() or 1) + 1).astype(int)
    return [slice(a, b) for a, b in pairwise(edges)]
