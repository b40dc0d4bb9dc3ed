"""Gate: which parts of a frame differ from the plate, from code values alone.

A frame is compared with a table of the plate at half resolution, in cells of 2 x 2 pixels, and in
blocks of 4 x 4 cells, over which noise averages out: a small sharp object changes cells, a faint broad
streak changes sums over blocks. In this file d is the difference of a frame and the plate times the
frame's gain, and σ its standard deviation without motion, measured from the differences of some
frames. Both are in sums of code values.
"""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from blurmatte.checks import Bools, Box, check_same_size
from blurmatte.radiometry.coded import CodedFrame, Planes
from blurmatte.statistics import MAD_TO_STD

Map = npt.NDArray[np.float32]
CELL = 2  # pixels: half resolution


@dataclass(frozen=True)
class GateSettings:
    """Thresholds of the differences, and the boxes around what moved."""

    block_cells: int = 4
    max_std: float = 5.0  # of d without motion
    min_cell_codes: float = 3.0  # |d|: video rounds a block up or down by a few codes
    min_block_codes: float = 1.5  # the same of a mean over a block
    min_cells: int = 6  # beyond their threshold in a block: fewer are noise with long tails
    std_window_cells: int = 5  # over which σ² is averaged
    min_samples: int = 8  # of a σ for each cell
    quantile: float = 0.4  # of |d| over the samples
    quantile_stds: float = 0.5244  # that of |x| for standard normal x
    margin_px: int = 32  # around what moved: the rims of a streak are fainter
    min_margin_ratio: float = 0.5  # of the lesser side: most of a box must show the plate
    gain_every_cells: int = 8  # for the gain of a frame
    max_gain_change: float = 0.005  # of one frame: smaller ones are noise of the median


@dataclass(frozen=True)
class Change:
    """What moved in one frame.

    Parameters
    ----------
    number : int
        Of the frame.
    time : float or None
        Seconds.
    boxes : tuple of (x0, y0, x1, y1)
        Around each part that moved, with a margin; they do not overlap.
    fraction : float
        Of the picture, that differs from the plate.
    gain : float
        Of the frame's code values over those of the plate.
    """

    number: int
    time: float | None
    boxes: tuple[Box, ...]
    fraction: float
    gain: float


@dataclass(frozen=True, eq=False)
class Gate:
    """Table of the plate's code values, and of how far those of a frame may differ from them.

    Parameters
    ----------
    cells : three (h, w) float32
        The plate over cells, each plane minus its zero.
    cell_reach : three (h, w) float32
        Largest |d| without motion.
    block_reach : three (h', w') float32
        The same for blocks.
    zero : three floats
        As in `CodedFrame`.
    size : (width, height)
        Of the frames, pixels.
    """

    cells: tuple[Map, ...]
    cell_reach: tuple[Map, ...]
    block_reach: tuple[Map, ...]
    zero: tuple[float, float, float]
    size: tuple[int, int]

    @classmethod
    def of(cls, plate: CodedFrame, samples: Iterable[CodedFrame]) -> "Gate":
        """The gate of a plate.

        Parameters
        ----------
        plate : CodedFrame
            The plate in the code values of the frames.
        samples : iterable of CodedFrame
            Frames of which most show the plate at each place, about a dozen.
        """
        settings, block = GateSettings, GateSettings.block_cells
        expected = _cells(plate.planes, plate.zero)
        near: list[list[Map]] = [[], [], []]
        over_blocks: list[list[Map]] = [[], [], []]
        for sample in samples:
            check_same_size("a sample", sample.size, "plate", plate.size)
            cells = _cells(sample.planes, sample.zero)
            gain = _gain(cells, expected)
            for c in range(3):
                d = cells[c] - gain * expected[c]
                near[c].append(d)
                over_blocks[c].append(_block_sums(d, block))
        if not near[0]:
            raise ValueError("samples must hold one frame or more, got none")
        reach, of_blocks = [], []
        for c in range(3):
            codes = _codes_per_cell(plate, c) * max(plate.step, 0.0)
            reach.append(_reach(near[c], settings.min_cell_codes * codes))
            of_blocks.append(_reach(over_blocks[c], settings.min_block_codes * codes * block**2))
        return cls(expected, tuple(reach), tuple(of_blocks), plate.zero, plate.size)

    def changes(self, frame: CodedFrame) -> Change:
        """What moved in a frame.

        Raises
        ------
        ValueError
            If the frame has another size.
        """
        from blurmatte.streaks.gate_kernel import count_changes  # numba takes half a second

        check_same_size("a frame", frame.size, "plate", self.size)
        cells = _cells(frame.planes, self.zero)
        gain, block = _gain(cells, self.cells), GateSettings.block_cells
        counts = np.zeros(self.block_reach[0].shape, np.int32)
        sums, moved = np.empty(counts.shape, np.float32), np.zeros(counts.shape, bool)
        for c in range(3):
            count_changes(
                cells[c], np.float32(gain), self.cells[c], self.cell_reach[c], block, counts, sums
            )
            moved |= np.abs(sums) > self.block_reach[c]
        moved |= counts >= GateSettings.min_cells
        boxes = _boxes(moved, CELL * block, self.size)
        return Change(frame.number, frame.time, boxes, float(moved.mean()), gain)


