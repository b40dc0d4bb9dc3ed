"""SizePrior: the radius of a disc from other frames of a clip; constant within one exposure."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class SizePrior:
    """A Gaussian prior of the radius of an object that is known to be a disc.

    Parameters
    ----------
    radius, std : float
        Pixels of the picture.

    Raises
    ------
    ValueError
        If they are not above 0.
    """

    radius: float
    std: float

    def __post_init__(self) -> None:
        if not (self.radius > 0 and self.std > 0):
            raise ValueError(f"radius and std must be above 0, got {self.radius} and {self.std}")

    def cost(self, shape: Array) -> float:
        """Negative log of the prior density, up to a constant."""
        return float(((shape[0] - self.radius) / self.std) ** 2 / 2)

    def added(self, H: Array, g: Array, shape: Array) -> tuple[Array, Array]:
        """Curvature and gradient of a cost, whose last parameters are the shape's, with the prior's."""
        H, g, at = H.copy(), g.copy(), len(g) - len(shape)
        H[at, at] += self.std**-2
        g[at] += (shape[0] - self.radius) / self.std**2
        return H, g
