"""fit_fall, fit_fall_in_space: do the places of a flight lie on the parabola of a free fall?

x(t) = x₀ + v t + a t² / 2 for all coordinates, by least squares, each place weighted by its inverse
covariance. A mean place over an exposure lies a T² / 24 beside the place in its middle, T the
exposure time, which is alike in all frames and changes x₀ alone.

Where the places scatter by more than their errors, as those of compressed clips do, scatter takes the
place of the errors, if a polynomial of fourth order explains the flight no better than scatter can
make it look: an F test of nested fits. A bounce, an arc or drag of the air bends it otherwise, and of
rounds a parabola leaves nearly all.
"""

from collections.abc import Sequence
from dataclasses import replace
from math import factorial

import numpy as np
import numpy.typing as npt

from blurmatte.checks import check_kind
from blurmatte.errors import MotionError
from blurmatte.motion.ball_motion import BallMotion
from blurmatte.motion.ball_place import BallPlace
from blurmatte.motion.fall import FreeFall
from blurmatte.motion.linking import FrameMotion, check_rows, main_track
from blurmatte.motion.shutter import check_line_time_of_clip
from blurmatte.motion.units import Scale

Array = npt.NDArray[np.float64]

_LEAST = 4  # places: with three any parabola fits
_BEST = 1e-3  # pixels: no center is known better
_SCATTER = 0.1  # of how far the places are spread, the most that they may err
_TELLING = 7  # places: of fewer, too little is left over to compare fits


def fit_fall(
    rows: Sequence[FrameMotion],
    scale: Scale | None = None,
    gravity: npt.ArrayLike | None = None,
    gravity_std: float = 0.0,
    line_time: float = 0.0,
) -> FreeFall:
    """Fit a parabola in time to the longest track: a free flight is one.

    That is a check; or, with a known gravity and no scale, it gives the scale.

    Parameters
    ----------
    rows : sequence of FrameMotion
        Of `measure_clip` or `link_sightings`; frames of the flight alone.
    scale : Scale, optional
        For an acceleration in m/s² too.
    gravity : float or (2,) or (3,) float, optional
        m/s². A number: straight down in the picture. A vector: as the camera sees it, x right, y down,
        z forward; of a camera that looks up or down, only the part within the picture accelerates
        what is seen. In the other part it comes nearer or goes away, which must be little.
    gravity_std : float
        Standard deviation of its size.
    line_time : float
        How much later a rolling shutter exposes each row of pixels than the one above, seconds. A frame
        is read before the next one.

    Returns
    -------
    FreeFall
        If gravity is known: with a `scale` by it, or `lengths`, how it compares to the one given.

    Raises
    ------
    MotionError
        If it has fewer than four frames, or their times are not known. If gravity is to give the
        scale, also if no parabola of clear acceleration towards gravity explains the places.
    ValueError
        If gravity is no such number or vector, or line_time is not finite, or longer than frames allow.
    """
    check_rows(rows)
    check_kind("scale", scale, Scale | None, "use blurmatte.Scale(meters_per_pixel)")
    check_line_time_of_clip(line_time, rows)
    track = main_track(rows)
    _check_count(len(track), "frames of one track")
    seen = [row.sighting for row in track if row.sighting is not None]
    places = np.array([s.place for s in seen])
    times = _times([row.time for row in track]) + line_time * places[:, 1]
    known = np.array([s.covariance + _BEST**2 * np.eye(2) for s in seen])
    fall = replace(_parabola(times, places, known), scale=scale)
    return fall if gravity is None else fall.in_gravity(gravity, gravity_std)


def fit_fall_in_space(
    balls: Sequence[BallMotion | BallPlace | None],
    times: Sequence[float] | None = None,
    gravity: npt.ArrayLike | None = None,
    gravity_std: float = 0.0,
) -> FreeFall:
    """Fit a parabola in time to where a ball was in several frames of a flight through space.

    As a check of distance and radius: with a known gravity `lengths` says how many times as large
    as given the ball is, and so how many times as far away. So even of a ball of unknown size the
    distance is measured: give any radius, and multiply.

    Parameters
    ----------
    balls : sequence of BallMotion, or of BallPlace or None
        Of `fit_ball` (or `measure_ball`), all with one camera and radius. Or of `places_in_space`:
        those without doubts of the longest track are used; let them be of the flight alone.
    times : sequence of float, optional
        Of each BallMotion, seconds; a BallPlace has its own.
    gravity : float or (3,) float, optional
        m/s²; a number: its size, wherever it points. A vector: in the camera's coordinates, x right, y
        down, z forward.
    gravity_std : float
        Standard deviation of its size.

    Returns
    -------
    FreeFall
        In meters. Its covariance is that of the pictures; errors of radius and camera, which all
        frames share, are the one of its `scale`.

    Raises
    ------
    MotionError
        If there are fewer than four, or times are not known.
    ValueError
        If there is not a time for each, or gravity is no such number or vector.
    """
    flight = _flight(balls) if times is None else _timed(balls, times)
    _check_count(len(flight), "places in space")
    t = _times([ball.time for ball in flight])
    places = np.array([ball.place for ball in flight])
    known = np.array([ball.picture_covariance for ball in flight])
    scale = Scale(1.0, max(ball.shared for ball in flight))
    fall = replace(_parabola(t, places, known), scale=scale)
    return fall if gravity is None else fall.in_gravity(gravity, gravity_std)


