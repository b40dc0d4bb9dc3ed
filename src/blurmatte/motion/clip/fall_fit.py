"""fit_fall, fit_fall_in_space: the parabola of a free fall through the positions of a flight.

x(t) = x₀ + v t + a t² / 2 for all coordinates, by least squares, each position weighted by its inverse
covariance. The mean position over an exposure differs from that in its middle by a T² / 24, T the
exposure time; this shift is the same in all frames and changes only x₀.

Positions at the border of the picture and those with doubts have the weight 0, since their errors are
not known. Of the others, those that differ by more than noise does from the parabola that is likeliest
under Student's t (`smoothing`) are outliers, and have the weight 0 if they are few.

If the positions scatter by more than their errors, as in compressed clips, their scatter replaces the
errors, provided that a polynomial of fourth order is not significantly better: an F test of nested
fits. It rejects a bounce, an arc or air drag. A path around a circle is rejected because the residuals
of the parabola are nearly as large as the path.
"""

from collections.abc import Sequence
from dataclasses import replace
from math import factorial

import numpy as np
import numpy.typing as npt
import scipy

from blurmatte.checks import Array, Bools, check_kind
from blurmatte.errors import MotionError
from blurmatte.motion.clip import smoothing
from blurmatte.motion.clip.detections import FrameMotion, check_rows, main_track
from blurmatte.motion.clip.fall import FreeFall
from blurmatte.motion.clip.positions_3d import BallPlace, check_line_time_of_clip
from blurmatte.motion.picture.motion import Scale
from blurmatte.motion.space.ball_motion import BallMotion

_MIN_POSITIONS = 4  # any three positions lie on a parabola
_MIN_F_POSITIONS = 7  # fewer leave too few degrees of freedom for the F test
_MAX_OUTLIER_FRACTION = 0.2  # of the positions: more are no mistakes of single frames
_MAX_SCATTER = 0.1  # of the spread of the positions, the largest error
_REWEIGHTINGS = 30  # of positions; their weights then change by less than a thousandth


def fit_fall(
    rows: Sequence[FrameMotion],
    scale: Scale | None = None,
    gravity: npt.ArrayLike | None = None,
    gravity_std: float = 0.0,
    line_time: float = 0.0,
) -> FreeFall:
    """Fit a parabola in time to the longest track, the path of a free flight.

    This checks the flight; with a known gravity and no scale, it also gives the scale. Frames at the
    border and those with doubts have no weight, if there are four others; nor has a frame in five or
    fewer that differs from the parabola of the others by more than noise (`FreeFall.off`).

    Parameters
    ----------
    rows : sequence of FrameMotion
        From `measure_clip` or `link_sightings`; only frames of the flight.
    scale : Scale, optional
        For an acceleration in m/s².
    gravity : float or (2,) or (3,) float, optional
        m/s². A number: downward in the picture. A vector: in the camera's coordinates, x right, y down,
        z forward; if the camera looks up or down, only the part parallel to the picture accelerates
        the image. The change of distance by the other part must be small.
    gravity_std : float
        Standard deviation of its magnitude.
    line_time : float
        Delay of a rolling shutter from each row of the sensor to the next, seconds; a frame is read
        before the next one. The next row lies in the direction `readout` of each detection.

    Returns
    -------
    FreeFall
        With gravity also a `scale`, or `lengths`, the ratio to the scale that was given.

    Raises
    ------
    MotionError
        For fewer than four frames, or unknown times. If the scale is computed from gravity, also if no
        parabola with a significant acceleration towards gravity explains the positions.
    ValueError
        If gravity is no such number or vector, or line_time is not finite, or longer than frames allow.

    Examples
    --------
    >>> free_fall = bm.motion.fit_fall(rows)
    >>> for sentence in bm.explain(free_fall):
    ...     print(sentence)
    It agrees with a free fall: the residuals of a parabola in time have 0.44 times the variance
    of its positions, as noise does. Its acceleration is 6254 ± 4.8 px/s², 89.987 ± 0.063° from
    right towards down (down).
    """
    check_rows(rows)
    check_kind("scale", scale, Scale | None, "use blurmatte.Scale(meters_per_pixel)")
    check_line_time_of_clip(line_time, rows)
    track = main_track(rows)
    _check_count(len(track), "frames of one track")
    fall = replace(_fall_of_track(track, line_time), scale=scale)
    return fall if gravity is None else fall.in_gravity(gravity, gravity_std)


