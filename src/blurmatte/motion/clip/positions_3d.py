"""3-D position and velocity of a ball of known size in each frame of a clip.

The position comes from a ball that was fitted to the frame (`fit_balls`), else from a disc
(`positions_of_discs`). The velocity is that of the parabola in time through three positions; a single
streak determines its component along the line of sight poorly. In this file the columns of S (3, k) are
the shifts of a position by one standard deviation of the radius, and of each principal component of
the camera's errors: all frames share them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from blurmatte.checks import Array, check_kind
from blurmatte.errors import MotionError
from blurmatte.intrinsics import Intrinsics, check_intrinsics
from blurmatte.motion.clip.detections import FrameMotion, Sighting, check_rows, grouped
from blurmatte.motion.picture.error_budget import (
    DIFFERENCE_STEP,
    by_axis,
    check_with_std,
    propagated,
)
from blurmatte.motion.picture.motion import MOMENTS, check_line_time
from blurmatte.motion.space.ball_motion import BallMotion
from blurmatte.motion.space.perspective_ball import positions, positions_of_discs

_MEAN = np.kron(np.array([1, 4, 1]) / 6, np.eye(3))  # over the exposure, by Simpson's rule


@dataclass(frozen=True, eq=False)
class BallPlace:
    """3-D position of a ball in one frame of a clip, and its velocity from neighboring frames.

    In the camera's coordinates: x right, y down, z forward, meters from the camera.

    Parameters
    ----------
    frame : int
        Its number.
    time : float or None
        Seconds; for a rolling shutter, when the row of its center was exposed, if that of the pixel
        (0, 0) was exposed at the time of the frame.
    track : int
        Number of its track, as in `FrameMotion`.
    place : (3,) float
        Of its center, mean over the exposure, meters.
    covariance : (3, 3) float
    picture_covariance : (3, 3) float
        The part caused by this frame alone, independent of other frames.
    shared : float
        Relative error of the distance that all frames share: of radius and camera.
    source : str
        "ball": fitted to the picture in three dimensions; else the source of the detection, a disc
        ("sweep") or "moments".
    doubted : bool
        True if the detection has doubts; velocities and falls do not use it.
    length, length_std : float or None
        Of the path within the exposure, meters; if a ball was fitted.
    velocity, velocity_covariance : (3,), (3, 3) float or None
        m/s, of the parabola in time through this position and those of the frames before and after
        (at the ends of a track, of the next two).

    Examples
    --------
    >>> lens = bm.Intrinsics.from_focal_length(28, image.size, sensor_width=36)
    >>> balls = bm.motion.places_in_space(rows, lens, radius=0.02)
    >>> print(f"{balls[0].distance:.4f} ± {balls[0].distance_std:.4f} m")
    0.3884 ± 0.0003 m
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
        """The mean position of the motion in one picture."""
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
        """(3,) standard deviations of the position, meters."""
        return np.asarray(np.sqrt(np.diag(self.covariance)))

    @property
    def is_fitted(self) -> bool:
        """Whether a ball was fitted to the picture in three dimensions."""
        return self.source == "ball"

    @property
    def has_shape(self) -> bool:
        """Whether it is that of a ball or of a disc, and not from the moments of alpha."""
        return self.source != MOMENTS

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
        """Magnitude of the velocity, m/s."""
        return float(np.linalg.norm(self._known(self.velocity)))

    @property
    def speed_std(self) -> float:
        """Its standard deviation."""
        u = self._known(self.velocity) / max(self.speed, 1e-12)
        return float(np.sqrt(u @ self._known(self.velocity_covariance) @ u))

    def numbers(self) -> dict[str, float | str | None]:
        """All numbers by name (`names`), flat, for a row of a table; velocities None if unknown."""
        row: dict[str, float | str | None] = dict.fromkeys(self.names)
        row["ball_source"] = self.source
        row |= by_axis("ball", self.place, self.place_std)
        if self.velocity is not None:
            row |= by_axis("ball_velocity", self.velocity, self.velocity_std)
            row |= {"ball_speed": self.speed, "ball_speed_std": self.speed_std}
        return row

    def _known(self, value: Array | None) -> Array:
        if value is None:
            raise MotionError(
                "a velocity needs the position in two more frames of the same track, and their times"
            )
        return value


def places_in_space(
    rows: Sequence[FrameMotion],
    intrinsics: Intrinsics,
    radius: float,
    radius_std: float = 0.0,
    balls: Sequence[BallMotion | None] | None = None,
    line_time: float = 0.0,
) -> list[BallPlace | None]:
    """3-D position and velocity of a ball in each frame of a clip.

    From the ball that was fitted to the picture (`fit_balls`), else from position and radius of the
    detection, as of a disc; errors of moments do not include shading and compression.

    Parameters
    ----------
    rows : sequence of FrameMotion
        From `measure_clip`, `link_sightings` or `link_objects`.
    intrinsics : Intrinsics
        Of the camera.
    radius, radius_std : float
        Of the ball, or of each of several, and its standard deviation; meters.
    balls : sequence of BallMotion or None, optional
        From `fit_balls`, one for each row; they replace the doubts of moments.
    line_time : float
        Delay of a rolling shutter from each row of the sensor to the next, seconds.

    Returns
    -------
    list of BallPlace or None
        One for each row; None without a detection, or where the distortion has no inverse.

    Raises
    ------
    ValueError
        If radius is not above 0, its error is negative, or line_time longer than frames allow.

    Examples
    --------
    >>> lens = bm.Intrinsics.from_focal_length(28, image.size, sensor_width=36)
    >>> balls = bm.motion.places_in_space(rows, lens, radius=0.02)
    >>> [round(float(ball.distance), 2) for ball in balls[:3]]
    [0.39, 0.35, 0.34]
    """
    check_rows(rows)
    check_intrinsics("intrinsics", intrinsics)
    check_with_std("radius", radius, radius_std)
    check_line_time_of_clip(line_time, rows)
    fitted = [None] * len(rows) if balls is None else balls
    for ball in fitted:
        check_kind("each of balls", ball, BallMotion | None, "use blurmatte.motion.fit_balls")
    places, shared = dict[int, BallPlace](), dict[int, Array]()
    for k, (row, ball) in enumerate(zip(rows, fitted, strict=True)):
        place = _place(row, ball, intrinsics, radius, line_time)
        if place is not None and np.all(np.isfinite(place.place)):
            shared[k] = _shared(place.place, intrinsics, radius, radius_std)
            places[k] = _with_shared_errors(place, shared[k])
    for track in _tracks(rows, places):
        _set_velocities(places, track, shared)
    return [places.get(k) for k in range(len(rows))]