def _flight(balls: Sequence[BallMotion | BallPlace | None]) -> list[BallPlace]:
    """The sound places of the longest track."""
    sound = []
    for ball in balls:
        if isinstance(ball, BallMotion):
            raise ValueError("times must be one number for each BallMotion, got none")
        check_kind("each of balls", ball, BallPlace | None, "use blurmatte.places_in_space")
        if ball is not None and not ball.doubted:
            sound.append(ball)
    tracks = [ball.track for ball in sound]
    longest = max(sorted(set(tracks)), key=tracks.count, default=0)
    return [ball for ball in sound if ball.track == longest]


def _timed(
    balls: Sequence[BallMotion | BallPlace | None], times: Sequence[float]
) -> list[BallPlace]:
    """Mean places of single pictures, at times."""
    t = np.asarray(times, dtype=float)
    if t.shape != (len(balls),) or not np.all(np.isfinite(t)):
        raise ValueError(f"times must be one number for each of {len(balls)} balls, got {t}")
    timed = []
    for k, ball in enumerate(balls):
        if not isinstance(ball, BallMotion):
            raise ValueError("times are for BallMotions; places in space have their own")
        timed.append(BallPlace.of(ball, k, float(t[k])))
    return timed


def _times(times: Sequence[float | None]) -> Array:
    t = np.array([np.nan if time is None else time for time in times])
    if not np.all(np.isfinite(t)):
        raise MotionError("the frames do not tell their times; give the rate, frames per second")
    return t


def _parabola(times: Array, places: Array, known: Array) -> FreeFall:
    """The most likely parabola through places (m, n) with the covariances (m, n, n)."""
    from scipy.special import chdtrc, fdtrc  # `stats` has them too, and takes a second to import

    (count, n), middle = places.shape, float(times.mean())
    found, covariance, chi2 = _polynomial(times - middle, places, known, 2)
    freedom = n * (count - 3)
    place, velocity, acceleration = found
    fall = FreeFall(
        place,
        velocity,
        acceleration,
        covariance[2 * n :, 2 * n :],
        middle,
        chi2,
        freedom,
        float(chdtrc(freedom, chi2)),
    )
    if count < _TELLING or fall.fits:
        return fall
    if chi2 > _SCATTER**2 * _polynomial(times - middle, places, known, 0)[2]:
        return fall  # it goes another way: nothing errs by so much of the whole path
    less = _polynomial(times - middle, places, known, 4)[2]
    more, left = 2 * n, n * (count - 5)
    ratio = (chi2 - less) / more / (less / left)
    fall = replace(fall, even=float(fdtrc(more, left, ratio)))
    grown = fall.acceleration_covariance * fall.overscatter**2
    return replace(fall, acceleration_covariance=grown) if fall.fits else fall


def _polynomial(t: Array, places: Array, known: Array, degree: int) -> tuple[Array, Array, float]:
    """Derivatives (degree + 1, n) at t = 0, their covariance and χ², by weighted least squares."""
    n = places.shape[1]
    powers = np.stack([t**k / factorial(k) for k in range(degree + 1)], axis=1)
    J = np.kron(powers[:, None], np.eye(n))
    W = np.linalg.inv(known)
    H = np.einsum("mia,mij,mjb->ab", J, W, J)
    found = np.linalg.solve(H, np.einsum("mia,mij,mj->a", J, W, places))
    left = places - J @ found
    chi2 = float(np.einsum("mi,mij,mj->", left, W, left))
    return found.reshape(-1, n), np.linalg.inv(H), chi2


def _check_count(count: int, what: str) -> None:
    if count < _LEAST:
        raise MotionError(f"a fall needs {_LEAST} {what}, got {count}")
