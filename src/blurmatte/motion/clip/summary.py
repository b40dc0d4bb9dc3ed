"""All frames of a clip together: scatter, scale and fall of each object, and the rows of its table."""

from __future__ import annotations

import math
import statistics
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np

from blurmatte.errors import MotionError
from blurmatte.intrinsics import Intrinsics
from blurmatte.motion.clip.clip_path import ClipPath, ClipRadius
from blurmatte.motion.clip.detections import FrameMotion, Sighting, check_rows
from blurmatte.motion.clip.fall import FreeFall
from blurmatte.motion.clip.fall_fit import fit_fall, fit_fall_in_space
from blurmatte.motion.clip.positions_3d import BallPlace
from blurmatte.motion.picture.motion import Scale

_MIN_FRAMES = 8  # for a scatter
_RELATIVE_STD = 1.0  # of the scatter, times √n: residuals of neighbors are correlated
Places = Sequence[BallPlace | None]
Uncertain = tuple[float, float]  # a number and its standard deviation


@dataclass(frozen=True)
class Scatter:
    """Residuals of frames from a smooth motion, in units of their stated errors.

    Parameters
    ----------
    place, radius : float
        Root of the reduced χ² of frames, each predicted from the others by stated errors: 1 if they are
        right, and the factor of all errors if they have one in common.
    count : int
        Number of frames that were compared: those that a disc explains, without doubts.
    unsteady : float
        Relative standard deviation of the radius of a single frame.

    Examples
    --------
    >>> scatter = bm.motion.Scatter(place=1.2, radius=2.0, count=30, unsteady=False)
    >>> scatter.too_large
    True
    """

    place: float
    radius: float
    count: int
    unsteady: float = 0.0

    @property
    def too_large(self) -> bool:
        """True if the scatter is above 1 by more than three of its standard deviations."""
        return self.excess_std > 3

    @property
    def excess_std(self) -> float:
        """Excess of the scatter over 1, in its own standard deviations."""
        std = _RELATIVE_STD / self.count**0.5
        return float((max(self.place, self.radius) - 1) / std)


def frame_scatter(rows: Sequence[FrameMotion]) -> Scatter | None:
    """Scatter of positions and radii of one object about its path and the change of its radius.

    Parameters
    ----------
    rows : sequence of FrameMotion
        From `measure_clip` or `link_sightings`; for several objects the rows of one.

    Returns
    -------
    Scatter or None
        None for fewer than eight frames that a disc explains and that others predict.

    Examples
    --------
    >>> scatter = bm.motion.frame_scatter(rows)
    >>> print(scatter)
    None
    """
    check_rows(rows)
    seen = [row for row in rows if row.sighting is not None]
    path, size = ClipPath.of(seen).as_stated, ClipRadius.of(seen).as_stated
    places, radii = path.chi2[path.used, 0], size.chi2[size.used, 0]
    places, radii = places[np.isfinite(places)], radii[np.isfinite(radii)]
    if min(len(places), len(radii)) < _MIN_FRAMES:
        return None
    place, radius = np.sqrt([places.mean() / 2, radii.mean()]).tolist()
    median = float(np.median(size.states.mean[size.used & size.states.known, 0]))
    return Scatter(place, radius, min(len(places), len(radii)), size.common_std / median)


@dataclass(frozen=True)
class KnownQuantities:
    """What is known of a clip besides its pictures.

    Parameters
    ----------
    scale : Scale, optional
        Of a pixel, the same in all frames.
    radius : (float, float), optional
        True radius of the object and its error, meters.
    lens : Intrinsics, optional
        Of the camera: the object is a ball in space.
    gravity : (float or list of float, float), optional
        A number (down; in space its size) or a vector, m/s², and the error of its size.
    exposure : (float, float), optional
        Exposure time and its error, seconds.
    line_time : float
        Of a rolling shutter, seconds.
    place_std : (float, float)
        Error in x and y that all places share, pixels.
    radius_std : float
        Of all radii by a transfer curve that is not stated, relative.
    """

    scale: Scale | None = None
    radius: Uncertain | None = None
    lens: Intrinsics | None = None
    gravity: tuple[float | list[float], float] | None = None
    exposure: Uncertain | None = None
    line_time: float = 0.0
    place_std: Uncertain = (0.0, 0.0)
    radius_std: float = 0.0

    def scale_of(self, rows: Sequence[FrameMotion]) -> Scale | None:
        """Meters per pixel of the object in these rows; None if unknown, or in space.

        Raises
        ------
        MotionError
            If it should follow from the radius, and the object was not found.
        """
        if self.lens is not None or self.radius is None:
            return None if self.lens is not None else self.scale
        (pixels, std), (true, true_std) = median_radius(rows), self.radius
        std = math.hypot(std, self.radius_std * pixels)
        relative = math.hypot(true_std / true, std / pixels)
        return Scale(true / pixels, true / pixels * relative)


