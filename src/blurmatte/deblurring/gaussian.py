"""The straight color under a Gaussian prior of its gradients, with its strength by evidence.

With the prior exp(−λ oᵀ Q o / 2), oᵀ Q o = Σ (oᵢ − oⱼ)² over neighbors, and noise of s times the
expected variance, let μ = λ s. The mean ô depends on μ alone, and so does the least weighted misfit

    m(μ) = Pᵀ W P − bᵀ ô.

The evidence, the probability of the data for any color, is largest for s = m / (3 (count − 1)):

    log Z(μ) = −(3/2) (count − 1) log m + (3/2) (n − 1) log μ − (1/2) Σ_c log |N + μ Q| + constant.

A constant color is not penalized, hence count − 1 and n − 1. s is a reduced χ²: about 1 if the model is
right; the posterior covariance s (N + μ Q)⁻¹ grows with it.
"""

from dataclasses import dataclass

import numpy as np
import scipy

from blurmatte.checks import Array
from blurmatte.deblurring.lattice import Lattice
from blurmatte.deblurring.normal_equations import Normal, NormalEquations, gradient_prior, posterior
from blurmatte.deblurring.sphere import Sphere

_MAX_CONTRAST = 10.0  # root mean square difference of neighbors, linear light
_MIN_CONTRAST = 1e-4
_TOLERANCE = 0.3  # of log μ
_STEP = 0.5  # of log μ, for derivatives of the evidence


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


def fit_gaussian(equations: NormalEquations, lattice: Lattice | Sphere) -> GaussianFit:
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
