"""places_in_space: where a ball of known size was in each frame of a clip, and how fast.

A disc of a frame tells where in space the ball was (`positions_of_discs`), and the frames beside it how
it moved: its velocity is that of the parabola in time through three places, along the line of sight
too, of which a single streak knows next to nothing. In this file the columns of S (3, k) are what one
standard deviation of the radius, or of the camera, moves a place by: all frames share them.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
import numpy.typing as npt

from blurmatte.errors import MotionError
from blurmatte.intrinsics import Intrinsics
from blurmatte.motion.ball import positions_of_discs
from blurmatte.motion.ball_motion import BallMotion
from blurmatte.motion.linking import FrameMotion
from blurmatte.motion.sources import check_number, named_axes

Array = npt.NDArray[np.float64]

_STEP = 1e-3  # of a standard deviation: small beside what bends, large beside rounding
_THREE = 3  # places that make a parabola
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
        Seconds.
    track : int
        Which track it belongs to, as in `FrameMotion`.
    place : (3,) float
        Of its center, mean over the exposure.
    covariance : (3, 3) float
    picture_covariance : (3, 3) float
        What of that comes from this frame's picture, and is not shared by other frames.
    shared : float
        Relative error of the distance that all frames share: of radius and camera.
    doubted : bool
        Whether the sighting has doubts; nothing else is made of such a place.
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
    doubted: bool
    velocity: Array | None = None
    velocity_covariance: Array | None = None

    names: ClassVar[tuple[str, ...]] = (
        *(f"ball_{axis}{std}" for axis in "xyz" for std in ("", "_std")),
        *(f"ball_velocity_{axis}{std}" for axis in "xyz" for std in ("", "_std")),
        *("ball_speed", "ball_speed_std"),
    )

    @classmethod
    def of(cls, motion: BallMotion, frame: int, time: float) -> "BallPlace":
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
            doubted=False,
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

    def numbers(self) -> dict[str, float | None]:
        """All numbers by name (`names`), flat, for a row of a table; velocities None if not known."""
        told: dict[str, float | None] = dict.fromkeys(self.names)
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


def places_in_space(
    rows: Sequence[FrameMotion],
    intrinsics: Intrinsics,
    radius: float,
    radius_std: float = 0.0,
) -> list[BallPlace | None]:
    """Where a ball was in space in each frame of a clip, and how fast.

    Parameters
    ----------
    rows : sequence of FrameMotion
        Of `measure_clip`, `link_sightings` or `link_objects`.
    intrinsics : Intrinsics
        Of the camera.
    radius, radius_std : float
        Of the ball, or of each of several, and its standard deviation; meters.

    Returns
    -------
    list of BallPlace or None
        One for each row; None where nothing was found, no disc explains what was, or the camera's
        distortion cannot be undone.

    Raises
    ------
    ValueError
        If radius is not above 0, or its error is negative.
    """
    check_number("radius", radius, radius_std)
    told: list[BallPlace | None] = [None] * len(rows)
    discs = [k for k, row in enumerate(rows) if row.sighting and row.sighting.source == "sweep"]
    if not discs:
        return told
    sights = [rows[k].sighting for k in discs]
    seen = np.array([(s.x, s.y, s.radius) for s in sights if s])
    errors = np.zeros((len(discs), 3, 3))
    errors[:, :2, :2] = [s.covariance for s in sights if s]
    errors[:, 2, 2] = [s.radius_std**2 for s in sights if s]
    X = radius * positions_of_discs(intrinsics, seen[:, :2], seen[:, 2])
    J = radius * _by_discs(intrinsics, seen, errors)
    pictures = J @ errors @ J.swapaxes(1, 2)
    S = np.concatenate(
        [X[:, :, None] * radius_std / radius, radius * _by_camera(intrinsics, seen)], axis=2
    )
    for k, x, V, s in zip(discs, X, pictures, S, strict=True):
        if np.all(np.isfinite(x)):
            told[k] = _place(rows[k], x, V, s)
    shared = dict(zip(discs, S, strict=True))
    for way in _ways(rows, told):
        _tell_velocities(told, way, shared)
    return told


def _place(row: FrameMotion, x: Array, picture: Array, S: Array) -> BallPlace:
    distance = float(np.linalg.norm(x))
    shared = float(np.linalg.norm(x @ S)) / distance**2
    doubted = row.sighting is not None and bool(row.sighting.doubts)
    return BallPlace(
        row.frame, row.time, row.track or 1, x, picture + S @ S.T, picture, shared, doubted
    )


def _by_discs(intrinsics: Intrinsics, seen: Array, errors: Array) -> Array:
    """(m, 3, 3) derivatives of places in radii by x, y and radius of the discs (m, 3), pixels."""
    J = np.empty((len(seen), 3, 3))
    steps = _STEP * np.sqrt(np.diagonal(errors, axis1=1, axis2=2)) + 1e-9
    for i, step in enumerate(steps.T):
        shift = np.zeros_like(seen)
        shift[:, i] = step
        ends = [
            positions_of_discs(intrinsics, d[:, :2], d[:, 2]) for d in (seen + shift, seen - shift)
        ]
        J[:, :, i] = (ends[0] - ends[1]) / (2 * step[:, None])
    return J


def _by_camera(intrinsics: Intrinsics, seen: Array) -> Array:
    """(m, 3, k) by what each independent part of the camera's error moves places, radii."""
    squares, parts = np.linalg.eigh(intrinsics.covariance)
    moved = []
    for square, part in zip(squares, parts.T, strict=True):
        if square > 0:
            step = _STEP * np.sqrt(square) * part
            ends = [
                positions_of_discs(
                    intrinsics.with_values(intrinsics.values + d), seen[:, :2], seen[:, 2]
                )
                for d in (step, -step)
            ]
            moved.append((ends[0] - ends[1]) / (2 * _STEP))
    return np.stack(moved, axis=2) if moved else np.zeros((len(seen), 3, 0))


def _ways(rows: Sequence[FrameMotion], told: Sequence[BallPlace | None]) -> list[list[int]]:
    """Which rows lie on each track, in order; those that are sound and have a time."""
    ways: dict[tuple[int | None, int | None], list[int]] = {}
    for k, (row, ball) in enumerate(zip(rows, told, strict=True)):
        if ball is not None and not ball.doubted and ball.time is not None:
            ways.setdefault((row.object, row.track), []).append(k)
    return list(ways.values())


def _tell_velocities(
    told: list[BallPlace | None], way: Sequence[int], shared: dict[int, Array]
) -> None:
    """Into the places of a track."""
    for n, k in enumerate(way[: 0 if len(way) < _THREE else None]):
        first = min(max(n - 1, 0), len(way) - _THREE)
        near = way[first : first + _THREE]
        balls = [ball for j in near if (ball := told[j]) is not None]
        t = np.array([ball.time for ball in balls], float)
        here = told[k]
        assert here is not None
        assert here.time is not None
        if np.any(np.diff(t) <= 0):
            continue
        w = np.linalg.inv(np.vander(t - here.time, increasing=True))[1]
        S = np.einsum("i,ijk->jk", w, [shared[j] for j in near])
        V = np.einsum("i,ijk->jk", w**2, [ball.picture_covariance for ball in balls])
        velocity = w @ [ball.place for ball in balls]
        told[k] = replace(here, velocity=velocity, velocity_covariance=V + S @ S.T)
