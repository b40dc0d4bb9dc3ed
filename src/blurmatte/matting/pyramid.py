"""Evidence on a field in cells of pixels, each level of twice the width of the one before.

All maps have a border of `BORDER` cells, in which the mask is False.
"""

from dataclasses import dataclass, replace

import numpy as np

from blurmatte.checks import Bools, Floats
from blurmatte.matting.smooth_kernel import doubled

BORDER = 2  # cells around all maps


@dataclass(frozen=True, eq=False)
class CellEvidence:
    """Information on alpha in each cell; maps are (h, w), of the dtype of the computation."""

    information: Floats  #: one over the variance of a cell's own alpha; 0 outside the mask
    pull: Floats  #: that alpha times the information
    mask: Bools  #: where alpha may be other than 0; False in the border
    lower: Floats  #: lower bound of alpha

    def weaker(self, factor: float) -> "CellEvidence":
        """The same with `factor` times the variance."""
        return replace(self, information=self.information / factor, pull=self.pull / factor)

    @property
    def count(self) -> int:
        """Number of cells in the mask."""
        return int(np.count_nonzero(self.mask))

    def levels(self, max_cells: int) -> list["CellEvidence"]:
        """The level and coarser ones, up to the first with at most `max_cells` cells."""
        found = [self]
        while found[-1].count > max_cells:
            found.append(found[-1].coarser())
        return found

    def coarser(self) -> "CellEvidence":
        """In cells of twice the width."""
        count = sums_2x2(self.mask.astype(np.uint8))
        lower = sums_2x2(np.where(self.mask, self.lower, 0))
        return CellEvidence(
            sums_2x2(self.information),
            sums_2x2(self.pull),
            count > 0,
            (lower / np.maximum(count, 1)).astype(lower.dtype),
        )


def upsampled(values: Floats, shape: tuple[int, ...]) -> Floats:
    """A map (h, w) in cells of half the width, interpolated linearly to a shape."""
    out = np.zeros(shape, values.dtype)
    doubled(values, BORDER, out)
    return out


def sums_2x2(values: Floats) -> Floats:
    """Sums over 2 by 2 cells, with a border of the same width."""
    inner = values[BORDER:-BORDER, BORDER:-BORDER]
    h, w = inner.shape
    inner = np.pad(inner, ((0, h % 2), (0, w % 2)))
    rows = inner[::2] + inner[1::2]
    return np.pad(rows[:, ::2] + rows[:, 1::2], BORDER)
