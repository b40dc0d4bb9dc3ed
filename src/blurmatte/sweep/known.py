"""What is known of a color before a picture is looked at."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from blurmatte.color.model import ColorModel
from blurmatte.sweep.frame import Frame

Array = npt.NDArray[np.float64]

_SURE = 1e-6  # radians, of a color that is given without an error


@dataclass(frozen=True, eq=False)
class KnownColor:
    """A color model with an error.

    Parameters
    ----------
    frame : Frame
    information : (2, 2) float
        Inverse covariance of its two turns, 1/radians².
    """

    frame: Frame
    information: Array

    def turns(self, frame: Frame) -> Array:
        """(2,) by which another frame is turned against it, radians, for small ones."""
        return np.asarray((self.frame.across.T @ frame.within).ravel())

    def cost(self, frame: Frame) -> float:
        """Minus the log likelihood of a frame."""
        turns = self.turns(frame)
        return float(turns @ self.information @ turns) / 2


def known_color(model: ColorModel) -> KnownColor:
    """The knowledge that is in a color model."""
    frame = Frame.of(model.basis)
    turning = frame.across if frame.rank == 1 else frame.within
    covariance = turning.T @ model.covariance @ turning + _SURE**2 * np.eye(2)
    return KnownColor(frame, np.asarray(np.linalg.inv(covariance)))
