"""The straight color under a prior of its total variation.

Paint has edges, which a Gaussian prior smooths. The prior exp(−ν TV(o)), with

    TV(o) = Σ |g|,   |g|² = Σ_c (oᵢ − oⱼ)_c² + ε²   over neighbors i, j,

has its edges in all channels at once. ε makes it quadratic for smaller differences. From a color with
differences g₀ it is bounded by a quadratic prior, |g| ≤ (|g|² / |g₀| + |g₀|) / 2, whose maximum is the
next color (iteratively reweighted least squares).

The evidence of the quadratic prior of weights 1 / |g₀| determines μ = ν s, see `gaussian`. It is a
lower bound of the strength: it counts the differences that the data leave open as free. At three to
four times this strength the residuals exceed the noise, χ² = count. The color is that of twice this
strength, between the two; the covariance is that of the evidence.
"""

import numpy as np
import numpy.typing as npt

from blurmatte.deblurring.gaussian import GaussianFit, fit_strength
from blurmatte.deblurring.lattice import Lattice
from blurmatte.deblurring.normal_equations import Normal, NormalEquations, gradient_prior

Array = npt.NDArray[np.float64]

_SMALLEST_EDGE = 0.01  # ε, linear light
_OVER_EVIDENCE = 2.0  # strength over that of the largest evidence
_ITERATIONS = 7
_SEARCHES = 3  # of them that also search for the strength
_STEP = 0.5  # of log μ, for derivatives of the evidence


def fit_total_variation(
    equations: NormalEquations, lattice: Lattice, start: GaussianFit
) -> GaussianFit:
    """The most probable color, with the covariance of the last quadratic prior of largest evidence."""
    fit, strength, (i, j) = start, start.strength, lattice.edges.T
    scale = start.noise_scale
    for iteration in range(_ITERATIONS):
        size = np.sqrt(((fit.normal.mean[i] - fit.normal.mean[j]) ** 2).sum(1) + _SMALLEST_EDGE**2)
        Q = gradient_prior(lattice, 1 / size, equations.band.shape[2])
        if iteration == 0:
            strength *= float(size.mean())  # as strong at an edge of the mean size
        if iteration < _SEARCHES:
            likeliest = _likeliest(equations, Q, strength)
            strength, scale = likeliest.strength, likeliest.noise_scale
        fit = fit_strength(equations, Q, _OVER_EVIDENCE * strength)
    covariance = fit_strength(equations, Q, strength)
    normal = Normal(fit.normal.mean, covariance.normal.factors)
    return GaussianFit(normal, fit.strength, scale, fit.log_evidence)


def _likeliest(equations: NormalEquations, Q: Array, strength: float) -> GaussianFit:
    """At the maximum of a parabola through three values of the evidence, over log μ."""
    factors = np.exp(np.array([-_STEP, 0.0, _STEP]))
    low, at, high = (fit_strength(equations, Q, strength * f).log_evidence for f in factors)
    curvature = low - 2 * at + high
    shift = _STEP * (low - high) / (2 * curvature) if curvature < 0 else np.sign(high - low)
    shift = float(np.clip(shift, -2 * _STEP, 2 * _STEP))
    return fit_strength(equations, Q, strength * float(np.exp(shift)))
