"""Families of paths: parameters → where the center is during the exposure, and its derivatives.

In this file `p` is the parameters of a family (n,), `t` times (T,) from 0 to 1; a path is xy (T, 2)
with its derivatives D (T, 2, n) by the parameters, all in pixels. Every family holds the straight
line at constant speed, and is started from a curve of points.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import ClassVar

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]


class PathFamily(ABC):
    """Paths of one kind."""

    name: ClassVar[str]
    size: ClassVar[int]  # how many parameters

    @abstractmethod
    def at(self, p: Array, t: Array) -> tuple[Array, Array]:
        """Points xy (T, 2) and their derivatives D (T, 2, n)."""

    def kink(self, p: Array) -> float | None:
        """When its velocity jumps; None if never."""
        return None

    @abstractmethod
    def starts(self, curve: Array) -> list[Array]:
        """Parameters (n,) of paths along `curve` (m, 2), points equally far from each other."""


@dataclass(frozen=True)
class Polynomial(PathFamily):
    """x and y as polynomials of time: a line, a throw, or a cubic.

    The parameters are the points that a curve of `degree` passes at equally spaced times.
    """

    degree: int

    @property
    def name(self) -> str:  # type: ignore[override]
        """What to call it."""
        return ("line", "parabola", "cubic")[self.degree - 1]

    @property
    def size(self) -> int:  # type: ignore[override]
        """How many parameters."""
        return 2 * (self.degree + 1)

    def at(self, p: Array, t: Array) -> tuple[Array, Array]:
        """Sums of the points, weighted by time."""
        basis = self.weights(t)
        return basis @ p.reshape(-1, 2), _both(basis)

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

    The parameters are start, end, and how far the middle of the way lies off the chord, to the left
    of it as seen with y up; 0 is a straight line.
    """

    name = "arc"
    size = 5

    def at(self, p: Array, t: Array) -> tuple[Array, Array]:
        """Around the circle."""
        return _arc(p, t).real, _by_complex_step(_arc, p, t)

    def starts(self, curve: Array) -> list[Array]:
        """Through its ends and its middle."""
        a, m, b = curve[0], curve[len(curve) // 2], curve[-1]
        chord = b - a
        length = max(float(np.linalg.norm(chord)), 1e-9)
        off = (chord[0] * (m - a)[1] - chord[1] * (m - a)[0]) / length
        return [np.array([*a, *b, off])]


class Bounce(PathFamily):
    """Two straight pieces, each at its own constant speed.

    The parameters are start, contact, end and the time of the contact.
    """

    name = "bounce"
    size = 7

    def at(self, p: Array, t: Array) -> tuple[Array, Array]:
        """Along the one piece, then the other."""
        a, m, b, k = p[:2], p[2:4], p[4:6], self.kink(p)
        first = t < k
        u = np.where(first, t / k, (t - k) / (1 - k))
        left = np.where(first, 1 - u, 0)
        right = np.where(first, 0, u)
        basis = np.stack([left, 1 - left - right, right], axis=1)
        by_time = np.where(first[:, None], -(u / k)[:, None] * (m - a), 0)
        by_time = by_time + np.where(first[:, None], 0, ((u - 1) / (1 - k))[:, None] * (b - m))
        by_time *= 0.02 < k < 0.98
        xy = basis @ np.stack([a, m, b])
        return xy, np.concatenate([_both(basis), by_time[:, :, None]], axis=2)

    def kink(self, p: Array) -> float:
        """The time of the contact."""
        return float(np.clip(p[6], 0.02, 0.98))

    def starts(self, curve: Array) -> list[Array]:
        """The corner is where the curve is farthest from its chord, or at a third or two of it."""
        a, b = curve[0], curve[-1]
        along = (b - a) / max(float(np.linalg.norm(b - a)), 1e-9)
        off = np.abs(along[0] * (curve - a)[:, 1] - along[1] * (curve - a)[:, 0])
        last = len(curve) - 1
        corners = {int(np.clip(np.argmax(off), 1, last - 1)), last // 3, 2 * last // 3}
        return [np.concatenate([a, curve[i], b, [i / last]]) for i in sorted(corners)]


class FromRest(PathFamily):
    """At rest, then straight at constant speed; backwards in time, a stop.

    The parameters are start, end and the time of the departure.
    """

    name = "from rest"
    size = 5

    def at(self, p: Array, t: Array) -> tuple[Array, Array]:
        """Nowhere, then along the line."""
        a, b, k = p[:2], p[2:4], self.kink(p)
        u = np.maximum((t - k) / (1 - k), 0)
        basis = np.stack([1 - u, u], axis=1)
        by_time = np.where((t > k) & (0 < k < 0.98), (t - 1) / (1 - k) ** 2, 0)[:, None] * (b - a)
        xy = basis @ np.stack([a, b])
        return xy, np.concatenate([_both(basis), by_time[:, :, None]], axis=2)

    def kink(self, p: Array) -> float:
        """The time of the departure."""
        return float(np.clip(p[4], 0, 0.98))

    def starts(self, curve: Array) -> list[Array]:
        """A line from one of its ends to the other."""
        return [np.concatenate([a, b, [0.3]]) for a, b in (curve[[0, -1]], curve[[-1, 0]])]


LINE, PARABOLA, CUBIC = Polynomial(1), Polynomial(2), Polynomial(3)
ARC, BOUNCE, FROM_REST = Arc(), Bounce(), FromRest()


def path_family(name: str) -> PathFamily:
    """The family of this name.

    Raises
    ------
    ValueError
        If there is none.
    """
    families = {f.name: f for f in (LINE, PARABOLA, CUBIC, ARC, BOUNCE, FROM_REST)}
    if name not in families:
        raise ValueError(f"a path is one of {', '.join(families)}, got {name!r}")
    return families[name]


_TINY = 1e-30  # no more than rounding


@cache
def _lagrange(degree: int) -> Array:
    """(degree + 1, degree + 1) coefficients of Lagrange's polynomials, a row for each power."""
    nodes = np.linspace(0, 1, degree + 1)
    return np.asarray(np.linalg.inv(np.vander(nodes, increasing=True)))


def _both(basis: Array) -> Array:
    """(T, 2, 2 k) derivatives of points that are `basis` (T, k) times k points (x, y)."""
    D = np.zeros((len(basis), 2, 2 * basis.shape[1]))
    D[:, 0, 0::2] = basis
    D[:, 1, 1::2] = basis
    return D


def _arc(p: Array, t: Array) -> Array:
    """(T, 2) points of a circle through start and end, also for complex parameters.

    Half of the arc turns by φ, tan(φ/2) = off / half chord; seen from the middle of the arc the
    point turns evenly. In units of half the chord a point is at sin(φ s)/sin φ along and
    (cos(φ s) − cos φ)/sin φ off it, s from −1 to 1; for small φ both go over into s and a parabola.
    """
    a, b, off = p[:2], p[2:4], p[4]
    half = (b - a) / 2
    length = np.sqrt(half[0] ** 2 + half[1] ** 2 + _TINY)
    phi = 2 * np.arctan(off / length)
    s = 2 * t - 1
    if abs(phi) < 1e-4:
        along, across = s * (1 + phi**2 * (1 - s**2) / 6), phi * (1 - s**2) / 2
    else:
        along = np.sin(phi * s) / np.sin(phi)
        across = (np.cos(phi * s) - np.cos(phi)) / np.sin(phi)
    normal = np.stack([-half[1], half[0]])
    return np.asarray((a + b) / 2 + along[:, None] * half + across[:, None] * normal)


def _by_complex_step(points: Callable[[Array, Array], Array], p: Array, t: Array) -> Array:
    """(T, 2, n) derivatives of analytic `points` by their parameters, exact to rounding."""
    D = np.empty((len(t), 2, len(p)))
    for i in range(len(p)):
        q = p.astype(complex)
        q[i] += 1j * _TINY
        D[:, :, i] = points(q, t).imag / _TINY
    return D