@dataclass(frozen=True, eq=False)
class ObjectSummary:
    """What all frames of one object say.

    Parameters
    ----------
    number : int
        Of the object.
    rows : sequence of FrameMotion
    places : sequence of BallPlace or None, optional
        In space, one for each row.
    known : KnownQuantities
    scale : Scale or None
        Of all its frames, if there is one.
    fall : FreeFall or None
    no_scale, no_fall, no_gravity : str
        Why there is no scale or fall, or why gravity was not used; "" otherwise.
    """

    number: int
    rows: Sequence[FrameMotion]
    places: Places | None
    known: KnownQuantities
    scale: Scale | None = None
    fall: FreeFall | None = None
    no_scale: str = ""
    no_fall: str = ""
    no_gravity: str = ""

    @classmethod
    def of(
        cls, number: int, rows: Sequence[FrameMotion], places: Places | None, known: KnownQuantities
    ) -> ObjectSummary:
        """The summary of the rows of one object; MotionError as `scale_of`."""
        scale, reason = known.scale_of(rows), ""
        each = cls(number, rows, places, known, scale)
        if known.gravity is not None:
            try:
                return each.falling(known)
            except MotionError as error:
                reason = str(error)
        try:
            return replace(each.falling(replace(known, gravity=None)), no_gravity=reason)
        except MotionError as error:
            return replace(each, no_fall=str(error), no_gravity=reason)

    def falling(self, known: KnownQuantities) -> ObjectSummary:
        """The same with the fall, and the scale that follows from it."""
        gravity, std = known.gravity or (None, 0.0)
        if self.places is not None:
            return replace(self, fall=fit_fall_in_space(self.places, None, gravity, std))
        fall = fit_fall(self.rows, self.scale, gravity, std, known.line_time)
        return replace(self, fall=fall, scale=fall.scale)


def summaries(
    rows: Sequence[FrameMotion], places: Places | None, several: bool, known: KnownQuantities
) -> list[ObjectSummary]:
    """Of the one object of a clip, or of each; the scale is that of its own place.

    Raises
    ------
    MotionError
        If the scale should follow from the radius of the only object, and it was not found.
    """
    if not several:
        return [ObjectSummary.of(1, rows, places, known)]
    found = []
    for number in sorted({row.object for row in rows if row.object is not None}):
        of = [k for k, row in enumerate(rows) if row.object == number]
        mine, there = [rows[k] for k in of], None if places is None else [places[k] for k in of]
        try:
            found.append(ObjectSummary.of(number, mine, there, known))
        except MotionError as error:
            unscaled = replace(known, scale=None, radius=None, gravity=None)
            one = ObjectSummary.of(number, mine, there, unscaled)
            found.append(replace(one, no_scale=str(error)))
    return found


def clip_table(
    rows: Sequence[FrameMotion],
    places: Places | None,
    found: Sequence[ObjectSummary],
    known: KnownQuantities,
) -> list[dict[str, Any]]:
    """All numbers of each frame, with the speed in the best unit that is known."""
    scales = {one.number: one.scale for one in found}
    lines = []
    for k, row in enumerate(rows):
        numbers = row.numbers()
        for name, std in zip(("x_std", "y_std"), known.place_std, strict=True):
            if numbers[name] is not None:
                numbers[name] = math.hypot(numbers[name], std)
        if places is None or known.lens is None:
            scale = scales.get(row.object or 1)
            unit, moved = "px" if scale is None else "m", path_length(row.sighting, scale)
        else:
            ball = places[k]
            unit, moved = "m", path_length_in_space(ball, row.sighting, known.lens)
            numbers |= dict.fromkeys(BallPlace.names) if ball is None else ball.numbers()
        unit += "/exposure" if known.exposure is None else "/s"
        speed = mean_speed(row, moved, known.exposure, known.line_time) or (None, None)
        names = "speed", "speed_std", "speed_unit"
        lines.append(numbers | dict(zip(names, (*speed, unit), strict=True)))
    return lines


def path_length(sighting: Sighting | None, scale: Scale | None) -> Uncertain | None:
    """Path length within the exposure, meters, or pixels without a scale."""
    if sighting is None:
        return None
    length, std = sighting.motion.length, sighting.motion.length_std
    if scale is None:
        return length, std
    by = scale.meters_per_pixel
    return by * length, math.hypot(by * std, scale.std * length)


