"""Motion of one picture, with the error of each number, and its speed in meters per second.

A rolling shutter exposes row y later than row 0 by y τ, τ the line time. Rows are those of the sensor:
y is the coordinate along the direction in which they are read out, which need not be down in a picture
that is shown upright. The exposure fraction s of the row in which the object's center is seen at p(s)
is the moment s T + τ y(s), T the exposure time. The object's own exposure therefore lasts

    D = T + τ (y(1) − y(0)),

longer than T if it moved down and shorter if it moved up, and its mean speed is length / D. The same
holds for the whole silhouette: the picture is that of a global shutter, sheared and stretched by
p → (x − v_x τ y, (1 − v_y τ) y), v in pixels per second. All lengths along the motion are stretched by
1 / (1 − v_y τ) = D / T, and so is the area of the silhouette. The direction stays. [Ait-Aider et al.,
"Simultaneous object pose and velocity computation using a single view from a rolling shutter camera",
ECCV 2006, has the camera model.]
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt

from blurmatte.checks import (
    DIRECTIONS,
    Array,
    Direction,
    check_direction,
    check_kind,
    check_not_negative,
    check_positive,
)
from blurmatte.errors import MotionError
from blurmatte.motion.picture.error_budget import ErrorBudget
from blurmatte.notebook import Displayed
from blurmatte.sweep.sweep import Sweep
from blurmatte.trajectory import Trajectory, derivative

SWEEP, MOMENTS = "sweep", "moments"  # what a motion was measured from
QUANTITIES = ("x", "y", "angle", "length", "width", "radius", "area", "top_speed")
MAX_READOUT = 1.1  # frame intervals: the rate in a file is an average, and not exact
MIN_EXCESS_STD = 3.5  # standard deviations by which a motion exceeds rest
MIN_DIRECTED_STD = 3.0  # standard deviations of a displacement along a path whose sign is known
USUAL_READOUT_S = 0.02  # of a rolling shutter, from the first row to the last
_ANGLE = QUANTITIES.index("angle")
_PER_METER_PER_SECOND = {"m/s": 1.0, "km/h": 3.6, "mph": 3600 / 1609.344}


@dataclass(frozen=True)
class Scale:
    """Size of a pixel where the object moved, in a plane parallel to the sensor.

    Parameters
    ----------
    meters_per_pixel : float
    std : float
        Its standard deviation.
    motion : Motion, optional
        The motion whose radius gave the scale: the errors of its radius and length are correlated.

    Raises
    ------
    ValueError
        Unless it is positive and its error is not negative.

    Examples
    --------
    >>> scale = bm.Scale.from_radius(motion, 0.02)
    >>> print(f"{1000 * scale.meters_per_pixel:.2f} mm a pixel")
    2.00 mm a pixel
    >>> print(motion.speed(scale, exposure_time=1 / 60).in_unit("km/h"))
    Speed(25.71 ± 0.099 km/h)
    """

    meters_per_pixel: float
    std: float = 0.0
    motion: Motion | None = field(default=None, repr=False)

    def __post_init__(self) -> None:
        check_positive("meters_per_pixel", self.meters_per_pixel)
        check_not_negative("std", self.std)

    @classmethod
    def from_radius(cls, motion: Motion, radius: float, std: float = 0.0) -> Scale:
        """From the true radius of a ball, or of the disc of the silhouette's area, in meters.

        Raises
        ------
        ValueError
            For a radius that is not positive.
        MotionError
            If the radius in the picture is not above its own error, or the object reaches the border.
        """
        check_kind("motion", motion, Motion, "use blurmatte.measure_motion(solution)")
        check_positive("radius", radius)
        check_not_negative("std", std)
        if motion.radius <= 3 * motion.radius_std:
            raise MotionError(
                f"a radius of {motion.radius:.2g} ± {motion.radius_std:.2g} px gives no scale; give "
                "meters per pixel, or two points of known distance"
            )
        if motion.at_border and not motion.has_shape:
            raise MotionError(
                "the object reaches the border, so that its radius in the picture is not known; give "
                "meters per pixel, or two points of known distance"
            )
        scale = radius / motion.radius
        relative = np.hypot(std / radius, motion.radius_std / motion.radius)
        return cls(scale, float(scale * relative), motion)

    @classmethod
    def from_points(
        cls, first: npt.ArrayLike, second: npt.ArrayLike, distance: float, std: float = 0.0
    ) -> Scale:
        """From two points (x, y) of the picture, pixels, and the distance between them, meters.

        `std` is the error of the distance and of pointing together, in meters. The points must have
        the same distance from the camera as the object.

        Raises
        ------
        ValueError
            If the points are one, or the distance is not positive.
        """
        a, b = np.asarray(first, float), np.asarray(second, float)
        if a.shape != (2,) or b.shape != (2,):
            raise ValueError(f"a point must be (x, y), got the shapes {a.shape} and {b.shape}")
        check_positive("distance", distance)
        check_not_negative("std", std)
        pixels = float(np.linalg.norm(b - a))
        if not (np.isfinite(pixels) and pixels > 0):
            raise ValueError(f"the two points must differ, got {a.tolist()} and {b.tolist()}")
        return cls(distance / pixels, std / pixels)


@dataclass(frozen=True)
class Speed(ErrorBudget):
    """Mean speed over the exposure, and the highest speed.

    Parameters
    ----------
    mean, mean_std, top, top_std : float
        With standard deviations, in `unit`.
    unit : str
        "m/s"; without a scale "px/s"; without an exposure time "m/exposure" or "px/exposure".
    parts : mapping of str to float
        Relative error of the mean that each source alone causes.
    unknown : float or None
        Relative change that a usual rolling shutter would cause, if no line time was given; 0 if one
        was given, None if the exposure time is not known.
    readout : "down", "up", "left" or "right"
        Where the next row of the sensor lies in the picture. A motion in this direction seems faster
        than it is.

    Examples
    --------
    >>> speed = motion.speed(exposure_time=1 / 60)
    >>> print(speed)
    Speed(3576 ± 13 px/s)
    >>> scale = bm.Scale.from_radius(motion, 0.02)
    >>> print(motion.speed(scale, exposure_time=1 / 60).in_unit("km/h"))
    Speed(25.71 ± 0.099 km/h)
    """

    mean: float
    mean_std: float
    top: float
    top_std: float
    unit: str
    parts: Mapping[str, float]
    unknown: float | None = 0.0
    readout: Direction = "down"

    def __repr__(self) -> str:
        return f"Speed({self.mean:.4g} ± {self.mean_std:.2g} {self.unit})"

    def numbers(self) -> dict[str, float | str | None]:
        """All numbers by name, flat, for a row of a table."""
        return {
            "mean_speed": self.mean,
            "mean_speed_std": self.mean_std,
            "highest_speed": self.top,
            "highest_speed_std": self.top_std,
            "speed_unit": self.unit,
            "speed_error_from": self.dominant,
            "rolling_shutter_may_change": self.unknown,
        }

    def missing(self) -> list[str]:
        """Names of missing inputs of the speed in meters per second."""
        lacking = {"scale": "px", "exposure time": "exposure"}
        return [name for name, unit in lacking.items() if unit in self.unit]

    def in_unit(self, unit: str) -> Speed:
        """The same in "m/s", "km/h" or "mph".

        Raises
        ------
        ValueError
            For another unit.
        MotionError
            If the speed is not known in meters per second.
        """
        if unit not in _PER_METER_PER_SECOND:
            raise ValueError(f"unit must be {' or '.join(_PER_METER_PER_SECOND)}, got {unit!r}")
        if self.unit not in _PER_METER_PER_SECOND:
            missing = " and ".join(f"{'a' if n == 'scale' else 'an'} {n}" for n in self.missing())
            raise MotionError(f"the speed is known in {self.unit} only; give {missing}")
        f = _PER_METER_PER_SECOND[unit] / _PER_METER_PER_SECOND[self.unit]
        mean, mean_std, top, top_std = (
            f * v for v in (self.mean, self.mean_std, self.top, self.top_std)
        )
        return replace(self, mean=mean, mean_std=mean_std, top=top, top_std=top_std, unit=unit)


@dataclass(frozen=True, eq=False)
class Motion(Displayed):
    """Position, path length, direction and size of an object during the exposure.

    Times are fractions of the exposure. A single picture does not determine the direction of time: the
    reversed motion gives the same picture, and `reversed` is as valid as this one.

    Parameters
    ----------
    trajectory : Trajectory
        Of the center of the silhouette, pixels.
    values, covariance : (8,), (8, 8) float
        Center x and y, angle, length, width, radius, area and top speed, in this order, and their
        covariance; see the properties of these names.
    speeds, speeds_std : (T − 1,) float
        Mean speed from each point of the trajectory to the next, pixels per exposure.
    source : str
        What it was measured from: "sweep", a fitted shape on a path, or "moments" of alpha, which
        assume a straight path at constant speed.
    path, silhouette : str
        Their kinds, such as "parabola" and "disc"; for moments "line" and "".
    acceleration, acceleration_covariance : (2,), (2, 2) float, optional
        Change of the velocity from the beginning to the end, pixels per exposure²; None if the model
        of the path is a straight line, at constant speed or after a rest.
    resting, resting_std : float
        Fraction of the exposure before its departure (or after its arrival); 0 for other paths.
    at_border : bool
        It reaches the border of the picture, so that `length` and `area` are lower bounds.
    doubts : tuple of str
        Reasons why these numbers may be wrong, one sentence each.
    exposure_time : float, optional
        Seconds, from the metadata of the image.
    size : (int, int)
        (width, height) of the picture.
    sweep : Sweep, optional
        The fit that it was measured from, if there is one.
    backward : bool
        True if its direction of time is opposite to that of the sweep.
    readout : "down", "up", "left" or "right"
        Where the next row of the sensor lies in the picture, from the metadata of the image.

    Examples
    --------
    >>> motion.center.round(1)
    array([59., 37.])
    >>> print(f"{motion.radius:.2f} ± {motion.radius_std:.2f} pixels")
    9.99 ± 0.02 pixels
    >>> print(f"{np.degrees(motion.angle):.1f}° ± {np.degrees(motion.angle_std):.1f}°")
    -13.6° ± 0.1°
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
    readout: Direction = "down"

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
        """(2,) mean position (x, y) of its center over the exposure, pixels."""
        return self.values[:2]

    @property
    def angle(self) -> float:
        """Direction from the first position to the last, radians from +x towards +y, −π to π."""
        return self._value("angle")

    @property
    def length(self) -> float:
        """Length of the path, pixels; also the mean speed in pixels per exposure."""
        return self._value("length")

    @property
    def width(self) -> float:
        """Width of the silhouette across the direction of motion, pixels."""
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
    def center_covariance(self) -> Array:
        """(2, 2) covariance of the center, pixels²; symmetric to the last bit."""
        (xx, xy), (_, yy) = self.covariance[:2, :2]
        return np.array([[xx, xy], [xy, yy]])

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
    def has_shape(self) -> bool:
        """Whether it was measured from a shape on a path, and not from the moments of alpha."""
        return self.source == SWEEP

    @property
    def moved(self) -> bool:
        """True if the length is significant; else the object may have been at rest.

        A motion of the length L is seen by the extent of the streak along its path, E = √(L² + w²),
        with the extent w at rest: √3 radii of a disc, by the variance along the path. E − w must be 3.5
        times its error L/E std, with the std of L: L must be 3.5 (1 + w/E) std. That is 3.5 std of a
        long path, and 7 std of a short one, whose square it is that alpha depends on. Noise alone
        exceeds this in 1 of 500 pictures: exp(−3.5² / 2) in two dimensions. Moments measure the square
        of any length: for these it is 7 std.
        """
        at_rest = np.sqrt(3) * self.radius
        extent = max(np.hypot(self.length, at_rest), 1e-12)
        factor = 1 + at_rest / extent if self.has_shape else 2.0
        return bool(self.length > MIN_EXCESS_STD * factor * self.length_std)

    @property
    def reversed(self) -> Motion:
        """The motion with the direction of time reversed, which gives the same picture."""
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

    def shifted(self, x: float, y: float) -> Motion:
        """The same elsewhere, such as in the picture if it was measured in a part of it, pixels."""
        corner, path = np.array([x, y], float), self.trajectory
        values = self.values.copy()
        values[:2] += corner
        return replace(self, trajectory=Trajectory(path.xy + corner, path.t), values=values)

    def mapped(self, points: Callable[[Array], Array]) -> Motion:
        """The same in the pixels of another picture, into which a function maps points (n, 2).

        Near the object the function is linear: path, size and their errors follow its derivative.
        """
        center = self.values[:2]
        J = derivative(points, center)
        angle = float(self.values[_ANGLE])
        along = J @ [np.cos(angle), np.sin(angle)]
        area, longer = abs(float(np.linalg.det(J))), float(np.hypot(*along))
        size = float(np.sqrt(area))
        by = {"length": longer, "top_speed": longer, "width": size, "radius": size, "area": area}
        D = np.diag([by.get(name, 1.0) for name in QUANTITIES])
        D[:2, :2], D[_ANGLE, _ANGLE] = J, area / longer**2
        values = D @ self.values
        values[:2], values[_ANGLE] = points(center[None])[0], np.arctan2(along[1], along[0])
        more, V = self.acceleration, self.acceleration_covariance
        return replace(
            self,
            trajectory=Trajectory(points(self.trajectory.xy), self.trajectory.t),
            values=values,
            covariance=D @ self.covariance @ D.T,
            speeds=longer * self.speeds,
            speeds_std=longer * self.speeds_std,
            acceleration=None if more is None else J @ more,
            acceleration_covariance=None if V is None else J @ V @ J.T,
        )

    def with_errors_times(self, place: float, path: float, size: float) -> Motion:
        """The same with larger errors: of the place, of the path, and of the size, by these factors."""
        by = {"x": place, "y": place, "angle": path, "length": path, "top_speed": path}
        factors = np.array([by.get(name, size) for name in QUANTITIES])
        covariance = np.outer(factors, factors) * self.covariance
        # The squares of the standard deviations themselves, whose roots are these to the last bit.
        stds = factors * np.sqrt(np.maximum(np.diag(self.covariance), 0))
        np.fill_diagonal(covariance, [std**2 for std in stds.tolist()])
        return replace(self, covariance=covariance)

    def outline_at(self, t: float) -> Array:
        """(129, 2) points of the silhouette's outline at exposure fraction t, pixels.

        Raises
        ------
        MotionError
            If it was measured from moments, which give no outline.
        """
        if self.sweep is None:
            raise MotionError(
                "no rigid outline explains this streak; end_silhouettes finds the first and the last "
                "silhouette from the derivative of alpha along the motion"
            )
        return self.sweep.outline_at(1 - t if self.backward else t)

    def place_covariance(self, t: float) -> Array:
        """(2, 2) covariance of the center at exposure fraction t, pixels²."""
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
        going: Direction | None = None,
    ) -> Speed:
        """Mean and highest speed, in meters per second if scale and exposure time are known.

        Parameters
        ----------
        scale : Scale, optional
            Meters per pixel. Without it the speed is in pixels per second.
        exposure_time, exposure_std : float
            Seconds; that of the image if not given. Without any, the speed is in pixels (or meters)
            per exposure.
        line_time : float, optional
            Delay of a rolling shutter from each row of the sensor to the next, seconds; at most 1 s
            for all rows. The next row lies in the direction `readout`.
        going : "down", "up", "left" or "right", optional
            Roughly where it moved in the picture: a rolling shutter changes opposite motions
            differently. If unknown, or if the path does not differ from its perpendicular, the mean
            of both is given, and half their difference is an error.

        Raises
        ------
        ValueError
            If a number is out of its range, or a line time is given without an exposure time.
        """
        time = self.exposure_time if exposure_time is None else exposure_time
        check_kind("scale", scale, Scale | None, "use blurmatte.Scale(meters_per_pixel)")
        check_not_negative("exposure_std", exposure_std)
        if time is not None:
            check_positive("exposure_time", time)
        lags = _possible_lags(self, time, line_time, going)
        both = np.array([_mean_and_top(self, scale, time, lag) for lag in lags])
        mean, top = both.mean(axis=0)
        parts = _relative_parts(self, scale, time, exposure_std)
        if lags[0] != 0 and len(lags) == 2:
            parts["direction of time"] = float(np.ptp(both[:, 0]) / 2 / max(mean, 1e-12))
        total = sum(part**2 for part in parts.values())
        of_mean = total + _correlation(self, scale, "length")
        of_top = (self.top_speed_std / max(self.top_speed, 1e-12)) ** 2
        of_top += total - parts["length"] ** 2
        of_top += _correlation(self, scale, "top_speed")
        return Speed(
            float(mean),
            float(mean * np.sqrt(max(of_mean, 0))),
            float(top),
            float(top * np.sqrt(max(of_top, 0))),
            ("px" if scale is None else "m") + ("/exposure" if time is None else "/s"),
            parts,
            _shutter_effect(self, time) if line_time is None else 0.0,
            self.readout,
        )

    def numbers(self) -> dict[str, float | str | bool | None]:
        """All numbers by name, flat, for a row of a table; pixels, radians, exposures."""
        row: dict[str, float | str | bool | None] = {}
        for name in QUANTITIES:
            row[name], row[f"{name}_std"] = self._value(name), self._std(name)
        row |= {"resting": self.resting, "resting_std": self.resting_std}
        for i, axis in enumerate("xy"):
            a, C = self.acceleration, self.acceleration_covariance
            row[f"acceleration_{axis}"] = None if a is None else float(a[i])
            row[f"acceleration_{axis}_std"] = None if C is None else float(np.sqrt(C[i, i]))
        for name, place in (("first", 0), ("last", -1)):
            row[f"{name}_x"], row[f"{name}_y"] = map(float, self.trajectory.xy[place])
        row |= {"source": self.source, "path": self.path, "silhouette": self.silhouette}
        return row | {"at_border": self.at_border, "exposure_time": self.exposure_time}

    def covariance_of(self, first: str, second: str) -> float:
        """Covariance of two of x, y, angle, length, width, radius, area and top_speed."""
        return float(self.covariance[QUANTITIES.index(first), QUANTITIES.index(second)])

    def _value(self, name: str) -> float:
        return float(self.values[QUANTITIES.index(name)])

    def _std(self, name: str) -> float:
        return float(np.sqrt(max(self.covariance_of(name, name), 0.0)))


