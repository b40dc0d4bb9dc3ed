"""Shape: what moves along a path, by named parameters.

In this file `shape` is the parameters of a shape (m,). A parameter has a name, and those that belong
together have the same one. The search knows these:

    radius   the first parameter, pixels: the size
    blur     the last one, if there is one: the standard deviation of the rim's blur, pixels
    turn     rotation during the exposure, radians from +x towards +y
    rates    (g, a, b) of change during the exposure, logarithms; or g alone

All others are numbers of order 1, unless `lengths` names them.
"""

from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass, replace
from inspect import isabstract
from typing import Any, ClassVar, Self

import numpy as np

from blurmatte.checks import Array
from blurmatte.errors import MotionError
from blurmatte.sweep.model.path import LINE, PathFamily
from blurmatte.sweep.model.pixels import Pixels

OUTLINE_POINTS = 720  # of the polygon whose area, centroid and width are those of an outline
_RADIUS_STEP = 1e-5  # radii, of numerical derivatives


@dataclass(frozen=True, eq=False)
class SweptAlpha:
    """Alpha, and its derivatives by the parameters of the path and then those of the shape.

    Parameters
    ----------
    alpha : (h, w) float
    by_parameters : (h, w, n + m) float
    """

    alpha: Array
    by_parameters: Array


class Shape(ABC):
    """What a fit needs of a shape: its alpha on a path, and which parameters are possible."""

    lengths: ClassVar[frozenset[str]] = frozenset({"radius", "blur"})  #: parameters in pixels

    @property
    @abstractmethod
    def name(self) -> str:
        """Its kind in messages and files."""

    @property
    @abstractmethod
    def names(self) -> tuple[str, ...]:
        """(m,) names of the parameters."""

    @property
    def opacity(self) -> float:
        """Fraction of the light behind it that it hides where it covers a pixel at all times."""
        return 1.0

    @property
    def is_disc(self) -> bool:
        """Whether it is a disc, which may grow."""
        return False

    @property
    def order(self) -> int:
        """Of the Fourier series of its outline; 0 if it has none."""
        return 0

    @property
    def size(self) -> int:
        """Number of parameters."""
        return len(self.names)

    @property
    def parameters(self) -> int:
        """Number of all that were fitted, those that it holds included."""
        return self.size

    def has(self, name: str) -> bool:
        """Whether it has a parameter of this name."""
        return name in self.names

    def at(self, name: str) -> slice:
        """Positions of the parameters of this name; empty if there are none."""
        first = self.names.index(name) if name in self.names else self.size
        return slice(first, first + self.names.count(name))

    def value(self, name: str, shape: Array) -> float:
        """The parameter of this name that it has, the first if there are several."""
        return float(shape[self.names.index(name)])

    @abstractmethod
    def sweep(self, family: PathFamily, path: Array, shape: Array, pixels: Pixels) -> SweptAlpha:
        """Alpha of a shape that moves along a path, which may leave the pixels.

        The parameters of path (n,) and shape (m,) are in pixels of the picture.
        """

    @abstractmethod
    def possible(self, shape: Array, bounds: tuple[float, float]) -> Array:
        """The nearest shape that is possible, with a radius within bounds, pixels."""

    def price(self, shape: Array) -> float:
        """Negative log prior of what it holds apart from its parameters, nats."""
        return 0.0

    def extreme(self, shape: Array) -> bool:
        """True if a search should go no further in this direction."""
        return False

    def radius(self, shape: Array) -> float:
        """Its size, pixels; of a flat shape the radius of the disc of the same area."""
        return self.value("radius", shape)

    def softness(self, shape: Array) -> float:
        """Standard deviation of the rim's blur, pixels; 0 if it is sharp."""
        return self.value("blur", shape) if self.has("blur") else 0.0

    def is_length(self) -> list[bool]:
        """(m,) which parameters are in pixels."""
        return [name in self.lengths for name in self.names]


