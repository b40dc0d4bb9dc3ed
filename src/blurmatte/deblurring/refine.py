"""Blind refinement: the path and shape that make the observed light likeliest, for any color.

In this file θ are the parameters of path and shape, with the sweep's covariance Σ around its estimate
θ₀ as prior, and o is the straight color. The light changes with θ as

    J = ∂/∂θ (A(θ) o − α(θ) B).

The color is marginalized: with the weights W, B = Aᵀ W J and S = (N + μ Q)⁻¹ the information about θ is
(Jᵀ W J − Bᵀ S B) / s + Σ⁻¹, and the gradient of log Z that follows from it is Jᵀ W r / s with the
residuals r. Steps of Gauss and Newton are accepted if they increase the objective
log Z(θ) − (θ − θ₀)ᵀ Σ⁻¹ (θ − θ₀) / 2. s is the variance scale of the residuals, so that an error of the
model does not count as evidence.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from blurmatte.deblurring.gaussian import (
    GaussianFit,
    fit_gaussian,
    fit_strength,
    refit_strength,
)
from blurmatte.deblurring.lattice import Lattice
from blurmatte.deblurring.normal_equations import NormalEquations, gradient_prior, summed
from blurmatte.deblurring.operator import Sparse, blurred, poses_of
from blurmatte.deblurring.view import View
from blurmatte.sweep.sweep import Sweep

Array = npt.NDArray[np.float64]

_LEAST_GAIN = 0.5  # of the log evidence by a step
_MAX_STEPS = 8
_DERIVATIVE_STEP_PX = 1.0  # motion between two moments: derivatives only direct the steps


@dataclass(frozen=True, eq=False)
class Explained:
    """Views of one object, and its straight color under a Gaussian prior.

    Parameters
    ----------
    views : tuple of View
    operators : tuple of sparse matrices
        Of each view.
    weights : tuple of (pixels, 3) float
    equations : NormalEquations
    fit : GaussianFit
    """

    views: tuple[View, ...]
    operators: tuple[Sparse, ...]
    weights: tuple[Array, ...]
    equations: NormalEquations
    fit: GaussianFit


def explained(views: Sequence[View], lattice: Lattice) -> Explained:
    """The color that explains views, with the likeliest strength of its prior."""
    operators = [view.blur(lattice) for view in views]
    alphas = (np.asarray(A.sum(axis=1)).ravel() for A in operators)
    weights = [view.weight(alpha) for view, alpha in zip(views, alphas, strict=True)]
    equations = _equations(views, operators, weights, lattice)
    fit = fit_gaussian(equations, lattice)
    return Explained(tuple(views), tuple(operators), tuple(weights), equations, fit)


def _moved(views: Sequence[View], first: Explained, lattice: Lattice) -> Explained:
    """Views with another motion, under the weights and the prior of the first state."""
    operators = [view.blur(lattice) for view in views]
    equations = _equations(views, operators, first.weights, lattice)
    Q = gradient_prior(lattice, np.ones(len(lattice.edges)), equations.band.shape[2])
    fit = fit_strength(equations, Q, first.fit.strength)
    return Explained(tuple(views), tuple(operators), first.weights, equations, fit)


def _equations(
    views: Sequence[View],
    operators: Sequence[Sparse],
    weights: Sequence[Array],
    lattice: Lattice,
) -> NormalEquations:
    parts = zip(views, operators, weights, strict=True)
    return summed([view.equations(A, lattice, weight) for view, A, weight in parts])


def refined(views: Sequence[View], lattice: Lattice) -> Explained:
    """The views with the likeliest paths and shapes, and their covariance."""
    first = state = explained(views, lattice)
    prior = [
        np.asarray(np.linalg.pinv(view.sweep.covariance, hermitian=True), float) for view in views
    ]
    for _ in range(_MAX_STEPS):
        information, gradient = _information(state, first, lattice, prior)
        step = np.asarray(np.linalg.solve(information, gradient), float)
        better = _along(state, step, first, lattice, prior)
        if better is None:
            break
        gain = _objective(better, first, prior) - _objective(state, first, prior)
        state = better
        if gain < _LEAST_GAIN:
            break
    if state is first:
        return first
    covariance = np.asarray(np.linalg.inv(information), float)  # before the last, small, step
    views = _with_covariance(state.views, covariance)
    Q = gradient_prior(lattice, np.ones(len(lattice.edges)), state.equations.band.shape[2])
    fit = refit_strength(state.equations, Q, state.fit.strength)
    return replace(state, views=tuple(views), fit=fit)


def _along(
    state: Explained, step: Array, first: Explained, lattice: Lattice, prior: Sequence[Array]
) -> Explained | None:
    """The state after a step, a half or a quarter of it; None if none is better."""
    before = _objective(state, first, prior)
    for part in (1.0, 0.5, 0.25):
        ends = np.cumsum([len(parameters(view.sweep)) for view in state.views])[:-1]
        moved = [
            view.with_sweep(with_parameters(view.sweep, parameters(view.sweep) + part * own))
            for view, own in zip(state.views, np.split(step, ends), strict=True)
        ]
        after = _moved(moved, first, lattice)
        if _objective(after, first, prior) > before:
            return after
    return None


def _objective(state: Explained, first: Explained, prior: Sequence[Array]) -> float:
    """The objective log Z(θ) − (θ − θ₀)ᵀ Σ⁻¹ (θ − θ₀) / 2."""
    total = state.fit.log_evidence
    for view, known, precision in zip(state.views, first.views, prior, strict=True):
        away = parameters(view.sweep) - parameters(known.sweep)
        total -= float(away @ precision @ away) / 2
    return total


def _information(
    state: Explained, first: Explained, lattice: Lattice, prior: Sequence[Array]
) -> tuple[Array, Array]:
    """Information about the parameters of all views, and the gradient of the objective."""
    s, color = state.fit.noise_scale, state.fit.normal.mean
    blocks, gradients, rights = [], [], []
    views = zip(state.views, first.views, state.operators, state.weights, prior, strict=True)
    for view, known, A, weight, precision in views:
        J = _derivatives(view, color, lattice)
        alpha = np.asarray(A.sum(axis=1)).ravel()
        r = view.light(alpha) - A @ color
        away = parameters(view.sweep) - parameters(known.sweep)
        blocks.append(np.einsum("pck,pc,pcl->kl", J, weight, J, optimize=True) / s + precision)
        gradients.append(np.einsum("pck,pc->k", J, weight * r) / s - precision @ away)
        rights.append(np.stack([A.T @ (weight[:, c, None] * J[:, c]) for c in range(3)]))
    right = np.concatenate(rights, axis=2)
    known_color = np.einsum("cnk,cnl->kl", right, state.fit.normal.solve(right)) / s
    total, at = -known_color, 0
    for block in blocks:
        place = slice(at, at + len(block))
        total[place, place] += block
        at += len(block)
    return total, np.concatenate(gradients)


def _derivatives(view: View, color: Array, lattice: Lattice) -> Array:
    """J (pixels, 3, k) by differences over a standard deviation of each parameter."""

    def model(moved: View) -> Array:
        poses = poses_of(moved.sweep, step=_DERIVATIVE_STEP_PX)
        alpha, light = blurred(color, moved.sweep, lattice, view.pixels, poses)
        return light - alpha[:, None] * view.B

    at, start = parameters(view.sweep), model(view)
    std = np.sqrt(np.diag(view.sweep.covariance))
    J = np.zeros((*start.shape, len(at)))
    for k in np.flatnonzero(std > 0):
        moved = at.copy()
        moved[k] += std[k]
        other = view.with_sweep(with_parameters(view.sweep, moved))
        J[..., k] = (model(other) - start) / std[k]
    return J


def parameters(sweep: Sweep) -> Array:
    """Parameters of path and shape (n + m,)."""
    return np.concatenate([sweep.path, sweep.shape])


def with_parameters(sweep: Sweep, values: Array) -> Sweep:
    """A sweep of the same kinds with other parameters."""
    path, shape = np.split(values, [len(sweep.path)])
    return replace(sweep, path=path, shape=shape)


def _with_covariance(views: Sequence[View], covariance: Array) -> list[View]:
    """The views with the blocks of the joint covariance of their parameters."""
    found, at = [], 0
    for view in views:
        end = at + len(parameters(view.sweep))
        own = replace(view.sweep, covariance=covariance[at:end, at:end])
        found.append(view.with_sweep(own))
        at = end
    return found