def check_line_time(line_time: float, rows: float, frame_interval: float | None = None) -> None:
    """Raise ValueError unless a rolling shutter can read so many rows.

    In 1 s at most, three times as long as the slowest still cameras take, and before the next frame,
    if the time between frames is given, seconds.
    """
    limits = [(1.0, "no camera takes more than {:g} s to read a picture")]
    if frame_interval is not None:
        limits.append((MAX_READOUT * frame_interval, "a frame must be read within {:.3g} s"))
    if not np.isfinite(line_time):
        raise ValueError(f"line_time must be finite seconds, got {line_time}")
    readout = abs(line_time) * rows
    for longest, reason in limits:
        if readout > longest:
            raise ValueError(
                f"a line_time of {line_time:g} s is {readout:.3g} s for {rows:.0f} rows, and "
                f"{reason.format(longest)}; is it in microseconds, like 15e-6 s (15us)?"
            )


def _possible_lags(
    motion: Motion, exposure_time: float | None, line_time: float | None, going: Direction | None
) -> list[float]:
    """τ (y(1) − y(0)) / T, the relative change of the object's own exposure; of both directions."""
    if going is not None:
        check_direction("going", going)
    lag = 0.0
    if line_time is not None:
        check_not_negative("line_time", line_time)
        check_line_time(line_time, _row_count(motion))
        if exposure_time is None:
            raise ValueError("line_time needs exposure_time, for its effect is their ratio")
        lag = line_time * _rows_crossed(motion) / exposure_time
    signs = (1, -1) if going is None else _signs(motion, going)
    possible = [sign * lag for sign in signs if 1 + sign * lag > 0]
    if not possible:
        raise ValueError(
            "no motion of this length towards rows that are read before is possible within the "
            "exposure; check line_time"
        )
    return possible


