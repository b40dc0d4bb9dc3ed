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
it, as the Dirichlet energy of a surface does not depend on scale. Poses turn the ball as well, and its
light on the silhouette is a factor of the operator, see `spin`. Further columns are the harmonics of
colored light, which does not turn.
"""

from abc import abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy

from blurmatte.checks import Array, Indices, Ints32
from blurmatte.deblurring import sphere_kernel
from blurmatte.deblurring.normal_equations import Nodes, Stencil
from blurmatte.deblurring.operator import (
    Entries,
    Poses,
    SeenMoments,
    Sparse,
    row_sums,
    seen_moments,
    sparse,
)
from blurmatte.deblurring.priors import GaussianFit
from blurmatte.deblurring.spin import HARMONICS, harmonics
from blurmatte.deblurring.view import View
from blurmatte.sweep.model.pixels import Pixels
from blurmatte.sweep.sweep import Sweep

_FINEST_PITCH_PX = 1.5  # a pixel of the picture covers more of a surface that is inclined
_MAX_NODES = 1500  # of a Cholesky factor that is not banded
COARSE_STEP_PX = 1.0  # on a sphere: motion between two moments, for derivatives and searches
_LEAST_CURVATURE = 0.1  # along a secant, of that of the information

Secant = tuple[Array, Array]  # a step, and the decrease of the gradient over it


class Surface(Nodes):
    """Nodes of an object's own color, from whose light its motion is refined."""

    @abstractmethod
    def derivatives(
        self, view: View, fit: GaussianFit, A: Sparse, weight: Array
    ) -> tuple[Array, Array]:
        """J (pixels, 3, k) of the light of a view by its parameters, and changes of the volume.

        The latter are (pixels, k), or (1, k) if they are omitted; see `refine`.
        """

    def with_curvature(self, information: Array, secants: Sequence[Secant]) -> Array:
        """Information (k, k) about parameters, with the curvature measured between iterates, if any."""
        return information


@dataclass(frozen=True, eq=False)
class Lattice(Surface):
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

    @cached_property
    def stencils(self) -> tuple[Stencil, ...]:
        """Differences of first and of second order, in rows and columns."""
        node = self.node
        neighbors = _neighbors((node[:, :-1], node[:, 1:]), (node[:-1], node[1:]))
        rows = node[:, :-2], node[:, 1:-1], node[:, 2:]
        columns = node[:-2], node[1:-1], node[2:]
        square = node[:-1, :-1], node[:-1, 1:], node[1:, :-1], node[1:, 1:]
        line = np.concatenate([_inside(*rows), _inside(*columns)])
        mixed = Stencil(_inside(*square), np.sqrt(2) * np.array([1.0, -1.0, -1.0, 1.0]))
        return _first(neighbors), Stencil(line, np.array([1.0, -2.0, 1.0])), mixed

    def operator(self, poses: Poses, seen: SeenMoments) -> Sparse:
        """A (pixels, nodes)."""
        from blurmatte.deblurring import operator_kernel  # loads scipy.special

        to_lattice = seen.to_disc * (self.radius / self.pitch)
        grid = self.corner, self.node, seen.width
        rows = operator_kernel.rows_of(poses.durations, seen.xy, to_lattice, *grid, seen.covered)
        return sparse(rows, self.size)

    def derivatives(
        self, view: View, fit: GaussianFit, A: Sparse, weight: Array
    ) -> tuple[Array, Array]:
        """J by differences over a small step of each parameter; small changes of the volume are 0."""
        color, count = fit.normal.mean, view.moment_count()
        near = seen_moments(view.sweep, view.pixels, view.poses(count))

        def model(moved: View) -> Array:
            """Light (pixels, 3) of the picture."""
            A, alpha = self.blur(moved.sweep, view.pixels, moved.poses(count), near)
            return np.asarray(A @ color + view.through(alpha))

        return _by_parameters(model, view, view.steps), np.zeros((1, len(view.parameters)))


@dataclass(frozen=True, eq=False)
class Sphere(Surface):
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
    def finest(cls, radius: float) -> "Sphere":
        """The sphere of finest pitch with at most 1500 nodes, but of 1.5 pixels or more."""
        cells = int(np.sqrt((_MAX_NODES - 2) / 6))
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
    def stencils(self) -> tuple[Stencil, ...]:
        """Differences of first order alone: the cells are not square."""
        node = self.node
        both = _neighbors((node[:, :-1], node[:, 1:]), (node[..., :-1], node[..., 1:]))
        return (_first(np.unique(both, axis=0)),)  # faces share edges

    def operator(self, poses: Poses, seen: SeenMoments) -> Sparse:
        """A (pixels, unknowns): nodes turn with the ball, columns of colored light do not."""
        (first, moment, weight, normal), light, field = _lit(poses, seen)
        entries = first, moment, weight * light, normal
        turns = poses.spin.turns(poses.t)
        A = sparse(sphere_kernel.rows_of(entries, turns, self.node, self.size), self.size)
        colored = scipy.sparse.csr_matrix(row_sums(first, weight, field))
        return scipy.sparse.hstack([A, colored], format="csr")

    def derivatives(
        self, view: View, fit: GaussianFit, A: Sparse, weight: Array
    ) -> tuple[Array, Array]:
        """J, and (pixels, k) changes of the volume.

        Light is linear in the shading: its steps may be large.
        """
        color, spread = fit.normal.mean, weight * (A @ fit.normal.inverse())
        count = view.moment_count(COARSE_STEP_PX)
        steps = np.append(view.steps[:-HARMONICS], np.ones(HARMONICS))

        def model(moved: View) -> Array:
            """Light (pixels, 3) of the picture, and (A spreadᵀ)ₚₚ."""
            A, alpha = self.blur(moved.sweep, view.pixels, moved.poses(count))
            return np.column_stack(
                [A @ color + view.through(alpha), A.multiply(spread).sum(axis=1)]
            )

        found = _by_parameters(model, view, steps)
        return found[:, :3], 3 * found[:, 3]

    def with_curvature(self, information: Array, secants: Sequence[Secant]) -> Array:
        """The information with the curvature of the objective measured between iterates.

        J contains the noise of the color, which the expected curvature does not. It is replaced in the
        directions of the secants by damped BFGS updates [Nocedal & Wright 2006, 18.3].
        """
        M = information
        for step, change in secants:
            Ms = M @ step
            expected, measured = step @ Ms, step @ change
            if measured < _LEAST_CURVATURE * expected:
                part = (1 - _LEAST_CURVATURE) * expected / (expected - measured)
                change = part * change + (1 - part) * Ms
            M = M - np.outer(Ms, Ms) / expected + np.outer(change, change) / (step @ change)
        return np.asarray(M)


def _by_parameters(model: Callable[[View], Array], view: View, steps: Array) -> Array:
    """(pixels, m, k) derivatives of a model (pixels, m), by differences over steps; 0 for no step."""
    at, start = view.parameters, model(view)
    found = np.zeros((*start.shape, len(at)))
    for k in np.flatnonzero(steps > 0):
        moved = view.moved(at + steps[k] * (np.arange(len(at)) == k))
        found[..., k] = (model(moved) - start) / steps[k]
    return found


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


def _lit(poses: Poses, seen: SeenMoments) -> tuple[Entries, Array, Array]:
    """Entries of the kernels; the light (m,) of the spin and the harmonics (m, k) at each."""
    first, moment, part = seen.covered
    normal = seen.normals
    middle = normal.mean(axis=1)
    entries = first, moment, poses.durations[moment] * part, normal
    return entries, poses.spin.light(middle), harmonics(middle)
