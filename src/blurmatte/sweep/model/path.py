"""Families of paths: parameters → positions of the center during the exposure, and derivatives.

In this file `p` is the parameters of a family (n,), `t` times (T,) from 0 to 1; a path is xy (T, 2)
with its derivatives D (T, 2, n) by the parameters, all in pixels. Every family contains the
straight line at constant speed, and is started from a curve of points.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import ClassVar

import numpy as np

from blurmatte.checks import Array
from blurmatte.compiling import njit
from blurmatte.sweep.model.pixels import Pixels

_MAX_STEP_PX = 0.125  # of the polyline that replaces a path in `path_spread`
_LATEST_KINK = 0.98  # fraction of the exposure: the last piece has a finite speed


@njit()
def _polynomial(p, weights, t):  # type: ignore[no-untyped-def]
    """Sums of points; weights (k, k) are the coefficients of theirs, a row for each power of t."""
    k = len(weights)
    xy, D = np.zeros((len(t), 2)), np.zeros((len(t), 2, 2 * k))
    for i in range(len(t)):
        for j in range(k):
            weight = 0.0
            for power in range(k - 1, -1, -1):
                weight = weight * t[i] + weights[power, j]
            for c in range(2):
                xy[i, c] += weight * p[2 * j + c]
                D[i, c, 2 * j + c] = weight
    return xy, D


@njit()
def _arc(p, t):  # type: ignore[no-untyped-def]
    """A circle through start and end, its middle p[4] off the chord.

    Half of the arc turns by φ, tan(φ/2) = p[4] / half chord. In units of half the chord a point is at
    sin(φ s)/sin φ along it and (cos(φ s) − cos φ)/sin φ off it, s from −1 to 1; for small φ these tend
    to s and a parabola.
    """
    xy, D = np.empty((len(t), 2)), np.empty((len(t), 2, 5))
    half = ((p[2] - p[0]) / 2, (p[3] - p[1]) / 2)
    normal = (-half[1], half[0])
    length, off = np.sqrt(half[0] ** 2 + half[1] ** 2 + 1e-30), p[4]
    phi = 2 * np.arctan(off / length)
    by_off = 2 * length / (length**2 + off**2)
    by_length = -2 * off / (length**2 + off**2)
    for i in range(len(t)):
        s = 2 * t[i] - 1
        if abs(phi) < 1e-4:  # radians: a parabola to rounding
            along, across = s * (1 + phi**2 * (1 - s**2) / 6), phi * (1 - s**2) / 2
            more_along, more_across = s * phi * (1 - s**2) / 3, (1 - s**2) / 2
        else:
            sine, cosine = np.sin(phi), np.cos(phi)
            along, across = np.sin(phi * s) / sine, (np.cos(phi * s) - cosine) / sine
            more_along = (s * np.cos(phi * s) - along * cosine) / sine
            more_across = (sine - s * np.sin(phi * s) - across * cosine) / sine
        for c in range(2):
            turned = more_along * half[c] + more_across * normal[c]
            xy[i, c] = (p[c] + p[2 + c]) / 2 + along * half[c] + across * normal[c]
            D[i, c, 4] = turned * by_off
            for d in range(2):
                lengthened = turned * by_length * half[d] / (2 * length)
                moved = along / 2 if c == d else (across / 2 if c > d else -across / 2)
                D[i, c, d] = (0.5 if c == d else 0.0) - moved - lengthened
                D[i, c, 2 + d] = (0.5 if c == d else 0.0) + moved + lengthened
    return xy, D


@njit()
def _bounce(p, contact, held, t):  # type: ignore[no-untyped-def]
    """Two straight pieces with the contact between; if `held`, its time cannot change."""
    xy, D = np.empty((len(t), 2)), np.zeros((len(t), 2, 7))
    for i in range(len(t)):
        first = t[i] < contact
        start, duration = (0, contact) if first else (2, 1 - contact)
        u = t[i] / contact if first else (t[i] - contact) / (1 - contact)
        for c in range(2):
            chord = p[start + 2 + c] - p[start + c]
            xy[i, c] = p[start + c] + u * chord
            D[i, c, start + c], D[i, c, start + 2 + c] = 1 - u, u
            if not held:
                D[i, c, 6] = (-u if first else u - 1) / duration * chord
    return xy, D


@njit()
def _from_rest(p, departure, held, t):  # type: ignore[no-untyped-def]
    """At rest, then along a line; if `held`, the time of the departure cannot change."""
    xy, D = np.empty((len(t), 2)), np.zeros((len(t), 2, 5))
    for i in range(len(t)):
        u = max((t[i] - departure) / (1 - departure), 0.0)
        for c in range(2):
            chord = p[2 + c] - p[c]
            xy[i, c] = p[c] + u * chord
            D[i, c, c], D[i, c, 2 + c] = 1 - u, u
            if not held and t[i] > departure:
                D[i, c, 4] = (t[i] - 1) / (1 - departure) ** 2 * chord
    return xy, D


@njit()
def pieces_of(xy, extra, step, max_count):  # type: ignore[no-untyped-def]
    """Midpoints of pieces of the exposure and their durations, from points at even times.

    The number of pieces between two points is the length of this part or its longer neighbor, plus
    `extra`, over `step`; at most `max_count`.
    """
    parts = len(xy) - 1
    length, counts, total = np.empty(parts), np.empty(parts, np.int64), 0
    for i in range(parts):
        length[i] = np.hypot(xy[i + 1, 0] - xy[i, 0], xy[i + 1, 1] - xy[i, 1]) + extra
    for i in range(parts):
        longest = max(length[i], length[max(i - 1, 0)], length[min(i + 1, parts - 1)])
        counts[i] = max(int(min(np.ceil(longest / step), max_count)), 1)
        total += counts[i]
    t, lengths, n = np.empty(total), np.empty(total), 0
    for i in range(parts):
        for j in range(counts[i]):
            t[n] = (i + (j + 0.5) / counts[i]) / parts
            lengths[n] = 1 / (parts * counts[i])
            n += 1
    return t, lengths


class PathFamily(ABC):
    """Paths of one kind."""

    name: str
    in_words: str  # with its article
    motion_in_words: str  # the same with the speed
    at_constant_speed: bool = False
    size: ClassVar[int]  # number of parameters

    @abstractmethod
    def at(self, p: Array, t: Array) -> tuple[Array, Array]:
        """Points xy (T, 2) and their derivatives D (T, 2, n)."""

    def kink(self, p: Array) -> float | None:
        """Time at which the velocity jumps; None if it does not."""
        return None

    def curve(self, p: Array) -> Array:
        """(33, 2) points at equally spaced times, pixels."""
        return self.at(p, np.linspace(0, 1, 33))[0]

    def motion(self, p: Array, pixel: float = 1.0) -> Array:
        """(2, 2) mean of v vᵀ over the exposure, v the velocity in `pixel` per exposure."""
        v = np.diff(self.curve(p), axis=0) * 32 / pixel
        return np.asarray(v.T @ v / len(v))

    def shifted(self, p: Array, by: Array) -> Array:
        """Parameters of the path moved by (x, y): they are points, and at most one other number."""
        moved, points = np.array(p, float), 2 * (len(p) // 2)
        moved[:points] += np.tile(by, points // 2)
        return moved

    def units(self, pixel: float) -> Array:
        """(n,) factors of the parameters if the unit of length is `pixel` times as large."""
        return np.full(self.size, pixel)

    @abstractmethod
    def starts(self, curve: Array) -> list[Array]:
        """Parameters (n,) of paths along `curve` (m, 2), equally spaced points."""

    def continued(self, p: Array, before: float, after: float) -> Array:
        """Parameters of the motion over more time, parts of the exposure before and after it."""
        return self.starts(self.at(p, np.linspace(-before, 1 + after, 33))[0])[0]


@dataclass(frozen=True)
class Polynomial(PathFamily):
    """x and y as polynomials of time: a line, a throw, or a cubic.

    The parameters are the points that a curve of `degree` passes at equally spaced times.
    """

    degree: int
    name: str
    in_words: str
    motion_in_words: str
    at_constant_speed: bool = False

    @property
    def size(self) -> int:  # type: ignore[override]
        """Number of parameters."""
        return 2 * (self.degree + 1)

    def at(self, p: Array, t: Array) -> tuple[Array, Array]:
        """Sums of the points, weighted by time."""
        xy, D = _polynomial(p, _lagrange(self.degree), t)
        return xy, D

    def starts(self, curve: Array) -> list[Array]:
        """The nearest such curve to it."""
        t = np.linspace(0, 1, len(curve))
        points, *_ = np.linalg.lstsq(self.weights(t), curve, rcond=None)
        return [np.asarray(points.ravel())]

    def weights(self, t: Array) -> Array:
        """(T, degree + 1) Lagrange's polynomials."""
        return np.asarray(np.vander(t, self.degree + 1, increasing=True) @ _lagrange(self.degree))