def _signs(motion: Motion, going: Direction) -> tuple[int, ...]:
    """1 if it crossed later and later rows, −1 for the opposite; both if `going` does not say."""
    along, across = DIRECTIONS[going] @ _rotation(motion.angle)
    moved = motion.length * along
    std = np.hypot(along * motion.length_std, motion.length * across * motion.angle_std)
    if abs(moved) <= MIN_DIRECTED_STD * std:
        return 1, -1
    chord = motion.trajectory.xy[-1] - motion.trajectory.xy[0]
    forward = np.sign(moved) * (chord @ DIRECTIONS[motion.readout])
    return (1,) if forward >= 0 else (-1,)


def _rotation(angle: float) -> Array:
    """(2, 2) columns: unit vectors along a direction, and across it."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s], [s, c]])


def _row_count(motion: Motion) -> int:
    """Number of the sensor's rows in the picture."""
    return motion.size[0 if DIRECTIONS[motion.readout][0] else 1]


def _rows(motion: Motion) -> Array:
    """(T,) row of the sensor at each point of the trajectory, from that of the pixel (0, 0)."""
    return np.asarray(motion.trajectory.xy @ DIRECTIONS[motion.readout])


def _rows_crossed(motion: Motion) -> float:
    """Rows between the first position and the last."""
    y = _rows(motion)
    return abs(float(y[-1] - y[0]))


