"""fit_fall, fit_fall_in_space: do the places of a flight lie on the parabola of a free fall?

x(t) = x₀ + v t + a t² / 2 for all coordinates, by least squares, each place weighted by its inverse
covariance. A mean place over an exposure lies a T² / 24 beside the place in its middle, T the
exposure time, which is alike in all frames and changes x₀ alone.

Where the places scatter by more than their errors, as those of compressed clips do, scatter takes the
place of the errors, if a polynomial of fourth order explains the flight no better than scatter can
make it look: an F test of nested fits. A bounce, an arc or drag of the air bends it otherwise, and of
rounds a parabola leaves nearly all.

With a known gravity g the parabola measures lengths: one pixel is |g| / |a| long, and a ball in space
is |g| / |a| times as large, and as far away, as was thought.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import factorial

import numpy as np
import numpy.typing as npt

from blurmatte.errors import MotionError
from blurmatte.motion.ball_motion import BallMotion
from blurmatte.motion.linking import FrameMotion, main_track
from blurmatte.motion.units import Scale

Array = npt.NDArray[np.float64]

_LEAST = 4  # places: with three any parabola fits
_BEST = 1e-3  # pixels: no center is known better
_UNLIKELY = 1e-3  # of χ²: noise alone does that in one of a thousand clips
_BENT = 1e-2  # of the F test: scatter alone makes one in a hundred flights look bent otherwise
_SCATTER = 0.1  # of how far the places are spread, the most that they may err
_TELLING = 7  # places: of fewer, too little is left over to compare fits
_CLEAR = 5.0  # times its error, an acceleration: below, its inverse is not normal any more
_SIGMAS = 3.0
_LEVEL = np.radians(10)  # off gravity: a camera that is held by hand is level to that
_SIMPSON = np.array([1, 4, 1]) / 6  # the mean place, of a line and of a parabola
_AXES = "xyz"


@dataclass(frozen=True, eq=False)
class FreeFall:
    """A parabola in time through the places of a flight, in a picture (n = 2) or in space (n = 3).

    Parameters
    ----------
    place, velocity, acceleration : (n,) float
        At `time`; pixels, in space meters, per second and second². x right, y down, z forward.
    acceleration_covariance : (n, n) float
        From the errors of the places, or from their scatter where that is larger and they fit.
    time : float
        Middle of the times, seconds.
    chi2 : float
        Sum of the squared residuals over their errors.
    freedom : int
        How many of them are free.
    likely : float
        How often noise alone would leave as much.
    even : float
        How often scatter alone would make a polynomial of fourth order look as much better; 0 where
        there are too few places to tell.
    scale : Scale, optional
        How many meters a unit of its places is: a pixel where it flew; in space 1, with the relative
        error that all places share.
    gravity : (n,) float, optional
        As far as known, m/s².
    gravity_std : float
        Standard deviation of its size.
    scaled_by_gravity : bool
        Whether the scale is what gravity makes of the acceleration.
    """

    place: Array
    velocity: Array
    acceleration: Array
    acceleration_covariance: Array
    time: float
    chi2: float
    freedom: int
    likely: float
    even: float = 0.0
    scale: Scale | None = None
    gravity: Array | None = None
    gravity_std: float = 0.0
    scaled_by_gravity: bool = False

    @property
    def fits(self) -> bool:
        """Whether a parabola explains the places, within their errors or as well as they scatter."""
        return self.likely > _UNLIKELY or self.even > _BENT

    @property
    def overscatter(self) -> float:
        """How many times as much as stated the places err, where their scatter took over; else 1."""
        return 1.0 if self.likely > _UNLIKELY else float(np.sqrt(self.chi2 / self.freedom))

    @property
    def unit(self) -> str:
        """Of the places: "px", or "m" in space."""
        return "px" if len(self.place) == 2 else "m"

    @property
    def size(self) -> float:
        """Of the acceleration, pixels or meters per second²."""
        return float(np.linalg.norm(self.acceleration))

    @property
    def size_std(self) -> float:
        """Its standard deviation."""
        u = self.acceleration / max(self.size, 1e-12)
        return float(np.sqrt(u @ self.acceleration_covariance @ u))

    @property
    def lengths(self) -> tuple[float, float]:
        """By what every length must be multiplied so that the acceleration is gravity, and its error.

        Lengths are those that the scale makes, in space those that the ball's radius makes: radius,
        distance, speed. The errors of scale and radius are not in it, for the fall replaces them.

        Raises
        ------
        MotionError
            If gravity or the scale is not known, or the flight is no fall.
        """
        if self.gravity is None or self.scale is None:
            raise MotionError(
                "lengths follow from a fall with a known gravity and scale; give both"
            )
        self._check()
        ratio = self._gravity_size / (self.size * self.scale.meters_per_pixel)
        return ratio, ratio * self._relative

    @property
    def objection(self) -> str:
        """Why it is no fall in this gravity, or down if none is known; "" if it is one."""
        if not self.fits:
            left = self.chi2 / self.freedom
            return (
                f"a parabola in time through its places leaves {left:.3g} times their variance: it was "
                "held, hit or slowed by air, it came nearer, or errors are larger than stated"
            )
        if not self.size > _CLEAR * self.size_std:
            return (
                f"its acceleration, {self.size:.3g} ± {self.size_std:.2g} {self.unit}/s², is not "
                f"{_CLEAR:g} times its error; a longer flight or more frames tell it better"
            )
        off = self._off
        if off > _LEVEL:
            return (
                f"its acceleration points {np.degrees(off):.0f}° off gravity; choose the flight alone, "
                "or give gravity as the camera sees it, x,y or x,y,z"
            )
        return ""

    def numbers(self) -> dict[str, float | int | bool | None]:
        """All by name, flat; with a scale in m/s² too, with gravity also what follows from it."""
        told: dict[str, float | int | bool | None] = {}
        std = np.sqrt(np.diag(self.acceleration_covariance))
        for axis, value, error in zip(_AXES, self.acceleration, std, strict=False):
            told |= {f"acceleration_{axis}": float(value), f"acceleration_{axis}_std": float(error)}
        told |= {
            "acceleration": self.size,
            "acceleration_std": self.size_std,
            "chi2": self.chi2,
            "degrees_of_freedom": self.freedom,
            "likely": self.likely,
            "overscatter": self.overscatter,
            "fits": self.fits,
        }
        if self.scale is not None:
            g, std_g = self.in_meters(self.scale)
            told |= {"acceleration_in_m_per_s2": g, "acceleration_in_m_per_s2_std": std_g}
        if self.gravity is not None:
            told |= {"gravity": self._gravity_size, "gravity_std": self.gravity_std}
            told |= self._by_gravity()
        return told

    def in_meters(self, scale: Scale) -> tuple[float, float]:
        """The acceleration's size and its error, m/s²."""
        g = self.size * scale.meters_per_pixel
        relative = np.hypot(
            self.size_std / max(self.size, 1e-12), scale.std / scale.meters_per_pixel
        )
        return g, float(g * relative)

    def _by_gravity(self) -> dict[str, float | int | bool | None]:
        if self.objection or self.scale is None:
            return {}
        if self.scaled_by_gravity:
            return {
                "meters_per_pixel": self.scale.meters_per_pixel,
                "meters_per_pixel_std": self.scale.std,
            }
        ratio, std = self.lengths
        return {"lengths_by_gravity": ratio, "lengths_by_gravity_std": std}

    def _check(self) -> None:
        if self.objection:
            raise MotionError(f"no free fall that gravity could measure: {self.objection}")

    @property
    def _gravity_size(self) -> float:
        return 0.0 if self.gravity is None else float(np.linalg.norm(self.gravity))

    @property
    def _relative(self) -> float:
        """Relative error of |g| / |a|."""
        return float(np.hypot(self.size_std / self.size, self.gravity_std / self._gravity_size))

    @property
    def _off(self) -> float:
        """By how much the acceleration points off gravity, radians; 0 if that may be its error."""
        if self.gravity is None:
            return 0.0
        down = self.gravity / self._gravity_size
        across = np.eye(len(down)) - np.outer(down, down)
        aside, along = float(np.linalg.norm(across @ self.acceleration)), down @ self.acceleration
        V = across @ self.acceleration_covariance @ across
        unsure = _SIGMAS * float(np.sqrt(np.linalg.eigvalsh(V)[-1]))
        return 0.0 if along > 0 and aside < unsure else float(np.arctan2(aside, along))


