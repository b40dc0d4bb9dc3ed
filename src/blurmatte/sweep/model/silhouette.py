"""Silhouettes: alpha of a moving shape in some pixels, and its derivatives.

In this file `shape` is the parameters of a silhouette (m,). The rim lies at the distance ρ(φ) from the
center at the angle φ from +x towards +y: the shape is star-shaped about its center. `rim_kernel`
defines ρ by the parameters.

A change during the exposure has three rates (g, a, b), natural logarithms: after the fraction τ of it,
the shape is mapped by exp(τ G) with G = [[g + a, b], [b, g − a]].
"""

from dataclasses import dataclass, replace
from functools import cache, cached_property
from typing import Annotated, Any

import numpy as np
import scipy
from annotated_types import Interval

from blurmatte.checks import Array
from blurmatte.statistics import UNIFORM_VARIANCE
from blurmatte.sweep.model import rim_kernel
from blurmatte.sweep.model.path import PathFamily, pieces_of
from blurmatte.sweep.model.pixels import Pixels
from blurmatte.sweep.model.shape import OUTLINE_POINTS, FlatShape, Shape, SweptAlpha

OPAQUE = 0.999  # alpha from which the plate is invisible


_Stretch = Annotated[float, Interval(ge=-1, le=1)]

# Bounds of the parameters of a silhouette.
MAX_ORDER = 64  # of the Fourier series of an outline, in files
_MAX_LOG_STRETCH = 2.0  # half the log of length over width: 55 times as long as wide
# Norm of the Fourier coefficients of log R, √2 of its root mean square; a star of five points
# has half of it
_MAX_COEFFICIENTS = 1.0
_MAX_LOG_RATE = 2.0  # logarithm by which a length changes during the exposure: 7.4 times
_MIN_BLUR_PX = 0.2  # standard deviation of the rim's blur: a pixel's width hides less
# Standard deviation by which files blur colors: blocks of 4 pixels share a color
MAX_FILE_BLUR_PX = 2.0
# Standard deviation by which a lens blurs the rim, of the radius; more hides the shape
_MAX_LENS_BLUR = 0.3
# Derivatives of a stretch
_BY_A, _BY_B = np.array([[1.0, 0], [0, -1]]), np.array([[0, 1.0], [1, 0]])
_QUARTER = np.array([[0, -1.0], [1, 0]])  # of a turn, from +x towards +y


# Moments at which a moving shape is drawn.
_PARTS = 48  # equal parts of the exposure, which are subdivided
_SOFT_PARTS = 8  # the same where rim and path are smooth
_MAX_STEP_PX = 0.7  # distance between two moments
_MAX_PER_PART = 200  # moments in a part