def _mean_and_top(
    motion: Motion, scale: Scale | None, exposure_time: float | None, lag: float
) -> tuple[float, float]:
    """Both speeds, if the last row is exposed later than the first by `lag` exposures."""
    size = 1.0 if scale is None else scale.meters_per_pixel
    if scale is not None and scale.motion is not None:
        size *= np.sqrt(1 + lag)  # the area that gave the radius is stretched by 1 + lag
    T = 1.0 if exposure_time is None else exposure_time
    y, t = _rows(motion), motion.trajectory.t
    rows_crossed = max(_rows_crossed(motion), 1e-12)
    later = np.diff(y) / np.diff(t) * np.sign(y[-1] - y[0]) / rows_crossed
    slower = np.maximum(1 + lag * later, 1e-6)
    fastest = motion.top_speed * np.max(motion.speeds / slower) / max(np.max(motion.speeds), 1e-12)
    return size * motion.length / (T * (1 + lag)), float(size * fastest / T)


def _relative_parts(
    motion: Motion, scale: Scale | None, exposure_time: float | None, exposure_std: float
) -> dict[str, float]:
    """Relative error of the mean speed that each source alone causes."""
    parts = {"length": motion.length_std / max(motion.length, 1e-12)}
    if scale is not None:
        parts["scale"] = scale.std / scale.meters_per_pixel
    if exposure_time is not None:
        parts["exposure time"] = exposure_std / exposure_time
    return parts


def _correlation(motion: Motion, scale: Scale | None, name: str) -> float:
    """Change of the relative variance of a speed by the correlation of the scale's error with it."""
    if scale is None or scale.motion is None or scale.motion.covariance is not motion.covariance:
        return 0.0
    both = motion.covariance_of(name, "radius")
    value = motion.length if name == "length" else motion.top_speed
    return -2 * both / (max(value, 1e-12) * motion.radius)


def _shutter_effect(motion: Motion, exposure_time: float | None) -> float | None:
    """Relative change of the speed that a usual rolling shutter would cause; None if not known."""
    if exposure_time is None:
        return None
    return USUAL_READOUT_S / _row_count(motion) * _rows_crossed(motion) / exposure_time
