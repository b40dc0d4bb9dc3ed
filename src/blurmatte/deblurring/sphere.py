"""Sphere: the nodes of the color of a ball's whole surface, an equiangular cubed sphere.

A point of the unit sphere is projected from the center on the faces of a cube. On a face, whose axis
is m, the angles atan(dₖ / |dₘ|) of the other two coordinates are divided into equal parts; neighboring
faces share the nodes of their edge, so that a bilinear interpolation is continuous on the whole sphere.
The distance of neighbors varies by 30 %. The sum of squared differences of neighbors does not depend on
it, as the Dirichlet energy of a surface does not depend on scale.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from blurmatte.checks import Array, Ints32

_FINEST_PITCH_PX = 1.5  # a pixel of the picture covers more of a surface that is inclined
MAX_NODES = 1500  # of a Cholesky factor that is not banded
HARMONICS = 8  # of the light on a ball: those of orders 1 and 2
FIELD_STD = 0.05  # of colored light: half of a factor's on gray paint, to which white light belongs


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
    def edges(self) -> npt.NDArray[np.intp]:
        """(m, 2) indices of neighbors, the smaller first."""
        pairs = [
            np.stack([a.ravel(), b.ravel()], axis=1)
            for a, b in (
                (self.node[:, :-1], self.node[:, 1:]),
                (self.node[..., :-1], self.node[..., 1:]),
            )
        ]
        both = np.sort(np.concatenate(pairs), axis=1)
        return np.unique(both, axis=0).astype(np.intp)
