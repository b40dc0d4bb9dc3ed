"""Motion: what the alpha of one picture says about the movement, each number with its error."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt

from blurmatte.errors import MotionError
from blurmatte.motion.units import Scale, Speed, speed_of
from blurmatte.sweep import Sweep
from blurmatte.trajectory import Trajectory

Array = npt.NDArray[np.float64]

QUANTITIES = ("x", "y", "angle", "length", "width", "radius", "area", "top_speed")
_SIGMAS = 3.5  # in two dimensions exp(−3.5² / 2)
_ANGLE = QUANTITIES.index("angle")


@dataclass(frozen=True, eq=False)
class Motion:
    """Where something was during the exposure, how far it went, and how large it is.

    Times are fractions of the exposure. A single picture cannot tell the direction of time: the same
    motion backwards gives the same picture, and `reversed` is as true as this.

    Parameters
    ----------
    trajectory : Trajectory
        Where the center of the silhouette was, pixels.
    values, covariance : (8,), (8, 8) float
        Center x and y, angle, length, width, radius, area and top speed, in this order, and how they
        err together; see the properties of these names.
    speeds, speeds_std : (T − 1,) float
        Mean speed from each point of the trajectory to the next, pixels per exposure.
    source : str
        What it was measured from: "sweep", a shape on a path that explains the streak, or "moments"
        of alpha, which assume a straight way at constant speed.
    path, silhouette : str
        Of what kind they are, such as "parabola" and "disc"; of moments a "line" and no silhouette.
    acceleration, acceleration_covariance : (2,), (2, 2) float, optional
        Change of the velocity from the beginning to the end, pixels per exposure²; None where the
        path is a straight line at constant speed by assumption, or at rest at first.
    resting, resting_std : float
        Which part of the exposure it was at rest before it left (or after it came); 0 if the path is
        of another kind.
    at_border : bool
        It reaches the border of the picture; what lies beyond is not known, and `length` and `area`
        are lower bounds.
    doubts : tuple of str
        Why these numbers may mean something else, one sentence each; none for a sound streak.
    exposure_time : float, optional
        Seconds, as the image said.
    size : (int, int)
        (width, height) of the picture.
    sweep : Sweep, optional
        What it was measured from, if it was a sweep.
    backward : bool
        Whether it runs against the sweep's own direction of time.
    """

    trajectory: Trajectory
    values: Array
    covariance: Array
    speeds: Array
    speeds_std: Array
    source: str
    path: str
    silhouette: str
    size: tuple[int, int]
    acceleration: Array | None = None
    acceleration_covariance: Array | None = None
    resting: float = 0.0
    resting_std: float = 0.0
    at_border: bool = False
    doubts: tuple[str, ...] = ()
    exposure_time: float | None = None
    sweep: Sweep | None = field(default=None, repr=False)
    backward: bool = False

    def __repr__(self) -> str:
        x, y = self.center
        more = "at least " if self.at_border else ""
        return (
            f"Motion(around ({x:.2f}, {y:.2f}), {more}{self.length:.2f} ± {self.length_std:.2g} px "
            f"at {np.degrees(self.angle):.2f} ± {np.degrees(self.angle_std):.2g}°, radius "
            f"{self.radius:.2f} ± {self.radius_std:.2g} px, from its {self.source})"
        )

    @property
    def center(self) -> Array:
        """(2,) mean place (x, y) of its center over the exposure, pixels."""
        return self.values[:2]

    @property
    def angle(self) -> float:
        """Direction from the first place to the last, radians from +x towards +y, −π to π."""
        return self._value("angle")

    @property
    def length(self) -> float:
        """Length of the path, pixels; so also the mean speed in pixels per exposure."""
        return self._value("length")

    @property
    def width(self) -> float:
        """How wide the silhouette is across the direction, pixels."""
        return self._value("width")

    @property
    def radius(self) -> float:
        """Radius of the disc with the area of the silhouette, pixels."""
        return self._value("radius")

    @property
    def area(self) -> float:
        """Area of the silhouette, pixels."""
        return self._value("area")

    @property
    def top_speed(self) -> float:
        """The largest speed, pixels per exposure."""
        return self._value("top_speed")

    @property
    def center_std(self) -> Array:
        """(2,) standard deviations of the center, pixels."""
        return np.array([self._std("x"), self._std("y")])

    @property
    def angle_std(self) -> float:
        """Standard deviation of the direction, radians."""
        return self._std("angle")

    @property
    def length_std(self) -> float:
        """Standard deviation of the length, pixels."""
        return self._std("length")

    @property
    def width_std(self) -> float:
        """Standard deviation of the width, pixels."""
        return self._std("width")

    @property
    def radius_std(self) -> float:
        """Standard deviation of the radius, pixels."""
        return self._std("radius")

    @property
    def area_std(self) -> float:
        """Standard deviation of the area, pixels."""
        return self._std("area")

    @property
    def top_speed_std(self) -> float:
        """Standard deviation of the top speed, pixels per exposure."""
        return self._std("top_speed")

    @property
    def moved(self) -> bool:
        """Whether it moved more than noise feigns; else it may have been at rest.

        Alpha depends on the square of a short length, and so does noise: it must be 3.5 times its
        error, which is twice the relative error of the length. Noise does that in 1 of 500.
        """
        return self.length > 2 * _SIGMAS * self.length_std

    @property
    def reversed(self) -> Motion:
        """The same with time run backwards, which gives the same picture."""
        path = self.trajectory
        values = self.values.copy()
        values[_ANGLE] += -np.pi if values[_ANGLE] > 0 else np.pi
        return replace(
            self,
            trajectory=Trajectory(path.xy[::-1], 1 - path.t[::-1]),
            values=values,
            speeds=self.speeds[::-1],
            speeds_std=self.speeds_std[::-1],
            backward=not self.backward,
        )

    def outline_at(self, t: float) -> Array:
        """(129, 2) points once around the silhouette at exposure fraction t, pixels.

        Raises
        ------
        MotionError
            If it was measured from moments, which do not know the outline.
        """
        if self.sweep is None:
            raise MotionError(
                "no rigid outline explains this streak; end_silhouettes tells the first and the last "
                "silhouette from how alpha changes along the motion"
            )
        return self.sweep.outline_at(1 - t if self.backward else t)

    def place_covariance(self, t: float) -> Array:
        """(2, 2) covariance of where the center was at exposure fraction t, pixels²."""
        if self.sweep is not None:
            n = len(self.sweep.path)
            when = np.array([1 - t if self.backward else t])
            D = self.sweep.family.at(self.sweep.path, when)[1][0]
            return np.asarray(D @ self.sweep.covariance[:n, :n] @ D.T)
        along = np.array([np.cos(self.angle), np.sin(self.angle)])
        across = np.array([-along[1], along[0]])
        D = np.column_stack([np.eye(2), (t - 0.5) * self.length * across, (t - 0.5) * along])
        return np.asarray(D @ self.covariance[:4, :4] @ D.T)

    def speed(
        self,
        scale: Scale | None = None,
        exposure_time: float | None = None,
        exposure_std: float = 0.0,
        line_time: float | None = None,
        downward: bool | None = None,
    ) -> Speed:
        """How fast it was, in meters per second if scale and exposure time are known.

        Parameters
        ----------
        scale : Scale, optional
            Meters per pixel. Without it the speed is in pixels per second.
        exposure_time, exposure_std : float
            Seconds; that of the image if not given. Without any, the speed is in pixels (or meters)
            per exposure.
        line_time : float, optional
            How much later a rolling shutter exposes each row than the one above, seconds. Nothing
            reads all rows of a picture in more than 1 s.
        downward : bool, optional
            Whether it moved down in the picture, which the shutter makes differ from up; if it is not
            known, the mean of both is given, and half their difference is an error.

        Returns
        -------
        Speed

        Raises
        ------
        ValueError
            If a number is out of its range, or a line time is given without an exposure time.
        """
        time = self.exposure_time if exposure_time is None else exposure_time
        return speed_of(self, scale, time, exposure_std, line_time, downward)

    def numbers(self) -> dict[str, float | str | bool | None]:
        """All numbers by name, flat, for a row of a table; pixels, radians, exposures."""
        told: dict[str, float | str | bool | None] = {}
        for name in QUANTITIES:
            told[name], told[f"{name}_std"] = self._value(name), self._std(name)
        told |= {"resting": self.resting, "resting_std": self.resting_std}
        for i, axis in enumerate("xy"):
            a, C = self.acceleration, self.acceleration_covariance
            told[f"acceleration_{axis}"] = None if a is None else float(a[i])
            told[f"acceleration_{axis}_std"] = None if C is None else float(np.sqrt(C[i, i]))
        for name, place in (("first", 0), ("last", -1)):
            told[f"{name}_x"], told[f"{name}_y"] = map(float, self.trajectory.xy[place])
        told |= {"source": self.source, "path": self.path, "silhouette": self.silhouette}
        return told | {"at_border": self.at_border, "exposure_time": self.exposure_time}

    def covariance_of(self, first: str, second: str) -> float:
        """Covariance of two of x, y, angle, length, width, radius, area and top_speed."""
        return float(self.covariance[QUANTITIES.index(first), QUANTITIES.index(second)])

    def _value(self, name: str) -> float:
        return float(self.values[QUANTITIES.index(name)])

    def _std(self, name: str) -> float:
        return float(np.sqrt(max(self.covariance_of(name, name), 0.0)))
