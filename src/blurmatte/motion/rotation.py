"""Rotation: how far something turned about a point."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from blurmatte.errors import MotionError
from blurmatte.motion.sources import named_axes

Array = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Rotation:
    """How far something turned about a point; which way round, the picture does not tell.

    Parameters
    ----------
    center : (2,) float
        The point (x, y) about which it turned, pixels; of something that also moved along, where its
        middle was in the middle of the exposure.
    angle : float
        Radians during the exposure.
    covariance : (3, 3) float
        Of center and angle.
    blades : int
        How many parts were seen on a circle around the center; 0 if nobody counted.
    exposure_time, exposure_std : float or None, float
        Seconds.
    """

    center: Array
    angle: float
    covariance: Array
    blades: int = 0
    exposure_time: float | None = None
    exposure_std: float = 0.0

    def __repr__(self) -> str:
        x, y = self.center
        speed = ""
        if self.exposure_time is not None:
            speed = f", {self.speed:.4g} ± {self.speed_std:.2g} rad/s"
        return (
            f"Rotation({np.degrees(self.angle):.2f}° ± {np.degrees(self.angle_std):.2g}° about "
            f"({x:.1f}, {y:.1f}){speed})"
        )

    @property
    def center_std(self) -> Array:
        """(2,) standard deviations of the center, pixels."""
        return np.asarray(np.sqrt(np.diag(self.covariance)[:2]))

    @property
    def angle_std(self) -> float:
        """Standard deviation of the angle, radians."""
        return float(np.sqrt(self.covariance[2, 2]))

    @property
    def speed(self) -> float:
        """Angular speed, rad/s."""
        return self.angle / self._seconds

    @property
    def speed_std(self) -> float:
        """Standard deviation of the speed, rad/s."""
        relative = np.hypot(self.angle_std / self.angle, self.exposure_std / self._seconds)
        return float(self.speed * relative)

    def numbers(self) -> dict[str, float]:
        """All numbers by name, flat, for a row of a table: pixels, radians, rad/s."""
        told = named_axes("rotation_center", self.center, self.center_std)
        told |= {"rotation": self.angle, "rotation_std": self.angle_std, "blades": self.blades}
        if self.exposure_time is not None:
            told |= {"rotation_speed": self.speed, "rotation_speed_std": self.speed_std}
        return told

    @property
    def _seconds(self) -> float:
        if self.exposure_time is None:
            raise MotionError("an angular speed needs the exposure_time, in seconds; give it")
        return self.exposure_time
