"""ColorPrior: a Gaussian prior of an object's colors along axes of color space.

The axes are orthonormal directions of linear RGB along which colors vary independently. The first axes
span the color model; along the others colors deviate from it by no more than its error.
"""

from dataclasses import dataclass, replace

import numpy as np

from blurmatte.checks import Array
from blurmatte.color.model import ColorModel


@dataclass(frozen=True, eq=False)
class ColorPrior:
    """Axes of color space, and the spread of colors along them."""

    axes: Array  # (3, 3) float: orthonormal columns, linear RGB
    rank: int = 3  # number of axes along which the mean color is free; 3 if nothing is known
    # Number of axes along which the spread of colors is estimated; it is small along the others
    varied: int = 3
    # Standard deviation of the angle between colors and the first `rank` axes, radians
    angle_std: float = 0.0

    @property
    def of_one_paint(self) -> "ColorPrior":
        """The same for an object of which only the brightness varies."""
        return replace(self, varied=1)

    @classmethod
    def of(cls, model: ColorModel | None) -> "ColorPrior":
        """The prior of a color model; without one, or with one of rank 3, nothing is known."""
        if model is None or model.rank == 3:
            return cls(np.eye(3))
        axes = np.linalg.svd(model.basis)[0]
        axes[:, 0] *= np.sign(axes[:, 0].sum())
        std = np.radians(model.angle_std) if model.covariance.any() else 0.0
        std = float(np.hypot(std, 1e-3))  # radians, of a model without an error
        return cls(axes, model.rank, model.rank, std)

    @classmethod
    def along(cls, mean: Array, moments: Array) -> "ColorPrior":
        """No prior knowledge: axes along a mean color (3,) and the second moments (3, 3) about it."""
        unit = mean / max(float(np.linalg.norm(mean)), 1e-12)
        across = np.eye(3) - np.outer(unit, unit)
        _, vectors = np.linalg.eigh(across @ moments @ across + 1e-12 * across)
        return cls(np.column_stack([unit, *vectors.T[:0:-1]]))
