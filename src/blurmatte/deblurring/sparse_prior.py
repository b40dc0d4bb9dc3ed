"""The straight color under priors of its first and second differences.

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

import numpy as np

from blurmatte.checks import Array
from blurmatte.deblurring.differences import Differences
from blurmatte.deblurring.gaussian import GaussianFit, fit_strength, refit_strength
from blurmatte.deblurring.normal_equations import NormalEquations, cholesky_of, inverse_band

_EXPONENT = 0.5  # p
_SMALLEST_EDGE = 0.01  # ε, linear light
_ITERATIONS = 5
_RATIOS = 0.25 * 4.0 ** np.arange(6)  # τ
_DECREASE = 0.4  # of λ, for a first guess, if τ increases by a factor 4


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
