"""Detections of an object in single frames, and rows of its track."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from blurmatte.checks import DIRECTIONS, Array, Box, Direction, check_kind
from blurmatte.motion.columns import Column, TableRow
from blurmatte.motion.picture.motion import Motion
from blurmatte.sweep.model.priors import MotionPrior

_CUT = (
    "It reaches the border of the picture: what is beyond is unknown, so that place, length and radius "
    "may be off by more than their errors."
)
NOTHING_MOVED = "nothing moved"  # reason of a frame that agrees with the plate
NO_COLOR = (  # of one that does not
    "nothing of the object's color moved: it is out of the picture, at rest in the plate too, or "
    "hidden"
)


@dataclass(frozen=True, eq=False)
class Sighting:
    """One streak that may be the object's: its motion in one frame, and what the clip says of it.

    Parameters
    ----------
    measured : Motion
        From the frame alone, in pixels of the frame, without its `sweep`. Its direction of time is not
        known; it is given as going to the right. Its `doubts` include those by other frames.
    color : str
        That names the object, `ColorModel.color`: its mean in this frame unless it has one paint.
    evidence : float
        Strength of its light, as in `Streak`.
    residual_excess : float
        Of the fitted disc, even if the numbers come from moments; as in `Diagnostics`.
    box : (int, int, int, int)
        x0, y0, x1, y1 of the part of the frame in which it was measured, always in pixels of the
        frame: what differs from the plate there, with a margin.
    backward : bool
        True if the other frames say that it went the other way, to the left.
    place_scatter, path_scatter, radius_scatter : float
        Factors of the errors of position, of length and direction, and of the radius: the object's
        frames scatter more than their own errors.

    Examples
    --------
    >>> seen = rows[2].sighting
    >>> seen.motion.center.round(1), seen.color
    (array([51. , 22.9]), '#ffc046')
    >>> seen.is_whole, seen.is_sound
    (True, True)
    """

    measured: Motion
    color: str
    evidence: float
    residual_excess: float
    box: Box
    backward: bool = False
    place_scatter: float = 1.0
    path_scatter: float = 1.0
    radius_scatter: float = 1.0

    def read_out(self, readout: Direction) -> Sighting:
        """The same by a camera whose next row lies in this direction."""
        return replace(self, measured=replace(self.measured, readout=readout))

    @cached_property
    def motion(self) -> Motion:
        """The motion in the direction of time if that is known; its errors explain the scatter."""
        motion = self.measured.reversed if self.backward else self.measured
        return motion.with_errors_times(self.place_scatter, self.path_scatter, self.radius_scatter)

    @property
    def velocity(self) -> Array:
        """(2,) mean velocity within the exposure, pixels per exposure."""
        angle, L = self.measured.angle, self.measured.length
        sign = -1 if self.backward else 1
        return np.array([sign * (L * np.cos(angle)), sign * (L * np.sin(angle))])

    @property
    def velocity_std(self) -> Array:
        """(2,) standard deviations of the velocity, pixels per exposure."""
        motion = self.measured
        c, s, L = np.cos(motion.angle), np.sin(motion.angle), motion.length
        J = np.array([[c, -L * s], [s, L * c]])
        names = ("length", "angle")
        V = J @ np.array([[motion.covariance_of(a, b) for b in names] for a in names]) @ J.T
        return np.asarray(self.path_scatter * np.sqrt(np.maximum(np.diag(V), 0)))

    @property
    def moved(self) -> bool:
        """Whether the frame alone shows that it moved, as in `Motion`."""
        return self.measured.moved

    def mapped(self, points: Callable[[Array], Array]) -> Sighting:
        """The same in the pixels of another picture, into which a function maps points (n, 2)."""
        return replace(self, measured=self.measured.mapped(points))

    @property
    def rows(self) -> tuple[float, float, float]:
        """Rows of the sensor, from that of the pixel (0, 0): of its center, and of both ends."""
        places = np.array([self.motion.center, *self.motion.trajectory.xy[[0, -1]]])
        center, first, last = (places @ DIRECTIONS[self.motion.readout]).tolist()
        return center, first, last

    @property
    def is_whole(self) -> bool:
        """Whether a disc explains the streak and it is not cut by the border or doubtful."""
        return self.measured.has_shape and self.is_sound

    @property
    def is_sound(self) -> bool:
        """Whether it is neither cut by the border nor doubtful."""
        return not self.doubts

    @property
    def doubts(self) -> tuple[str, ...]:
        """Why its numbers may be wrong: reasons of frame and clip, and that the border cuts it."""
        return (*self.measured.doubts, *((_CUT,) if self.measured.at_border else ()))

    @property
    def stated(self) -> Sighting:
        """The same with the errors that the frame alone states."""
        return replace(self, place_scatter=1.0, path_scatter=1.0, radius_scatter=1.0)

    @property
    def reversed(self) -> Sighting:
        """The motion with the direction of time reversed."""
        return replace(self, backward=not self.backward)

    def with_doubts(self, *doubts: str) -> Sighting:
        """The same with these doubts instead of its own."""
        return replace(self, measured=replace(self.measured, doubts=doubts))


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

    Examples
    --------
    >>> frame = found[2]
    >>> frame.frame, len(frame.found)
    (2, 1)
    """

    frame: int
    time: float | None
    found: tuple[Sighting, ...]
    reason: str = ""
    unmeasured: int = 0


