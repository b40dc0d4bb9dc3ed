"""Families of paths: parameters → positions of the center during the exposure, and derivatives.

In this file `p` is the parameters of a family (n,), `t` times (T,) from 0 to 1; a path is xy (T, 2)
with its derivatives D (T, 2, n) by the parameters, all in pixels. Every family contains the
straight line at constant speed, and is started from a curve of points.
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import cache
from typing import ClassVar

import numpy as np

from blurmatte.checks import Array


class PathFamily(ABC):
    """Paths of one kind."""

    name: ClassVar[str]
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

    def shifted(self, p: Array, by: Array) -> Array:
        """Parameters of the path moved by (x, y): they are points, and at most one other number."""
        moved, points = np.array(p, float), 2 * (len(p) // 2)
        moved[:points] += np.tile(by, points // 2)
        return moved

    @abstractmethod
    def starts(self, curve: Array) -> list[Array]:
        """Parameters (n,) of paths along `curve` (m, 2), equally spaced points."""


@dataclass(frozen=True)
class Polynomial(PathFamily):
    """x and y as polynomials of time: a line, a throw, or a cubic.

    The parameters are the points that a curve of `degree` passes at equally spaced times.
    """

    degree: int

    @property
    def name(self) -> str:  # type: ignore[override]
        """Name in messages and files."""
        return ("line", "parabola", "cubic")[self.degree - 1]

    @property
    def size(self) -> int:  # type: ignore[override]
        """Number of parameters."""
        return 2 * (self.degree + 1)

    def at(self, p: Array, t: Array) -> tuple[Array, Array]:
        """Sums of the points, weighted by time."""
        from blurmatte.sweep.model import path_kernel  # numba takes half a second to import

        xy, D = path_kernel.polynomial(p, _lagrange(self.degree), t)
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
    size = 5

    def at(self, p: Array, t: Array) -> tuple[Array, Array]:
        """Around the circle."""
        from blurmatte.sweep.model import path_kernel  # numba takes half a second to import

        xy, D = path_kernel.arc(p, t)
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

    earliest: ClassVar[float] = 0.02
    latest: ClassVar[float] = 0.98

    def kink(self, p: Array) -> float:
        """Time at which the velocity jumps, within its bounds."""
        return float(np.clip(p[-1], self.earliest, self.latest))

    def _is_held(self, p: Array) -> bool:
        """True if that time is at a bound."""
        return not self.earliest < self.kink(p) < self.latest


class Bounce(Kinked):
    """Two straight pieces, each at its own constant speed.

    The parameters are start, contact, end and the time of the contact.
    """

    name = "bounce"
    size = 7

    def at(self, p: Array, t: Array) -> tuple[Array, Array]:
        """Along the one piece, then the other."""
        from blurmatte.sweep.model import path_kernel  # numba takes half a second to import

        xy, D = path_kernel.bounce(p, self.kink(p), self._is_held(p), t)
        return xy, D

    def starts(self, curve: Array) -> list[Array]:
        """The corner is the point farthest from the chord, or at one or two thirds of the curve."""
        a, b = curve[0], curve[-1]
        along = (b - a) / max(float(np.linalg.norm(b - a)), 1e-9)
        off = np.abs(along[0] * (curve - a)[:, 1] - along[1] * (curve - a)[:, 0])
        last = len(curve) - 1
        corners = {int(np.clip(np.argmax(off), 1, last - 1)), last // 3, 2 * last // 3}
        return [np.concatenate([a, curve[i], b, [i / last]]) for i in sorted(corners)]


class FromRest(Kinked):
    """At rest, then straight at constant speed; backwards in time, a stop.

    The parameters are start, end and the time of the departure.
    """

    name = "from rest"
    size = 5
    earliest = 0.0

    def at(self, p: Array, t: Array) -> tuple[Array, Array]:
        """At the start until the departure, then along the line."""
        from blurmatte.sweep.model import path_kernel  # numba takes half a second to import

        xy, D = path_kernel.from_rest(p, self.kink(p), self._is_held(p), t)
        return xy, D

    def starts(self, curve: Array) -> list[Array]:
        """A line from either end of the curve to the other."""
        return [np.concatenate([a, b, [0.3]]) for a, b in (curve[[0, -1]], curve[[-1, 0]])]


LINE, PARABOLA, CUBIC = Polynomial(1), Polynomial(2), Polynomial(3)
ARC, BOUNCE, FROM_REST = Arc(), Bounce(), FromRest()


def path_family(name: str) -> PathFamily:
    """The family of this name; raises ValueError if there is none."""
    families = {f.name: f for f in (LINE, PARABOLA, CUBIC, ARC, BOUNCE, FROM_REST)}
    if name not in families:
        raise ValueError(f"a path is one of {', '.join(families)}, got {name!r}")
    return families[name]


@cache
def _lagrange(degree: int) -> Array:
    """(degree + 1, degree + 1) coefficients of Lagrange's polynomials, a row for each power."""
    nodes = np.linspace(0, 1, degree + 1)
    return np.ascontiguousarray(np.linalg.inv(np.vander(nodes, increasing=True)))