class Arc(PathFamily):
    """Along a circle at constant speed.

    The parameters are start, end, and the offset of the path's middle from the chord, positive to
    the left of it as seen with y up; 0 is a straight line.
    """

    name = "arc"
    in_words = "an arc"
    motion_in_words = "an arc at constant speed"
    at_constant_speed = True
    size = 5

    def at(self, p: Array, t: Array) -> tuple[Array, Array]:
        """Around the circle."""
        xy, D = _arc(p, t)
        return xy, D

    def starts(self, curve: Array) -> list[Array]:
        """Through its ends and its middle."""
        a, m, b = curve[0], curve[len(curve) // 2], curve[-1]
        chord = b - a
        length = max(float(np.linalg.norm(chord)), 1e-9)
        off = (chord[0] * (m - a)[1] - chord[1] * (m - a)[0]) / length
        return [np.array([*a, *b, off])]


class Kinked(PathFamily):
    """Families whose last parameter is the time at which the velocity jumps."""

    earliest: ClassVar[float] = 0.02  # fraction of the exposure, as `_LATEST_KINK`
    _pieces: ClassVar[Callable[..., tuple[Array, Array]]]  # compiled

    def kink(self, p: Array) -> float:
        """Time at which the velocity jumps, within its bounds."""
        return float(np.clip(p[-1], self.earliest, _LATEST_KINK))

    def units(self, pixel: float) -> Array:
        """Of lengths, and of the time, which has no unit."""
        return np.append(np.full(self.size - 1, pixel), 1.0)

    def at(self, p: Array, t: Array) -> tuple[Array, Array]:
        """Along both pieces; the time of a kink at a bound cannot change."""
        kink = self.kink(p)
        xy, D = self._pieces(p, kink, not self.earliest < kink < _LATEST_KINK, t)
        return xy, D


class Bounce(Kinked):
    """Two straight pieces, each at its own constant speed.

    The parameters are start, contact, end and the time of the contact.
    """

    name = "bounce"
    in_words = "a path that bounces"
    motion_in_words = "two straight pieces"
    size = 7
    _pieces = staticmethod(_bounce)

    def starts(self, curve: Array) -> list[Array]:
        """The corner is the point farthest from the chord, or at one or two thirds of the curve."""
        a, b = curve[0], curve[-1]
        along = (b - a) / max(float(np.linalg.norm(b - a)), 1e-9)
        off = np.abs(along[0] * (curve - a)[:, 1] - along[1] * (curve - a)[:, 0])
        last = len(curve) - 1
        corners = {int(np.clip(np.argmax(off), 1, last - 1)), last // 3, 2 * last // 3}
        return [np.concatenate([a, curve[i], b, [i / last]]) for i in sorted(corners)]

    def continued(self, p: Array, before: float, after: float) -> Array:
        """With the same contact."""
        (start, end), _ = self.at(p, np.array([-before, 1 + after]))
        contact = (self.kink(p) + before) / (1 + before + after)
        return np.concatenate([start, p[2:4], end, [contact]])


class FromRest(Kinked):
    """At rest, then straight at constant speed; backwards in time, a stop.

    The parameters are start, end and the time of the departure.
    """

    name = "from rest"
    in_words = "a path from rest"
    motion_in_words = "a straight line, at rest for a while"
    size = 5
    earliest = 0.0  # all of it is one straight piece
    _pieces = staticmethod(_from_rest)

    def starts(self, curve: Array) -> list[Array]:
        """A line from either end of the curve to the other."""
        return [np.concatenate([a, b, [0.3]]) for a, b in (curve[[0, -1]], curve[[-1, 0]])]

    def continued(self, p: Array, before: float, after: float) -> Array:
        """With a start farther back, and so much less time at rest."""
        rest = self.kink(p)
        velocity = (p[2:4] - p[:2]) / (1 - rest)
        duration = max(1.0, 1 - rest + before) + after
        start, end = p[:2] - before * velocity, p[2:4] + after * velocity
        return np.concatenate([start, end, [max(rest - before, 0.0) / duration]])


LINE = Polynomial(1, "line", "a straight line", "a straight line at constant speed", True)
PARABOLA = Polynomial(2, "parabola", "a parabola", "a curve of constant acceleration")
CUBIC = Polynomial(3, "cubic", "a cubic curve", "a curve of changing acceleration")
ARC, BOUNCE, FROM_REST = Arc(), Bounce(), FromRest()
# In the order in which they are fitted
FAMILIES: tuple[PathFamily, ...] = (LINE, ARC, PARABOLA, CUBIC, FROM_REST, BOUNCE)


def path_family(name: str) -> PathFamily:
    """The family of this name; raises ValueError if there is none."""
    families = {family.name: family for family in FAMILIES}
    if name not in families:
        raise ValueError(f"a path is one of {', '.join(families)}, got {name!r}")
    return families[name]


@cache
def _lagrange(degree: int) -> Array:
    """(degree + 1, degree + 1) coefficients of Lagrange's polynomials, a row for each power."""
    nodes = np.linspace(0, 1, degree + 1)
    return np.ascontiguousarray(np.linalg.inv(np.vander(nodes, increasing=True)))


def path_spread(family: PathFamily, path: Array, pixels: Pixels) -> Array:
    """(h, w) fractions of the exposure that a moving point spends in each pixel.

    Exact for a polyline of short pieces; these are split at the borders of pixels.
    """
    curve = family.at(path, np.linspace(0, 1, 257))[0]
    speed = 256 * np.linalg.norm(np.diff(curve, axis=0), axis=1).max()
    t = np.linspace(0, 1, int(np.ceil(speed / _MAX_STEP_PX)) + 2)
    xy = family.at(path, t)[0] - np.array(pixels.origin) + 0.5  # borders at whole numbers
    times = [t]
    for x in xy.T:
        before, after = x[:-1], x[1:]
        crosses = np.floor(before) != np.floor(after)
        border = np.floor(np.maximum(before, after)[crosses])
        part = (border - before[crosses]) / (after - before)[crosses]
        times.append(t[:-1][crosses] + part * np.diff(t)[crosses])
    edges = np.unique(np.concatenate(times))
    middles = (edges[:-1] + edges[1:]) / 2
    column, row = (np.floor(np.interp(middles, t, x)).astype(int) for x in xy.T)
    h, w = pixels.shape
    inside = (column >= 0) & (column < w) & (row >= 0) & (row < h)
    flat = np.bincount((row * w + column)[inside], np.diff(edges)[inside], minlength=h * w)
    return np.asarray(flat.reshape(h, w), dtype=float)
