"""What is known of an object's colors before the picture is looked at: axes of color space.

The axes are orthonormal directions of linear RGB in which colors vary independently. Of a color model
the first axes span the model, and the others are those that its colors leave by no more than its error.
"""

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from blurmatte.color.model import ColorModel

Array = npt.NDArray[np.float64]

_EXACT_STD_RAD = 1e-3  # of a model that is given without an error


@dataclass(frozen=True, eq=False)
class ColorPrior:
    """Axes of color space, and how far colors may leave the first of them.

    Parameters
    ----------
    axes : (3, 3) float
        Orthonormal columns, linear RGB.
    rank : int
        Along how many of them the mean color is free; 3 if nothing is known.
    varied : int
        Along how many of them the spread of colors is estimated; it is small along the others.
    angle_std : float
        Standard deviation of the angle between colors and the first `rank` axes, radians.
    """

    axes: Array
    rank: int = 3
    varied: int = 3
    angle_std: float = 0.0

    @property
    def of_one_paint(self) -> "ColorPrior":
        """The same for an object of which only the brightness varies."""
        return replace(self, varied=1)

    @classmethod
    def of(cls, model: ColorModel) -> "ColorPrior":
        """What a color model says."""
        if model.rank == 3:
            return cls(np.eye(3))
        axes = np.linalg.svd(model.basis)[0]
        axes[:, 0] *= np.sign(axes[:, 0].sum())
        std = np.radians(model.angle_std) if model.covariance.any() else 0.0
        return cls(axes, model.rank, model.rank, float(np.hypot(std, _EXACT_STD_RAD)))

    @classmethod
    def along(cls, mean: Array, moments: Array) -> "ColorPrior":
        """Nothing is known: axes along a mean color (3,) and the second moments (3, 3) about it."""
        unit = mean / max(float(np.linalg.norm(mean)), 1e-12)
        across = np.eye(3) - np.outer(unit, unit)
        _, vectors = np.linalg.eigh(across @ moments @ across + 1e-12 * across)
        return cls(np.column_stack([unit, *vectors.T[:0:-1]]))
