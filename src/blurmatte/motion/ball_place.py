"""BallPlace: where a ball was in space in one frame of a clip, and how fast."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import numpy.typing as npt

from blurmatte.errors import MotionError
from blurmatte.motion.ball_motion import BallMotion
from blurmatte.motion.sources import named_axes

Array = npt.NDArray[np.float64]

_MEAN = np.kron(np.array([1, 4, 1]) / 6, np.eye(3))  # of the way, of a line and of a parabola


@dataclass(frozen=True, eq=False)
class BallPlace:
    """Where a ball was in space in one frame of a clip, and its velocity if frames beside it tell it.

    In the camera's coordinates: x right, y down, z forward, meters from the camera.

    Parameters
    ----------
    frame : int
        Its number.
    time : float or None
        Seconds; of a rolling shutter, of the row of pixels in which its center is seen.
    track : int
        Which track it belongs to, as in `FrameMotion`.
    place : (3,) float
        Of its center, mean over the exposure.
    covariance : (3, 3) float
    picture_covariance : (3, 3) float
        What of that comes from this frame's picture, and is not shared by other frames.
    shared : float
        Relative error of the distance that all frames share: of radius and camera.
    source : str
        "ball": a ball that flew through space was fitted to the picture; else what the sighting was
        measured from, a disc ("sweep") or "moments".
    doubted : bool
        Whether the sighting has doubts; nothing else is made of such a place.
    length, length_std : float or None
        Of the way within the exposure, meters; where a ball was fitted.
    velocity, velocity_covariance : (3,), (3, 3) float or None
        m/s, of the parabola in time through this place and those of the frames before and after (at
        the ends of a track, of the next two).
    """

    frame: int
    time: float | None
    track: int
    place: Array
    covariance: Array
    picture_covariance: Array
    shared: float
    source: str = "ball"
    doubted: bool = False
    length: float | None = None
    length_std: float | None = None
    velocity: Array | None = None
    velocity_covariance: Array | None = None

    names: ClassVar[tuple[str, ...]] = (
        *(f"ball_{axis}{std}" for axis in "xyz" for std in ("", "_std")),
        *(f"ball_velocity_{axis}{std}" for axis in "xyz" for std in ("", "_std")),
        *("ball_speed", "ball_speed_std", "ball_source"),
    )

    @classmethod
    def of(cls, motion: BallMotion, frame: int, time: float | None) -> BallPlace:
        """The mean place of a flight that one picture tells."""
        parts = motion.depth_parts
        return cls(
            frame,
            time,
            1,
            _MEAN @ motion.positions.ravel(),
            _MEAN @ motion.covariance @ _MEAN.T,
            _MEAN @ motion.picture_covariance @ _MEAN.T,
            float(np.hypot(parts["radius"], parts["camera"])),
            length=motion.length,
            length_std=motion.length_std,
        )

    @property
    def place_std(self) -> Array:
        """(3,) standard deviations of the place, meters."""
        return np.asarray(np.sqrt(np.diag(self.covariance)))

    @property
    def distance(self) -> float:
        """From the camera, meters."""
        return float(np.linalg.norm(self.place))

    @property
    def distance_std(self) -> float:
        """Its standard deviation."""
        u = self.place / self.distance
        return float(np.sqrt(u @ self.covariance @ u))

    @property
    def velocity_std(self) -> Array:
        """(3,) standard deviations of the velocity, m/s."""
        return np.asarray(np.sqrt(np.diag(self._known(self.velocity_covariance))))

    @property
    def speed(self) -> float:
        """Size of the velocity, m/s."""
        return float(np.linalg.norm(self._known(self.velocity)))

    @property
    def speed_std(self) -> float:
        """Its standard deviation."""
        u = self._known(self.velocity) / max(self.speed, 1e-12)
        return float(np.sqrt(u @ self._known(self.velocity_covariance) @ u))

    def numbers(self) -> dict[str, float | str | None]:
        """All numbers by name (`names`), flat, for a row of a table; velocities None if not known."""
        told: dict[str, float | str | None] = dict.fromkeys(self.names)
        told["ball_source"] = self.source
        told |= named_axes("ball", self.place, self.place_std)
        if self.velocity is not None:
            told |= named_axes("ball_velocity", self.velocity, self.velocity_std)
            told |= {"ball_speed": self.speed, "ball_speed_std": self.speed_std}
        return told

    def _known(self, value: Array | None) -> Array:
        if value is None:
            raise MotionError(
                "a velocity needs the place in two more frames of the same track, and their times"
            )
        return value
