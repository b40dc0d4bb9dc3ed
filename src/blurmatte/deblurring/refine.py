"""Blind refinement: the path, shape and spin that make the observed light likeliest, for any color.

In this file θ are their parameters, with their covariance Σ around the estimate θ₀ as prior, and o is
the straight color. The light changes with θ as

    J = ∂/∂θ (A(θ) o − α(θ) B).

The color is marginalized: with the weights W, B = Aᵀ W J and S = (N + μ Q)⁻¹ the information about θ is
(Jᵀ W J − Bᵀ S B) / s + Σ⁻¹, and the gradient of log Z is

    Jᵀ W r / s − tr(S ∂N/∂θ) / 2,   tr(S ∂N/∂θ) = 2 Σₚ wₚ (∂A/∂θ S Aᵀ)ₚₚ,

with the residuals r. The second term, summed over channels, is the change of the volume of colors that
explain the light. On a flat lattice, where it is small, it is omitted. Steps of Gauss and Newton are
accepted if they increase the objective log Z(θ) − (θ − θ₀)ᵀ Σ⁻¹ (θ − θ₀) / 2. Each evaluation builds
the operator anew; so few lengths of a step are tried, and secants correct the information instead of
damping it. s is the variance scale of the residuals, so that an error of the model does not count as
evidence. On a flat lattice one W serves all channels, and the steps start from the maximum in pictures
of blocks of pixels.

Files, and errors of the motion or the shape, leave residuals that correlate over pixels. The color's
covariance counts them as independent. With the covariance S of the color, noise W^(-1/2) e changes
the color by S Aᵀ W^(1/2) e. Random e with the autocorrelation of the standardized residuals, and
independent ones, give the ratio of its variances.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy

from blurmatte.checks import Array, Bools
from blurmatte.deblurring import priors
from blurmatte.deblurring.lattice import Lattice, Secant, Surface
from blurmatte.deblurring.normal_equations import NormalEquations, summed
from blurmatte.deblurring.operator import Blur
from blurmatte.deblurring.view import View
from blurmatte.radiometry.compression import BLOCK
from blurmatte.statistics import scaled_inverse

LEAST_GAIN = 0.5  # expected increase of the log evidence by a step
MAX_STEPS = 8  # of one refinement
_LEAST_RADIUS = 8.0  # of an object in coarse pictures, nodes
_LONGEST_STD = 6.0  # of a step that measures the curvature, which changes over longer ones
SAMPLES = 4  # of noise in a picture, or of the posterior, that give an error


@dataclass(frozen=True, eq=False)
class ExplainedViews:
    """Views of one object, and its straight color under a Gaussian prior.

    Parameters
    ----------
    lattice : Surface
    views : tuple of View
    blurs : tuple of Blur
        Of each view.
    weights : tuple of (pixels, 3) float
    equations : NormalEquations
    fit : GaussianFit
    """

    lattice: Surface
    views: tuple[View, ...]
    blurs: tuple[Blur, ...]
    weights: tuple[Array, ...]
    equations: NormalEquations
    fit: priors.GaussianFit

    def of_channels(self) -> NormalEquations:
        """The equations with the weights of each channel."""
        views = [replace(view, shared_weight=False) for view in self.views]
        return _equations(views, self.blurs, _weights(views, self.blurs), self.lattice)


def explained(
    views: Sequence[View], lattice: Surface, weights: Sequence[Array] | None = None
) -> ExplainedViews:
    """The color that explains views, with the likeliest strength of its prior.

    Evidences of two motions compare under the same weights.
    """
    blurs = [view.blur(lattice) for view in views]
    weights = _weights(views, blurs) if weights is None else weights
    equations = _equations(views, blurs, weights, lattice)
    fit = priors.fit_gaussian(equations, lattice)
    return ExplainedViews(lattice, tuple(views), tuple(blurs), tuple(weights), equations, fit)


def _moved(views: Sequence[View], first: ExplainedViews) -> ExplainedViews:
    """Views with another motion, under the weights and the prior of the first state."""
    blurs = [view.blur(first.lattice) for view in views]
    equations = _equations(views, blurs, first.weights, first.lattice)
    Q = priors.gradient_prior(first.lattice, equations.width)
    fit = priors.fit_strength(equations, Q, first.fit.strength)
    return replace(first, views=tuple(views), blurs=tuple(blurs), equations=equations, fit=fit)


def _weights(views: Sequence[View], blurs: Sequence[Blur]) -> list[Array]:
    """Of the pixels of each view."""
    return [view.weight(blur.alpha) for view, blur in zip(views, blurs, strict=True)]


def _equations(
    views: Sequence[View], blurs: Sequence[Blur], weights: Sequence[Array], lattice: Surface
) -> NormalEquations:
    parts = zip(views, blurs, weights, strict=True)
    return summed([view.equations(blur, lattice, weight) for view, blur, weight in parts])


def refined(
    views: Sequence[View],
    lattice: Surface,
    steps: int = MAX_STEPS,
    weights: Sequence[Array] | None = None,
    least_gain: float = LEAST_GAIN,
) -> ExplainedViews:
    """The views with the likeliest paths, shapes and spins, and their covariance, by some steps.

    They end where a step is expected to increase the log evidence by less than the least gain. Without
    weights they are those of the first motion.
    """
    found = _likeliest(views, _parameters(views), lattice, weights, steps, least_gain)
    return _with_likeliest_strength(_known_to(views, *found))


def refined_flat(views: Sequence[View], lattice: Lattice) -> ExplainedViews:
    """As `refined` for a flat object, with the weights of the refined motion.

    The steps start from the likeliest motions in pictures of blocks of pixels.
    """
    known, start = [view.for_path() for view in views], _parameters(views)
    for by in (4, 2):
        if lattice.radius / (by * lattice.pitch) >= _LEAST_RADIUS:
            nodes = Lattice.of(views[0].sweep, by * lattice.pitch)
            coarse = _likeliest([view.coarser(by) for view in known], start, nodes)
            start = _parameters(coarse[0].views)
    state = _known_to(views, *_likeliest(known, start, lattice))
    return _with_likeliest_strength(_within_streak(state))


def _known_to(views: Sequence[View], state: ExplainedViews, information: Array) -> ExplainedViews:
    """The state with the views at its parameters, and their covariance."""
    at = _at(views, _parameters(state.views), scaled_inverse(information))
    return replace(state, views=tuple(at))


def _with_likeliest_strength(state: ExplainedViews) -> ExplainedViews:
    """The state with the likeliest strength of the prior near its own."""
    Q = priors.gradient_prior(state.lattice, state.equations.width)
    return replace(state, fit=priors.refit_strength(state.equations, Q, state.fit.strength))


def _likeliest(
    known: Sequence[View],
    start: Array,
    lattice: Surface,
    weights: Sequence[Array] | None = None,
    steps: int = MAX_STEPS,
    least_gain: float = LEAST_GAIN,
) -> tuple[ExplainedViews, Array]:
    """The views with the likeliest parameters, from a start, and the information about them."""
    state = explained(_at(known, start), lattice, weights)
    first = replace(state, views=tuple(known))
    secants, before = list[Secant](), None
    for _ in range(steps):
        information, gradient = information_of(state, first)
        if before is not None:
            last = _parameters(state.views) - before[0]
            if last @ information @ last < _LONGEST_STD**2:
                secants.append((last, before[1] - gradient))
        before = _parameters(state.views), gradient
        information = lattice.with_curvature(information, secants)
        step = scaled_inverse(information) @ gradient
        if gradient @ step / 2 < least_gain:
            break
        better = _along(state, step, first)
        if better is None:
            break
        state = better
    return state, information


def _within_streak(state: ExplainedViews) -> ExplainedViews:
    """The equations of the pixels that see the object, with the refined error of alpha."""
    views = tuple(replace(v.with_error_of_alpha(), shared_weight=True) for v in state.views)
    weights = _weights(views, state.blurs)
    equations = _equations(views, state.blurs, weights, state.lattice)
    return replace(state, views=views, weights=tuple(weights), equations=equations)


def _parameters(views: Sequence[View]) -> Array:
    """(k,) of all views."""
    return np.concatenate([view.parameters for view in views])


def _along(state: ExplainedViews, step: Array, first: ExplainedViews) -> ExplainedViews | None:
    """The state after a step or a part of it; None if none is better."""
    before, at = objective(state, first), _parameters(state.views)
    for part in (1.0, 0.4):
        after = _moved(_at(state.views, at + part * step), first)
        if objective(after, first) > before:
            return after
    return None


def objective(state: ExplainedViews, first: ExplainedViews) -> float:
    """The objective log Z(θ) − (θ − θ₀)ᵀ Σ⁻¹ (θ − θ₀) / 2."""
    total = state.fit.log_evidence
    for view, known in zip(state.views, first.views, strict=True):
        away = view.parameters - known.parameters
        total -= float(away @ _precision(known) @ away) / 2
    return total


def _precision(view: View) -> Array:
    """Σ⁻¹ (k, k); 0 for parameters that are fixed."""
    return scaled_inverse(view.covariance)


def information_of(state: ExplainedViews, first: ExplainedViews) -> tuple[Array, Array]:
    """Information about the parameters of all views, and the gradient of the objective."""
    s, color = state.fit.noise_scale, state.fit.normal.mean
    blocks, gradients, rights = [], [], []
    views = zip(state.views, first.views, state.blurs, state.weights, strict=True)
    for view, known, (A, alpha), weight in views:
        precision = _precision(known)
        J, volume = state.lattice.derivatives(view, state.fit, A, weight)
        weight, r = np.broadcast_to(weight, (len(weight), 3)), view.light(alpha) - A @ color
        away = view.parameters - known.parameters
        blocks.append(np.einsum("pck,pc,pcl->kl", J, weight, J, optimize=True) / s + precision)
        gradients.append(np.einsum("pck,pc->k", J, weight * r) / s)
        gradients[-1] -= volume.sum(axis=0) + precision @ away
        rights.append(np.stack([A.T @ (weight[:, c, None] * J[:, c]) for c in range(3)]))
    right = np.concatenate(rights, axis=2)
    known_color = np.einsum("cnk,cnl->kl", right, state.fit.normal.solve(right)) / s
    return scipy.linalg.block_diag(*blocks) - known_color, np.concatenate(gradients)


def scores(state: ExplainedViews) -> Array:
    """(pixels, k) parts of the gradient of log Z of one view; their sum is the gradient."""
    (view,), ((A, alpha),), (weight,) = state.views, state.blurs, state.weights
    J, volume = state.lattice.derivatives(view, state.fit, A, weight)
    r = view.light(alpha) - A @ state.fit.normal.mean
    score = np.einsum("pck,pc->pk", J, weight * r) / state.fit.noise_scale - volume
    return np.asarray(score)


def _at(views: Sequence[View], parameters: Array, covariance: Array | None = None) -> list[View]:
    """The views with parts of all parameters, and the blocks of their joint covariance."""
    found, at = [], 0
    for view in views:
        own = slice(at, at + len(view.parameters))
        block = None if covariance is None else covariance[own, own]
        found.append(view.moved(parameters[own], block))
        at = own.stop
    return found


def color_variance_inflation(state: ExplainedViews, fit: priors.GaussianFit) -> float:
    """Variance of the color with correlated noise over that with independent noise, at least 1."""
    rng, shape = np.random.default_rng(0), fit.normal.mean.T.shape
    seen = np.zeros((2, *shape, SAMPLES))  # independent and correlated noise, channels, nodes
    for view, (A, alpha), weight in zip(state.views, state.blurs, state.weights, strict=True):
        root, (h, w) = np.sqrt(np.broadcast_to(weight, (len(weight), 3))), view.pixels.shape
        residual = (root * (view.light(alpha) - A @ fit.normal.mean)).reshape(h, w, 3)
        spectrum = _spectrum(residual, (root > 0).all(axis=1).reshape(h, w))
        white = rng.normal(size=(SAMPLES, *_padded(h, w)))
        colored = np.fft.irfft2(np.fft.rfft2(white) * np.sqrt(spectrum), white.shape[1:])
        for sums, noise in zip(seen, (white, colored), strict=True):
            e = noise[:, :h, :w].reshape(SAMPLES, -1).T
            sums += np.stack([A.T @ (root[:, [c]] * e) for c in range(3)])
    independent, correlated = (float(np.sum(fit.normal.solve(sums) ** 2)) for sums in seen)
    return max(1.0, correlated / independent)


def _spectrum(residual: Array, use: Bools) -> Array:
    """Power of `rfft2` of noise of variance 1 with the autocorrelation of residuals (h, w, 3)."""
    size = _padded(*use.shape)
    energy = np.abs(np.fft.rfft2(np.where(use[..., None], residual, 0), size, axes=(0, 1))) ** 2
    pairs = np.fft.irfft2(np.abs(np.fft.rfft2(use.astype(float), size)) ** 2, size)
    products = np.fft.irfft2(energy.mean(axis=-1), size)
    lags = [np.minimum(np.arange(n), n - np.arange(n)) for n in size]
    y, x = (np.maximum(1 - lag / BLOCK, 0) for lag in lags)
    # Files correlate noise within a block; a triangular window keeps ρ positive definite.
    rho = y[:, None] * x * products / np.maximum(pairs, 1)
    power = np.maximum(np.fft.rfft2(rho).real, 0)
    return np.asarray(power / np.fft.irfft2(power, size)[0, 0])


def _padded(h: int, w: int) -> tuple[int, int]:
    """Size of transforms in which lags do not wrap around."""
    return scipy.fft.next_fast_len(h + BLOCK), scipy.fft.next_fast_len(w + BLOCK)