def path_length_in_space(
    ball: BallPlace | None, sighting: Sighting | None, lens: Intrinsics
) -> Uncertain | None:
    """The same of a ball in space, meters; if it was not fitted, of a disc parallel to the picture."""
    if ball is None or sighting is None:
        return None
    if ball.length is not None and ball.length_std is not None:
        return ball.length, ball.length_std
    motion = sighting.motion
    pixel = ball.distance / float(lens.magnification(motion.center))
    from_distance = motion.length * ball.distance_std / ball.distance
    return pixel * motion.length, pixel * math.hypot(motion.length_std, from_distance)


def mean_speed(
    row: FrameMotion, moved: Uncertain | None, time: Uncertain | None, line_time: float
) -> Uncertain | None:
    """Mean speed within the exposure, from the path length; None if it is not known.

    Nor is it where the border of the picture cuts the path.

    A rolling shutter shows what moves towards later rows for longer than the exposure, and what moves
    towards earlier ones for less. If the direction is not known, half of the difference is an error.

    Parameters
    ----------
    row : FrameMotion
    moved : (float, float) or None
        Path length within the exposure and its error.
    time : (float, float) or None
        Exposure time and its error, seconds; without it the speed is that per exposure.
    line_time : float
        Of a rolling shutter, seconds.
    """
    T, T_std = time or (1.0, 0.0)
    shares = [T / D for D in _durations(row, time, line_time) if D > 0]
    cut = row.sighting is not None and row.sighting.measured.at_border
    if moved is None or cut or not shares:
        return None
    length, std = moved
    share, apart = (max(shares) + min(shares)) / 2, (max(shares) - min(shares)) / 2
    error = math.hypot(std * share, length * share * T_std / T, length * apart)
    return length * share / T, error / T


def speeds_between(
    rows: Sequence[FrameMotion], scale: Scale, line_time: float = 0.0
) -> list[Uncertain]:
    """Speeds from each frame of a track to the next, m/s, and their errors with that of the scale.

    Without exposure time: from places and times alone. Frames with doubts or at the border are left
    out, and nothing follows without times.

    Parameters
    ----------
    rows : sequence of FrameMotion
        Of one object.
    scale : Scale
    line_time : float
        Of a rolling shutter, seconds.
    """
    sound = [
        (row.track, row.time, row.sighting)
        for row in rows
        if row.time is not None and row.sighting is not None and row.sighting.is_sound
    ]
    speeds = []
    for (track, begun, one), (next_track, ended, other) in pairwise(sound):
        time = ended - begun + line_time * (other.rows[0] - one.rows[0])
        apart = other.motion.center - one.motion.center
        length = float(np.linalg.norm(apart))
        if track != next_track or not (time > 0 and length > 0):
            continue
        covariance = one.motion.center_covariance + other.motion.center_covariance
        std = math.sqrt(apart @ covariance @ apart) / length
        error = math.hypot(scale.meters_per_pixel * std, scale.std * length)
        speeds.append((scale.meters_per_pixel * length / time, error / time))
    return speeds


def _durations(row: FrameMotion, time: Uncertain | None, line_time: float) -> list[float]:
    """How long it may have been visible, in seconds, or exposures if their time is not known."""
    if time is None or row.sighting is None:
        return [1.0]
    _, first, last = row.sighting.rows
    later = line_time * (last - first)
    return [time[0] + sign * later for sign in ((1,) if row.directed else (1, -1))]


def median_radius(rows: Sequence[FrameMotion]) -> Uncertain:
    """Median of the radii, pixels, and its error from their scatter.

    It is at least the usual error of a frame: codec and lens may shift all radii alike, which no
    scatter shows.

    Raises
    ------
    MotionError
        If the object was found in no frame.
    """
    found = reliable(rows)
    if not found:
        raise MotionError("the object was found in no frame, so that its size gives no scale")
    middle, scatter = median_and_scatter(found)
    # The median of normal numbers scatters by √(π/2) times as much as their mean.
    std = math.sqrt(math.pi / 2 / len(found)) * scatter
    return middle, max(std, statistics.median(one.motion.radius_std for one in found))


def reliable(rows: Sequence[FrameMotion]) -> list[Sighting]:
    """The detections off the border and without doubts, or all if there are no others."""
    found = [row.sighting for row in rows if row.sighting is not None]
    return [one for one in found if one.is_sound] or found


def median_and_scatter(found: Sequence[Sighting]) -> Uncertain:
    """Median of the radii, and their standard deviation if they are normal, by the median deviation."""
    radii = [one.motion.radius for one in found]
    middle = statistics.median_high(radii)
    deviation = statistics.median_high([abs(radius - middle) for radius in radii])
    return middle, deviation / statistics.NormalDist().inv_cdf(0.75)