@dataclass(frozen=True)
class FrameMotion(TableRow):
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
    prior : MotionPrior, optional
        What the other frames say of its motion, where it is solved; no column of the table.

    Examples
    --------
    >>> row = rows[0]
    >>> row.frame, row.time, row.sighting.motion.center.round(1)
    (0, 0.0, array([16.3, 44.6]))
    """

    frame: int
    time: float | None
    sighting: Sighting | None
    track: int | None = None
    directed: bool = False
    others: int = 0
    reason: str = ""
    object: int | None = None
    prior: MotionPrior | None = field(default=None, repr=False)

    @property
    def place(self) -> tuple[int, int]:
        """Number of the frame and of the object, by which rows of all tables are found."""
        return self.frame, self.object or 1

    @property
    def something_moved(self) -> bool:
        """Whether the frame differs from the plate, by the object or by anything else."""
        return self.sighting is not None or self.reason != NOTHING_MOVED

    @property
    def color_moved(self) -> bool:
        """Whether light of the object's color moved."""
        return self.something_moved and self.reason != NO_COLOR

    def mapped(self, points: Callable[[Array], Array]) -> FrameMotion:
        """The row with detection and prior in another picture, as `Sighting.mapped`."""
        one = self.sighting
        if one is None:
            return self
        prior = self.prior and self.prior.mapped(points, one.measured.center)
        return replace(self, sighting=one.mapped(points), prior=prior)

    @property
    def stated(self) -> Sighting | None:
        """The detection with the errors that the frame alone states."""
        return None if self.sighting is None else self.sighting.stated

    @property
    def columns(self) -> Sequence[Column[FrameMotion]]:
        """The columns of its table."""
        return CLIP_COLUMNS


def _seen(name: str, unit: str, of: Callable[[Sighting], Any]) -> Column[FrameMotion]:
    """A column that is read from the detection; empty without one."""
    return Column(name, unit, lambda row: None if row.sighting is None else of(row.sighting))


CLIP_COLUMNS: tuple[Column[FrameMotion], ...] = (
    Column("frame", "", lambda row: row.frame),
    Column("time", "s", lambda row: row.time),
    Column("object", "", lambda row: row.object),
    Column("track", "", lambda row: row.track),
    _seen("x", "px", lambda one: float(one.motion.center[0])),
    _seen("y", "px", lambda one: float(one.motion.center[1])),
    _seen("x_std", "px", lambda one: float(one.motion.center_std[0])),
    _seen("y_std", "px", lambda one: float(one.motion.center_std[1])),
    _seen("xy_covariance", "px²", lambda one: one.motion.covariance_of("x", "y")),
    _seen("vx", "px/exposure", lambda one: float(one.velocity[0])),
    _seen("vy", "px/exposure", lambda one: float(one.velocity[1])),
    _seen("vx_std", "px/exposure", lambda one: float(one.velocity_std[0])),
    _seen("vy_std", "px/exposure", lambda one: float(one.velocity_std[1])),
    _seen("length", "px", lambda one: one.motion.length),
    _seen("length_std", "px", lambda one: one.motion.length_std),
    _seen("angle", "rad", lambda one: one.motion.angle),
    _seen("angle_std", "rad", lambda one: one.motion.angle_std),
    _seen("radius", "px", lambda one: one.motion.radius),
    _seen("radius_std", "px", lambda one: one.motion.radius_std),
    _seen("first_x", "px", lambda one: float(one.motion.trajectory.xy[0, 0])),
    _seen("first_y", "px", lambda one: float(one.motion.trajectory.xy[0, 1])),
    _seen("last_x", "px", lambda one: float(one.motion.trajectory.xy[-1, 0])),
    _seen("last_y", "px", lambda one: float(one.motion.trajectory.xy[-1, 1])),
    _seen("color", "", lambda one: one.color),
    _seen("evidence", "", lambda one: one.evidence),
    _seen("source", "", lambda one: one.motion.source),
    _seen("path", "", lambda one: one.motion.path),
    _seen("silhouette", "", lambda one: one.motion.silhouette),
    _seen("residual_excess", "", lambda one: one.residual_excess),
    _seen("at_border", "", lambda one: one.motion.at_border),
    _seen("moved", "", lambda one: one.moved),
    _seen("doubts", "", lambda one: " ".join(one.doubts)),
    _seen("readout", "", lambda one: one.motion.readout),
    Column("directed", "", lambda row: None if row.sighting is None else row.directed),
    _seen("place_scatter", "", lambda one: one.place_scatter),
    _seen("path_scatter", "", lambda one: one.path_scatter),
    _seen("radius_scatter", "", lambda one: one.radius_scatter),
    Column("others", "", lambda row: row.others),
    Column("reason", "", lambda row: row.reason),
)


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


def grouped(rows: Sequence[FrameMotion], key: Callable[[FrameMotion], Hashable]) -> list[list[int]]:
    """Indices of the rows with a detection that have the same key, in the order of their first."""
    groups: dict[Hashable, list[int]] = {}
    for k, row in enumerate(rows):
        if row.sighting is not None:
            groups.setdefault(key(row), []).append(k)
    return list(groups.values())


def by_object(rows: Iterable[FrameMotion]) -> dict[int, list[FrameMotion]]:
    """The rows of each object that have a detection, by its number."""
    objects: dict[int, list[FrameMotion]] = {}
    for row in rows:
        if row.sighting is not None:
            objects.setdefault(row.object or 1, []).append(row)
    return dict(sorted(objects.items()))


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
