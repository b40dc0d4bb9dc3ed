"""Normal equations of a straight color, and their solution under a quadratic prior.

In this file o (n, 3) is the straight color, P (pixels, 3) the premultiplied light, A the operator and
W the inverse variance of P in each channel. With the prior exp(−λ oᵀ Q o / 2) the posterior of channel
c is normal, with mean and covariance

    ô = (N + λ Q)⁻¹ b,   (N + λ Q)⁻¹,   N = Aᵀ W_c A,   b = Aᵀ W_c P.

The nodes are ordered so that N is banded, and a Cholesky factor costs n b² operations. On a ball the
unknowns are the nodes and the coefficients of colored light, whose independent prior is part of N.

A symmetric matrix S of n rows and b bands below the diagonal is stored as (n, b + 1), band[i, k] =
S[i + k, i]; as (b + 1, n) in Fortran's order this is the lower form of LAPACK, which factors it: bands
are hundreds wide. `sweep.model.color_field_kernel` factors its narrow bands within compiled loops.
"""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import scipy

from blurmatte.checks import Array, Indices
from blurmatte.compiling import njit
from blurmatte.deblurring.operator import Blur, Poses, SeenMoments, Sparse, poses_of, seen_moments
from blurmatte.sweep.model.pixels import Pixels
from blurmatte.sweep.sweep import Sweep

FIELD_STD = 0.05  # of colored light: half of a factor's on gray paint, to which white light belongs


class Stencil(NamedTuple):
    """Nodes (m, k) of m differences, and their coefficients (k,)."""

    nodes: Indices
    coefficients: Array


class Nodes(ABC):
    """Where a straight color is known: its unknowns, their differences, and how a picture sees them."""

    @property
    @abstractmethod
    def size(self) -> int:
        """Number of nodes."""

    @property
    def unknowns(self) -> int:
        """Number of nodes, and of coefficients of light after them, if any."""
        return self.size

    @property
    @abstractmethod
    def stencils(self) -> tuple[Stencil, ...]:
        """Differences that a prior makes small: first those of neighbors, then of second order."""

    @abstractmethod
    def operator(self, poses: Poses, seen: SeenMoments) -> Sparse:
        """A (pixels, unknowns): straight color → premultiplied light."""

    def blur(
        self,
        sweep: Sweep,
        pixels: Pixels,
        poses: Poses | None = None,
        near: SeenMoments | None = None,
    ) -> Blur:
        """The operator of the pixels of a box, and alpha; by default of the whole exposure.

        near: when they see the object of a near motion at as many poses.
        """
        poses = poses_of(sweep) if poses is None else poses
        seen = seen_moments(sweep, pixels, poses, near)
        return Blur(self.operator(poses, seen), seen.alpha(poses.durations))


@dataclass(frozen=True, eq=False)
class NormalEquations:
    """N, b and the energy of the data.

    Parameters
    ----------
    band : (3, n, b + 1) or (1, n, b + 1) float
        N of each channel, stored as banded matrices; one if their weights are the same.
    right : (3, n) float
        b of each channel.
    energy : (3,) float
        Pᵀ W P.
    count : int
        Pixels of the data.
    """

    band: Array
    right: Array
    energy: Array
    count: int

    @classmethod
    def of(cls, A: Sparse, light: Array, weight: Array, lattice: Nodes) -> "NormalEquations":
        """The equations of one picture: light (pixels, 3), and weight, 0 where there is no light.

        A weight (pixels, 1) is that of all channels.
        """
        band = np.zeros((weight.shape[1], lattice.unknowns, bandwidth(A, lattice) + 1))
        band[:, lattice.size :, 0] = FIELD_STD**-2
        for own, total in zip(np.ascontiguousarray(weight.T), band, strict=True):
            add_normal(A.indptr, A.indices, A.data, own, total)
        right = np.asarray(A.T @ (weight * light)).T
        return cls(
            band, right, (weight * light**2).sum(axis=0), int((weight > 0).all(axis=1).sum())
        )

    @property
    def size(self) -> int:
        """Number of unknowns."""
        return int(self.band.shape[1])

    @property
    def width(self) -> int:
        """Bands of N, with the diagonal."""
        return int(self.band.shape[2])

    def widened(self, width: int) -> "NormalEquations":
        """The same equations, with bands for a prior that needs so many."""
        more = max(0, width - self.width)
        return replace(self, band=np.pad(self.band, ((0, 0), (0, 0), (0, more))))

    def misfit(self, normal: "Normal") -> float:
        """Pᵀ W P − bᵀ ô: the least sum of squared residuals and prior, before noise is scaled."""
        return float(self.energy.sum() - np.sum(self.right * normal.mean.T))


def bandwidth(A: Sparse, lattice: Nodes) -> int:
    """Bands below the diagonal of the normal equations of an operator and of the prior."""
    apart = np.ptp(lattice.stencils[0].nodes, axis=1).max()
    rows = np.flatnonzero(np.diff(A.indptr))  # that are not empty; their columns ascend
    widths = A.indices[A.indptr[rows + 1] - 1] - A.indices[A.indptr[rows]]
    return int(max(widths.max(initial=0), apart))


