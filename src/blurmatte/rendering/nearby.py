"""Light that a body takes from the plate near it, and gives to it.

A sphere at distance h from a wall hides, of the light that comes to a point of the wall from all
sides, a part in proportion to h / (h² + d²)^(3/2), where d is the distance of the point from the
sphere's foot; and the light that it sends there goes the same. Relative to the foot this is

    g(d) = (1 + d² / h²)^(-3/2).
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from blurmatte.checks import Box

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Nearby:
    """A soft contact shadow, and light that the body sends to the plate; they move with it.

    Parameters
    ----------
    occlusion : float
        Part of the plate's light that the body takes at its foot, 0…1.
    bounce : float
        Part that it adds there in a channel in which the body's mean color is 1, 0…1.
    reach : float
        Distance h of the body from the plate, in radii of the body, above 0: the effect falls to a
        third at a distance of 1.04 h.

    Raises
    ------
    ValueError
        For a number outside its range.
    """

    occlusion: float = 0.02
    bounce: float = 0.005
    reach: float = 2.0

    def __post_init__(self) -> None:
        for name in ("occlusion", "bounce"):
            if not 0 <= getattr(self, name) <= 1:
                raise ValueError(f"{name} must lie between 0 and 1, got {getattr(self, name)}")
        if not (np.isfinite(self.reach) and self.reach > 0):
            raise ValueError(f"reach must be a positive number of radii, got {self.reach}")

    def taken(self, color: Array) -> Array:
        """(3,) part of the plate's light that a body of this mean color takes at its foot."""
        return np.asarray(self.occlusion - self.bounce * color)


def proximity(center: Array, distance: float, box: Box) -> Array:
    """G (h, w) at the pixels of a box, for a body over `center` at this distance from the plate."""
    x0, y0, x1, y1 = box
    x, y = (np.arange(x0, x1) - center[0]) / distance, (np.arange(y0, y1) - center[1]) / distance
    s = 1 + x**2 + y[:, None] ** 2
    return np.asarray(1 / (s * np.sqrt(s)))
