"""Streak: a region of the image in which something moved, and the morphology of its mask."""

from dataclasses import dataclass

import numpy as np
import scipy

from blurmatte.checks import Bools, Box, box_of, check_kind, check_map, grown, rows_columns

MAX_EXPECTED = 0.05  # false streaks in a picture: a streak with fewer is significant


@dataclass(frozen=True, eq=False)
class Streak:
    """A region of the image in which something moved.

    Parameters
    ----------
    mask : (H, W) bool
        True inside.
    box : (x0, y0, x1, y1)
        Bounding box, pixels; x1 and y1 are exclusive.
    evidence : float
        Sum of the test statistic T over the region, see `evidence`.
    cell : int
        Width of the cells in which it was found, pixels; the mask is a few cells wider than the object.
        1 if the region was given.
    expected_false : float
        How many streaks with as large a test statistic noise or compression yield in such a picture;
        0 if the region was given, or nothing else moved.

    Raises
    ------
    ValueError
        If the mask is empty.

    Examples
    --------
    >>> streak = bm.streaks.Streak.from_box((20, 15, 105, 60), image.size)
    >>> int(streak.mask.sum())
    3825
    """

    mask: Bools
    box: Box = (0, 0, 0, 0)
    evidence: float = float("nan")
    cell: int = 1
    expected_false: float = 0.0

    def __post_init__(self) -> None:
        mask = check_map("mask", self.mask, kinds="b")
        if mask.ndim != 2:
            raise ValueError(f"mask must have the shape (height, width), got {mask.shape}")
        object.__setattr__(self, "mask", mask)
        if not mask.any():
            raise ValueError("a streak needs at least one pixel; its mask is empty")
        object.__setattr__(self, "box", box_of(mask))

    def __repr__(self) -> str:
        x0, y0, x1, y1 = self.box
        area = int(np.count_nonzero(self.mask))
        return f"Streak({x1 - x0}x{y1 - y0} at {x0},{y0}, {area} pixels)"

    @property
    def significant(self) -> bool:
        """Whether noise or compression of the picture is unlikely to yield it."""
        return self.expected_false < MAX_EXPECTED

    @classmethod
    def from_box(cls, box: Box, size: tuple[int, int]) -> "Streak":
        """The box (x0, y0, x1, y1) in a picture of `size` (width, height).

        Raises
        ------
        ValueError
            If the box is empty or leaves the picture.
        """
        x0, y0, x1, y1 = box
        width, height = size
        if not (0 <= x0 < x1 <= width and 0 <= y0 < y1 <= height):
            raise ValueError(
                f"region {x0},{y0},{x1},{y1} must lie in the picture of {width}x{height} pixels, "
                "with x0 < x1 and y0 < y1"
            )
        mask = np.zeros((height, width), bool)
        mask[rows_columns(box)] = True
        return cls(mask)

    def around(self, margin: int) -> Box:
        """The box with `margin` more pixels on each side, cut at the border of the picture."""
        height, width = self.mask.shape
        return grown(self.box, margin, (width, height))

    @property
    def rows_columns(self) -> tuple[slice, slice]:
        """The box as slices of an array."""
        return rows_columns(self.box)


def check_streak(name: str, value: object) -> None:
    """Raise TypeError unless the value is a Streak or None."""
    check_kind(name, value, Streak | None, "use blurmatte.streaks.Streak(mask), or from_box")


def opened(mask: Bools) -> Bools:
    """Opening of a mask (H, W) by a square of 3 x 3 pixels."""
    inside = np.pad(mask, 2)
    for combine in (np.logical_and, np.logical_or):
        inside = combine(combine(inside[:-2], inside[1:-1]), inside[2:])
        inside = combine(combine(inside[:, :-2], inside[:, 1:-1]), inside[:, 2:])
    return np.asarray(inside)


def dilated(mask: Bools, by: int) -> Bools:
    """Dilation of a mask (H, W) by so many steps along rows and columns."""
    for _ in range(by):
        before, mask = mask, mask.copy()
        mask[1:] |= before[:-1]
        mask[:-1] |= before[1:]
        mask[:, 1:] |= before[:, :-1]
        mask[:, :-1] |= before[:, 1:]
    return mask


def grown_part(
    part: Bools, place: tuple[slice, ...], shape: tuple[int, ...], gap: int, rim: int
) -> Bools:
    """(H, W) mask of a part at its place in a picture, closed, filled, and dilated by a rim in all.

    Gaps of up to twice `gap` are closed, which is at most the rim.
    """
    joined = dilated(np.pad(part, rim), gap)
    whole = np.zeros([side + 2 * rim for side in shape], bool)
    around = tuple(slice(s.start, s.stop + 2 * rim) for s in place)
    whole[around] = dilated(scipy.ndimage.binary_fill_holes(joined), rim - gap)
    return whole[rim:-rim, rim:-rim]


def cells_to_pixels(cells: Bools, cell: int, shape: tuple[int, ...]) -> Bools:
    """(H, W) mask of `shape`: every cell repeated over `cell` x `cell` pixels, False beyond them."""
    inner = cells.repeat(cell, axis=0).repeat(cell, axis=1)[: shape[0], : shape[1]]
    pixels = np.zeros(shape, bool)
    pixels[: inner.shape[0], : inner.shape[1]] = inner
    return pixels