def summed(parts: Sequence[NormalEquations]) -> NormalEquations:
    """The equations of several pictures of one object."""
    width = max(part.width for part in parts)
    band = np.asarray(sum(part.widened(width).band for part in parts))
    right, energy = sum(p.right for p in parts), sum(p.energy for p in parts)
    return NormalEquations(band, np.asarray(right), np.asarray(energy), sum(p.count for p in parts))


@dataclass(frozen=True, eq=False)
class Normal:
    """A normal distribution of the straight color.

    Parameters
    ----------
    mean : (n, 3) float
    factors : (3, n, b + 1) or (1, n, b + 1) float
        Cholesky factors of the inverse covariance of each channel, as bands; one if they are the same.
    """

    mean: Array
    factors: Array

    @property
    def log_determinant(self) -> float:
        """Of the inverse covariances of the three channels."""
        return float(2 * 3 / len(self.factors) * np.log(self.factors[..., 0]).sum())

    def solve(self, right: Array) -> Array:
        """Covariance (n, n) of each channel times vectors (3, n, k)."""
        lower = [(self.factors[c % len(self.factors)].T, True) for c in range(3)]
        pairs = zip(lower, right, strict=True)
        return np.stack([scipy.linalg.cho_solve_banded(factor, r) for factor, r in pairs])

    def inverse(self) -> Array:
        """(n, n) covariance of the first channel, not banded."""
        n = len(self.factors[0])
        lower, _ = scipy.linalg.lapack.dpotri(block(self.factors[0], 0, n, 0, n), lower=1)
        return np.asarray(np.tril(lower) + np.tril(lower, -1).T)

    def variances(self) -> Array:
        """(n, 3) variances of the nodes."""
        return self.covariance_band()[..., 0].T

    def covariance_band(self) -> Array:
        """(3, n, b + 1) the covariances as bands; elements outside are not 0 but not computed."""
        bands = np.stack([inverse_band(factor) for factor in self.factors])
        return np.repeat(bands, 3 // len(self.factors), axis=0)


def inverse_band(factor: Array) -> Array:
    """(n, b + 1) band of S⁻¹ from that of its Cholesky factor L [Takahashi, Fagan & Chen 1973].

    In blocks of the band's width S is tridiagonal. With G = L[k + 1, k] L[k, k]⁻¹ the blocks of the
    inverse are, from the last one upwards,

        Z[k + 1, k] = −Z[k + 1, k + 1] G,   Z[k, k] = (L[k, k] L[k, k]ᵀ)⁻¹ − Gᵀ Z[k + 1, k].
    """
    n, width = factor.shape
    band, later = np.zeros_like(factor), np.zeros((0, 0))
    for begin in range((n - 1) // width * width, -1, -width):
        end, last = min(begin + width, n), min(begin + 2 * width, n)
        inverse, _ = scipy.linalg.lapack.dtrtri(block(factor, begin, end, begin, end), lower=1)
        G = block(factor, end, last, begin, end) @ inverse
        below = -later @ G
        later = inverse.T @ inverse - G.T @ below
        rows = np.concatenate([later, below, np.zeros((2 * width - (last - begin), end - begin))])
        column = np.arange(end - begin)[:, None]
        band[begin:end] = rows[column + np.arange(width), column]
    return band


def cholesky_of(band: Array) -> Array:
    """The Cholesky factor of a matrix, both bands (n, b + 1); the matrix may be overwritten."""
    return np.asarray(
        scipy.linalg.cholesky_banded(band.T, overwrite_ab=True, lower=True, check_finite=False).T
    )


def posterior(equations: NormalEquations, prior: Array) -> Normal:
    """The posterior under a prior λ Q, a band (n, b + 1)."""
    factors = np.stack([cholesky_of(band + prior) for band in equations.band])
    found = Normal(np.empty(0), factors)
    return replace(found, mean=found.solve(equations.right[..., None])[..., 0].T)


@njit(fastmath=True)
def add_normal(first, columns, values, weights, band):  # type: ignore[no-untyped-def]
    """Add Aᵀ W A to a band (n, b + 1), for weights (pixels,)."""
    row = np.zeros(band.shape[1])
    for p in range(len(first) - 1):
        begin, end = first[p], first[p + 1]
        if begin == end or weights[p] == 0:
            continue
        left, last = columns[begin], columns[end - 1]
        for r in range(begin, end):
            row[columns[r] - left] = values[r]
        for q in range(begin, end):
            i, scaled = columns[q], weights[p] * values[q]
            sums, later = band[i], row[i - left :]
            for k in range(last - i + 1):  # zeros, too: a loop without gaps is vectorized
                sums[k] += scaled * later[k]
        row[: last - left + 1] = 0


@njit()
def block(band, top, bottom, left, right):  # type: ignore[no-untyped-def]
    """Rows and columns of the lower triangular matrix of a band."""
    found = np.zeros((bottom - top, right - left))
    for i in range(left, right):
        for j in range(max(top, i), min(bottom, i + band.shape[1])):
            found[j - top, i - left] = band[i, j - i]
    return found
