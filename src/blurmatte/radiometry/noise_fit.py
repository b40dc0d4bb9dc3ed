"""NoiseFit: a sensor's noise, fitted to variances that were measured at many levels of light.

In this file y is a variance, x the light at which it was measured and θ the coefficients of 1, x and
x² in it: read_std², gain and relative_std² (a photon transfer curve; J. R. Janesick, *Photon Transfer*,
SPIE 2007). Code values round light. Noise of variance σ² (in steps², the step being that of the code
values) comes out of a file as

    σ² + 1/12 − Σₖ exp(−4π²k²σ²) / (2π²k²),   k = 1, 2, …

when the same light is seen several times: of the 1/12 that rounding adds, the last part is an error
that is always the same (B. Widrow and I. Kollár, *Quantization Noise*, Cambridge 2008).
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from blurmatte.radiometry.noise import NoiseModel

Array = npt.NDArray[np.float64]
Levels = tuple[Array, ...]

_ROUNDS = 8  # of the fit, until its weights are those of its own variances
_ODD = 3.0  # standard deviations from the curve, from where on a level counts less
_SEEN = 2.0  # standard deviations; else no part of the noise is taken for a fraction of the light
_OPEN = 0.3  # of itself: a gain or read noise that is less sure than that is not known
_FINEST, _COARSEST = 0.02, 3.0  # steps: noise in between is told from its rounding by a table


@dataclass(frozen=True, eq=False)
class NoiseFit:
    """Noise that was measured: the sensor's, the rounding of its file, and how both hang together.

    Parameters
    ----------
    sensor : NoiseModel
        Without the rounding.
    rounding : NoiseModel
        What the code values of the file add.
    covariance : (3 channels, 3, 3) float
        Of the sensor's coefficients of 1, light and light² (`NoiseModel.coefficients`).
    light, variance, variance_std : three (K,) float, one for each channel
        What was measured: the whole variance at K levels of light, and its error.
    coherence : (3 channels, 4) float
        By how much more noise adds up over blocks of 2, 4, 8 and 16 pixels' width than if every pixel
        had its own.
    changed : float
        Share of the pixels that were left out, because something else than noise changed there.
    """

    sensor: NoiseModel
    rounding: NoiseModel
    covariance: Array
    light: Levels
    variance: Levels
    variance_std: Levels
    coherence: Array
    changed: float = 0.0

    def __repr__(self) -> str:
        gain, gain_std = np.mean(self.sensor.gain), np.mean(self.gain_std)
        read, read_std = np.mean(self.sensor.read_std), np.mean(self.read_std_std)
        return f"NoiseFit(gain {gain:.3g} ± {gain_std:.1g}, read_std {read:.3g} ± {read_std:.1g})"

    @property
    def noise(self) -> NoiseModel:
        """All of it, as the pixels of such a file have it: what a LinearImage wants."""
        return NoiseModel.from_coefficients(self.sensor.coefficients + self.rounding.coefficients)

    @property
    def gain_std(self) -> Array:
        """(3,) standard deviation of the sensor's gain."""
        return np.asarray(np.sqrt(self.covariance[:, 1, 1]))

    @property
    def read_std_std(self) -> Array:
        """(3,) standard deviation of the sensor's read_std."""
        return self._of_root(0)

    @property
    def relative_std_std(self) -> Array:
        """(3,) standard deviation of the sensor's relative_std."""
        return self._of_root(2)

    @property
    def scale(self) -> Array:
        """(3,) width of a square whose pixels err alike, pixels: 1 if each has its own noise.

        Sums over large areas scatter as if there were one number for each such square.
        """
        return np.asarray(np.sqrt(np.maximum(self.coherence.max(axis=1), 1)))

    @property
    def parted(self) -> bool:
        """Whether gain or read noise is known by itself, in every channel, and not just their sum."""
        sensor = self.sensor
        gain_known = self.gain_std < _OPEN * np.asarray(sensor.gain)
        read_known = self.read_std_std < _OPEN * np.asarray(sensor.read_std)
        return bool(np.all(gain_known | read_known))

    def rounding_share(self, light: float) -> Array:
        """(3,) part of the variance at this light that is rounding."""
        x = np.full(3, float(light))
        return np.asarray(self.rounding.variance(x) / np.maximum(self.noise.variance(x), 1e-30))

    def _of_root(self, term: int) -> Array:
        # The root of a coefficient that is nearly zero errs by more than its slope says.
        value = self.sensor.coefficients[:, term]
        std = np.sqrt(self.covariance[:, term, term])
        return np.asarray(np.sqrt(value + std) - np.sqrt(value))