@dataclass(frozen=True)
class Silhouette(FlatShape):
    """Discs, ellipses, or outlines of higher order; each kind contains the simpler ones.

    The parameters are the radius in pixels, two numbers of the stretch of an ellipse, two more for
    every order of an outline from 3 on, the turn in radians, the rates of change, and the standard
    deviation in pixels of the rim's blur: half the radius of the circle of confusion of a lens. Size,
    area and outline are those in the middle of the exposure.

    A shape that changes is mapped by exp((t − ½) G) at the exposure fraction t, before it turns, with
    G = [[g + a, b], [b, g − a]] and the rates g, a, b, natural logarithms: g is growth, as of an object
    that approaches, and (a, b) a change of foreshortening. A disc has only g.

    A camera that exposes its rows one after another stretches every shape by a known map, before that
    of the shape's own stretch S: the image is r exp(S + S₀), S₀ = [[a, b], [b, −a]] with a and b of
    `camera_stretch`.

    Raises ValueError if `order` is less than 1, or if a disc turns, which is not observable.
    """

    kind = "silhouette"

    # Of the Fourier series of the outline: 1 is a disc, 2 an ellipse
    order: Annotated[int, Interval(ge=1, le=MAX_ORDER)] = 1
    turns: bool = False  # it rotates at constant rate in the plane of the picture
    soft: bool = False  # its rim is blurred: by the lens, or by the file
    # Its size, and unless it is a disc its proportions, change at constant rates
    changes: bool = False
    camera_stretch: tuple[_Stretch, _Stretch] = (0.0, 0.0)  # logarithms, as an ellipse's

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.order < 1:
            raise ValueError(f"order must be 1 or more, got {self.order}")
        if self.turns and self.order < 2:
            raise ValueError("a silhouette that turns must be of order 2 or more, got a disc")

    @property
    def name(self) -> str:
        """Name in messages and files."""
        kind = {1: "disc", 2: "ellipse"}.get(self.order, f"outline of order {self.order}")
        if self.order == 1:
            return f"growing {kind}" if self.changes else kind
        does = ["turning"] * self.turns + ["changing"] * self.changes
        return f"{', '.join(does)} {kind}".strip()

    @property
    def is_disc(self) -> bool:
        """Whether it is a disc, which may grow."""
        return self.order == 1

    @cached_property
    def names(self) -> tuple[str, ...]:
        """(m,) names of the parameters."""
        first = ("radius", *2 * ("stretch",) * (self.order > 1))
        outline = 2 * max(self.order - 2, 0) * ("outline",)
        rates = self.changes * (1 if self.order == 1 else 3) * ("rates",)
        return *first, *outline, *self.turns * ("turn",), *rates, *self.soft * ("blur",)

    @property
    def still(self) -> "Silhouette":
        """The same at one moment, opaque."""
        return replace(self, turns=False, changes=False, opacity=1.0)

    @property
    def sharp(self) -> "Silhouette":
        """The same with a sharp rim."""
        return replace(self, soft=False)

    def start(self, radius: float) -> Array:
        """Parameters (m,) of a disc of this radius."""
        return np.array([radius, *np.zeros(self.size - 1)])

    def possible(self, shape: Array, bounds: tuple[float, float]) -> Array:
        """The shape clipped to radius bounds (pixels) and to the bounds above."""
        near = shape.copy()
        near[0], rate = np.clip(shape[0], *bounds), _MAX_LOG_RATE
        near[self.at("rates")] = np.clip(shape[self.at("rates")], -rate, rate)
        if self.soft:
            lens = _MAX_LENS_BLUR * near[0]
            largest = max(MAX_FILE_BLUR_PX, lens)
            near[self.at("blur")] = np.clip(self.softness(shape), _MIN_BLUR_PX, largest)
        return near

    def extreme(self, shape: Array) -> bool:
        """True if it gets too long or its rim is too jagged for the bounds above."""
        if self.order == 1:
            return False
        long = np.linalg.norm(shape[self.at("stretch")]) + np.linalg.norm(self.rates(shape)[1:]) / 2
        jagged = np.linalg.norm(self._coefficients(shape))
        return bool(long > _MAX_LOG_STRETCH or jagged > _MAX_COEFFICIENTS)

    def opaque(self, family: PathFamily, path: Array, shape: Array, pixels: Pixels) -> SweptAlpha:
        """Alpha and its derivatives, compiled."""
        from blurmatte.sweep.model import silhouette_kernel as kernel  # SciPy is slow to import

        scale, soft = pixels.scale, self.softness(shape) / pixels.scale
        alpha = np.zeros(pixels.shape)
        J = np.zeros((*alpha.shape, len(path) + self.size))
        t, weights = moments(family, path, scale, self.rim_motion(shape), soft)
        xy, D = family.at(path, t)
        xy, D = (xy - pixels.origin) / scale, D / scale
        if self.order == 1 and self.camera_stretch == (0.0, 0.0):
            radius, growth = shape[0] / scale, shape[1] if self.changes else 0.0
            kernel.disc(xy, D, weights, radius, growth, t - 0.5, self.changes, soft, alpha, J)
            J[..., len(path)] /= scale
        else:
            A, by_A = (x / scale for x in self._stretch(shape))
            outline, rim = (A, by_A, self._coefficients(shape)), self.rim(shape, scale)
            maps, motion = self._maps(shape, t), (xy, D, weights)
            kernel.sweep(motion, *maps, self.changes, rim, outline, soft, alpha, J)
        if self.soft:
            J[..., -1] /= scale
        return SweptAlpha(alpha, J)

    def rim(self, shape: Array, scale: float = 1.0) -> tuple[Array, float, float, float, Array]:
        """Distances from the rim on a lattice, in pixels of a width: `rim_kernel.lattice_around`."""
        A, soft = self._stretch(shape)[0] / scale, self.softness(shape) / scale
        reach = rim_kernel.reach_of(soft) * np.exp(most_shrinking(self.rates(shape)))
        variance = rim_kernel.variance_of(soft)
        rim = rim_kernel.lattice_around(A, self._coefficients(shape), variance, reach)
        return rim  # type: ignore[no-any-return]

    def rim_motion(self, shape: Array) -> float:
        """Distance by which turn and change move the rim during the exposure, pixels."""
        if not (self.turns or self.changes):
            return 0.0
        rate = abs(self.turn(shape)) + 2 * most_shrinking(self.rates(shape))
        return float(rate * self.reach(shape))

    def map_at(self, shape: Array, t: Array) -> Array:
        """(T, 2, 2) linear maps from the shape in the middle of the exposure to that at fractions t."""
        return self._maps(shape, t)[0]

    def _maps(self, shape: Array, t: Array) -> tuple[Array, Array]:
        """`map_at` (T, 2, 2), and derivatives (T, 2, 2, l) by turn and rates."""
        late, count = t - 0.5, len(t)
        maps, by = np.tile(np.eye(2), (count, 1, 1)), np.zeros((count, 2, 2, 0))
        if self.changes:
            maps, by = changed(self.rates(shape), late)
            by = by[..., : self.names.count("rates")]
        if self.turns:
            maps, by = turned(self.turn(shape), late, maps, by)
        return np.ascontiguousarray(maps), np.ascontiguousarray(by)

    def area(self, shape: Array) -> float:
        """Area in the middle of the exposure, pixels²."""
        return float(np.pi * shape[0] ** 2 * np.mean(self._star(shape, count=360) ** 2))

    def left_out(self, shape: Array) -> float:
        """Error of the rim from truncating its Fourier series, pixels: the size of the last order."""
        if self.order < 3:
            return 0.0
        return float(shape[0] * np.linalg.norm(self._coefficients(shape)[-2:]))

    def center(self, shape: Array) -> Array:
        """(2,) centroid; that of an outline of order 3 or more is off the path."""
        if self.order < 3:
            return np.zeros(2)
        x, y = self.outline(shape, OUTLINE_POINTS).T
        cross = x * np.roll(y, -1) - np.roll(x, -1) * y
        middle = [((p + np.roll(p, -1)) * cross).sum() / (3 * cross.sum()) for p in (x, y)]
        return np.array(middle)

    def outline(self, shape: Array, count: int) -> Array:
        """Points (count, 2) around the rim in the middle of the exposure, from the center, pixels."""
        phi, A = _angles(count), self._stretch(shape)[0]
        circle = np.stack([np.cos(phi), np.sin(phi)], axis=1)
        return np.asarray(self._star(shape, count)[:, None] * circle @ A.T)

    def mapped(self, shape: Array, by: Array) -> Array:
        """Parameters (m,) of the image of a shape under a linear map (2, 2) of positive determinant.

        A disc changes its size alone; the rates are kept.
        """
        new = shape.copy()
        new[0] *= np.sqrt(np.linalg.det(by))
        if self.order == 1:
            return new
        turn, A = scipy.linalg.polar(by @ self._stretch(shape)[0], side="left")
        S = scipy.linalg.logm(A / new[0]).real
        new[1:3] = np.array([S[0, 0], S[0, 1]]) - self.camera_stretch
        angle = np.arctan2(turn[1, 0], turn[0, 0])
        for k in range(3, self.order + 1):
            a, b = shape[2 * k - 3 : 2 * k - 1]
            cosine, sine = np.cos(k * angle), np.sin(k * angle)
            new[2 * k - 3 : 2 * k - 1] = cosine * a - sine * b, sine * a + cosine * b
        return new

    def _stretch(self, shape: Array) -> tuple[Array, Array]:
        """A (2, 2) and its derivatives (2, 2, 1 or 3) by the radius and the stretch.

        A = r exp S with S = [[a, b], [b, −a]], that of the camera included.
        """
        r, known = shape[0], np.array(self.camera_stretch)
        if self.order == 1:
            unit = exponential(*known)[0] if known.any() else np.eye(2)
            return r * unit, unit[:, :, None]
        unit, by_a, by_b = exponential(*(shape[1:3] + known))
        return r * unit, np.stack([unit, r * by_a, r * by_b], axis=2)

    def _coefficients(self, shape: Array) -> Array:
        """(k,) Fourier coefficients of order 3 and more."""
        return shape[self.at("outline")]

    def _star(self, shape: Array, count: int) -> Array:
        """(count,) distances of the rim before the stretch, at even angles, of mean about 1."""
        if self.order < 3:
            return np.ones(count)
        phi = np.arange(3, self.order + 1)[:, None] * _angles(count)
        waves = np.stack([np.cos(phi), np.sin(phi)], axis=1).reshape(-1, count)
        return np.asarray(np.exp(self._coefficients(shape) @ waves))