def _fall_of_track(track: Sequence[FrameMotion], line_time: float) -> FreeFall:
    """The parabola of the rows of a track."""
    seen = [row.sighting for row in track if row.sighting is not None]
    places = np.array([s.motion.center for s in seen])
    times = _times([row.time for row in track]) + line_time * np.array([s.rows[0] for s in seen])
    least = smoothing.MIN_STD_PX**2 * np.eye(2)
    known = np.array([s.motion.center_covariance + least for s in seen])
    sound = np.array([one.is_sound for one in seen])
    return _fall([row.frame for row in track], times, places, known, sound)


def fit_fall_in_space(
    balls: Sequence[BallMotion | BallPlace | None],
    times: Sequence[float] | None = None,
    gravity: npt.ArrayLike | None = None,
    gravity_std: float = 0.0,
) -> FreeFall:
    """Fit a parabola in time to the 3-D positions of a ball in several frames of a flight.

    This checks distance and radius: with a known gravity, `lengths` is the ratio of the true radius and
    distance to those that were given or found. The distance of a ball of unknown size can be measured:
    give any radius, and multiply.

    Parameters
    ----------
    balls : sequence of BallMotion, or of BallPlace or None
        From `fit_ball` (or `measure_ball`), all with one camera and radius. Or from `places_in_space`:
        those of the longest track without doubts are used; give only frames of the flight.
    times : sequence of float, optional
        Of each BallMotion, seconds; a BallPlace has its own.
    gravity : float or (3,) float, optional
        m/s²; a number: its magnitude, in any direction. A vector: in the camera's coordinates, x right,
        y down, z forward.
    gravity_std : float
        Standard deviation of its magnitude.

    Returns
    -------
    FreeFall
        In meters. Its covariance is that of the pictures; the errors of radius and camera, which all
        frames share, are that of its `scale`.

    Raises
    ------
    MotionError
        For fewer than four positions, or unknown times.
    ValueError
        Without a time for each, or if gravity is no such number or vector.

    Examples
    --------
    >>> lens = bm.Intrinsics.from_focal_length(28, image.size, sensor_width=36)
    >>> balls = bm.motion.places_in_space(rows, lens, radius=0.02)
    >>> fall = bm.motion.fit_fall_in_space(balls)
    >>> print(f"{fall.acceleration[1]:.1f} m/s² downwards")
    21.0 m/s² downwards
    """
    used = _flight(balls) if times is None else _timed(balls, times)
    _check_count(len(used), "positions in space")
    fall = _fall(
        [ball.frame for ball in used],
        _times([ball.time for ball in used]),
        np.array([ball.place for ball in used]),
        np.array([ball.picture_covariance for ball in used]),
        np.ones(len(used), bool),
    )
    fall = replace(fall, scale=Scale(1.0, max(ball.shared for ball in used)))
    return fall if gravity is None else fall.in_gravity(gravity, gravity_std)


def _flight(balls: Sequence[BallMotion | BallPlace | None]) -> list[BallPlace]:
    """The positions without doubts of the longest track."""
    sound = []
    for ball in balls:
        if isinstance(ball, BallMotion):
            raise ValueError("times must be one number for each BallMotion, got none")
        check_kind("each of balls", ball, BallPlace | None, "use blurmatte.motion.places_in_space")
        if ball is not None and not ball.doubted:
            sound.append(ball)
    tracks = [ball.track for ball in sound]
    longest = max(sorted(set(tracks)), key=tracks.count, default=0)
    return [ball for ball in sound if ball.track == longest]


def _timed(
    balls: Sequence[BallMotion | BallPlace | None], times: Sequence[float]
) -> list[BallPlace]:
    """Mean positions of single pictures, with their times."""
    t = np.asarray(times, dtype=float)
    if t.shape != (len(balls),) or not np.all(np.isfinite(t)):
        raise ValueError(f"times must be one number for each of {len(balls)} balls, got {t}")
    timed = []
    for k, ball in enumerate(balls):
        if not isinstance(ball, BallMotion):
            raise ValueError("times are for BallMotions; a BallPlace has its own")
        timed.append(BallPlace.of(ball, k, float(t[k])))
    return timed