def fit_sensor(x: Array, y: Array, spread: Array, rounding: Array) -> tuple[Array, Array, Array]:
    """The sensor's coefficients from variances at several levels of light.

    Parameters
    ----------
    x, y : (K,) float
        Levels of light, and variances without rounding.
    spread : (K,) float
        Standard deviation of y, in parts of the whole variance: y and rounding.
    rounding : (K,) float
        Variance of the rounding there.

    Returns
    -------
    coefficients : (3,) float
        Not negative.
    covariance : (3, 3) float
        As the levels scatter, at least as `spread` says, with that of light² open even where none is
        seen. No coefficient errs by more than it would have to be to make all of the variance.
    y_std : (K,) float
        Standard deviation of y.
    """
    A = np.stack([x**0, x, x**2], axis=1)
    theta, weight, y_std = _weighted(A, y, spread, rounding)
    most = np.min((y + y_std)[:, None] / np.maximum(A, 1e-30), axis=0, initial=np.inf, where=A > 0)
    unit = np.maximum(most, 1e-30)
    information = (A * unit).T @ ((A * unit) * weight[:, None]) + np.eye(3)
    covariance = np.linalg.inv(information) * np.outer(unit, unit)
    if theta[2] < _SEEN * np.sqrt(covariance[2, 2]):
        theta, _, y_std = _weighted(A[:, :2], y, spread, rounding)
        theta = np.append(theta, 0.0)
    return theta, covariance, y_std


def _weighted(A: Array, y: Array, spread: Array, rounding: Array) -> tuple[Array, Array, Array]:
    """θ, weights of the levels, and standard deviations of y; levels off the curve count less."""
    from scipy.optimize import nnls

    theta, trust = np.zeros(A.shape[1]), np.ones(len(y))
    y_std = spread * np.maximum(y + rounding, 1e-30)
    for _ in range(_ROUNDS):
        root = np.sqrt(trust) / y_std
        theta, _ = nnls(A * root[:, None], y * root)
        y_std = spread * np.maximum(A @ theta + rounding, 1e-30)
        z = np.abs(y - A @ theta) / y_std
        usual = max(1.4826 * float(np.median(z)), 1.0)
        trust = 1 / (1 + (z / (_ODD * usual)) ** 2)
    scatter = float(np.sum(trust * z**2)) / max(len(y) - A.shape[1], 1)
    return theta, trust / y_std**2 / max(scatter, 1.0), y_std


def without_rounding(y: Array, step2: Array, repeated: bool) -> Array:
    """Variances before the rounding to code values.

    Parameters
    ----------
    y : (K,) float
        Variances, light².
    step2 : (K,) float
        Squared steps of the code values, light²; 0 for none.
    repeated : bool
        Of light seen several times; else of different light, where all of the rounding shows.
    """
    steps = np.maximum(step2, 1e-30)
    if not repeated:
        return np.maximum(y - step2 / 12, 0)
    sigma2 = np.geomspace(_FINEST, _COARSEST, 400) ** 2
    k = np.arange(1, 60)[:, None]
    same = np.sum(np.exp(-4 * np.pi**2 * k**2 * sigma2) / (2 * np.pi**2 * k**2), axis=0)
    seen = sigma2 + 1 / 12 - same
    told = np.interp(y / steps, seen, sigma2, left=0) * steps
    return np.where(y > seen[-1] * steps, y - step2 / 12, told)