DISC, ELLIPSE = Silhouette(1), Silhouette(2)


def as_silhouette(shape: Shape) -> Silhouette:
    """A shape in a search for silhouettes, which starts from a disc."""
    assert isinstance(shape, Silhouette)
    return shape


def moments(
    family: PathFamily, path: Array, scale: float, rim_motion: float = 0, soft: float = 0
) -> tuple[Array, Array]:
    """Midpoints (T,) of pieces of the exposure, and their durations, which sum to 1.

    Pieces are shorter where the rim is fast. The times stay the same when a path changes slightly, so
    that alpha is a smooth function of the path. A soft rim on a path without a kink makes alpha smooth
    in time: a piece of two standard deviations of the blur has two Gauss–Legendre nodes.

    scale: width of a pixel, pixels of the picture.
    rim_motion: distance by which turn and change move the rim, pixels of the picture.
    soft: standard deviation of the rim's blur, in units of `scale`.
    """
    even = soft > 0 and family.kink(path) is None
    parts = _SOFT_PARTS if even else _PARTS
    step = _MAX_STEP_PX
    if even:  # the variance of a pixel, and that of the blur
        step = 2 * max(float(np.sqrt(UNIFORM_VARIANCE + soft**2)), step)
    xy, _ = family.at(path, _even(parts))
    t, lengths = pieces_of(xy, rim_motion / parts, step * scale, _MAX_PER_PART)
    if not even:
        return t, lengths
    pairs = t[:, None] + 1 / np.sqrt(12) * lengths[:, None] * np.array([-1, 1])
    return pairs.ravel(), np.repeat(lengths / 2, 2)


