"""Gate: which parts of a frame differ from the plate, from code values alone.

A frame is compared with a table of the plate at half resolution, in cells of 2 x 2 pixels, and in
blocks of 4 x 4 cells, over which noise averages out: a small sharp object changes cells, a faint broad
streak changes sums over blocks. In this file d is the difference of a frame and the plate times the
frame's gain, and σ its standard deviation without motion, measured from the differences of some
frames. Both are in sums of code values.
"""

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
import scipy

from blurmatte.checks import Bools, Box, Floats32, check_same_size, enclosing, grown, strips
from blurmatte.compiling import njit
from blurmatte.radiometry.coded import CodedFrame, Planes
from blurmatte.radiometry.compression import BLOCK
from blurmatte.statistics import MAD_TO_STD, block_sums

CELL = 2  # pixels: half resolution


# Thresholds of the differences, and the boxes around what moved.
_BLOCK_CELLS = BLOCK // CELL
_STRIP_CELLS = 256  # rows that are compared at a time
_MAX_STD = 5.0  # of d without motion
_MIN_CELL_CODES = 3.0  # |d|: video rounds a block up or down by a few codes
_MIN_BLOCK_CODES = 1.5  # the same of a mean over a block
_MIN_CELLS = 6  # beyond their threshold in a block: fewer are noise with long tails
_STD_WINDOW_CELLS = 5  # over which σ² is averaged
_MIN_SAMPLES = 8  # of a σ for each cell
_CONTRAST_CLASSES = 8  # of the places of one frame
_QUANTILE = 0.4  # of |d| over the samples
_QUANTILE_STDS = 0.5244  # that of |x| for standard normal x
MARGIN_PX = 32  # around what moved: the rims of a streak are fainter
_MIN_MARGIN_RATIO = 0.5  # of the lesser side: most of a box must show the plate
_GAIN_EVERY_CELLS = 8  # for the gain of a frame
_MAX_GAIN_CHANGE = 0.005  # of one frame: smaller ones are noise of the median


