"""Silhouettes: alpha of a shape on its way, in the pixels of some data, and its derivatives.

In this file `shape` is the parameters of a silhouette (m,). Seen from its center the rim is ρ(φ)
away at the angle φ from +x towards +y, the center of no particular meaning but that all of the rim
can be seen from it. How ρ follows from the parameters stands in `rim_kernel`.
"""

from dataclasses import dataclass
from functools import cache
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from blurmatte.sweep.model.linear_maps import changed, exponential, most_shrinking, turned
from blurmatte.sweep.model.observation import Observation
from blurmatte.sweep.model.path import PathFamily

Array = npt.NDArray[np.float64]

_PARTS = 48  # of the exposure, equally long
_SOFT_PARTS = 8  # where nothing is sharp, neither the rim nor the path
_GAUSS = 1 / np.sqrt(
    12
)  # of a piece, how far its two moments are from its middle: exact for cubics
_STEP, _MOST = 0.7, 200  # pixels between two moments, and how many in a part at most
_PIXEL = 1 / 12  # variance of a box as wide as a pixel
_ANGLES = 360
_LONGEST = 2.0  # half the log of its length over its width: 55 times as long as wide
_JAGGED = 1.0  # of log R, √2 of its root mean square: a star of five points has half of it
BLUR_OF_FILES = 2.0  # pixels, the most that files blur colors: blocks of 4 share none
_FASTEST = 2.0  # logarithm by which a length changes: to 7.4 times what it was, or by two such
_MIDDLE = 0.5  # of the exposure
_SHARP = 0.2  # pixels: a pixel's width hides less
_DEFOCUSED = 0.3  # of a radius, by which a lens may blur a rim; more hides the shape


@dataclass(frozen=True, eq=False)
class Swept:
    """Alpha, and its derivatives by the parameters of the path and then those of the shape.

    Parameters
    ----------
    alpha : (h, w) float
    by_parameters : (h, w, n + m) float
    """

    alpha: Array
    by_parameters: Array