@cache
def _even(parts: int) -> Array:
    """(parts + 1,) ends of equal parts of the exposure."""
    return np.linspace(0, 1, parts + 1)


def _angles(count: int) -> Array:
    return 2 * np.pi * np.arange(count) / count


def exponential(a: Any, b: Any) -> tuple[Array, Array, Array]:
    """Exp S (..., 2, 2) with S = [[a, b], [b, −a]], and its derivatives by a and b.

    exp S = cosh m + S sinh(m)/m with m² = a² + b².
    """
    one, S = np.eye(2), a * _BY_A + b * _BY_B
    m = np.maximum(np.hypot(a, b), 1e-4)  # a smaller m changes lengths by 5e-9 of them
    even, odd = np.cosh(m), np.sinh(m) / m
    more = (even - odd) / m**2  # the derivative of `odd` by m²/2
    both = odd * one + more * S
    return even * one + odd * S, a * both + odd * _BY_A, b * both + odd * _BY_B


def changed(rates: Array, late: Array) -> tuple[Array, Array]:
    """Maps (T, 2, 2) of changes of some rates (3,), and their derivatives (T, 2, 2, 3) by the rates.

    `late` (T,) are τ, fractions of the exposure.
    """
    (g, a, b), late = rates, late[:, None, None]
    unit, by_a, by_b = exponential(a * late, b * late)
    larger = np.exp(g * late)
    maps = larger * unit
    return maps, late[..., None] * np.stack([maps, larger * by_a, larger * by_b], axis=3)


def turned(turn: float, late: Array, maps: Array, by: Array) -> tuple[Array, Array]:
    """Maps (T, 2, 2) and derivatives (T, 2, 2, 1 + l), turned by turn τ, the first by the turn.

    The turn is in radians from +x towards +y; `late` (T,) are τ, fractions of the exposure; `by`
    (T, 2, 2, l) are derivatives of the maps by some parameters.
    """
    late = late[:, None, None]
    rotation = np.cos(turn * late) * np.eye(2) + np.sin(turn * late) * _QUARTER
    maps = rotation @ maps
    by_turn = (late * (_QUARTER @ maps))[..., None]
    return maps, np.concatenate([by_turn, np.einsum("tij,tjkp->tikp", rotation, by)], axis=3)


def most_shrinking(rates: Array) -> float:
    """Largest logarithm by which a change shrinks a length in half an exposure, 0 or more."""
    return float(abs(rates[0]) + np.hypot(rates[1], rates[2])) / 2