@dataclass(frozen=True, eq=False)
class Gate:
    """Table of the plate's code values, and of how far those of a frame may differ from them."""

    cells: tuple[Floats32, ...]  # three (h, w): the plate over cells, each plane minus its zero
    cell_reach: tuple[Floats32, ...]  # three (h, w): largest |d| without motion
    block_reach: tuple[Floats32, ...]  # three (h', w'): the same for blocks
    zero: tuple[float, float, float]  # as in `CodedFrame`
    size: tuple[int, int]  # (width, height) of the frames, pixels

    @classmethod
    def of(
        cls,
        plate: CodedFrame,
        samples: Iterable[CodedFrame],
        hidden: Bools | None = None,
        strip: int = _STRIP_CELLS,
    ) -> "Gate":
        """The gate of a plate in the code values of frames.

        samples: frames of which most show the plate at each place, about a dozen.
        hidden (H, W): where changes are no motion.
        strip: rows of cells that are compared at a time, of all samples: whole blocks.
        """
        block = _BLOCK_CELLS
        padded = _padded(plate.planes)
        shape = tuple(n // CELL for n in padded[0].shape)
        expected = tuple(map(_summed, padded, 3 * [shape], plate.zero))
        few: list[tuple[Planes, float]] = []
        for sample in samples:
            check_same_size("a sample", sample.size, "plate", plate.size)
            planes = _padded(sample.planes)
            few.append((planes, _gain(planes[0], sample.zero[0], expected[0])))
        if not few:
            raise ValueError("samples must hold one frame or more, got none")
        reach, of_blocks = [], []
        for c, cells in enumerate(expected):  # one at a time saves memory
            stds: tuple[list[Floats32], list[Floats32]] = [], []
            side = len(padded[c]) // len(cells)
            # Few frames share one median of the whole picture.
            for rows in strips(len(cells), len(cells) if len(few) < _MIN_SAMPLES else strip):
                own, part = slice(side * rows.start, side * rows.stop), cells[rows]
                shown = ((_summed(p[c][own], part.shape, plate.zero[c]), gain) for p, gain in few)
                d = np.stack([summed - gain * part for summed, gain in shown])
                stds[1].append(_std(np.stack([block_sums(one, block) for one in d])))
                stds[0].append(_std(d))
            of_cells, over_blocks = map(np.concatenate, stds)
            in_cell = CELL**2 if plate.planes[c].shape == plate.planes[0].shape else 1
            codes = in_cell * max(plate.step, 0.0)
            reach.append(_reach(of_cells, _MIN_CELL_CODES * codes))
            of_blocks.append(_reach(over_blocks, _MIN_BLOCK_CODES * codes * block**2))
        if hidden is not None:
            ignored = _padded((hidden, hidden, hidden))[0]
            for side, tables in ((CELL, reach), (CELL * block, of_blocks)):
                h, w = (n // side for n in ignored.shape)
                touched = ignored.reshape(h, side, w, side).any(axis=(1, 3))
                for table in tables:
                    table[touched] = np.inf
        return cls(expected, tuple(reach), tuple(of_blocks), plate.zero, plate.size)

    @classmethod
    def of_frame(cls, plate: CodedFrame, frame: CodedFrame, hidden: Bools) -> "Gate":
        """The gate of one frame: what differs without motion is measured at places of like contrast.

        A plate that was warped to a frame differs from it most at edges. Of each class of contrast, by
        rank, less than half is an object.
        """
        gate = cls.of(plate, [frame], hidden)
        planes = _padded(frame.planes)
        gain = _gain(planes[0], frame.zero[0], gate.cells[0])
        reach, of_blocks = [], []
        for c, cells in enumerate(gate.cells):
            known, contrast = np.isfinite(gate.cell_reach[c]), _contrast(cells)
            change = _summed(planes[c], cells.shape, frame.zero[c]) - gain * cells
            sums = np.abs(block_sums(change, _BLOCK_CELLS))
            of_block = np.sqrt(block_sums(contrast**2, _BLOCK_CELLS))
            reach.append(_by_contrast(gate.cell_reach[c], np.abs(change), contrast, known))
            known = np.isfinite(gate.block_reach[c])
            of_blocks.append(_by_contrast(gate.block_reach[c], sums, of_block, known))
        return replace(gate, cell_reach=tuple(reach), block_reach=tuple(of_blocks))

    def changes(self, frame: CodedFrame) -> tuple[Box, ...]:
        """Boxes around each part that moved in a frame, with a margin; they do not overlap.

        Raises ValueError if the frame has another size.
        """
        check_same_size("a frame", frame.size, "plate", self.size)
        planes, block = _padded(frame.planes), _BLOCK_CELLS
        gain = _gain(planes[0], self.zero[0], self.cells[0])
        counts = np.zeros(self.block_reach[0].shape, np.int32)
        sums, moved = np.empty(counts.shape, np.float32), np.zeros(counts.shape, bool)
        for c in range(3):
            zero = np.float32(self.zero[c] * (planes[c].size // self.cells[c].size))
            table = self.cells[c], self.cell_reach[c]
            count_changes(planes[c], zero, np.float32(gain), *table, block, counts, sums)
            moved |= np.abs(sums) > self.block_reach[c]
        moved |= counts >= _MIN_CELLS
        return _boxes(moved, CELL * block, self.size)


def _contrast(cells: Floats32) -> Floats32:
    """Range of a table over neighboring cells."""
    high, low = (f(cells, 3) for f in (scipy.ndimage.maximum_filter, scipy.ndimage.minimum_filter))
    return np.asarray(high - low, np.float32)


def _by_contrast(least: Floats32, d: Floats32, contrast: Floats32, known: Bools) -> Floats32:
    """The reach, at least that of places of like contrast; it rises with contrast."""
    if np.count_nonzero(known) < 2 * _CONTRAST_CLASSES:
        return least
    order = np.argsort(contrast[known])
    classes = np.array_split(order, _CONTRAST_CLASSES)
    of_class = [MAD_TO_STD * float(np.median(d[known][one])) for one in classes]
    at = [float(np.median(contrast[known][one])) for one in classes]
    std = np.interp(contrast, at, np.maximum.accumulate(of_class))
    return np.where(known, np.maximum(least, _MAX_STD * std), least).astype(np.float32)


def _padded(planes: Planes) -> Planes:
    """The planes, extended at the right and below to whole blocks.

    Raises ValueError if planes are neither of the size of the first nor of half of it.
    """
    (height, width), side = planes[0].shape, CELL * _BLOCK_CELLS
    whole = np.array([-(-height // side) * side, -(-width // side) * side])
    padded = []
    for plane in planes:
        if plane.shape not in ((height, width), (-(-height // CELL), -(-width // CELL))):
            raise ValueError(
                f"planes must have the size of the first or half of it, got {plane.shape}"
            )
        shape = whole if plane.shape == (height, width) else whole // CELL
        more = [(0, int(n)) for n in shape - plane.shape]
        padded.append(np.pad(plane, more, mode="edge") if any(n for _, n in more) else plane)
    return padded[0], padded[1], padded[2]


def _summed(plane: npt.NDArray[np.generic], shape: tuple[int, ...], zero: float) -> Floats32:
    """Sums of a padded plane minus its zero over cells."""
    if plane.shape == shape:
        summed = plane.astype(np.float32)
    else:
        summed = np.empty(shape, np.float32)
        sum_pairs(plane, summed)
    summed -= np.float32(plane.size // summed.size * zero)
    return summed


def _gain(plane: npt.NDArray[np.generic], zero: float, expected: Floats32) -> float:
    """Gain of a frame: the median ratio of its first plane to the plate's; 1 if it hardly changed."""
    step = CELL * _GAIN_EVERY_CELLS
    corners = (plane[y::step, x::step].astype(np.float32) for y in range(CELL) for x in range(CELL))
    few = np.asarray(sum(corners) - np.float32(CELL**2 * zero))
    b = expected[::_GAIN_EVERY_CELLS, ::_GAIN_EVERY_CELLS]
    bright = b > 0.1 * b.max()  # dark code values have no ratio
    if not bright.any():
        return 1.0
    gain = float(np.median(few[bright] / b[bright]))
    return gain if abs(gain - 1) > _MAX_GAIN_CHANGE else 1.0


def _std(differences: Floats32) -> Floats32:
    """From a low quantile of |d| over frames: an object may cover half of them. Overwrites d."""
    sizes = np.abs(differences, out=differences)
    if len(sizes) < _MIN_SAMPLES:
        return np.full(sizes[0].shape, MAD_TO_STD * np.median(sizes))
    rank = int(_QUANTILE * len(sizes))
    sizes.partition(rank, axis=0)
    return np.asarray(sizes[rank] / _QUANTILE_STDS)


def _reach(std: Floats32, least: float) -> Floats32:
    """Largest |d| without motion, from its standard deviations."""
    variance = scipy.ndimage.uniform_filter(std**2, _STD_WINDOW_CELLS, mode="nearest")
    std = np.sqrt(np.maximum(variance, std**2))  # of edges, which restless places are next to
    return np.asarray(np.maximum(_MAX_STD * std, max(least, 1e-9)), np.float32)


def _boxes(moved: Bools, side: int, size: tuple[int, int]) -> tuple[Box, ...]:
    """Boxes of pixels around the parts of a mask of blocks, joined until none overlap."""
    if not moved.any():
        return ()
    labels, _ = scipy.ndimage.label(moved, np.ones((3, 3)))
    boxes = []
    for y, x in scipy.ndimage.find_objects(labels):
        least = side * min(y.stop - y.start, x.stop - x.start)
        margin = max(MARGIN_PX, int(_MIN_MARGIN_RATIO * least))
        part = x.start * side, y.start * side, x.stop * side, y.stop * side
        boxes.append(grown(part, margin, size))
    return tuple(joined(boxes))


def joined(boxes: Iterable[Box]) -> list[Box]:
    """Boxes around those that overlap, in the order of their corners; none of the result overlap."""
    rest, whole = sorted(boxes), list[Box]()
    while rest:
        box, others = rest[0], rest[1:]
        touching = [other for other in others if overlap(box, other)]
        if touching:
            box = enclosing([box, *touching])
            rest = [box, *(other for other in others if other not in touching)]
        else:
            whole.append(box)
            rest = others
    return sorted(whole)


def overlap(a: Box, b: Box) -> bool:
    """Whether two boxes have a pixel in common."""
    return a[0] < b[2] and b[0] < a[2] and a[1] < b[3] and b[1] < a[3]


@njit()
def _sum_two_rows(upper, lower, row):  # type: ignore[no-untyped-def]
    """Sums of two rows (W,) over squares of two values; `row` is (W // 2,) float32."""
    for x in range(row.size):
        total = upper[2 * x] + upper[2 * x + 1]
        total += lower[2 * x]
        total += lower[2 * x + 1]
        row[x] = total


@njit()
def sum_pairs(plane, out):  # type: ignore[no-untyped-def]
    """Sums of a plane (H, W) over squares of two values; `out` is (H // 2, W // 2) float32."""
    for y in range(out.shape[0]):
        _sum_two_rows(plane[2 * y], plane[2 * y + 1], out[y])


@njit()
def count_changes(plane, zero, gain, expected, reach, block, counts, sums):  # type: ignore[no-untyped-def]
    """Count the cells of each block that differ from the plate, and sum their differences.

    plane (n h, n w): code values of a frame; a cell has n x n of them, n = 1 or 2. `zero` is that of a
    cell without light, `gain` that of the frame over the plate. expected, reach (h, w): cells of the
    plate minus their zero, and the largest difference without motion. counts (h // block, w // block)
    are increased by the numbers of cells beyond their reach, sums overwritten by those of differences.
    """
    width = counts.shape[1] * block
    halved = plane.shape[0] == 2 * expected.shape[0]
    line = np.empty(width, np.float32)
    for y in range(counts.shape[0]):
        for x in range(counts.shape[1]):
            sums[y, x] = 0
        for i in range(y * block, y * block + block):
            if halved:
                _sum_two_rows(plane[2 * i], plane[2 * i + 1], line)
            else:
                line[:] = plane[i, :width]
            for x in range(0, width, block):
                total, count = sums[y, x // block], 0
                for j in range(x, x + block):
                    d = line[j] - zero - gain * expected[i, j]
                    total += d
                    count += abs(d) > reach[i, j]
                sums[y, x // block] = total
                counts[y, x // block] += count