@dataclass(frozen=True, kw_only=True)
class FlatShape(Shape):
    """A shape in the plane of the picture, the same wherever it is: that of a `Sweep`.

    A member is a frozen dataclass, whose fields are saved with a sweep under its `kind`, and checked
    by their types when they are read. Sizes and outlines are those in the middle of the exposure.

    Alpha is the opacity times the part of the exposure during which the shape covers a pixel. An opaque
    object at rest that was there for a part of the exposure has this part as its opacity; one that
    only adds light has 0.

    Raises ValueError if the opacity is not from 0 to 1.
    """

    kind: ClassVar[str]  #: its name in files

    opacity: float = 1.0  # from 0 to 1

    def __post_init__(self) -> None:
        if not 0 <= self.opacity <= 1:
            raise ValueError(f"opacity must be from 0 to 1, got {self.opacity}")

    @abstractmethod
    def opaque(self, family: PathFamily, path: Array, shape: Array, pixels: Pixels) -> SweptAlpha:
        """As `sweep`, of an opaque shape."""

    def sweep(self, family: PathFamily, path: Array, shape: Array, pixels: Pixels) -> SweptAlpha:
        """Alpha of a shape that moves along a path, and its derivatives."""
        swept = self.opaque(family, path, shape, pixels)
        if self.opacity == 1:
            return swept
        return SweptAlpha(self.opacity * swept.alpha, self.opacity * swept.by_parameters)

    @abstractmethod
    def start(self, radius: float) -> Array:
        """Parameters (m,) from which fits start, nearest to a disc of this radius."""

    @abstractmethod
    def outline(self, shape: Array, count: int) -> Array:
        """Points (count, 2) around the outer rim, from the center, pixels."""

    def with_opacity(self, opacity: float) -> Self:
        """The same with another opacity."""
        return replace(self, opacity=opacity)

    @property
    def still(self) -> "FlatShape":
        """The kind of the shape at one moment, opaque."""
        return self.with_opacity(1.0)

    @property
    def sharp(self) -> "FlatShape":
        """The same without the blur of the rim, which is the last parameter."""
        return self

    def like(self, other: Shape, shape: Array) -> Array:
        """Parameters (m,) of the shape of another kind; those that this one lacks are dropped."""
        mine = self.start(other.value("radius", shape))
        for name in dict.fromkeys(self.names):
            to, known = self.at(name), shape[other.at(name)]
            count = min(len(known), to.stop - to.start)
            mine[to.start : to.start + count] = known[:count]
        return mine

    def units(self, pixel: float) -> Array:
        """(m,) factors of the parameters if the unit of length is `pixel` times as large."""
        return np.where(self.is_length(), pixel, 1.0)

    def area(self, shape: Array) -> float:
        """Area, pixels²."""
        x, y = self.outline(shape, OUTLINE_POINTS).T
        return float(abs(x @ np.roll(y, -1) - y @ np.roll(x, -1)) / 2)

    def radius(self, shape: Array) -> float:
        """Radius of the disc of the same area, pixels."""
        return float(np.sqrt(self.area(shape) / np.pi))

    def radius_slope(self, shape: Array) -> Array:
        """(m,) derivatives of the radius by the parameters."""
        step = _RADIUS_STEP * self.value("radius", shape) * np.eye(len(shape))
        radius = self.radius
        return np.array([(radius(shape + d) - radius(shape - d)) / (2 * d.sum()) for d in step])

    def center(self, shape: Array) -> Array:
        """(2,) centroid, from the point that moves along the path, pixels."""
        return np.zeros(2)

    def reach(self, shape: Array) -> float:
        """Largest distance of the rim from the center at any moment, pixels.

        Under exp(τ G) with a symmetric G a distance is a convex function of τ, largest at an end.
        """
        rim = self.outline(shape, count=360)
        if self.has("rates"):
            rim = np.concatenate(rim @ self.map_at(shape, np.array([0.0, 1.0])).transpose(0, 2, 1))
        return float(np.linalg.norm(rim, axis=1).max())

    def left_out(self, shape: Array) -> float:
        """Error of the rim by detail that the parameters cannot describe, pixels."""
        return 0.0

    def map_at(self, shape: Array, t: Array) -> Array:
        """(T, 2, 2) linear maps from the shape in the middle of the exposure to that at fractions t."""
        return np.tile(np.eye(2), (len(t), 1, 1))

    def rim_motion(self, shape: Array) -> float:
        """Distance by which turn and change move the rim during the exposure, pixels."""
        return 0.0

    def coverage(self, shape: Array, pixels: Pixels) -> Array:
        """(h, w) coverage in the middle of the exposure, with the center at (0, 0)."""
        still = self.still
        return still.sweep(LINE, np.zeros(4), still.like(self, shape), pixels).alpha

    def rim(self, shape: Array, scale: float = 1.0) -> Any:
        """Distances from the rim on a lattice, which sharp objects need: `Silhouette.rim`.

        Raises
        ------
        MotionError
            For a shape with more than one rim.
        """
        raise MotionError(
            f"only objects of one rim can be made sharp, and the fitted shape is: {self.name}; its "
            "layer can be composed as it is"
        )

    def turn(self, shape: Array) -> float:
        """Rotation during the exposure, radians from +x towards +y."""
        return float(shape[self.at("turn")].sum())

    def turn_slope(self) -> Array:
        """(m,) derivatives of the turn by the parameters."""
        slope = np.zeros(self.size)
        slope[self.at("turn")] = 1.0
        return slope

    def rates(self, shape: Array) -> Array:
        """(3,) rates (g, a, b) of change during the exposure, logarithms; 0 if it does not change."""
        rates, known = np.zeros(3), shape[self.at("rates")]
        rates[: len(known)] = known
        return rates


def shape_kind(kind: str) -> type[FlatShape]:
    """The class of this kind; ValueError if no module that was imported defines it."""
    found = {member.kind: member for member in _members(FlatShape) if not isabstract(member)}
    if kind not in found:
        raise ValueError(f"the shape {kind!r} is unknown; import the module that defines it")
    return found[kind]


def _members(of: Any) -> Iterator[type[FlatShape]]:
    """The subclasses that are defined, and theirs."""
    for member in of.__subclasses__():
        yield member
        yield from _members(member)