def check_line_time_of_clip(line_time: float, rows: Sequence[FrameMotion]) -> None:
    """Raise ValueError unless a rolling shutter can read the rows of all detections in time."""
    seen = [row.sighting.rows[0] for row in rows if row.sighting is not None]
    most = max(map(abs, seen), default=0.0)
    times = sorted({row.time for row in rows if row.time is not None})
    interval = float(np.median(np.diff(times))) if len(times) > 1 else None
    check_line_time(line_time, most, interval)


def _with_shared_errors(ball: BallPlace, S: Array) -> BallPlace:
    """The position with the errors that all frames share."""
    covariance = ball.picture_covariance + S @ S.T
    shared = float(np.linalg.norm(ball.place @ S)) / ball.distance**2
    return replace(ball, covariance=covariance, shared=shared)


def _place(
    row: FrameMotion,
    ball: BallMotion | None,
    intrinsics: Intrinsics,
    radius: float,
    line_time: float,
) -> BallPlace | None:
    """Position from a fitted ball, else from the disc of a detection, with the errors of the frame."""
    seen = row.sighting
    if seen is None:
        return None
    if ball is None:
        place = _of_disc(row, seen, intrinsics, radius)
    else:
        place = replace(BallPlace.of(ball, row.frame, row.time), track=row.track or 1)
    doubted = bool(seen.doubts) and (ball is None or seen.motion.has_shape)
    time = None if row.time is None else row.time + line_time * seen.rows[0]
    return replace(place, doubted=doubted, time=time)


def _of_disc(row: FrameMotion, seen: Sighting, intrinsics: Intrinsics, radius: float) -> BallPlace:
    """Position from that of a disc; not finite where the distortion has no inverse."""
    covariance = np.zeros((3, 3))
    covariance[:2, :2], covariance[2, 2] = seen.motion.center_covariance, seen.motion.radius_std**2

    def place(disc: Array) -> Array:
        """Position of a disc (x, y, radius), meters."""
        return np.asarray(
            radius * positions_of_discs(intrinsics, disc[None, :2], disc[2].item())[0]
        )

    x, V = propagated(place, np.array([*seen.motion.center, seen.motion.radius]), covariance)
    return BallPlace(row.frame, row.time, row.track or 1, x, V, V, 0.0, seen.motion.source)


def _shared(place: Array, intrinsics: Intrinsics, radius: float, radius_std: float) -> Array:
    """S of a position: the image stays, radius or camera changes."""
    pixel = intrinsics.project(place[None])
    size = intrinsics.magnification(pixel) * radius / np.linalg.norm(place)
    columns = [place * radius_std / radius]
    squares, parts = np.linalg.eigh(intrinsics.covariance)
    for square, part in zip(squares, parts.T, strict=True):
        if square > 0:
            step = DIFFERENCE_STEP * np.sqrt(square) * part
            cameras = [intrinsics.with_values(intrinsics.values + d) for d in (step, -step)]
            ends = [radius * positions(camera, pixel, size)[0] for camera in cameras]
            columns.append((ends[0] - ends[1]) / (2 * DIFFERENCE_STEP))
    return np.stack(columns, axis=1)


def _tracks(rows: Sequence[FrameMotion], places: Mapping[int, BallPlace]) -> list[list[int]]:
    """Indices of the rows of each track, in order; those without doubts and with a time."""
    use = {k for k, one in places.items() if not one.doubted and one.time is not None}
    tracks = grouped(rows, lambda row: (row.object, row.track))
    return [[k for k in track if k in use] for track in tracks]


def _set_velocities(
    places: dict[int, BallPlace], track: Sequence[int], shared: Mapping[int, Array]
) -> None:
    """Set the velocities on a track, each from three positions; none if it has fewer."""
    for n, k in enumerate(track[: 0 if len(track) < 3 else None]):
        first = min(max(n - 1, 0), len(track) - 3)
        near = track[first : first + 3]
        balls = [places[j] for j in near]
        t = np.array([ball.time for ball in balls], float)
        if np.any(np.diff(t) <= 0):
            continue
        w = np.linalg.inv(np.vander(t - t[n - first], increasing=True))[1]
        S = np.einsum("i,ijk->jk", w, [shared[j] for j in near])
        V = np.einsum("i,ijk->jk", w**2, [ball.picture_covariance for ball in balls])
        velocity = w @ [ball.place for ball in balls]
        places[k] = replace(places[k], velocity=velocity, velocity_covariance=V + S @ S.T)
