"""places_in_space: where a ball of known size was in each frame of a clip, and how fast.

A ball that was fitted to a frame tells where in space it was (`fit_balls`), else a disc does
(`positions_of_discs`). The frames beside it tell how it moved: its velocity is that of the parabola in
time through three places, along the line of sight too, of which a single streak knows little. In this
file the columns of S (3, k) are what one standard deviation of the radius, or of a part of the camera,
moves a place by: all frames share them.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from blurmatte.checks import check_kind
from blurmatte.intrinsics import Intrinsics, check_intrinsics
from blurmatte.motion.ball import positions_of_discs
from blurmatte.motion.ball_motion import BallMotion
from blurmatte.motion.ball_place import BallPlace
from blurmatte.motion.linking import FrameMotion, check_rows
from blurmatte.motion.propagation import propagated
from blurmatte.motion.seen_ball import positions
from blurmatte.motion.shutter import check_line_time_of_clip
from blurmatte.motion.sightings import Sighting
from blurmatte.motion.sources import check_number

Array = npt.NDArray[np.float64]

_STEP = 1e-3  # of a standard deviation: small beside what bends, large beside rounding
_THREE = 3  # places that make a parabola


def places_in_space(
    rows: Sequence[FrameMotion],
    intrinsics: Intrinsics,
    radius: float,
    radius_std: float = 0.0,
    balls: Sequence[BallMotion | None] | None = None,
    line_time: float = 0.0,
) -> list[BallPlace | None]:
    """Where a ball was in space in each frame of a clip, and how fast.

    From where a ball was fitted to the picture (`fit_balls`), which knows that a ball is no disc beside
    the middle of the picture, and grows as it comes nearer. Else from place and size of what was
    found, as if it were a disc; of moments the errors know neither shading nor compression.

    Parameters
    ----------
    rows : sequence of FrameMotion
        Of `measure_clip`, `link_sightings` or `link_objects`.
    intrinsics : Intrinsics
        Of the camera.
    radius, radius_std : float
        Of the ball, or of each of several, and its standard deviation; meters.
    balls : sequence of BallMotion or None, optional
        Of `fit_balls`, one for each row. One that explains the picture has no doubts of moments.
    line_time : float
        How much later a rolling shutter exposes each row of pixels than the one above, seconds. A frame
        is read before the next one.

    Returns
    -------
    list of BallPlace or None
        One for each row; None where nothing was found, or the camera's distortion cannot be undone.

    Raises
    ------
    ValueError
        If radius is not above 0, its error is negative, or line_time is not finite, or longer than
        frames allow.
    """
    check_rows(rows)
    check_intrinsics("intrinsics", intrinsics)
    check_number("radius", radius, radius_std)
    check_line_time_of_clip(line_time, rows)
    told: list[BallPlace | None] = [None] * len(rows)
    shared: dict[int, Array] = {}
    fitted = [None] * len(rows) if balls is None else balls
    for ball in fitted:
        check_kind("each of balls", ball, BallMotion | None, "use blurmatte.fit_balls")
    for k, (row, ball) in enumerate(zip(rows, fitted, strict=True)):
        if row.sighting is None:
            continue
        seen = row.sighting
        place = _of_disc(row, seen, intrinsics, radius)
        if ball is not None:
            place = replace(BallPlace.of(ball, row.frame, row.time), track=place.track)
        if np.all(np.isfinite(place.place)):
            S = _shared(place.place, intrinsics, radius, radius_std)
            time = None if row.time is None else row.time + line_time * seen.y
            doubted = bool(seen.doubts) and (ball is None or seen.source == "sweep")
            told[k] = replace(_sharing(place, S), time=time, doubted=doubted)
            shared[k] = S
    for way in _ways(rows, told):
        _tell_velocities(told, way, shared)
    return told


def _of_disc(row: FrameMotion, seen: Sighting, intrinsics: Intrinsics, radius: float) -> BallPlace:
    """What place and size of a sighting tell; not finite where the distortion cannot be undone."""
    covariance = np.zeros((3, 3))
    covariance[:2, :2], covariance[2, 2] = seen.covariance, seen.radius_std**2

    def place(disc: Array) -> Array:
        return np.asarray(
            radius * positions_of_discs(intrinsics, disc[None, :2], disc[2].item())[0]
        )

    x, V = propagated(place, np.array([seen.x, seen.y, seen.radius]), covariance)
    return BallPlace(row.frame, row.time, row.track or 1, x, V, V, 0.0, seen.source)


def _shared(place: Array, intrinsics: Intrinsics, radius: float, radius_std: float) -> Array:
    """S of a place: the picture stays, radius or camera is another one."""
    pixel = intrinsics.project(place[None])
    size = intrinsics.magnification(pixel) * radius / np.linalg.norm(place)
    columns = [place * radius_std / radius]
    squares, parts = np.linalg.eigh(intrinsics.covariance)
    for square, part in zip(squares, parts.T, strict=True):
        if square > 0:
            step = _STEP * np.sqrt(square) * part
            cameras = [intrinsics.with_values(intrinsics.values + d) for d in (step, -step)]
            ends = [radius * positions(camera, pixel, size)[0] for camera in cameras]
            columns.append((ends[0] - ends[1]) / (2 * _STEP))
    return np.stack(columns, axis=1)


def _sharing(ball: BallPlace, S: Array) -> BallPlace:
    """A place with the errors that all frames share."""
    return replace(
        ball,
        covariance=ball.picture_covariance + S @ S.T,
        shared=float(np.linalg.norm(ball.place @ S)) / ball.distance**2,
    )


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
