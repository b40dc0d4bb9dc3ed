"""Frame: a model of colors as directions within and across it, which can turn together."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Frame:
    """Orthonormal directions in linear RGB.

    It has two ways to turn whether it is a line or a plane: of each direction within towards each
    one across. The whole space has none.

    Parameters
    ----------
    within : (3, rank) float
        Directions that the object's colors have, rank 1, 2 or 3.
    across : (3, 3 - rank) float
        Those that they have not.
    """

    within: Array
    across: Array

    @classmethod
    def of(cls, directions: Array) -> "Frame":
        """The frame that `directions` (3, rank), independent, lie in."""
        left, _, _ = np.linalg.svd(directions)
        rank = directions.shape[1]
        return cls(left[:, :rank], left[:, rank:])

    @property
    def rank(self) -> int:
        """1 for a line, 2 for a plane, 3 for all colors."""
        return int(self.within.shape[1])

    def turned(self, turns: Array) -> "Frame":
        """After small turns (2,), radians: of all within towards the first across, then the second."""
        if self.rank == 3:
            return self
        turns = turns.reshape(self.across.shape[1], self.rank)
        within = self.within + self.across @ turns
        across = self.across - self.within @ turns.T
        return Frame(_orthonormal(within), _orthonormal(across))


def _orthonormal(directions: Array) -> Array:
    """The nearest orthonormal directions X S^(−1/2), S = XᵀX, of one or two that are nearly so."""
    if directions.shape[1] == 1:
        return np.asarray(directions / np.sqrt((directions**2).sum()))
    (a, b), (_, d) = directions.T @ directions
    root = np.sqrt(a * d - b * b)
    more = np.sqrt(a + d + 2 * root)
    inverse = np.array([[d + root, -b], [-b, a + root]]) / (more * root)
    return np.asarray(directions @ inverse)
