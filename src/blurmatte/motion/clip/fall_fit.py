"""fit_fall, fit_fall_in_space: the parabola of a free fall through the positions of a flight.

x(t) = x₀ + v t + a t² / 2 for all coordinates, by least squares, each position weighted by its inverse
covariance. The mean position over an exposure differs from that in its middle by a T² / 24, T the
exposure time; this shift is the same in all frames and changes only x₀.

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

from blurmatte.checks import check_kind
from blurmatte.errors import MotionError
from blurmatte.motion.clip.detections import FrameMotion, check_rows, main_track
from blurmatte.motion.clip.fall import FallSettings, FreeFall
from blurmatte.motion.clip.positions_3d import BallPlace, check_line_time_of_clip
from blurmatte.motion.picture.motion import Scale
from blurmatte.motion.space.ball_motion import BallMotion

Array = npt.NDArray[np.float64]


def fit_fall(
    rows: Sequence[FrameMotion],
    scale: Scale | None = None,
    gravity: npt.ArrayLike | None = None,
    gravity_std: float = 0.0,
    line_time: float = 0.0,
) -> FreeFall:
    """Fit a parabola in time to the longest track, the path of a free flight.

    This checks the flight; with a known gravity and no scale, it also gives the scale.

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
    """
    check_rows(rows)
    check_kind("scale", scale, Scale | None, "use blurmatte.Scale(meters_per_pixel)")
    check_line_time_of_clip(line_time, rows)
    track = main_track(rows)
    _check_count(len(track), "frames of one track")
    seen = [row.sighting for row in track if row.sighting is not None]
    places = np.array([s.place for s in seen])
    rows_of_sensor = np.array([s.rows[0] for s in seen])
    times = _times([row.time for row in track]) + line_time * rows_of_sensor
    least = FallSettings.min_position_std_px**2 * np.eye(2)
    known = np.array([s.covariance + least for s in seen])
    fall = replace(_parabola(times, places, known), scale=scale)
    return fall if gravity is None else fall.in_gravity(gravity, gravity_std)


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
    """
    flight = _flight(balls) if times is None else _timed(balls, times)
    _check_count(len(flight), "positions in space")
    t = _times([ball.time for ball in flight])
    places = np.array([ball.place for ball in flight])
    known = np.array([ball.picture_covariance for ball in flight])
    scale = Scale(1.0, max(ball.shared for ball in flight))
    fall = replace(_parabola(t, places, known), scale=scale)
    return fall if gravity is None else fall.in_gravity(gravity, gravity_std)


def _flight(balls: Sequence[BallMotion | BallPlace | None]) -> list[BallPlace]:
    """The positions without doubts of the longest track."""
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
    return t


def _parabola(times: Array, places: Array, known: Array) -> FreeFall:
    """The most likely parabola through positions (m, n) with the covariances (m, n, n)."""
    from scipy.special import chdtrc, fdtrc  # scipy.stats takes a second to import

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
    if count < FallSettings.min_f_positions or fall.fits:
        return fall
    if chi2 > FallSettings.max_scatter**2 * _polynomial(times - middle, places, known, 0)[2]:
        return fall
    less = _polynomial(times - middle, places, known, 4)[2]
    added, free = 2 * n, n * (count - 5)
    ratio = (chi2 - less) / added / (less / free)
    fall = replace(fall, even=float(fdtrc(added, free, ratio)))
    inflated = fall.acceleration_covariance * fall.overscatter**2
    return replace(fall, acceleration_covariance=inflated) if fall.fits else fall


def _polynomial(t: Array, places: Array, known: Array, degree: int) -> tuple[Array, Array, float]:
    """Derivatives (degree + 1, n) at t = 0, their covariance and χ², by weighted least squares."""
    n = places.shape[1]
    powers = np.stack([t**k / factorial(k) for k in range(degree + 1)], axis=1)
    J = np.kron(powers[:, None], np.eye(n))
    W = np.linalg.inv(known)
    H = np.einsum("mia,mij,mjb->ab", J, W, J)
    found = np.linalg.solve(H, np.einsum("mia,mij,mj->a", J, W, places))
    residuals = places - J @ found
    chi2 = float(np.einsum("mi,mij,mj->", residuals, W, residuals))
    return found.reshape(-1, n), np.linalg.inv(H), chi2


def _check_count(count: int, what: str) -> None:
    if count < FallSettings.min_positions:
        raise MotionError(f"a fall needs {FallSettings.min_positions} {what}, got {count}")
