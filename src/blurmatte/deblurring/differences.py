"""Differences of a straight color between nodes, of first and second order, for its priors.

In this file d are the differences of a color o (n, 3) with their coefficients in a row of D. First
differences are those of neighbors. Second differences, on a flat lattice, are

    oᵢ₋₁ − 2 oᵢ + oᵢ₊₁ along rows and columns,   √2 (o₀₀ − o₀₁ − o₁₀ + o₁₁) of four nodes of a square,

whose squares sum to that of the Laplacian. A quadratic prior has the band of Q = Dᵀ diag(w) D.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
import scipy

from blurmatte.checks import Array, Ints32
from blurmatte.deblurring.lattice import Lattice
from blurmatte.deblurring.sphere import Sphere


class Stencil(NamedTuple):
    """Nodes (m, k) of m differences, and their coefficients (k,)."""

    nodes: npt.NDArray[np.intp]
    coefficients: Array


@dataclass(frozen=True, eq=False)
class Differences:
    """The m differences of n nodes, those of first order first.

    Parameters
    ----------
    size : int
        Number of unknowns: nodes, and of a ball the coefficients of colored light.
    stencils : tuple of Stencil
        The first has the first order, others the second.
    """

    size: int
    stencils: tuple[Stencil, ...]

    @classmethod
    def of(cls, lattice: Lattice | Sphere) -> "Differences":
        """Those of a lattice; of first order only on a sphere, whose cells are not square."""
        first = Stencil(lattice.edges, np.array([1.0, -1.0]))
        if isinstance(lattice, Sphere):
            return cls(lattice.unknowns, (first,))
        node = lattice.node
        rows = node[:, :-2], node[:, 1:-1], node[:, 2:]
        columns = node[:-2], node[1:-1], node[2:]
        square = node[:-1, :-1], node[:-1, 1:], node[1:, :-1], node[1:, 1:]
        line = np.concatenate([_inside(*rows), _inside(*columns)])
        mixed = Stencil(_inside(*square), np.sqrt(2) * np.array([1.0, -1.0, -1.0, 1.0]))
        return cls(lattice.unknowns, (first, Stencil(line, np.array([1.0, -2.0, 1.0])), mixed))

    @property
    def orders(self) -> list[slice]:
        """The differences of each order."""
        first, total = len(self.stencils[0].nodes), sum(len(one.nodes) for one in self.stencils)
        return [slice(0, first), slice(first, total)][: min(len(self.stencils), 2)]

    @property
    def rank(self) -> int:
        """Of Q: all nodes but one, for a constant color is not penalized."""
        return int(self.stencils[0].nodes.max())

    @cached_property
    def width(self) -> int:
        """Bands of Q, with the diagonal."""
        return 1 + max(int(np.ptp(one.nodes, axis=1).max()) for one in self.stencils)

    @cached_property
    def matrix(self) -> Any:
        """D (m, n), a sparse matrix."""
        parts = []
        for nodes, coefficients in self.stencils:
            m, k = nodes.shape
            places = np.repeat(np.arange(m), k), nodes.ravel()
            parts.append(
                scipy.sparse.csr_matrix((np.tile(coefficients, m), places), shape=(m, self.size))
            )
        return scipy.sparse.vstack(parts, format="csr")

    def weights(self, strengths: Array) -> Array:
        """(m,) a strength for each order."""
        lengths = [one.stop - one.start for one in self.orders]
        return np.repeat(strengths, lengths)

    def sums(self, values: Array) -> Array:
        """Sums of values (m, ...) over each order and all other axes."""
        return np.array([values[order].sum() for order in self.orders])

    def band(self, weights: Array, width: int) -> Array:
        """The band (n, width) of Q for weights (m,)."""
        total, at = np.zeros(self.size * width), 0
        for nodes, coefficients in self.stencils:
            own = weights[at : at + len(nodes)]
            at += len(nodes)
            for a, i in zip(coefficients, nodes.T, strict=True):
                for b, j in zip(coefficients, nodes.T, strict=True):
                    lower = j >= i
                    place = (i * width + j - i)[lower]
                    total += np.bincount(place, a * b * own[lower], len(total))
        return total.reshape(self.size, width)

    def bands(self, width: int) -> list[Array]:
        """The band of the Q of each order."""
        return [self.band(self.weights(k), width) for k in np.eye(len(self.orders))]

    def squares(self, color: Array) -> Array:
        """(m,) squares of the differences of a color, summed over channels."""
        return np.asarray(((self.matrix @ color) ** 2).sum(axis=1))

    def variances(self, band: Array) -> Array:
        """(m,) variances of the differences from a covariance of the nodes, a band (n, width)."""
        parts = []
        for nodes, coefficients in self.stencils:
            variance = np.zeros(len(nodes))
            for a, i in zip(coefficients, nodes.T, strict=True):
                for b, j in zip(coefficients, nodes.T, strict=True):
                    variance += a * b * band[np.minimum(i, j), np.abs(j - i)]
            parts.append(variance)
        return np.concatenate(parts)


def _inside(*nodes: Ints32) -> npt.NDArray[np.intp]:
    """(m, k) nodes of which none is missing."""
    together = np.stack([one.ravel() for one in nodes], axis=1)
    return together[(together >= 0).all(axis=1)].astype(np.intp)
