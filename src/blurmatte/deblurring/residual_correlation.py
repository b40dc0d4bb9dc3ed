"""The variance of a straight color if the noise of neighboring pixels is correlated.

Files, and errors of the motion or the shape, leave residuals that correlate over pixels. The color's
covariance counts them as independent. With the operator A, the weights W and the covariance S of the
color, noise W^(-1/2) e changes the color by S Aᵀ W^(1/2) e. Random e with the autocorrelation of the
standardized residuals, and independent ones, give the ratio of its variances.
"""

import numpy as np

from blurmatte.checks import Array, Bools
from blurmatte.deblurring.gaussian import GaussianFit
from blurmatte.deblurring.refine import Explained

_SAMPLES = 4  # of noise in a picture
_MAX_LAG_PX = 8  # of the autocorrelation: a block of a JPEG file


def color_variance_inflation(state: Explained, fit: GaussianFit) -> float:
    """Variance of the color with correlated noise over that with independent noise, at least 1."""
    rng, shape = np.random.default_rng(0), fit.normal.mean.T.shape
    seen = np.zeros((2, *shape, _SAMPLES))  # independent and correlated noise, channels, nodes
    for view, (A, alpha), weight in zip(state.views, state.blurs, state.weights, strict=True):
        root, (h, w) = np.sqrt(np.broadcast_to(weight, (len(weight), 3))), view.pixels.shape
        residual = (root * (view.light(alpha) - A @ fit.normal.mean)).reshape(h, w, 3)
        spectrum = _spectrum(residual, (root > 0).all(axis=1).reshape(h, w))
        white = rng.normal(size=(_SAMPLES, *_padded(h, w)))
        colored = np.fft.irfft2(np.fft.rfft2(white) * np.sqrt(spectrum), white.shape[1:])
        for sums, noise in zip(seen, (white, colored), strict=True):
            e = noise[:, :h, :w].reshape(_SAMPLES, -1).T
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
    y, x = (np.maximum(1 - lag / _MAX_LAG_PX, 0) for lag in lags)
    # A triangular window keeps an autocorrelation positive definite.
    rho = y[:, None] * x * products / np.maximum(pairs, 1)
    power = np.maximum(np.fft.rfft2(rho).real, 0)
    return np.asarray(power / np.fft.irfft2(power, size)[0, 0])


def _padded(h: int, w: int) -> tuple[int, int]:
    """Size of transforms in which lags do not wrap around."""
    from scipy.fft import next_fast_len

    return next_fast_len(h + _MAX_LAG_PX), next_fast_len(w + _MAX_LAG_PX)
