"""Lattice: the nodes of an object's own straight color.

The object is described in its own coordinates: pixels from its center, in its pose in the middle of the
exposure. Its straight color o is known by its values at nodes of a square lattice, only where the
silhouette is: a disc of radius r has n ≈ π r² nodes. On this compact support a blur can be inverted at
frequencies that a blur of the whole plane removes.

The nodes are numbered across the path. A pixel of the blurred picture mixes nodes along the path, so
that normal equations are banded: n r instead of n² numbers.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt
import scipy

from blurmatte.checks import Array, Ints32
from blurmatte.sweep.model.pixels import Pixels
from blurmatte.sweep.sweep import Sweep


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
    def edges(self) -> npt.NDArray[np.intp]:
        """(m, 2) indices of neighbors in rows and columns, the smaller first."""
        pairs = [
            np.stack([a.ravel(), b.ravel()], axis=1)
            for a, b in ((self.node[:, :-1], self.node[:, 1:]), (self.node[:-1], self.node[1:]))
        ]
        both = np.concatenate(pairs)
        return np.sort(both[(both >= 0).all(axis=1)], axis=1).astype(np.intp)
