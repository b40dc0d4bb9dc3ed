"""Path length, speed and radius of an object in the frames of a clip, in meters and seconds."""

from __future__ import annotations

import math
import statistics
from collections.abc import Sequence

from blurmatte.errors import MotionError
from blurmatte.intrinsics import Intrinsics
from blurmatte.motion.clip.detections import FrameMotion, Sighting
from blurmatte.motion.clip.positions_3d import BallPlace
from blurmatte.motion.picture.motion import Scale

Uncertain = tuple[float, float]  # a number and its standard deviation


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
    if moved is None or not shares:
        return None
    length, std = moved
    share, apart = (max(shares) + min(shares)) / 2, (max(shares) - min(shares)) / 2
    error = math.hypot(std * share, length * share * T_std / T, length * apart)
    return length * share / T, error / T


def _durations(row: FrameMotion, time: Uncertain | None, line_time: float) -> list[float]:
    """How long it may have been visible, in seconds, or exposures if their time is not known."""
    if time is None or row.sighting is None:
        return [1.0]
    _, first, last = row.sighting.rows
    later = line_time * (last - first)
    return [time[0] + sign * later for sign in ((1,) if row.directed else (1, -1))]


def median_radius(rows: Sequence[FrameMotion]) -> Uncertain:
    """Median of the radii, pixels, and its error from their scatter.

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
    return middle, max(std, min(one.motion.radius_std for one in found))


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
