"""FreeFall: a parabola in time through the places of a flight, and what a known gravity makes of it.

With a known gravity g the parabola measures lengths: one pixel is |g| / |a| long, and a ball in space
is |g| / |a| times as large, and as far away, as was thought.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from blurmatte.checks import check_kind
from blurmatte.errors import MotionError
from blurmatte.motion.sources import named_axes
from blurmatte.motion.units import Scale

Array = npt.NDArray[np.float64]

_UNLIKELY = 1e-3  # of χ²: noise alone does that in one of a thousand clips
_BENT = 1e-2  # of the F test: scatter alone makes one in a hundred flights look bent otherwise
_CLEAR = 5.0  # times its error, an acceleration: below, its inverse is not normal any more
_SIGMAS = 3.0
_LEVEL = np.radians(10)  # off gravity: a camera that is held by hand is level to that


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
        As far as known, m/s²; (1,) in space, where only its size is.
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
            left, nearer = self.chi2 / self.freedom, "it came nearer, " if self.unit == "px" else ""
            return (
                f"a parabola in time through its places leaves {left:.3g} times their variance: it was "
                f"held, hit or slowed by air, {nearer}or errors are larger than stated"
            )
        if not self.size > _CLEAR * self.size_std:
            return (
                f"its acceleration, {self.size:.3g} ± {self.size_std:.2g} {self.unit}/s², is not "
                f"{_CLEAR:g} times its error; a longer flight or more frames tell it better"
            )
        off, std = self.off_gravity
        if self.directed and off > max(_LEVEL, _SIGMAS * std):
            vector = "x,y or x,y,z" if self.unit == "px" else "x,y,z, or its size alone"
            return (
                f"its acceleration points {np.degrees(off):.0f}° off gravity; choose the flight alone, "
                f"or give gravity as the camera sees it, {vector}"
            )
        return ""

    @property
    def directed(self) -> bool:
        """Whether it is known where gravity points."""
        return self.gravity is not None and len(self.gravity) == len(self.place)

    @property
    def off_gravity(self) -> tuple[float, float]:
        """Angle between acceleration and gravity, and its error, radians.

        From straight down in the picture, if it is not known where gravity points.
        """
        down = np.eye(len(self.place))[1]
        if self.gravity is not None and self.directed:
            down = self.gravity / self._gravity_size
        across = np.eye(len(down)) - np.outer(down, down)
        aside, along = across @ self.acceleration, float(down @ self.acceleration)
        spread = np.linalg.eigvalsh(across @ self.acceleration_covariance @ across)[-1]
        angle = float(np.arctan2(np.linalg.norm(aside), along))
        return angle, float(np.sqrt(max(spread, 0))) / max(self.size, 1e-12)

    def in_gravity(self, gravity: npt.ArrayLike, std: float = 0.0) -> FreeFall:
        """The same where gravity is known; that gives the scale if there is none.

        Parameters
        ----------
        gravity : float or (2,) or (3,) float
            m/s²; as `fit_fall` and `fit_fall_in_space` have it.
        std : float
            Standard deviation of its size.

        Raises
        ------
        MotionError
            If it is to give the scale, and no parabola of clear acceleration towards gravity explains
            the places.
        ValueError
            If gravity is no such number or vector.
        """
        known = replace(self, gravity=self._vector(gravity, std), gravity_std=std)
        if not known._gravity_size > 0:
            raise ValueError(f"gravity must have a part within the picture, got {gravity!r}")
        if self.scale is not None:
            return known
        known._check()
        scale = known._gravity_size / self.size
        return replace(known, scale=Scale(scale, scale * known._relative), scaled_by_gravity=True)

    def numbers(self) -> dict[str, float | int | bool | None]:
        """All by name, flat; with a scale in m/s² too, with gravity also what follows from it."""
        told: dict[str, float | int | bool | None] = {}
        std = np.sqrt(np.diag(self.acceleration_covariance))
        told |= named_axes("acceleration", self.acceleration, std)
        off, off_std = self.off_gravity
        told |= {
            "acceleration": self.size,
            "acceleration_std": self.size_std,
            "off_gravity": off,
            "off_gravity_std": off_std,
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
        check_kind("scale", scale, Scale, "use blurmatte.Scale(meters_per_pixel)")
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

    def _vector(self, gravity: npt.ArrayLike, std: float) -> Array:
        """(n,) of a vector, or of a number: straight down, or (1,) in space."""
        g, flat = np.asarray(gravity, dtype=float), self.unit == "px"
        shapes = ((), (2,), (3,)) if flat else ((), (3,))
        if g.shape not in shapes or not np.all(np.isfinite(g)) or not (g.ndim or g > 0):
            vectors = "(x, y) or (x, y, z)" if flat else "(x, y, z) in space"
            raise ValueError(f"gravity must be a number above 0, {vectors}, got {gravity!r}")
        if not (np.isfinite(std) and std >= 0):
            raise ValueError(f"gravity_std must be finite and not negative, got {std}")
        if g.ndim == 0:
            return np.array([0.0, float(g)] if flat else [float(g)])
        return g[: len(self.place)]
