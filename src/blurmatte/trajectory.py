"""The path of an object's center over the exposure, and the time of a point in each pixel.

Points are (x, y) in pixels, x right, y down, pixel centers at whole numbers. Times are fractions of
the exposure: 0 when the shutter opens, 1 when it closes.

A trajectory is any polyline: the truth of the renderer, and the path of a finished sweep. Families of
paths that are fitted (`sweep.model.path`) have parameters and derivatives, and share no code with it:
rendered scenes test them.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from blurmatte.checks import AnyArray, Array, as_array, check_map

_STEP_PX = 0.5  # of a numerical derivative


def derivative(points: Callable[[Array], Array], at: Array) -> Array:
    """(2, 2) derivative of a function of points (n, 2), pixels, at one (2,)."""
    steps = _STEP_PX * np.array([[1, 0], [-1, 0], [0, 1], [0, -1]])
    right, left, down, up = points(at + steps)
    return np.column_stack([right - left, down - up]) / (2 * _STEP_PX)


@dataclass(frozen=True, eq=False)
class Trajectory:
    """Positions over the exposure, interpolated linearly.

    Parameters
    ----------
    xy : (T, 2) float
        Points in pixels, T >= 2.
    t : (T,) float
        Times of the points: increasing from 0 to 1.

    Raises
    ------
    ValueError
        For other shapes, values that are not finite, or times that do not run from 0 to 1.

    Examples
    --------
    >>> path = bm.Trajectory.parabola((20, 60), (80, -40), (0, 60))
    >>> path.at(0.5)
    array([60. , 47.5])
    >>> print(f"{path.length:.1f} pixels")
    82.4 pixels
    """

    xy: Array
    t: Array

    def __post_init__(self) -> None:
        xy, t = (np.array(as_array(at, getattr(self, at)), float) for at in ("xy", "t"))
        if xy.ndim != 2 or xy.shape[1] != 2 or len(xy) < 2:
            raise ValueError(f"xy must have the shape (T, 2) with T >= 2, got {xy.shape}")
        if t.shape != xy.shape[:1]:
            raise ValueError(f"t must have the shape {xy.shape[:1]}, got {t.shape}")
        if not np.all(np.isfinite(xy)):
            raise ValueError("xy must be finite")
        if not (t[0] == 0 and t[-1] == 1 and np.all(np.diff(t) > 0)):
            raise ValueError(f"t must increase from 0 to 1, got {t[0]:g} to {t[-1]:g}")
        object.__setattr__(self, "xy", xy)
        object.__setattr__(self, "t", t)

    def __repr__(self) -> str:
        (x0, y0), (x1, y1) = self.xy[0], self.xy[-1]
        return (
            f"Trajectory(({x0:.1f}, {y0:.1f}) to ({x1:.1f}, {y1:.1f}), "
            f"{self.length:.1f} px, {len(self.t)} points)"
        )

    @property
    def length(self) -> float:
        """Length of the path, pixels."""
        return float(np.linalg.norm(np.diff(self.xy, axis=0), axis=1).sum())

    @property
    def top_speed(self) -> float:
        """Largest speed, pixels per exposure."""
        steps = np.linalg.norm(np.diff(self.xy, axis=0), axis=1)
        return float(np.max(steps / np.diff(self.t)))

    def at(self, t: npt.ArrayLike) -> Array:
        """(..., 2) position at exposure fractions `t` (...); constant before 0 and after 1."""
        x, y = (np.interp(np.asarray(t, dtype=float), self.t, axis) for axis in self.xy.T)
        return np.stack([x, y], axis=-1)

    @classmethod
    def line(cls, start: npt.ArrayLike, end: npt.ArrayLike) -> Trajectory:
        """Straight from `start` to `end`, (x, y) each, at constant speed; at rest if they are equal."""
        return cls(np.stack([_point("start", start), _point("end", end)]), np.array([0.0, 1.0]))

    @classmethod
    def arc(
        cls, start: npt.ArrayLike, middle: npt.ArrayLike, end: npt.ArrayLike, points: int = 65
    ) -> Trajectory:
        """Along the circle through three points (x, y), at constant speed.

        `middle` is any point between the others. Three points on a line give that line.

        Raises
        ------
        ValueError
            If the points lie on a line but `middle` is not between the others, or `points` < 3.
        """
        if points < 3:
            raise ValueError(f"points must be 3 or more, got {points}")
        a, b, c = _point("start", start), _point("middle", middle), _point("end", end)
        # In units of the chord from a to c: a = -1, c = 1, and the circle's center is h·i.
        half = (c - a) / 2
        chord = complex(half[0], half[1])
        if chord == 0:
            raise ValueError("start and end of an arc must differ")
        offset = b - (a + c) / 2
        m = complex(offset[0], offset[1]) / chord
        if abs(m.imag) < 1e-9:
            if abs(m.real) >= 1:
                raise ValueError("middle must lie between start and end when all are on a line")
            return cls.line(a, c)
        h = (abs(m) ** 2 - 1) / (2 * m.imag)
        start_angle, middle_angle, end_angle = np.angle([-1 - 1j * h, m - 1j * h, 1 - 1j * h])
        turn = (end_angle - start_angle) % (2 * np.pi)
        if (middle_angle - start_angle) % (2 * np.pi) > turn:
            turn -= 2 * np.pi
        t = np.linspace(0, 1, points)
        z = (1j * h + np.hypot(1, h) * np.exp(1j * (start_angle + turn * t))) * chord
        return cls((a + c) / 2 + np.stack([z.real, z.imag], axis=-1), t)

    @classmethod
    def parabola(
        cls,
        start: npt.ArrayLike,
        velocity: npt.ArrayLike,
        acceleration: npt.ArrayLike,
        points: int = 65,
    ) -> Trajectory:
        """Start + velocity · t + acceleration · t² / 2.

        If velocity and acceleration are parallel, a line at changing speed.

        Parameters
        ----------
        start : (2,) float
            Pixels.
        velocity : (2,) float
            Pixels per exposure, at the start.
        acceleration : (2,) float
            Pixels per exposure².
        points : int
            Number of points of the polyline.

        Raises
        ------
        ValueError
            If `points` < 3.
        """
        if points < 3:
            raise ValueError(f"points must be 3 or more, got {points}")
        a = _point("acceleration", acceleration)
        t = np.linspace(0, 1, points)
        s = t[:, None]
        return cls(_point("start", start) + s * _point("velocity", velocity) + s**2 * a / 2, t)

    @classmethod
    def bounce(
        cls, start: npt.ArrayLike, contact: npt.ArrayLike, end: npt.ArrayLike, at: float = 0.5
    ) -> Trajectory:
        """Straight from `start` to `contact`, reached at exposure fraction `at`, then to `end`.

        Raises
        ------
        ValueError
            If `at` is not between 0 and 1.
        """
        if not 0 < at < 1:
            raise ValueError(f"at must lie between 0 and 1, got {at}")
        points = [_point("start", start), _point("contact", contact), _point("end", end)]
        return cls(np.stack(points), np.array([0, at, 1]))

    @classmethod
    def from_rest(cls, start: npt.ArrayLike, end: npt.ArrayLike, until: float) -> Trajectory:
        """At rest in `start` until exposure fraction `until`, then straight to `end`.

        Raises
        ------
        ValueError
            If `until` is not between 0 and 1.
        """
        if not 0 < until < 1:
            raise ValueError(f"until must lie between 0 and 1, got {until}")
        return cls.bounce(start, start, end, until)

    def part(self, start: float, end: float) -> Trajectory:
        """The path between two exposure fractions, with times from 0 to 1.

        Raises
        ------
        ValueError
            Unless 0 <= start < end <= 1.
        """
        if not 0 <= start < end <= 1:
            raise ValueError(f"start and end must be 0 <= start < end <= 1, got {start}, {end}")
        inner = self.t[(self.t > start) & (self.t < end)]
        t = np.concatenate([[start], inner, [end]])
        times = (t - start) / (end - start)
        times[0], times[-1] = 0, 1
        return Trajectory(self.at(t), times)


def _point(name: str, value: npt.ArrayLike) -> Array:
    point = np.asarray(value, dtype=float)
    if point.shape != (2,):
        raise ValueError(f"{name} must be one point (x, y), got the shape {point.shape}")
    return point


@dataclass(frozen=True, eq=False)
class PointSpread:
    """The point spread function of a motion, in pixels of the picture.

    Parameters
    ----------
    weight : (h, w) float
        Fraction of the exposure that the point was in each pixel.
    std : (h, w) float
        Its standard deviation; errors of neighbors are correlated.
    corner : (int, int)
        Position (x, y) of the first pixel in the picture.

    Raises
    ------
    TypeError, ValueError
        For arrays of another dtype, or of different shapes.

    Examples
    --------
    >>> psf = bm.deblurring.PointSpread(np.full((1, 4), 0.25), np.full((1, 4), 0.01), (8, 5))
    >>> print(f"{psf.weight.sum():.2f}, at most {psf.weight.max():.2f} in one place")
    1.00, at most 0.25 in one place
    """

    weight: Array
    std: Array
    corner: tuple[int, int]

    def __post_init__(self) -> None:
        weight = check_map("weight", self.weight)
        object.__setattr__(self, "weight", weight)
        object.__setattr__(self, "std", check_map("std", self.std, weight.shape))
        if self.weight.ndim != 2:
            raise ValueError(f"weight must have the shape (h, w), got {self.weight.shape}")

    def __repr__(self) -> str:
        height, width = self.weight.shape
        return f"PointSpread({width}x{height} at {self.corner}, sum {self.weight.sum():.3f})"

    @property
    def rows(self) -> list[Mapping[str, float]]:
        """A row (x, y, weight, std) for each pixel with a weight, as for a table."""
        y, x = place = np.nonzero(self.weight)
        left, top = self.corner
        return rows_of(x=x + left, y=y + top, weight=self.weight[place], std=self.std[place])


def rows_of(**columns: AnyArray) -> list[Mapping[str, float]]:
    """The rows of a table of columns (n,), each by the names of these."""
    rows = zip(*(column.tolist() for column in columns.values()), strict=True)
    return [dict(zip(columns, row, strict=True)) for row in rows]
