"""The straight color under priors of its differences: Gaussian, smooth and sparse.

In this file d are the differences of a color o (n, 3) with their coefficients in a row of D. First
differences are those of neighbors. Second differences, on a flat lattice, are

    oᵢ₋₁ − 2 oᵢ + oᵢ₊₁ along rows and columns,   √2 (o₀₀ − o₀₁ − o₁₀ + o₁₁) of four nodes of a square,

whose squares sum to that of the Laplacian. A quadratic prior has the band of Q = Dᵀ diag(w) D.

With the prior exp(−λ oᵀ Q o / 2), oᵀ Q o = Σ (oᵢ − oⱼ)² over neighbors, and noise of s times the
expected variance, let μ = λ s. The mean ô depends on μ alone, and so does the least weighted misfit

    m(μ) = Pᵀ W P − bᵀ ô.

The evidence, the probability of the data for any color, is largest for s = m / (3 (count − 1)):

    log Z(μ) = −(3/2) (count − 1) log m + (3/2) (n − 1) log μ − (1/2) Σ_c log |N + μ Q| + constant.

A constant color is not penalized, hence count − 1 and n − 1. s is a reduced χ²: about 1 if the model is
right; the posterior covariance s (N + μ Q)⁻¹ grows with it.

A picture shows means over pixels: fine details of the color are weaker than a prior of first
differences says, which takes noise for details and overstates the error. The Gaussian prior is

    exp(−λ Σ |d|² / 2 − τ λ Σ |d'|² / 2),

with the differences d of first and d' of second order. λ and τ maximize the evidence; of τ a grid.

Paint has edges, which a Gaussian prior smooths. The prior exp(−ν U), U = Σ |d|^p + κ Σ |d'|^p, with
p = 1/2 has edges in all channels at once; of natural images p is 0.5 to 0.8 [Krishnan & Fergus 2009].
About E|d|² = |E d|² + Var d + ε² of a Gaussian posterior it is bounded by a quadratic prior with the
weights p ν (E|d|²)^(p/2 − 1), whose posterior is the next one: a variational approximation with mean
and covariance. U scales as o^p, so that the density of the prior is proportional to ν^(3 (n − 1) / p),
whose mean logarithm is largest for ν = 3 (n − 1) / (p U). κ gives both orders the ratio τ of mean
weights.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import scipy

from blurmatte.checks import Array
from blurmatte.deblurring.normal_equations import (
    Nodes,
    Normal,
    NormalEquations,
    Stencil,
    cholesky_of,
    inverse_band,
    posterior,
)

_MAX_CONTRAST = 10.0  # root mean square difference of neighbors, linear light
_MIN_CONTRAST = 1e-4  # the same
_TOLERANCE = 0.3  # of log μ
_STEP = 0.5  # of log μ, for derivatives of the evidence
_EXPONENT = 0.5  # p
_SMALLEST_EDGE = 0.01  # ε, linear light
_ITERATIONS = 5  # of the quadratic bound of the prior of edges
_RATIOS = 0.25 * 4.0 ** np.arange(6)  # τ
_DECREASE = 0.4  # of λ, for a first guess, if τ increases by a factor 4


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
    def of(cls, lattice: Nodes) -> "Differences":
        """Those of a lattice or a sphere."""
        return cls(lattice.unknowns, lattice.stencils)

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

    def quadratic(self, weights: Array) -> Any:
        """Q (n, n) for weights (m,), a sparse matrix."""
        return (self.matrix.T @ self.matrix.multiply(weights[:, None])).tocsr()

    def band(self, weights: Array, width: int) -> Array:
        """The band (n, width) of Q for weights (m,)."""
        Q, band = scipy.sparse.tril(self.quadratic(weights)), np.zeros((self.size, width))
        band[Q.col, Q.row - Q.col] = Q.data
        return band

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


@dataclass(frozen=True, eq=False)
class GaussianFit:
    """The straight color, and the evidence.

    Parameters
    ----------
    normal : Normal
        Posterior for the expected variance of noise.
    strength : float
        μ, the precision of differences of neighbors, times the variance scale of the noise.
    noise_scale : float
        s, the variance of the residuals over that expected: the reduced χ².
    log_evidence : float
        log Z, up to a constant of the lattice.
    """

    normal: Normal
    strength: float
    noise_scale: float
    log_evidence: float


def gradient_prior(lattice: Nodes, width: int) -> Array:
    """The band (n, width) of Q: oᵀ Q o = Σ (oᵢ − oⱼ)² over neighbors."""
    return Differences(lattice.unknowns, lattice.stencils[:1]).bands(width)[0]


def fit_gaussian(equations: NormalEquations, lattice: Nodes) -> GaussianFit:
    """The posterior for the likeliest strength."""
    Q = gradient_prior(lattice, equations.width)
    bounds = -2 * np.log(_MAX_CONTRAST), -2 * np.log(_MIN_CONTRAST)
    best = scipy.optimize.minimize_scalar(
        lambda x: -fit_strength(equations, Q, np.exp(x)).log_evidence,
        bounds=bounds,
        method="bounded",
        options={"xatol": _TOLERANCE},
    )
    return fit_strength(equations, Q, float(np.exp(best.x)))


def fit_strength(equations: NormalEquations, Q: Array, strength: float) -> GaussianFit:
    """The posterior for a strength μ of the prior with the band Q (n, b + 1)."""
    normal = posterior(equations, strength * Q)
    misfit = equations.misfit(normal)
    freedom, nodes = 3 * (equations.count - 1), 3 * (np.count_nonzero(Q[:, 0]) - 1)
    likelihood = nodes * np.log(strength) - freedom * np.log(misfit) - normal.log_determinant
    return GaussianFit(normal, strength, misfit / freedom, float(likelihood / 2))


def refit_strength(equations: NormalEquations, Q: Array, strength: float) -> GaussianFit:
    """The posterior of a strength near this: the maximum of a parabola through three evidences."""
    factors = np.exp(np.array([-_STEP, 0.0, _STEP]))
    low, at, high = (fit_strength(equations, Q, strength * f).log_evidence for f in factors)
    curvature = low - 2 * at + high
    shift = _STEP * (low - high) / (2 * curvature) if curvature < 0 else np.sign(high - low)
    shift = float(np.clip(shift, -2 * _STEP, 2 * _STEP))
    return fit_strength(equations, Q, strength * float(np.exp(shift)))


def fit_smooth(
    equations: NormalEquations, differences: Differences, start: GaussianFit
) -> tuple[GaussianFit, Array]:
    """The posterior under the likeliest Gaussian prior, and its strengths λ, τ λ.

    It starts from a fit under first differences alone, whose evidence is for the same noise.
    """
    bands = differences.bands(equations.width)
    best, ratio, strength = start, 0.0, start.strength
    evidence = start.log_evidence + 1.5 * log_determinant(bands[0], differences)
    for tau in _RATIOS if len(bands) > 1 else ():
        Q = bands[0] + tau * bands[1]
        fit = refit_strength(equations, Q, strength * (1.0 if tau == _RATIOS[0] else _DECREASE))
        own = fit.log_evidence + 1.5 * log_determinant(Q, differences)
        if own < evidence and ratio > 0:
            break
        strength = fit.strength
        if own > evidence:
            best, ratio, evidence = fit, float(tau), own
    strengths = best.strength / best.noise_scale * np.array([1.0, ratio])
    return best, strengths[: len(bands)]


def fit_sparse(
    equations: Sequence[NormalEquations],
    differences: Differences,
    smooth: GaussianFit,
    strengths: Array,
) -> GaussianFit:
    """The posterior under the prior of edges, from that under the Gaussian prior.

    The first equations may have one weight of all channels; those of the posterior are the last.
    """
    fit, bound = smooth, None
    for data in [equations[0]] * (_ITERATIONS - 1) + [equations[-1]]:
        band = fit.noise_scale * fit.normal.covariance_band().sum(axis=0)
        square = differences.squares(fit.normal.mean) + differences.variances(band)
        bound = bound or Bound.of(differences, square, strengths)
        Q = differences.band(bound.weights(square), data.width)
        fit = fit_strength(data, Q, smooth.noise_scale)
    return fit


class Bound:
    """Quadratic bounds of the prior of edges, at mean squares E|d|² (m,) of the differences.

    Parameters
    ----------
    differences : Differences
    factors : (m,) float
        1 of first differences, κ of second ones.
    """

    def __init__(self, differences: Differences, factors: Array) -> None:
        self.differences, self.factors = differences, factors

    @classmethod
    def of(cls, differences: Differences, square: Array, strengths: Array) -> "Bound":
        """The bound with the ratio of a Gaussian prior's strengths at its posterior."""
        mean = [
            np.mean((square[order] + _SMALLEST_EDGE**2) ** (_EXPONENT / 2 - 1))
            for order in differences.orders
        ]
        kappa = strengths / strengths[0] * mean[0] / np.array(mean)
        return cls(differences, differences.weights(kappa))

    def weights(self, square: Array) -> Array:
        """(m,) weights of the quadratic prior."""
        square = square + _SMALLEST_EDGE**2
        energy = np.sum(self.factors * square ** (_EXPONENT / 2))
        precision = 3 * self.differences.rank / (_EXPONENT * energy)
        return np.asarray(
            _EXPONENT * precision * self.factors * square ** (_EXPONENT / 2 - 1), float
        )


def traces(differences: Differences, strengths: Array) -> Array:
    """tr(P⁺ Qₖ) of both orders, of the prior P = Σ λₖ Qₖ; a constant color is not penalized."""
    bands = differences.bands(differences.width)
    P = np.tensordot(strengths, bands, 1)
    nodes = slice(1, differences.rank + 1)
    inverse = inverse_band(cholesky_of(P[nodes]))
    twice = np.r_[1.0, np.full(P.shape[1] - 1, 2.0)]
    return np.array([np.sum(twice * inverse * band[nodes]) for band in bands])


def log_determinant(Q: Array, differences: Differences) -> float:
    """Of a prior's band without its first node: up to a constant the product of its eigenvalues."""
    nodes = slice(1, differences.rank + 1)
    return float(2 * np.log(cholesky_of(Q[nodes].copy())[:, 0]).sum())