def fit_fall(
    rows: Sequence[FrameMotion],
    scale: Scale | None = None,
    gravity: npt.ArrayLike | None = None,
    gravity_std: float = 0.0,
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
        If gravity is no such number or vector.
    """
    track = main_track(rows)
    _check_count(len(track), "frames of one track")
    times = np.array([np.nan if row.time is None else row.time for row in track])
    if not np.all(np.isfinite(times)):
        raise MotionError("the frames do not tell their times; give the rate, frames per second")
    seen = [row.sighting for row in track if row.sighting is not None]
    places = np.array([s.place for s in seen])
    known = np.array([s.covariance + _BEST**2 * np.eye(2) for s in seen])
    fall = replace(_parabola(times, places, known), scale=scale)
    return _in_gravity(fall, gravity, gravity_std)


def fit_fall_in_space(
    balls: Sequence[BallMotion],
    times: Sequence[float],
    gravity: npt.ArrayLike | None = None,
    gravity_std: float = 0.0,
) -> FreeFall:
    """Fit a parabola in time to where a ball was in several frames of a flight through space.

    As a check of distance and radius: with a known gravity `lengths` says how many times as large
    as given the ball is, and so how many times as far away. So even of a ball of unknown size the
    distance is measured: give any radius to `fit_ball`, and multiply.

    Parameters
    ----------
    balls : sequence of BallMotion
        Of `fit_ball` (or `measure_ball`), all with one camera and radius.
    times : sequence of float
        Of each, seconds.
    gravity : float or (2,) or (3,) float, optional
        m/s²; a number: along y, straight down in the picture of a level camera. A vector: in the
        camera's coordinates, x right, y down, z forward.
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
        If there are fewer than four.
    ValueError
        If there is not a time for each, or gravity is no such number or vector.
    """
    t = np.asarray(times, dtype=float)
    if t.shape != (len(balls),) or not np.all(np.isfinite(t)):
        raise ValueError(f"times must be one number for each of {len(balls)} balls, got {t}")
    _check_count(len(balls), "places in space")
    D = np.kron(_SIMPSON, np.eye(3))
    places = np.array([D @ ball.positions.ravel() for ball in balls])
    known = np.array([D @ ball.picture_covariance @ D.T for ball in balls])
    shared = max(np.hypot(b.depth_parts["radius"], b.depth_parts["camera"]) for b in balls)
    fall = replace(_parabola(t, places, known), scale=Scale(1.0, float(shared)))
    return _in_gravity(fall, gravity, gravity_std)


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


def _in_gravity(fall: FreeFall, gravity: npt.ArrayLike | None, std: float) -> FreeFall:
    """The same where gravity is known, if it is; that gives the scale if there is none."""
    if gravity is None:
        return fall
    known = replace(fall, gravity=_vector(gravity, std)[: len(fall.place)], gravity_std=std)
    if not known._gravity_size > 0:
        raise ValueError(f"gravity must have a part within the picture, got {gravity!r}")
    if fall.scale is not None:
        return known
    known._check()
    scale = known._gravity_size / fall.size
    return replace(known, scale=Scale(scale, scale * known._relative), scaled_by_gravity=True)


def _check_count(count: int, what: str) -> None:
    if count < _LEAST:
        raise MotionError(f"a fall needs {_LEAST} {what}, got {count}")


def _vector(gravity: npt.ArrayLike, std: float) -> Array:
    """(3,) of a number, straight down, or of a vector of two or three."""
    g = np.asarray(gravity, dtype=float)
    if g.shape not in ((), (2,), (3,)) or not np.all(np.isfinite(g)) or not (g.ndim or g > 0):
        raise ValueError(f"gravity must be a number above 0, (x, y) or (x, y, z), got {gravity!r}")
    if not (np.isfinite(std) and std >= 0):
        raise ValueError(f"gravity_std must be finite and not negative, got {std}")
    if g.ndim == 0:
        return np.array([0.0, float(g), 0.0])
    return np.append(g, np.zeros(3 - len(g)))