def _times(times: Sequence[float | None]) -> Array:
    t = np.array([np.nan if time is None else time for time in times])
    if not np.all(np.isfinite(t)):
        raise MotionError("the frames have no times; give the rate, frames per second")
    if len(np.unique(t)) < _MIN_POSITIONS:
        raise MotionError(
            f"a fall needs {_MIN_POSITIONS} different times, got {len(np.unique(t))}; give "
            "the rate, frames per second"
        )
    return t


def _fall(
    frames: Sequence[int], times: Array, places: Array, known: Array, sound: Bools
) -> FreeFall:
    """The parabola of the sound positions, without a few outliers; of all, if few are sound.

    Numbers of frames (m,), times (m,), positions (m, n), and their covariances (m, n, n).
    """
    if sound.sum() < _MIN_POSITIONS:
        sound = np.ones(len(sound), bool)
    excess = _excess(times, places, known, sound)
    used = sound & (excess <= 1)
    most = _MAX_OUTLIER_FRACTION * sound.sum()
    if used.sum() < _MIN_F_POSITIONS or (sound & ~used).sum() > most:
        used = sound
    off = np.flatnonzero(~used & (excess > 1)).tolist()
    fall = _parabola(times[used], places[used], known[used])
    return replace(fall, off=tuple(frames[k] for k in off))


def _excess(times: Array, places: Array, known: Array, sound: Bools) -> Array:
    """(m,) χ² about the Student-t parabola of the sound positions, over the limit of noise."""
    t, n = times - times[sound].mean(), places.shape[1]
    W, freedom = np.linalg.inv(known), np.full(len(t), float(n))
    weights, chi2 = np.ones(len(t)), np.zeros(len(t))
    count = int(sound.sum())
    free = n * max(count - 3, 1)
    share = free / (n * count)  # of χ² that the parabola leaves
    for _ in range(_REWEIGHTINGS):
        weighted = known[sound] / weights[sound, None, None]
        found, *_ = _polynomial(t[sound], places[sound], weighted, 2)
        off = places - _powers(t, 2) @ found
        chi2 = np.einsum("mi,mij,mj->m", off, W, off)
        chi2 /= smoothing.noise_scale(chi2[sound] / share, freedom[sound])
        weights = smoothing.student_weights(chi2, freedom)
    limit = smoothing.MIN_OUTLIER_PROBABILITY / count
    return np.asarray(chi2 / n / scipy.special.fdtri(n, free, 1 - limit))


def _parabola(times: Array, places: Array, known: Array) -> FreeFall:
    """The most likely parabola through positions (m, n) with the covariances (m, n, n)."""
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
        float(scipy.special.chdtrc(freedom, chi2)),
    )
    if count < _MIN_F_POSITIONS or fall.fits:
        return fall
    if chi2 > _MAX_SCATTER**2 * _polynomial(times - middle, places, known, 0)[2]:
        return fall
    less = _polynomial(times - middle, places, known, 4)[2]
    added, free = 2 * n, n * (count - 5)
    ratio = (chi2 - less) / added / (less / free)
    fall = replace(fall, even=float(scipy.special.fdtrc(added, free, ratio)))
    inflated = fall.acceleration_covariance * fall.overscatter**2
    return replace(fall, acceleration_covariance=inflated) if fall.fits else fall


def _polynomial(t: Array, places: Array, known: Array, degree: int) -> tuple[Array, Array, float]:
    """Derivatives (degree + 1, n) at t = 0, their covariance and χ², by weighted least squares."""
    n = places.shape[1]
    J = np.kron(_powers(t, degree)[:, None], np.eye(n))
    W = np.linalg.inv(known)
    H = np.einsum("mia,mij,mjb->ab", J, W, J)
    found = np.linalg.solve(H, np.einsum("mia,mij,mj->a", J, W, places))
    residuals = places - J @ found
    chi2 = float(np.einsum("mi,mij,mj->", residuals, W, residuals))
    return found.reshape(-1, n), np.linalg.inv(H), chi2


def _powers(t: Array, degree: int) -> Array:
    """(m, degree + 1) factors of the derivatives in the positions at times t (m,)."""
    return np.stack([t**k / factorial(k) for k in range(degree + 1)], axis=1)


def _check_count(count: int, what: str) -> None:
    if count < _MIN_POSITIONS:
        raise MotionError(f"a fall needs {_MIN_POSITIONS} {what}, got {count}")