def _cells(planes: Planes, zero: tuple[float, float, float]) -> tuple[Map, ...]:
    """Each plane minus its zero, over cells; cells at odd borders are extended to whole ones."""
    from blurmatte.streaks.gate_kernel import sum_pairs  # numba takes half a second

    height, width = planes[0].shape
    h, w = -(-height // CELL), -(-width // CELL)
    pad = (-h) % GateSettings.block_cells, (-w) % GateSettings.block_cells
    cells = []
    for plane, offset in zip(planes, zero, strict=True):
        if plane.shape == (height, width):
            if height % CELL or width % CELL:
                plane = np.pad(plane, ((0, height % CELL), (0, width % CELL)), mode="edge")
            summed = np.empty((h, w), np.float32)
            sum_pairs(plane, summed)
            summed -= np.float32(CELL**2 * offset)
        elif plane.shape == (h, w):
            summed = plane.astype(np.float32)
            summed -= np.float32(offset)
        else:
            raise ValueError(
                f"planes must have the size of the first or half of it, got {plane.shape}"
            )
        cells.append(
            np.pad(summed, ((0, pad[0]), (0, pad[1])), mode="edge") if any(pad) else summed
        )
    return tuple(cells)


def _codes_per_cell(frame: CodedFrame, c: int) -> float:
    """Number of code values in a cell of a plane."""
    return float(CELL**2 if frame.planes[c].shape == frame.planes[0].shape else 1)


def _gain(cells: tuple[Map, ...], expected: tuple[Map, ...]) -> float:
    """Gain of a frame: the median ratio of its first plane to the plate's; 1 if it hardly changed."""
    few = np.s_[:: GateSettings.gain_every_cells, :: GateSettings.gain_every_cells]
    a, b = cells[0][few], expected[0][few]
    bright = b > 0.1 * b.max()  # dark code values have no ratio
    if not bright.any():
        return 1.0
    gain = float(np.median(a[bright] / b[bright]))
    return gain if abs(gain - 1) > GateSettings.max_gain_change else 1.0


def _block_sums(cells: Map, block: int) -> Map:
    h, w = (n // block for n in cells.shape)
    return np.asarray(cells.reshape(h, block, w, block).sum(axis=(1, 3)))


def _reach(differences: list[Map], least: float) -> Map:
    """Largest |d| without motion, from a low quantile of |d| over frames.

    An object may cover a place in half of them. Few frames share one median of the whole picture.
    """
    from scipy.ndimage import uniform_filter

    sizes = np.abs(differences)
    if len(sizes) < GateSettings.min_samples:
        std = np.full(sizes[0].shape, MAD_TO_STD * np.median(sizes))
    else:
        rank = int(GateSettings.quantile * len(sizes))
        std = np.partition(sizes, rank, axis=0)[rank] / GateSettings.quantile_stds
    variance = uniform_filter(std**2, GateSettings.std_window_cells, mode="nearest")
    std = np.sqrt(np.maximum(variance, std**2))  # of edges, which restless places are next to
    return np.asarray(np.maximum(GateSettings.max_std * std, max(least, 1e-9)), np.float32)


def _boxes(moved: Bools, side: int, size: tuple[int, int]) -> tuple[Box, ...]:
    """Boxes of pixels around the parts of a mask of blocks, joined until none overlap."""
    from scipy import ndimage

    if not moved.any():
        return ()
    labels, _ = ndimage.label(moved, np.ones((3, 3)))
    width, height = size
    boxes = []
    for y, x in ndimage.find_objects(labels):
        least = side * min(y.stop - y.start, x.stop - x.start)
        margin = max(GateSettings.margin_px, int(GateSettings.min_margin_ratio * least))
        x0, y0 = max(x.start * side - margin, 0), max(y.start * side - margin, 0)
        box = x0, y0, min(x.stop * side + margin, width), min(y.stop * side + margin, height)
        boxes.append(box)
    return tuple(joined(boxes))


def joined(boxes: Iterable[Box]) -> list[Box]:
    """Boxes around those that overlap, in the order of their corners; none of the result overlap."""
    rest, whole = sorted(boxes), list[Box]()
    while rest:
        box, others = rest[0], rest[1:]
        touching = [other for other in others if _overlap(box, other)]
        if touching:
            both = np.array([box, *touching])
            (x0, y0), (x1, y1) = both[:, :2].min(axis=0), both[:, 2:].max(axis=0)
            box = int(x0), int(y0), int(x1), int(y1)
            rest = [box, *(other for other in others if other not in touching)]
        else:
            whole.append(box)
            rest = others
    return sorted(whole)


def _overlap(a: Box, b: Box) -> bool:
    return a[0] < b[2] and b[0] < a[2] and a[1] < b[3] and b[1] < a[3]
