"""BallMotion: the motion of a ball in three dimensions, and its error budget."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from blurmatte.checks import Array
from blurmatte.errors import MotionError
from blurmatte.intrinsics import Intrinsics
from blurmatte.motion.picture.error_budget import (
    ErrorBudget,
    OverExposure,
    Source,
    by_axis,
    check_exposure,
    check_with_std,
    covariances,
    relative_errors,
)
from blurmatte.sweep.model.path import PARABOLA

_POSITIONS = 9  # coordinates of three positions
_DEPTH = 5  # index of z in the middle of the exposure


@dataclass(frozen=True, eq=False)
class BallMotion(OverExposure, ErrorBudget):
    """Positions of a ball in three dimensions during the exposure, and its speed.

    In the camera's coordinates: x right, y down, z forward, meters from the camera. A picture does not
    determine the direction of time: the reversed flight (`reversed`) gives the same picture.

    Parameters
    ----------
    positions : (3, 3) float
        Of its center at the beginning, in the middle and at the end of the exposure, meters.
    covariance : (9, 9) float
        Of the positions, row by row.
    picture_covariance : (9, 9) float
        The part caused by the picture alone, independent of other frames of the ball.
    length, length_std : float
        Of its path, meters.
    depth, depth_std : float
        Along the optical axis, in the middle of the exposure, meters.
    path : str
        "line" or "parabola" in space, fitted to the picture; or "disc": from a disc of constant
        radius, which assumes a speed of 0 along the line of sight.
    parts, depth_parts : mapping of str to float
        Relative errors of the speed, and of the depth, that each source alone causes: the "picture",
        the "radius" of the ball, the "camera", and the "exposure time".
    exposure_time, exposure_std : float or None, float
        Seconds.

    Examples
    --------
    >>> lens = bm.Intrinsics.from_focal_length(28, image.size, sensor_width=36)
    >>> ball = bm.motion.measure_ball(sweep, lens, radius=0.02, exposure_time=1 / 60)
    >>> print(f"{ball.speed:.2f} ± {ball.speed_std:.2f} m/s, {ball.depth:.3f} m away")
    7.32 ± 0.03 m/s, 0.200 m away
    """

    positions: Array
    covariance: Array
    picture_covariance: Array
    length: float
    length_std: float
    depth: float
    depth_std: float
    path: str
    parts: Mapping[str, float]
    depth_parts: Mapping[str, float]
    exposure_time: float | None = None
    exposure_std: float = 0.0

    def __repr__(self) -> str:
        moved = f"{self.length:.4g} ± {self.length_std:.2g} m on a {self.path}"
        if self.path == "disc":
            moved = f"{self.length:.4g} ± {self.length_std:.2g} m at constant distance"
        speed = self._speed_in_words()
        return f"BallMotion({self.depth:.4g} ± {self.depth_std:.2g} m away, {moved}{speed})"

    @property
    def positions_std(self) -> Array:
        """(3, 3) standard deviations of the positions, meters."""
        return np.asarray(np.sqrt(np.diag(self.covariance)).reshape(3, 3))

    @property
    def displacement(self) -> Array:
        """(3,) from the beginning to the end, meters."""
        return np.asarray(self.positions[2] - self.positions[0])

    @property
    def displacement_std(self) -> Array:
        """(3,) standard deviations of the displacement, meters."""
        return np.asarray(np.sqrt(np.diag(self._difference @ self.covariance @ self._difference.T)))

    @property
    def velocity(self) -> Array:
        """(3,) mean over the exposure, m/s."""
        return np.asarray(self.displacement / self._seconds)

    @property
    def velocity_std(self) -> Array:
        """(3,) standard deviations of the velocity, m/s."""
        of_time = self.displacement * self.exposure_std / self._seconds
        return np.asarray(np.hypot(self.displacement_std, of_time) / self._seconds)

    @property
    def acceleration(self) -> Array:
        """(3,) m/s²; zeros if the fitted path is a line."""
        start, middle, end = self.positions
        return np.asarray(4 * (start - 2 * middle + end) / self._seconds**2)

    @property
    def acceleration_std(self) -> Array:
        """(3,) standard deviations of the acceleration, m/s²; zeros for a line."""
        bend = np.kron([4.0, -8.0, 4.0], np.eye(3))
        variance = np.diag(bend @ self.covariance @ bend.T)
        return np.asarray(np.sqrt(np.maximum(variance, 0)) / self._seconds**2)

    def numbers(self) -> dict[str, float | str]:
        """All numbers by name, flat, for a row of a table: meters, and m/s if the time is known."""
        row: dict[str, float | str] = {"ball_path": self.path}
        row |= {"ball_depth": self.depth, "ball_depth_std": self.depth_std}
        row |= {"ball_length": self.length, "ball_length_std": self.length_std}
        for when, place, std in zip(
            ("start", "middle", "end"), self.positions, self.positions_std, strict=True
        ):
            row |= by_axis(f"ball_{when}", place, std)
        if self.exposure_time is not None:
            row |= {"ball_speed": self.speed, "ball_speed_std": self.speed_std}
            row |= by_axis("ball_velocity", self.velocity, self.velocity_std)
        return row | {"ball_error_from": self.dominant}

    @property
    def reversed(self) -> BallMotion:
        """The reversed flight, which gives the same picture."""
        order = np.kron(np.eye(3)[::-1], np.eye(3))
        return replace(
            self,
            positions=self.positions[::-1],
            covariance=order @ self.covariance @ order.T,
            picture_covariance=order @ self.picture_covariance @ order.T,
        )

    @property
    def _difference(self) -> Array:
        return np.asarray(np.kron([-1.0, 0.0, 1.0], np.eye(3)), dtype=float)

    @property
    def _moved(self) -> tuple[float, float]:
        return self.length, self.length_std


def ball_motion(
    nodes: Callable[[Array, Array], Array],
    picture: Source,
    intrinsics: Intrinsics,
    radius: tuple[float, float],
    exposure: tuple[float | None, float],
    path: str,
) -> BallMotion:
    """BallMotion from positions in ball radii, with the errors of all their inputs.

    nodes: positions (3, 3) at the beginning, middle and end, radii, as a function of the parameters
        `picture` and of the values of a camera.
    radius, exposure: with their standard deviations, meters and seconds.
    """
    check_with_std("radius", *radius)
    check_exposure(*exposure)
    sources = {
        "picture": picture,
        "radius": Source.number(*radius),
        "camera": Source(intrinsics.values, intrinsics.covariance),
    }

    def positions_and_length(parameters: Array, size: Array, values: Array) -> Array:
        """Positions at begin, middle and end, and the path length, meters."""
        X = size[0] * nodes(parameters, values)
        return np.concatenate([X.ravel(), [_length(X)]])

    values, parts, total = covariances(positions_and_length, sources)
    if not np.all(np.isfinite(values)):
        raise MotionError("the ball is seen where the camera's distortion cannot be undone")
    length, depth = float(values[_POSITIONS]), float(values[_DEPTH])
    relative = relative_errors(parts, _POSITIONS, max(length, 1e-12), *exposure)
    return BallMotion(
        values[:_POSITIONS].reshape(3, 3),
        total[:_POSITIONS, :_POSITIONS],
        parts["picture"][:_POSITIONS, :_POSITIONS],
        length,
        float(np.sqrt(total[_POSITIONS, _POSITIONS])),
        depth,
        float(np.sqrt(total[_DEPTH, _DEPTH])),
        path,
        relative,
        relative_errors(parts, _DEPTH, depth),
        *exposure,
    )


def _length(X: Array) -> float:
    """Length of the parabola through three positions (3, 3) at equally spaced times."""
    points = PARABOLA.weights(np.linspace(0, 1, 33)) @ X
    return float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum())
