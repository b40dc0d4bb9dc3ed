"""Streak: a region of the image in which something moved."""

from dataclasses import dataclass

import numpy as np

from blurmatte.checks import Bools, Box, as_array, check_kind, check_map
from blurmatte.streaks.false_alarms import MAX_EXPECTED


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
    """

    mask: Bools
    box: Box = (0, 0, 0, 0)
    evidence: float = float("nan")
    cell: int = 1
    expected_false: float = 0.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "mask", as_array("mask", self.mask))
        shape = self.mask.shape[:2] if isinstance(self.mask, np.ndarray) else ()
        check_map("mask", self.mask, shape, kinds="b")
        rows, columns = (np.flatnonzero(np.any(self.mask, axis=axis)) for axis in (1, 0))
        if len(rows) == 0:
            raise ValueError("a streak needs at least one pixel; its mask is empty")
        box = (int(columns[0]), int(rows[0]), int(columns[-1]) + 1, int(rows[-1]) + 1)
        object.__setattr__(self, "box", box)

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
        mask[y0:y1, x0:x1] = True
        return cls(mask)

    def around(self, margin: int) -> Box:
        """The box with `margin` more pixels on each side, cut at the border of the picture."""
        x0, y0, x1, y1 = self.box
        height, width = self.mask.shape
        return (
            max(0, x0 - margin),
            max(0, y0 - margin),
            min(width, x1 + margin),
            min(height, y1 + margin),
        )

    @property
    def rows_columns(self) -> tuple[slice, slice]:
        """The box as slices of an array."""
        x0, y0, x1, y1 = self.box
        return slice(y0, y1), slice(x0, x1)


def check_streak(name: str, value: object) -> None:
    """Raise TypeError unless the value is a Streak or None."""
    check_kind(name, value, Streak | None, "use blurmatte.Streak(mask), or from_box")
