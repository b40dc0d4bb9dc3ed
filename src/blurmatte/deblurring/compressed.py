"""The straight color of an object in compressed pictures.

A JPEG file rounds coefficients of blocks, which correlates the noise of pixels and channels, and
averages chroma, which blurs the colors of the object across its path. The color is refined here under
the likelihood of the coefficients; elsewhere in this package noise is taken as independent.

In this file M = A o + (1 − α) B is the light of a model, z are the coefficients of `jpeg_coefficients`,
and r = z(C) − z(M) their residuals. The plate's chroma was blurred by its own file: M' is M with the
plate blurred again, and the code values of C are changed by those of M' − M, as in
`sweep.model.chroma_subsampling`. With J = ∂z/∂o and the precisions w of the coefficients

    H = Jᵀ w J / max(1, s) + Q,   1 / w = q² / 12 + variance of the noise of P, in codes,

is the inverse covariance of the color under a quadratic prior Q, with the premultiplied light
P = C − (1 − α) B and the step q of a coefficient's rounding. Steps of Gauss and Newton are solved
by conjugate gradients, which only apply H (`descent` needs its elements, too many here), with the
factors of the equations of independent noise as preconditioner, for the steps along the axes of color
that the file knows with different precision. H⁻¹ is
sampled: x = H⁻¹ (Jᵀ √w e + Dᵀ √(weights of Q) e') has this covariance for independent e, e'
[Papandreou & Yuille 2010].

1. The prior Q = Σ λₖ Qₖ, Qₖ = Dₖᵀ Dₖ of first and second differences, see `priors`. The strengths
   λₖ of independent noise take noise of the file for texture. They are therefore fitted again: λₖ =
   γₖ / |Dₖ o|², where the data determine γₖ = λₖ (3 tr Q⁺ Qₖ − E|Dₖ x|²) parameters [MacKay 1992].
2. The prior of edges, see `priors`. E|d|² has the variance of independent noise, scaled to that
   of the samples.
3. The covariance is that of independent noise under the last prior, scaled to the samples.

s is the mean of w (r² + (J x)²), about 1 if the model is right. Rounding to zero leaves residuals
smaller than q² / 12 in coefficients that say little about the color, and wrong motions leave large ones
in those that say much: the mean over the blocks of each coefficient counts by its leverage w (J x)².
As q and the noise are known, the scale in H is at least 1.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy

from blurmatte.checks import Array, Bools
from blurmatte.deblurring.normal_equations import Normal, NormalEquations, posterior
from blurmatte.deblurring.operator import Blur
from blurmatte.deblurring.priors import Bound, Differences, GaussianFit, traces
from blurmatte.deblurring.refine import SAMPLES, ExplainedViews
from blurmatte.deblurring.view import MODEL_STD, StoredCodes, View
from blurmatte.radiometry.compression import BLOCK
from blurmatte.sweep.model.chroma_subsampling import codes_before, light_after

_ROUNDS = 3, 2  # of the strengths, of the prior of edges
_TOLERANCE = 0.02  # of the residual of conjugate gradients, relative
_TOLERANCE_OF_SAMPLES = 0.05  # the same of samples, whose scatter needs no more
_MAX_PRODUCTS = 100  # of conjugate gradients


@dataclass(frozen=True, eq=False)
class _ViewData:
    """Measurements of a view about a color, with independent noise.

    Parameters
    ----------
    residuals, precisions : lists of arrays
        r, and w for s = 1.
    of, adjoint : functions
        Changes of the color (n, 3) → those of the measurements, and the adjoint.
    touched : list of arrays, optional
        Coefficients of a file that see the object.
    """

    residuals: list[Array]
    precisions: list[Array]
    of: Callable[[Array], list[Array]]
    adjoint: Callable[[list[Array]], Array]
    touched: list[Bools] | None = None

    def curvature(self, x: Array, s: float) -> Array:
        """Jᵀ w J x / s."""
        pairs = zip(self.precisions, self.of(x), strict=True)
        return self.adjoint([w / s * y for w, y in pairs])

    def gradient(self, s: float) -> Array:
        """Jᵀ w r / s."""
        pairs = zip(self.precisions, self.residuals, strict=True)
        return self.adjoint([w / s * r for w, r in pairs])

    def noise(self, s: float, rng: np.random.Generator) -> Array:
        """Jᵀ √(w / s) e."""
        return self.adjoint([np.sqrt(w / s) * rng.normal(size=w.shape) for w in self.precisions])

    def misfit(self, samples: Sequence[Array]) -> float:
        """The mean of w (r² + (J x)²), weighted by leverage."""
        assert self.touched is not None
        spread = [np.mean(np.square(y), axis=0) for y in zip(*map(self.of, samples), strict=True)]
        energy, leverage = 0.0, 0.0
        parts = zip(self.precisions, self.residuals, spread, self.touched, strict=True)
        for w, r, v, use in parts:
            count, own, expected = (
                _over_blocks(values * use) for values in (np.ones_like(w), w * v, w * (r**2 + v))
            )
            energy += float(np.sum(own * expected / np.maximum(count, 1)))
            leverage += float(own.sum())
        return energy / leverage


def compressed_color(
    state: ExplainedViews,
    equations: NormalEquations,
    of_channels: NormalEquations,
    smooth: GaussianFit,
    strengths: Array,
) -> tuple[Array, Array, float]:
    """The color from the posterior under independent noise and a Gaussian prior."""
    solver = _QuadraticFit(state, equations, smooth)
    differences = solver.differences
    solver.step(differences.weights(strengths))
    for _ in range(_ROUNDS[0]):
        solver.step(differences.weights(strengths))
        samples = solver.sampled()
        changes = [differences.matrix @ x for x in samples]
        of_samples = np.mean([differences.sums(d**2) for d in changes], axis=0)
        free = strengths * (3 * traces(differences, strengths) - of_samples)
        square = differences.squares(solver.color)
        strengths = np.maximum(free, 1) / differences.sums(square)
    bound = None
    for _ in range(_ROUNDS[1]):
        variance = np.mean([(d**2).sum(axis=1) for d in changes], axis=0)
        own = differences.variances(solver.normal.covariance_band().sum(axis=0))
        square = differences.squares(solver.color) + own * variance.mean() / own.mean()
        bound = bound or Bound.of(differences, square, strengths)
        solver.step(bound.weights(square))
    samples = solver.sampled()
    band = differences.band(solver.weights[:, 0], of_channels.width)
    scaled = posterior(of_channels, solver.independent_scale * band).variances()
    ratio = np.mean(np.square(samples), axis=0).sum(axis=0) / scaled.sum(axis=0)
    return solver.color, ratio * scaled, solver.misfit


class _QuadraticFit:
    """The color under quadratic priors, and samples of its posterior."""

    def __init__(
        self, state: ExplainedViews, equations: NormalEquations, smooth: GaussianFit
    ) -> None:
        self.state, self.equations = state, equations
        self.differences = Differences.of(state.lattice)
        self.color, self.normal = smooth.normal.mean, smooth.normal
        self.independent_scale, self.misfit = smooth.noise_scale, 1.0
        self.rng = np.random.default_rng(0)
        T = next(one.stored.coefficients.equally_noisy for one in state.views if one.stored)
        precisions, self.axes = np.linalg.eigh(T.T @ T)  # of the colors of a pixel in a file
        bands = precisions[:, None, None] * equations.band.mean(axis=0)
        self.rotated = replace(equations, band=bands)

    def step(self, weights: Array) -> None:
        """A step of Gauss and Newton under the prior with weights (m,) of its differences."""
        band = self.differences.band(weights, self.equations.width)
        self.normal = posterior(self.equations, self.independent_scale * band)
        self.weights, self.prior = weights[:, None], self.differences.quadratic(weights)
        parts = zip(self.state.views, self.state.blurs, self.state.weights, strict=True)
        self.data = [linearized(*part, self.color, self.independent_scale) for part in parts]
        gradient = sum(self._scaled(_ViewData.gradient)) - self.prior @ self.color
        rotated = posterior(self.rotated, self.independent_scale * band)
        self.color = self.color + self._solved(gradient, _TOLERANCE, rotated, self.axes)

    def sampled(self) -> list[Array]:
        """Samples of the error of the color; the scale of the noise is estimated again."""
        samples, D = [], self.differences.matrix
        for _ in range(SAMPLES):
            noise = sum(self._scaled(lambda one, s: one.noise(s, self.rng)))
            prior = np.sqrt(self.weights) * self.rng.normal(size=(len(self.weights), 3))
            right = noise + D.T @ prior
            samples.append(self._solved(right, _TOLERANCE_OF_SAMPLES, self.normal, np.eye(3)))
        misfits = [one.misfit(samples) for one in self.data if one.touched is not None]
        self.misfit = float(np.mean(misfits))
        return samples

    def _scaled(self, function: Callable[[_ViewData, float], Array]) -> Iterable[Array]:
        """A function of the data of each view and the scale of its noise."""
        s = max(1.0, self.misfit)
        return (function(one, 1.0 if one.touched is None else s) for one in self.data)

    def _solved(self, right: Array, tolerance: float, normal: Normal, axes: Array) -> Array:
        """H⁻¹ times a vector (n, 3), about the covariance along axes (3, 3) of color."""
        shape = self.color.shape

        def product(x: Array) -> Array:
            """H x."""
            x = x.reshape(shape)
            data = sum(self._scaled(lambda one, s: one.curvature(x, s)))
            return np.asarray(data + self.prior @ x).ravel()

        def inverse(x: Array) -> Array:
            """The covariance under independent noise times a vector."""
            columns = normal.solve((x.reshape(shape) @ axes).T[..., None])
            return np.asarray(self.independent_scale * columns[..., 0].T @ axes.T).ravel()

        size = self.color.size, self.color.size
        solution, _ = scipy.sparse.linalg.cg(
            scipy.sparse.linalg.LinearOperator(size, product, dtype=float),
            np.asarray(right).ravel(),
            rtol=tolerance,
            maxiter=_MAX_PRODUCTS,
            M=scipy.sparse.linalg.LinearOperator(size, inverse, dtype=float),
        )
        return np.asarray(solution.reshape(shape))


def linearized(view: View, blur: Blur, weight: Array, color: Array, scale: float) -> _ViewData:
    """The measurements of a view about a color; `scale` is that of independent noise."""
    if view.stored is not None:
        return _of_file(view, view.stored, blur, color)
    A, alpha = blur
    return _ViewData(
        [view.light(alpha) - A @ color],
        [np.broadcast_to(weight / scale, (len(weight), 3))],
        lambda x: [A @ x],
        lambda y: np.asarray(A.T @ y[0]),
    )


def _of_file(view: View, stored: StoredCodes, blur: Blur, color: Array) -> _ViewData:
    z, shape, (A, alpha) = stored.coefficients, (*view.pixels.shape, 3), blur
    transposed, own, part = A.T, A @ color, alpha.reshape(shape[:2])
    plates = view.B, light_after(view.B, z.seen, stored.transfer)
    before, predicted = codes_before(
        stored.codes, plates, part, own.reshape(shape), z.seen, stored.transfer
    )
    r = z.stored(np.where(view.valid[..., None], 255 * (before - predicted), 0))
    light = own + view.through(alpha)
    slope = 255 / stored.transfer.slope(np.maximum(light, MODEL_STD))  # codes per light
    variance = z.variances((slope**2 * view.variance(alpha)).reshape(shape))
    streak = np.repeat((part > 0)[..., None], 3, axis=-1).astype(float)
    return _ViewData(
        r,
        [1 / (q + v) for q, v in zip(z.step_variances, variance, strict=True)],
        lambda x: z.of((slope * (A @ x)).reshape(shape)),
        lambda y: np.asarray(transposed @ (slope * z.adjoint(y).reshape(-1, 3))),
        [one > 0 for one in z.variances(streak)],
    )


def _over_blocks(coefficients: Array) -> Array:
    """(8, 8) sums over the blocks of a component."""
    h, w = coefficients.shape
    blocks = coefficients.reshape(h // BLOCK, BLOCK, w // BLOCK, BLOCK)
    return np.asarray(blocks.sum(axis=(0, 2)))
