"""Detections of an object in single frames, and rows of its track."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from blurmatte.checks import DIRECTIONS, Array, Direction, check_kind

NOTHING_MOVED = "nothing moved"  # reason of a frame that agrees with the plate


@dataclass(frozen=True)
class Sighting:
    """One streak that may be the object's, in pixels, exposures and radians.

    Its direction of time is not known; it is given as going to the right.

    Parameters
    ----------
    x, y, x_std, y_std, xy_covariance : float
        Mean position of the center, with its errors.
    vx, vy, vx_std, vy_std : float
        Mean velocity within the exposure, pixels per exposure.
    length, length_std, angle, angle_std, radius, radius_std : float
        As in `Motion`.
    first_x, first_y, last_x, last_y : float
        The ends of the path.
    color : str
        That names the object, `ColorModel.color`: its mean in this frame unless it has one paint.
    evidence : float
        Strength of its light, as in `Streak`.
    source, path, silhouette : str
        As in `Motion`.
    residual_excess : float
        Of the fitted disc, even if the numbers come from moments; as in `Diagnostics`.
    at_border, moved : bool
        As in `Motion`.
    doubts : str
        Reasons why the numbers may be wrong.
    readout : "down", "up", "left" or "right"
        As in `Motion`.
    """

    x: float
    y: float
    x_std: float
    y_std: float
    xy_covariance: float
    vx: float
    vy: float
    vx_std: float
    vy_std: float
    length: float
    length_std: float
    angle: float
    angle_std: float
    radius: float
    radius_std: float
    first_x: float
    first_y: float
    last_x: float
    last_y: float
    color: str
    evidence: float
    source: str
    path: str
    silhouette: str
    residual_excess: float
    at_border: bool
    moved: bool
    doubts: str
    readout: Direction = "down"

    @property
    def rows(self) -> tuple[float, float, float]:
        """Rows of the sensor, from that of the pixel (0, 0): of its center, and of both ends."""
        x, y = DIRECTIONS[self.readout]
        places = (self.x, self.y), (self.first_x, self.first_y), (self.last_x, self.last_y)
        center, first, last = (x * at[0] + y * at[1] for at in places)
        return center, first, last

    @property
    def place(self) -> Array:
        """(2,) position of the center, pixels."""
        return np.array([self.x, self.y])

    @property
    def covariance(self) -> Array:
        """(2, 2) covariance of the position, pixels²."""
        off = self.xy_covariance
        return np.array([[self.x_std**2, off], [off, self.y_std**2]])

    @property
    def is_whole(self) -> bool:
        """Whether a disc explains the streak and it is not cut by the border or doubtful."""
        return self.source == "sweep" and self.is_sound

    @property
    def is_sound(self) -> bool:
        """Whether it is neither cut by the border nor doubtful."""
        return not (self.at_border or self.doubts)

    def with_errors_times(self, place: float, path: float, radius: float) -> Sighting:
        """The same with the errors of position, of the path, and of the radius multiplied."""
        names = "vx_std", "vy_std", "length_std", "angle_std"
        larger = {name: path * getattr(self, name) for name in names}
        return replace(
            self,
            **larger,
            x_std=place * self.x_std,
            y_std=place * self.y_std,
            xy_covariance=place**2 * self.xy_covariance,
            radius_std=radius * self.radius_std,
        )

    def shifted(self, x: float, y: float) -> Sighting:
        """The same elsewhere, such as in the picture if it was measured in a part of it, pixels."""
        return replace(
            self,
            x=self.x + x,
            y=self.y + y,
            first_x=self.first_x + x,
            first_y=self.first_y + y,
            last_x=self.last_x + x,
            last_y=self.last_y + y,
        )

    @property
    def reversed(self) -> Sighting:
        """The motion with the direction of time reversed."""
        return replace(
            self,
            vx=-self.vx,
            vy=-self.vy,
            angle=self.angle + (-np.pi if self.angle > 0 else np.pi),
            first_x=self.last_x,
            first_y=self.last_y,
            last_x=self.first_x,
            last_y=self.first_y,
        )


@dataclass(frozen=True)
class FrameSightings:
    """Detections in one frame.

    Parameters
    ----------
    frame : int
        Its number.
    time : float or None
        Seconds.
    found : tuple of Sighting
        None, one or several.
    reason : str
        Why there is none, or why streaks were rejected; "" otherwise.
    unmeasured : int
        Number of streaks that are fainter than one that a disc explains, and were not measured.
    """

    frame: int
    time: float | None
    found: tuple[Sighting, ...]
    reason: str = ""
    unmeasured: int = 0


@dataclass(frozen=True)
class FrameMotion:
    """A row of the table of a clip: an object in one frame, or the reason why it was not found.

    Parameters
    ----------
    frame : int
        Its number.
    time : float or None
        Seconds.
    sighting : Sighting or None
        The detection, in the direction of time if that is known.
    track : int or None
        Its track, from 1. A new track begins where the object was lost for more than five frames, or
        appeared where no track predicted it.
    directed : bool
        True if the neighboring frames determine the direction of time; else it is given as going to
        the right.
    others : int
        Number of other streaks of its color, which were ignored.
    reason : str
        Why there is no detection; "" if there is one.
    object : int or None
        Number of the object, from 1.
    place_scatter, path_scatter, radius_scatter : float
        Factors by which the errors of position, of length and direction, and of the radius were
        multiplied, because the object's frames scatter more than their own errors.
    """

    frame: int
    time: float | None
    sighting: Sighting | None
    track: int | None = None
    directed: bool = False
    others: int = 0
    reason: str = ""
    object: int | None = None
    place_scatter: float = 1.0
    path_scatter: float = 1.0
    radius_scatter: float = 1.0

    @property
    def something_moved(self) -> bool:
        """Whether the frame differs from the plate, by the object or by anything else."""
        return self.sighting is not None or self.reason != NOTHING_MOVED

    @property
    def stated(self) -> Sighting | None:
        """The detection with the errors that the frame alone states."""
        if self.sighting is None:
            return None
        factors = self.place_scatter, self.path_scatter, self.radius_scatter
        return self.sighting.with_errors_times(*(1 / factor for factor in factors))

    def numbers(self) -> dict[str, Any]:
        """All by name, flat, for a row of a table; pixels, radians, exposures, seconds."""
        row: dict[str, Any] = {"frame": self.frame, "time": self.time}
        row |= {"object": self.object, "track": self.track}
        for name in Sighting.__dataclass_fields__:
            row[name] = None if self.sighting is None else getattr(self.sighting, name)
        for name in ("directed", "place_scatter", "path_scatter", "radius_scatter"):
            row[name] = None if self.sighting is None else getattr(self, name)
        return row | {"others": self.others, "reason": self.reason}


def in_intervals(rows: Sequence[FrameSightings] | Sequence[FrameMotion]) -> list[float]:
    """When each row was taken, in usual intervals between frames; its number if times are not known."""
    numbers = [float(row.frame) for row in rows]
    known = {row.frame: row.time for row in rows if row.time is not None}
    if len(known) < max(len(set(numbers)), 2):
        return numbers
    times = np.array(list(known.values()))
    interval = float(np.median(np.diff(times) / np.diff(list(known))))
    if not interval > 0 or np.diff(times).min() < 0:  # these are no times of successive frames
        return numbers
    # Rounded, so that the frames of a constant rate have whole numbers.
    return [round((known[row.frame] - times[0]) / interval, 6) for row in rows]


def parts_of_tracks(rows: Sequence[FrameMotion]) -> npt.NDArray[np.int_]:
    """Number of each row's track, from 0 in the order of their first rows.

    Nothing is known of an object between its tracks: each is a curve of its own.
    """
    tracks = [row.track for row in rows]
    numbers = {track: number for number, track in enumerate(dict.fromkeys(tracks))}
    return np.array([numbers[track] for track in tracks], np.int_)


def main_track(rows: Sequence[FrameMotion]) -> list[FrameMotion]:
    """The rows of the track with the most frames."""
    numbers = [row.track for row in rows if row.track is not None]
    longest = max(sorted(set(numbers)), key=numbers.count, default=None)
    return [row for row in rows if row.track is not None and row.track == longest]


def check_rows(rows: Iterable[object]) -> None:
    """Raise TypeError unless each is a FrameMotion."""
    for row in rows:
        check_kind("each of rows", row, FrameMotion, "use blurmatte.measure_clip(frames)")