@dataclass(frozen=True)
class Silhouette:
    """Discs, ellipses, or outlines of higher order; each kind contains the simpler ones.

    The parameters are the radius in pixels, of an ellipse also two of its stretch, of an outline
    two more for every order from 3 on, then by how many radians it turns, then how it changes, and
    at last the standard deviation, in pixels, of what its rim is blurred by: half the radius of the
    circle of confusion of a lens. Size, area and outline are those in the middle of the exposure.

    What changes is at the exposure fraction t the shape under the map exp((t − ½) G), before it
    turns, with G = [[g + a, b], [b, g − a]] and the parameters g, a, b, natural logarithms: it comes
    nearer by g, and is stretched by (a, b) as a thing is that is foreshortened less and less. A disc
    has only g.

    Parameters
    ----------
    order : int
        Of the Fourier series of the outline: 1 is a disc, 2 an ellipse.
    turns : bool
        It turns evenly during the exposure, in the plane of the picture.
    soft : bool
        Its rim is blurred: by the lens, or by the file.
    changes : bool
        Its size, and if it is no disc its proportions, change evenly during the exposure.

    Raises
    ------
    ValueError
        If `order` is less than 1, or a disc turns, which nobody can see.
    """

    order: int = 1
    turns: bool = False
    soft: bool = False
    changes: bool = False

    def __post_init__(self) -> None:
        if self.order < 1:
            raise ValueError(f"order must be 1 or more, got {self.order}")
        if self.turns and self.order < 2:
            raise ValueError("a silhouette that turns must be of order 2 or more, got a disc")

    @property
    def name(self) -> str:
        """What to call it."""
        kind = {1: "disc", 2: "ellipse"}.get(self.order, f"outline of order {self.order}")
        if self.order == 1:
            return f"growing {kind}" if self.changes else kind
        does = ["turning"] * self.turns + ["changing"] * self.changes
        return f"{', '.join(does)} {kind}".strip()

    @property
    def size(self) -> int:
        """How many parameters."""
        return 2 * self.order - 1 + self.turns + self._changing + self.soft

    @property
    def _changing(self) -> int:
        """How many parameters tell how it changes."""
        return self.changes * (1 if self.order == 1 else 3)

    def start(self, half_width: float) -> Array:
        """Parameters (m,) of a disc of this radius."""
        return np.array([half_width, *np.zeros(self.size - 1)])

    def like(self, other: "Silhouette", shape: Array) -> Array:
        """Parameters (m,) of the shape of another silhouette, as far as this one can have it."""
        mine = self.start(shape[0])
        known = min(2 * self.order - 1, 2 * other.order - 1)
        mine[1:known] = shape[1:known]
        if self.turns:
            mine[2 * self.order - 1] = other.turn(shape)
        if self.changes:
            mine[self._rates] = other.rates(shape)[: self._changing]
        if self.soft:
            mine[-1] = other.softness(shape)
        return mine

    def possible(self, shape: Array, bounds: tuple[float, float]) -> Array:
        """The nearest shape with a radius within bounds, and a rim that leaves something to see."""
        near = shape.copy()
        near[0] = np.clip(shape[0], *bounds)
        near[self._rates] = np.clip(shape[self._rates], -_FASTEST, _FASTEST)
        if self.soft:
            near[-1] = np.clip(shape[-1], _SHARP, max(BLUR_OF_FILES, _DEFOCUSED * near[0]))
        return near

    def extreme(self, shape: Array) -> bool:
        """Whether it may get so long, or is so jagged, that it is no outline of a thing any more."""
        if self.order == 1:
            return False
        long = np.linalg.norm(shape[1:3]) + np.linalg.norm(self.rates(shape)[1:]) / 2
        jagged = np.linalg.norm(self._coefficients(shape))
        return bool(long > _LONGEST or jagged > _JAGGED)

    def sweep(self, family: PathFamily, path: Array, shape: Array, data: Observation) -> Swept:
        """Alpha of a shape that goes along a path; the path may leave the data.

        Parameters
        ----------
        family : PathFamily
        path : (n,) float
            Its parameters, pixels of the picture.
        shape : (m,) float
            Pixels of the picture, radians by which it turns, logarithms, and pixels again.
        data : Observation
            Where to look.
        """
        from blurmatte.sweep.model import (
            silhouette_kernel as kernel,
        )  # numba takes half a second to import

        alpha = np.zeros(data.weight.shape)
        J = np.zeros((*alpha.shape, len(path) + self.size))
        way, soft = self._way(family, path, shape, data), self.softness(shape) / data.scale
        if self.order == 1:
            radius, growth = shape[0] / data.scale, shape[1] if self.changes else 0.0
            late = way.t - _MIDDLE
            kernel.disc(
                way.xy, way.D, way.weights, radius, growth, late, self.changes, soft, alpha, J
            )
            J[..., len(path)] /= data.scale
        else:
            self._cover(way, shape, data.scale, self._stretch(shape)[1], alpha, J)
        if self.soft:
            J[..., -1] /= data.scale
        return Swept(alpha, J)

    def _way(self, family: PathFamily, path: Array, shape: Array, data: Observation) -> "_Way":
        """Where it is when, for how long."""
        soft = self.softness(shape) / data.scale
        rim_way = 0.0
        if self.turns or self.changes:
            rate = abs(self.turn(shape)) + 2 * most_shrinking(self.rates(shape))
            rim_way = rate * self.reach(shape)
        t, weights = moments(family, path, data.scale, rim_way, soft)
        xy, D = family.at(path, t)
        return _Way(t, weights, (xy - data.origin) / data.scale, D / data.scale)

    def _cover(
        self, way: "_Way", shape: Array, scale: float, by_A: Array, alpha: Array, J: Array
    ) -> None:
        """Add what a shape covers to alpha and J, as `kernel.sweep` does."""
        from blurmatte.sweep.model import rim_kernel
        from blurmatte.sweep.model import (
            silhouette_kernel as kernel,
        )  # numba takes half a second to import

        t, weights, xy, D = way
        A, by_A = self._stretch(shape)[0] / scale, by_A / scale
        coefficients, soft = self._coefficients(shape), self.softness(shape) / scale
        reach = kernel.reach_of(soft) * np.exp(most_shrinking(self.rates(shape)))
        rim = rim_kernel.lattice_around(A, coefficients, kernel.variance_of(soft), reach)
        maps, by_maps = self._maps(shape, t)
        kernel.sweep(
            xy, D, weights, maps, by_maps, self.changes, rim, A, by_A, coefficients, soft, alpha, J
        )

    def map_at(self, shape: Array, t: Array) -> Array:
        """(T, 2, 2) linear maps from the shape in the middle of the exposure to that at fractions t."""
        return self._maps(shape, t)[0]

    def _maps(self, shape: Array, t: Array) -> tuple[Array, Array]:
        """`map_at` (T, 2, 2), and derivatives (T, 2, 2, l) by how it turns and changes."""
        late, count = t - _MIDDLE, len(t)
        maps, by = np.broadcast_to(np.eye(2), (count, 2, 2)), np.zeros((count, 2, 2, 0))
        if self.changes:
            maps, by = changed(self.rates(shape), late)
            by = by[..., : self._changing]
        if self.turns:
            maps, by = turned(self.turn(shape), late, maps, by)
        return np.ascontiguousarray(maps), np.ascontiguousarray(by)

    def area(self, shape: Array) -> float:
        """Area in the middle of the exposure, pixels²."""
        return float(np.pi * shape[0] ** 2 * np.mean(self._star(shape, _ANGLES) ** 2))

    def radius(self, shape: Array) -> float:
        """Radius of the disc of the same area in the middle of the exposure, pixels."""
        return float(np.sqrt(self.area(shape) / np.pi))

    def reach(self, shape: Array) -> float:
        """How far the rim is from the center at most, at any moment, pixels.

        Under exp(τ G) with a symmetric G a distance is a convex function of τ: it is largest at an end.
        """
        rim = self.outline(shape, _ANGLES)
        if self.changes:
            rim = np.concatenate(rim @ self.map_at(shape, _ENDS).transpose(0, 2, 1))
        return float(np.linalg.norm(rim, axis=1).max())

    def left_out(self, shape: Array) -> float:
        """How far the rim may be off by the orders that it cannot have here, pixels."""
        if self.order < 3:
            return 0.0
        return float(shape[0] * np.linalg.norm(self._coefficients(shape)[-2:]))

    def outline(self, shape: Array, count: int) -> Array:
        """Points (count, 2) around the rim in the middle of the exposure, from the center, pixels."""
        phi, A = _angles(count), self._stretch(shape)[0]
        circle = np.stack([np.cos(phi), np.sin(phi)], axis=1)
        return np.asarray(self._star(shape, count)[:, None] * circle @ A.T)

    def turn(self, shape: Array) -> float:
        """By how much it turns during the exposure, radians from +x towards +y."""
        return float(shape[2 * self.order - 1]) if self.turns else 0.0

    def rates(self, shape: Array) -> Array:
        """(3,) logarithms (g, a, b) by which it changes during the exposure; 0 if it does not."""
        rates = np.zeros(3)
        rates[: self._changing] = shape[self._rates]
        return rates

    @property
    def _rates(self) -> slice:
        """Which parameters tell how it changes."""
        first = 2 * self.order - 1 + self.turns
        return slice(first, first + self._changing)

    def softness(self, shape: Array) -> float:
        """Standard deviation by which the rim is blurred, pixels; 0 if it is sharp."""
        return float(shape[-1]) if self.soft else 0.0

    def mapped(self, shape: Array, by: Array) -> Array:
        """Parameters (m,) of the image of a shape under a linear map (2, 2) that mirrors nothing.

        Of a disc only the size changes; how it changes stays.
        """
        from scipy.linalg import logm, polar

        new = shape.copy()
        new[0] *= np.sqrt(np.linalg.det(by))
        if self.order == 1:
            return new
        turn, A = polar(by @ self._stretch(shape)[0], side="left")
        S = logm(A / new[0]).real
        new[1:3] = S[0, 0], S[0, 1]
        angle = np.arctan2(turn[1, 0], turn[0, 0])
        for k in range(3, self.order + 1):
            a, b = shape[2 * k - 3 : 2 * k - 1]
            cosine, sine = np.cos(k * angle), np.sin(k * angle)
            new[2 * k - 3 : 2 * k - 1] = cosine * a - sine * b, sine * a + cosine * b
        return new

    def _stretch(self, shape: Array) -> tuple[Array, Array]:
        """A (2, 2) and its derivatives (2, 2, 1 or 3) by the radius and the stretch.

        A = r exp S with S = [[a, b], [b, −a]].
        """
        r, one = shape[0], np.eye(2)
        if self.order == 1:
            return r * one, one[:, :, None]
        unit, by_a, by_b = exponential(*shape[1:3])
        return r * unit, np.stack([unit, r * by_a, r * by_b], axis=2)

    def _coefficients(self, shape: Array) -> Array:
        """(k,) Fourier coefficients of order 3 and more."""
        return shape[3 : 2 * self.order - 1]

    def _star(self, shape: Array, count: int) -> Array:
        """(count,) distances of the rim before the stretch, at even angles, of mean about 1."""
        if self.order < 3:
            return np.ones(count)
        phi = np.arange(3, self.order + 1)[:, None] * _angles(count)
        waves = np.stack([np.cos(phi), np.sin(phi)], axis=1).reshape(-1, count)
        return np.asarray(np.exp(self._coefficients(shape) @ waves))


