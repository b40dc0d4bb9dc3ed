"""Mask: a rigid silhouette of any form, as the parts of square cells that it covers."""

import math
from dataclasses import dataclass, field
from functools import cached_property
from typing import Annotated

import numpy as np
import scipy
from annotated_types import Ge, Gt, Interval

from blurmatte.checks import Array
from blurmatte.sweep.model import mask_kernel as kernel
from blurmatte.sweep.model.path import PathFamily
from blurmatte.sweep.model.pixels import Pixels
from blurmatte.sweep.model.shape import FlatShape, SweptAlpha
from blurmatte.sweep.model.silhouette import moments

_WAYS = 3  # in which a rim continues from one cell to the next: it does not return
_STEPS_PER_CELL = 4  # along the rays that find the outer rim
_NODES_PER_CELL = 8  # of the lattice of distances from the rims


@dataclass(frozen=True)
class Mask(FlatShape):
    """A silhouette that may have any rim, holes and parts, and neither turns nor changes.

    Its one parameter is the radius in pixels, a size; the cells were fitted, and scale with it. The
    path is that of the middle of the cells.

    Parameters
    ----------
    cells : (n, m) numbers
        The part of each cell that the silhouette covers, rows from above, 0…1.
    width : float
        Of a cell, radii.
    freedom : float
        Effective number of parameters of the cells.
    rim_error : float
        Standard deviation of the rim's position, radii.

    Raises
    ------
    ValueError
        If the rows are not of one length, or no cell is covered.
    """

    kind = "mask"
    name = "free silhouette"
    names = ("radius",)

    cells: tuple[tuple[Annotated[float, Interval(ge=0, le=1)], ...], ...] = field(repr=False)
    width: Annotated[float, Gt(0)]
    freedom: Annotated[float, Ge(0)] = 0.0
    rim_error: Annotated[float, Ge(0)] = 0.0

    def __post_init__(self) -> None:
        super().__post_init__()
        if len({len(row) for row in self.cells}) != 1:
            raise ValueError("the rows of a mask must be of one length")
        if not self.covered.any():
            raise ValueError("a mask must cover at least one cell")

    @cached_property
    def covered(self) -> Array:
        """(n, m) parts of the cells."""
        return np.array(self.cells, dtype=float)

    @property
    def parameters(self) -> int:
        """The size, and as many as the cells are worth."""
        return 1 + round(self.freedom)

    def start(self, radius: float) -> Array:
        """The radius."""
        return np.array([radius])

    def possible(self, shape: Array, bounds: tuple[float, float]) -> Array:
        """A radius within the bounds."""
        return np.clip(shape, *bounds)

    def opaque(self, family: PathFamily, path: Array, shape: Array, pixels: Pixels) -> SweptAlpha:
        """Alpha and its derivatives, exact for cells of constant coverage."""
        t, weights = moments(family, path, pixels.scale)
        xy, D = family.at(path, t)
        at = (xy - np.array(pixels.origin)) / pixels.scale
        width = self.width * shape[0] / pixels.scale
        alpha = np.zeros(pixels.shape)
        J = np.zeros((*pixels.shape, len(path) + 1))
        kernel.sweep(self.covered, width, at, D / pixels.scale, weights, alpha, J)
        J[..., -1] *= self.width / pixels.scale
        return SweptAlpha(alpha, J)

    def price(self, shape: Array) -> float:
        """Of the rim; its length is the sum of the steps between cells."""
        down, right = (np.diff(np.pad(self.covered, 1), axis=k) for k in (0, 1))
        return rim_price(float(np.hypot(down[:, :-1], right[:-1]).sum()))

    def outline(self, shape: Array, count: int) -> Array:
        """Points (count, 2) where rays from the centroid leave the silhouette for the last time."""
        n, m = self.covered.shape
        x, y = self._middle
        far = np.arange(0, np.hypot(n, m), 1 / _STEPS_PER_CELL)
        angle = 2 * np.pi * np.arange(count) / count
        ray = np.stack([np.cos(angle), np.sin(angle)], axis=1)
        at = [y + np.outer(ray[:, 1], far), x + np.outer(ray[:, 0], far)]
        inside = scipy.ndimage.map_coordinates(self.covered, at, order=1) >= self.covered.max() / 2
        last = far[np.max(np.where(inside, np.arange(len(far)), 0), axis=1)]
        from_middle = np.array([x - (m - 1) / 2, y - (n - 1) / 2])
        return np.asarray(self.width * shape[0] * (from_middle + last[:, None] * ray))

    def rim(self, shape: Array, scale: float = 1.0) -> tuple[Array, float, float, float, Array]:
        """Distances from all rims on a lattice, as `rim_kernel.lattice_around` has them.

        The rim is where half of a cell is covered, linear between the centers of cells. It is taken as
        straight within a pixel. The polygon is the box of the cells.
        """
        (n, m), width = self.covered.shape, self.width * shape[0] / scale
        border = int(np.ceil(2 / width)) + 1  # cells, more than a pixel
        fine = np.arange(-border * _NODES_PER_CELL, (max(n, m) + border) * _NODES_PER_CELL)
        rows, columns = (
            fine[: (k + 2 * border) * _NODES_PER_CELL] / _NODES_PER_CELL for k in (n, m)
        )
        at = np.meshgrid(rows, columns, indexing="ij")
        half = self.covered.max() / 2
        inside = scipy.ndimage.map_coordinates(self.covered, at, order=1) >= half
        depth, height = (scipy.ndimage.distance_transform_edt(x) for x in (inside, ~inside))
        h = width / _NODES_PER_CELL
        lattice = np.zeros((*inside.shape, 8))
        lattice[..., 0] = h * np.where(inside, depth - 0.5, 0.5 - height)
        down, right = np.gradient(
            scipy.ndimage.gaussian_filter(lattice[..., 0], _NODES_PER_CELL / 2)
        )
        length = np.maximum(np.hypot(down, right), 1e-9)
        lattice[..., 1], lattice[..., 2] = -right / length, -down / length
        x0, y0 = (width * (-border - (k - 1) / 2) for k in (m, n))
        x1, y1 = (at + h * (k - 2) for at, k in zip((x0, y0), inside.shape[::-1], strict=True))
        polygon = np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]])
        return lattice, x0, y0, h, polygon

    def coverage(self, shape: Array, pixels: Pixels) -> Array:
        """(h, w) coverage within the rims of `rim`, without fainter cells."""
        lattice, x0, y0, h, _ = self.rim(shape, pixels.scale)
        at = np.indices(pixels.shape, dtype=float)
        at += (np.array(pixels.origin[::-1]) / pixels.scale)[:, None, None]
        inside = np.empty(pixels.shape)
        nodes = (at - np.array([y0, x0])[:, None, None]) / h
        scipy.ndimage.map_coordinates(lattice[..., 0], nodes, inside, order=1, cval=-1.0)
        return np.clip(inside + 0.5, 0, 1)

    def area(self, shape: Array) -> float:
        """Area, pixels²."""
        return float(self.covered.sum() * (self.width * shape[0]) ** 2)

    def center(self, shape: Array) -> Array:
        """(2,) centroid, from the middle of the cells, pixels."""
        n, m = self.covered.shape
        return np.asarray(self.width * shape[0] * (self._middle - [(m - 1) / 2, (n - 1) / 2]))

    def reach(self, shape: Array) -> float:
        """Distance of the farthest corner of a cell that is covered, pixels."""
        n, m = self.covered.shape
        y, x = np.nonzero(self.covered)
        far = np.hypot(np.abs(x - (m - 1) / 2) + 0.5, np.abs(y - (n - 1) / 2) + 0.5).max()
        return float(far * self.width * shape[0])

    def left_out(self, shape: Array) -> float:
        """Error of the rim by errors of the cells, pixels."""
        return float(self.rim_error * shape[0])

    @property
    def _middle(self) -> Array:
        """(2,) centroid (x, y), cells from the first one."""
        y, x = np.indices(self.covered.shape)
        sums = np.array([(self.covered * i).sum() for i in (x, y)])
        return np.asarray(sums / self.covered.sum())


def rim_price(length: float) -> float:
    """Negative log prior of a rim of a length in cells, nats: one of 3ⁿ."""
    return math.log(_WAYS) * length
