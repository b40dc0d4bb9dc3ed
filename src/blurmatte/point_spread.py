"""PointSpread: where a point of an object was during the exposure."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from blurmatte.checks import Array, check_map


@dataclass(frozen=True, eq=False)
class PointSpread:
    """The point spread function of a motion, in pixels of the picture.

    Parameters
    ----------
    weight : (h, w) float
        Fraction of the exposure that the point was in each pixel.
    std : (h, w) float
        Its standard deviation; errors of neighbors are correlated.
    corner : (int, int)
        Position (x, y) of the first pixel in the picture.

    Raises
    ------
    TypeError, ValueError
        For arrays of another dtype, or of different shapes.
    """

    weight: Array
    std: Array
    corner: tuple[int, int]

    def __post_init__(self) -> None:
        check_map("weight", self.weight, np.shape(self.weight))
        check_map("std", self.std, self.weight.shape)
        if self.weight.ndim != 2:
            raise ValueError(f"weight must have the shape (h, w), got {self.weight.shape}")

    def __repr__(self) -> str:
        height, width = self.weight.shape
        return f"PointSpread({width}x{height} at {self.corner}, sum {self.weight.sum():.3f})"

    @property
    def rows(self) -> list[Mapping[str, float]]:
        """A row (x, y, weight, std) for each pixel with a weight, as for a table."""
        y, x = np.nonzero(self.weight)
        return [
            {
                "x": int(i) + self.corner[0],
                "y": int(j) + self.corner[1],
                "weight": float(self.weight[j, i]),
                "std": float(self.std[j, i]),
            }
            for j, i in zip(y, x, strict=True)
        ]