class _Way(NamedTuple):
    """Times (T,), parts of the exposure (T,), centers (T, 2) and their derivatives (T, 2, n).

    Pixels of the data.
    """

    t: Array
    weights: Array
    xy: Array
    D: Array


DISC, ELLIPSE = Silhouette(1), Silhouette(2)

_ENDS = np.array([0.0, 1.0])  # of the exposure


def moments(
    family: PathFamily, path: Array, scale: float, rim_way: float = 0, soft: float = 0
) -> tuple[Array, Array]:
    """Times (T,) in the middles of pieces of the exposure, and how long these are, of sum 1.

    Pieces are shorter where the rim is fast. The times stay the same when a path changes a little,
    so that alpha changes smoothly; as the crow flies is not enough where one part is folded. rim_way
    is how far a turn or a change moves the rim, pixels of the picture; soft is the softness in units of
    scale. Of a soft rim on a path without a kink alpha is so smooth in time that two moments of Gauss's
    do for a piece of two of its standard deviations.
    """
    from blurmatte.sweep.model import path_kernel  # numba takes half a second to import

    even = soft > 0 and family.kink(path) is None
    parts = _SOFT_PARTS if even else _PARTS
    step = 2 * max(float(np.sqrt(_PIXEL + soft**2)), _STEP) if even else _STEP
    xy, _ = family.at(path, _even(parts))
    t, lengths = path_kernel.pieces(xy, rim_way / parts, step * scale, _MOST)
    if not even:
        return t, lengths
    pairs = t[:, None] + _GAUSS * lengths[:, None] * np.array([-1, 1])
    return pairs.ravel(), np.repeat(lengths / 2, 2)


@cache
def _even(parts: int) -> Array:
    """(parts + 1,) times that part the exposure."""
    return np.linspace(0, 1, parts + 1)


def _angles(count: int) -> Array:
    return 2 * np.pi * np.arange(count) / count
