"""The nodes of an object's own straight color: a lattice on the silhouette, or a sphere.

The object is described in its own coordinates: pixels from its center, in its pose in the middle of the
exposure. Its straight color o is known by its values at nodes of a square lattice, only where the
silhouette is: a disc of radius r has n ≈ π r² nodes. On this compact support a blur can be inverted at
frequencies that a blur of the whole plane removes.

The nodes are numbered across the path. A pixel of the blurred picture mixes nodes along the path, so
that normal equations are banded: n r instead of n² numbers.

A point of the unit sphere is projected from the center on the faces of a cube. On a face, whose axis
is m, the angles atan(dₖ / |dₘ|) of the other two coordinates are divided into equal parts; neighboring
faces share the nodes of their edge, so that a bilinear interpolation is continuous on the whole sphere.
The distance of neighbors varies by 30 %. The sum of squared differences of neighbors does not depend on
it, as the Dirichlet energy of a surface does not depend on scale.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
import scipy

from blurmatte.checks import Array, Indices, Ints32
from blurmatte.sweep.model.pixels import Pixels
from blurmatte.sweep.sweep import Sweep

_FINEST_PITCH_PX = 1.5  # a pixel of the picture covers more of a surface that is inclined
MAX_NODES = 1500  # of a Cholesky factor that is not banded
HARMONICS = 8  # of the light on a ball: those of orders 1 and 2
FIELD_STD = 0.05  # of colored light: half of a factor's on gray paint, to which white light belongs


class Stencil(NamedTuple):
    """Nodes (m, k) of m differences, and their coefficients (k,)."""

    nodes: Indices
    coefficients: Array


@dataclass(frozen=True, eq=False)
class Lattice:
    """Nodes within a silhouette, and their order.

    Parameters
    ----------
    node : (rows, columns) int
        Index of the node, −1 where there is none.
    corner : (2,) float
        Lattice coordinates (x, y) of node (0, 0) from the center.
    radius : float
        Radius of the silhouette, pixels: other pictures of the object are scaled to it.
    pitch : float
        Distance of neighbors, pixels.
    """

    node: Ints32
    corner: Array
    radius: float
    pitch: float = 1.0

    @classmethod
    def of(cls, sweep: Sweep, pitch: float = 1.0) -> "Lattice":
        """Nodes inside a sweep's silhouette, and those around them that its pixels interpolate."""
        reach = int(np.ceil(sweep.silhouette.reach(sweep.shape) / pitch)) + 3
        side = 2 * reach + 1
        nodes = Pixels((side, side), (-reach * pitch, -reach * pitch), pitch)
        inside = sweep.silhouette.coverage(sweep.shape, nodes) > 0
        inside = scipy.ndimage.binary_dilation(inside, np.ones((3, 3), bool))
        y, x = np.nonzero(inside)
        velocity = np.diff(sweep.trajectory.xy, axis=0)
        across = np.linalg.eigh(velocity.T @ velocity)[1][:, 0]  # of the least mean square velocity
        order = np.argsort(np.stack([x, y], axis=1) @ across, kind="stable")
        node = np.full((side, side), -1, np.int32)
        node[y[order], x[order]] = np.arange(len(x))
        return cls(node, np.full(2, -float(reach)), sweep.radius, pitch)

    @property
    def size(self) -> int:
        """Number of nodes."""
        return int(self.node.max()) + 1

    @property
    def unknowns(self) -> int:
        """Number of nodes: the light on a flat object is part of its color."""
        return self.size

    @cached_property
    def edges(self) -> Indices:
        """(m, 2) indices of neighbors in rows and columns, the smaller first."""
        node = self.node
        return _neighbors((node[:, :-1], node[:, 1:]), (node[:-1], node[1:]))

    @property
    def stencils(self) -> tuple[Stencil, ...]:
        """Differences of first and of second order."""
        node = self.node
        rows = node[:, :-2], node[:, 1:-1], node[:, 2:]
        columns = node[:-2], node[1:-1], node[2:]
        square = node[:-1, :-1], node[:-1, 1:], node[1:, :-1], node[1:, 1:]
        line = np.concatenate([_inside(*rows), _inside(*columns)])
        mixed = Stencil(_inside(*square), np.sqrt(2) * np.array([1.0, -1.0, -1.0, 1.0]))
        return _first(self.edges), Stencil(line, np.array([1.0, -2.0, 1.0])), mixed


@dataclass(frozen=True, eq=False)
class Sphere:
    """Nodes on a ball.

    Parameters
    ----------
    node : (6, cells + 1, cells + 1) int
        Index of each node of the faces −x, +x, −y, +y, −z, +z.
    points : (n, 3) float
        Places of the nodes on the unit sphere, in the pose in the middle of the exposure.
    """

    node: Ints32
    points: Array

    @classmethod
    def of(cls, radius: float, pitch: float) -> "Sphere":
        """A sphere of a radius, with nodes at most about a pitch apart; both in pixels."""
        cells = max(2, int(np.ceil(np.pi / 2 * radius / pitch)))
        steps = np.arange(cells + 1)
        cube = np.empty((6, cells + 1, cells + 1, 3), int)
        for face in range(6):
            axis, side = divmod(face, 2)
            cube[face, ..., axis] = side * cells
            cube[face, ..., (axis + 1) % 3] = steps[:, None]
            cube[face, ..., (axis + 2) % 3] = steps
        places, index = np.unique(cube.reshape(-1, 3), axis=0, return_inverse=True)
        points = np.tan(np.pi / 4 * (2 * places / cells - 1))
        points /= np.linalg.norm(points, axis=1, keepdims=True)
        return cls(index.reshape(cube.shape[:3]).astype(np.int32), points)

    @classmethod
    def within(cls, radius: float, most: int) -> "Sphere":
        """The sphere of finest pitch with at most so many nodes, but of 1.5 pixels or more."""
        cells = int(np.sqrt((most - 2) / 6))
        return cls.of(radius, max(_FINEST_PITCH_PX, np.pi / 2 * radius / cells))

    @property
    def size(self) -> int:
        """Number of nodes."""
        return len(self.points)

    @property
    def unknowns(self) -> int:
        """Number of nodes, and of harmonics of colored light on the ball."""
        return self.size + HARMONICS

    @cached_property
    def edges(self) -> Indices:
        """(m, 2) indices of neighbors, the smaller first."""
        node = self.node
        both = _neighbors((node[:, :-1], node[:, 1:]), (node[..., :-1], node[..., 1:]))
        return np.unique(both, axis=0)  # faces share edges

    @property
    def stencils(self) -> tuple[Stencil, ...]:
        """Differences of first order alone: the cells are not square."""
        return (_first(self.edges),)


def _first(edges: Indices) -> Stencil:
    """Differences of first order."""
    return Stencil(edges, np.array([1.0, -1.0]))


def _neighbors(*pairs: tuple[Ints32, Ints32]) -> Indices:
    """(m, 2) pairs of nodes of which none is missing, the smaller first."""
    return np.sort(np.concatenate([_inside(*pair) for pair in pairs]), axis=1)


def _inside(*nodes: Ints32) -> Indices:
    """(m, k) nodes of which none is missing."""
    together = np.stack([one.ravel() for one in nodes], axis=1)
    return together[(together >= 0).all(axis=1)].astype(np.intp)
