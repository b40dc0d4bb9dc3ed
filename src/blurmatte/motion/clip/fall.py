"""FreeFall: a parabola in time through the positions of a flight, and the scale from gravity.

With a known gravity g the parabola measures lengths: one pixel is |g| / |a| meters, and radius and
distance of a ball in space are |g| / |a| times those that were assumed.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from blurmatte.checks import Array, check_kind, check_not_negative
from blurmatte.errors import MotionError
from blurmatte.motion.picture.error_budget import by_axis
from blurmatte.motion.picture.motion import Scale

# Tests of a parabola in time, and of its acceleration.
_MIN_CHI2_PROBABILITY = 1e-3
_MIN_F_PROBABILITY = 1e-2
_MIN_ACCELERATION_STD = 5.0  # standard deviations: below, its inverse is not normal
_MIN_TILT = float(np.radians(10))  # radians off gravity, of a camera held by hand
_MIN_TILT_STD = 3.0  # standard deviations off gravity


@dataclass(frozen=True, eq=False)
class FreeFall:
    """A parabola in time through the positions of a flight, in a picture (n = 2) or in space (n = 3).

    Parameters
    ----------
    place, velocity, acceleration : (n,) float
        At `time`; pixels, in space meters, per second and second². x right, y down, z forward.
    acceleration_covariance : (n, n) float
        From the errors of the positions, or from their scatter if that is larger and the fit good.
    time : float
        Middle of the times, seconds.
    chi2 : float
        Sum of the squared residuals over their errors.
    freedom : int
        Degrees of freedom.
    likely : float
        Probability that noise alone gives this χ² or a larger one.
    even : float
        Probability that scatter alone improves a polynomial of fourth order as much (F test); 0 for
        too few positions.
    scale : Scale, optional
        Meters per unit of its positions: of a pixel; in space 1, with the relative error that all
        positions share.
    gravity : (n,) float, optional
        m/s²; (1,) in space if only its magnitude is known.
    gravity_std : float
        Standard deviation of its magnitude.
    scaled_by_gravity : bool
        True if the scale was computed from gravity and acceleration.
    off : tuple of int
        Frames that differ from the parabola by more than noise and have no weight.

    Examples
    --------
    >>> free_fall = bm.motion.fit_fall(rows)
    >>> free_fall.fits
    True
    >>> print(f"{free_fall.acceleration[1]:.0f} pixels/s² downwards; true: {90 / 0.12**2:.0f}")
    6254 pixels/s² downwards; true: 6250
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
    off: tuple[int, ...] = ()

    @property
    def fits(self) -> bool:
        """True if a parabola explains the positions, within their errors or their scatter."""
        return self._within_errors or self.even > _MIN_F_PROBABILITY

    @property
    def overscatter(self) -> float:
        """Ratio of the positions' scatter to their errors if it replaces the errors, else 1."""
        return 1.0 if self._within_errors else float(np.sqrt(self.chi2 / self.freedom))

    @property
    def in_picture(self) -> bool:
        """Whether the positions are pixels of a picture, and not meters in space."""
        return len(self.place) == 2

    @property
    def unit(self) -> str:
        """Of the positions: "px", or "m" in space."""
        return "px" if self.in_picture else "m"

    @property
    def size(self) -> float:
        """Magnitude of the acceleration, pixels or meters per second²."""
        return float(np.linalg.norm(self.acceleration))

    @property
    def size_std(self) -> float:
        """Its standard deviation."""
        u = self.acceleration / max(self.size, 1e-12)
        return float(np.sqrt(u @ self.acceleration_covariance @ u))

    @property
    def angle_std(self) -> float:
        """Standard deviation of the direction of the acceleration in a picture, radians."""
        x, y = self.acceleration[:2] / max(self.size, 1e-12)
        across = np.array([-y, x])
        spread = across @ self.acceleration_covariance[:2, :2] @ across
        return float(np.sqrt(max(spread, 0.0))) / max(self.size, 1e-12)

    @property
    def lengths(self) -> tuple[float, float]:
        """Factor for every length that makes the acceleration equal to gravity, and its error.

        Lengths are those from the scale, in space those from the ball's radius: radius, distance,
        speed. The errors of scale and radius are not included, because the fall replaces them.

        Raises
        ------
        MotionError
            If gravity or the scale is not known, or the flight is rejected as a fall.
        """
        if self.gravity is None or self.scale is None:
            raise MotionError(
                "lengths follow from a fall with a known gravity and scale; give both"
            )
        self._check()
        ratio = self._gravity_size / (self.size * self.scale.meters_per_pixel)
        return ratio, ratio * self._relative

    @property
    def rejection(self) -> str:
        """Why it is no fall in this gravity, or downward if none is known; "" if it is one."""
        if not self.fits:
            ratio = self.chi2 / self.freedom
            nearer = "it came nearer, " if self.in_picture else ""
            return (
                f"the residuals of a parabola in time have {ratio:.3g} times the variance of its "
                f"positions: it was held, hit or slowed by air, {nearer}or errors are larger than "
                "stated"
            )
        if not self.size > _MIN_ACCELERATION_STD * self.size_std:
            return (
                f"its acceleration, {self.size:.3g} ± {self.size_std:.2g} {self.unit}/s², is not "
                f"{_MIN_ACCELERATION_STD:g} times its error; use a longer flight or more frames"
            )
        off, std = self.off_gravity
        if self._down_is_known and off > max(_MIN_TILT, _MIN_TILT_STD * std):
            vector = "x,y or x,y,z" if self.in_picture else "x,y,z, or its size alone"
            down = "gravity" if self.directed else "down in the picture"
            return (
                f"its acceleration points {np.degrees(off):.0f}° off {down}; choose the flight alone, "
                f"or give gravity as the camera sees it, {vector}"
            )
        return ""

    @property
    def directed(self) -> bool:
        """True if the direction of gravity is known."""
        return self.gravity is not None and len(self.gravity) == len(self.place)

    @property
    def _down_is_known(self) -> bool:
        """True if the direction of gravity is known, or that of the picture is taken for it."""
        return self.directed or (self.gravity is None and self.in_picture)

    @property
    def off_gravity(self) -> tuple[float, float]:
        """Angle between acceleration and gravity, and its error, radians.

        From the y axis of the picture, if the direction of gravity is not known.
        """
        down = np.eye(len(self.place))[1]
        if self.gravity is not None and self.directed:
            down = self.gravity / self._gravity_size
        across = np.eye(len(down)) - np.outer(down, down)
        perpendicular, along = across @ self.acceleration, float(down @ self.acceleration)
        spread = np.linalg.eigvalsh(across @ self.acceleration_covariance @ across)[-1]
        angle = float(np.arctan2(np.linalg.norm(perpendicular), along))
        return angle, float(np.sqrt(max(spread, 0))) / max(self.size, 1e-12)

    def in_gravity(self, gravity: npt.ArrayLike, std: float = 0.0) -> FreeFall:
        """The fall with a known gravity, which gives the scale if there is none.

        Parameters
        ----------
        gravity : float or (2,) or (3,) float
            m/s²; as in `fit_fall` and `fit_fall_in_space`.
        std : float
            Standard deviation of its magnitude.

        Raises
        ------
        MotionError
            If the scale is computed from gravity, and no parabola with a significant acceleration
            towards gravity explains the positions.
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
        """All by name, flat; with a scale also in m/s², with gravity also its results."""
        row: dict[str, float | int | bool | None] = {"time": self.time}
        for name, vector in (("place", self.place), ("velocity", self.velocity)):
            row |= {f"{name}_{axis}": float(x) for axis, x in zip("xyz", vector, strict=False)}
        std = np.sqrt(np.diag(self.acceleration_covariance))
        row |= by_axis("acceleration", self.acceleration, std)
        off, off_std = self.off_gravity
        row |= {
            "acceleration": self.size,
            "acceleration_std": self.size_std,
            "off_gravity": off,
            "off_gravity_std": off_std,
            "chi2": self.chi2,
            "degrees_of_freedom": self.freedom,
            "likely": self.likely,
            "overscatter": self.overscatter,
            "fits": self.fits,
            "frames_off": len(self.off),
        }
        if self.scale is not None:
            g, std_g = self.in_meters(self.scale)
            row |= {"acceleration_in_m_per_s2": g, "acceleration_in_m_per_s2_std": std_g}
        if self.gravity is not None:
            row |= {"gravity": self._gravity_size, "gravity_std": self.gravity_std}
            row |= self._from_gravity()
        return row

    def in_meters(self, scale: Scale) -> tuple[float, float]:
        """Magnitude of the acceleration and its error, m/s²."""
        check_kind("scale", scale, Scale, "use blurmatte.Scale(meters_per_pixel)")
        g = self.size * scale.meters_per_pixel
        relative = np.hypot(
            self.size_std / max(self.size, 1e-12), scale.std / scale.meters_per_pixel
        )
        return g, float(g * relative)

    def _from_gravity(self) -> dict[str, float | int | bool | None]:
        if self.rejection or self.scale is None:
            return {}
        if self.scaled_by_gravity:
            return {
                "meters_per_pixel": self.scale.meters_per_pixel,
                "meters_per_pixel_std": self.scale.std,
            }
        ratio, std = self.lengths
        return {"lengths_by_gravity": ratio, "lengths_by_gravity_std": std}

    def _check(self) -> None:
        if self.rejection:
            raise MotionError(f"no free fall that gravity could measure: {self.rejection}")

    @property
    def _within_errors(self) -> bool:
        return self.likely > _MIN_CHI2_PROBABILITY

    @property
    def _gravity_size(self) -> float:
        return 0.0 if self.gravity is None else float(np.linalg.norm(self.gravity))

    @property
    def _relative(self) -> float:
        """Relative error of |g| / |a|."""
        return float(np.hypot(self.size_std / self.size, self.gravity_std / self._gravity_size))

    def _vector(self, gravity: npt.ArrayLike, std: float) -> Array:
        """(n,) from a vector, or from a number: downward in the picture, or (1,) in space."""
        g, flat = np.asarray(gravity, dtype=float), self.in_picture
        shapes = ((), (2,), (3,)) if flat else ((), (3,))
        if g.shape not in shapes or not np.all(np.isfinite(g)) or not (g.ndim or g > 0):
            vectors = "(x, y) or (x, y, z)" if flat else "(x, y, z) in space"
            raise ValueError(f"gravity must be a number above 0, {vectors}, got {gravity!r}")
        check_not_negative("gravity_std", std)
        if g.ndim == 0:
            return np.array([0.0, float(g)] if flat else [float(g)])
        return g[: len(self.place)]
