"""The straight color of an object in compressed pictures.

A JPEG file rounds coefficients of blocks, which correlates the noise of pixels and channels, and
averages chroma, which blurs the colors of the object across its path. The color is refined here under
the likelihood of the coefficients; elsewhere in this package noise is taken as independent.

In this file M = A o + (1 − α) B is the light of a model, z are the coefficients of `jpeg_coefficients`,
and r = z(C) − z(M) their residuals. The plate's chroma was blurred by its own file: M' is M with the
plate blurred again, and the code values of C are changed by those of M' − M, as in
`sweep.model.chroma_subsampling`. With the precisions w of the coefficients the color minimizes

    Σ w r² / (2 s) + ν TV(o),   1 / w = q² / 12 + variance of the noise of P, in codes,

where s is the mean of w r² in the blocks of the streak: rounding to zero leaves an error smaller than
q² / 12. ν is that of independent noise, see `total_variation`, a property of the object. Each step
linearizes z and bounds TV by a quadratic; conjugate gradients solve it, with the factors of the
equations of independent noise as preconditioner.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from blurmatte.deblurring.gaussian import GaussianFit
from blurmatte.deblurring.lattice import Lattice
from blurmatte.deblurring.operator import Sparse
from blurmatte.deblurring.refine import Explained
from blurmatte.deblurring.total_variation import edge_weights
from blurmatte.deblurring.view import MODEL_STD, StoredCodes, View

Array = npt.NDArray[np.float64]


class _Linearized(NamedTuple):
    """Gradient (n, 3) of a log likelihood, products with its curvature, and the reduced χ²."""

    gradient: Array
    curvature: Callable[[Array], Array]
    misfit: float


_STEPS = 7
_TOLERANCE = 0.01  # of the residual of conjugate gradients, relative
_MAX_PRODUCTS = 100  # of conjugate gradients


def compressed_color(state: Explained, lattice: Lattice, fit: GaussianFit) -> tuple[Array, float]:
    """(n, 3) straight color, from a fit under independent noise with its total variation; and s."""
    from scipy.sparse import csr_matrix
    from scipy.sparse.linalg import LinearOperator, cg

    color, shape = fit.normal.mean, fit.normal.mean.shape
    m, (i, j) = len(lattice.edges), lattice.edges.T
    ends = np.repeat(np.arange(m), 2), lattice.edges.ravel()
    D = csr_matrix((np.tile([1.0, -1.0], m), ends), shape=(m, lattice.size))

    def inverse(right: Array) -> Array:
        """The covariance under independent noise times a vector."""
        columns = fit.noise_scale * fit.normal.solve(right.reshape(shape).T[..., None])
        return np.asarray(columns[..., 0].T.ravel())

    for _ in range(_STEPS):
        parts = zip(state.views, (blur.A for blur in state.blurs), state.weights, strict=True)
        data = [_linearized(*part, color, fit.noise_scale) for part in parts]
        prior = fit.strength * edge_weights(color, lattice)[:, None]

        def product(x: Array, data: list[_Linearized] = data, prior: Array = prior) -> Array:
            """The curvature times a vector."""
            x = x.reshape(shape)
            return np.asarray(
                (sum(one.curvature(x) for one in data) + D.T @ (prior * (D @ x))).ravel()
            )

        gradient = sum(one.gradient for one in data) - D.T @ (prior * (color[i] - color[j]))
        size = color.size, color.size
        step, _ = cg(
            LinearOperator(size, product, dtype=float),
            np.asarray(gradient).ravel(),
            rtol=_TOLERANCE,
            maxiter=_MAX_PRODUCTS,
            M=LinearOperator(size, inverse, dtype=float),
        )
        color = color + step.reshape(shape)
    return color, float(np.mean([one.misfit for one in data]))


def _linearized(view: View, A: Sparse, weight: Array, color: Array, scale: float) -> _Linearized:
    """The log likelihood of a view about a color."""
    if view.stored is not None:
        return _of_file(view, view.stored, A, color)
    alpha = np.asarray(A.sum(axis=1)).ravel()
    gradient = A.T @ (weight * (view.light(alpha) - A @ color)) / scale
    return _Linearized(
        np.asarray(gradient), lambda x: np.asarray(A.T @ (weight * (A @ x))) / scale, scale
    )


def _of_file(view: View, stored: StoredCodes, A: Sparse, color: Array) -> _Linearized:
    z, shape = stored.coefficients, (*view.pixels.shape, 3)
    alpha = np.asarray(A.sum(axis=1))
    through, own = (1 - alpha), A @ color
    light = own + through * view.B
    predicted = stored.codes_of(light).reshape(shape)
    with_plate = stored.codes_of(own + through * stored.plate_seen).reshape(shape)
    residual = stored.codes + with_plate - predicted - z.seen(predicted)
    r = z.stored(np.where(view.valid.reshape(shape[:2])[..., None], residual, 0))
    slope = 255 / stored.transfer.slope(np.maximum(light, MODEL_STD))  # codes per light
    variance = z.variances((slope**2 * view.variance(alpha.ravel())).reshape(shape))
    streak = np.repeat((alpha > 0).reshape(*shape[:2], 1), 3, axis=-1).astype(float)
    touched = [one > 0 for one in z.variances(streak)]
    w = [1 / (q + v) for q, v in zip(z.step_variances, variance, strict=True)]
    energy = [float((a * b**2)[use].sum()) for a, b, use in zip(w, r, touched, strict=True)]
    scale = sum(energy) / sum(int(use.sum()) for use in touched)

    def back(values: list[Array]) -> Array:
        """Weighted coefficients → gradient by the color."""
        weighted = [a * b / scale for a, b in zip(w, values, strict=True)]
        return np.asarray(A.T @ (slope * z.adjoint(weighted).reshape(-1, 3)))

    return _Linearized(back(r), lambda x: back(z.of((slope * (A @ x)).reshape(shape))), scale)
