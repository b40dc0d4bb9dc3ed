"""NoiseFit: a sensor's noise model, fitted to variances at many levels of light.

In this file y is a variance, x the light at which it was measured and θ the coefficients of 1, x and
x² in it: read_std², gain and relative_std² (a photon transfer curve; J. R. Janesick, *Photon Transfer*,
SPIE 2007). Code values round light. Noise of variance σ², in squared steps of the code values, has in a
file the variance

    σ² + 1/12 − Σₖ exp(−4π²k²σ²) / (2π²k²),   k = 1, 2, …

if the same light is measured repeatedly: the sum is the part of the rounding error, of variance 1/12,
that is the same each time (B. Widrow and I. Kollár, *Quantization Noise*, Cambridge 2008).
"""

from dataclasses import dataclass

import numpy as np

from blurmatte.checks import Array
from blurmatte.radiometry import NoiseModel
from blurmatte.statistics import UNIFORM_VARIANCE, nonnegative_least_squares, robust_std

Levels = tuple[Array, ...]

_TINY = 1e-30  # guards a division


@dataclass(frozen=True, eq=False)
class NoiseFit:
    """Measured noise: that of the sensor, the rounding of its file, and their correlation.

    Parameters
    ----------
    sensor : NoiseModel
        Without the rounding.
    rounding : NoiseModel
        Noise of the code values of the file.
    covariance : (3 channels, 3, 3) float
        Of the sensor's coefficients of 1, light and light² (`NoiseModel.coefficients`).
    light, variance, variance_std : three (K,) float, one for each channel
        The data: total variance at K levels of light, and its standard deviation.
    variance_inflation : (3 channels, 4) float
        Variance of sums over blocks of 2, 4, 8 and 16 pixels' width, over that of independent pixels.
    changed : float
        Fraction of the pixels rejected because the scene changed there.

    Examples
    --------
    >>> fit = bm.calibration.measure_noise_against(image, plate)
    >>> print(fit)
    NoiseFit(gain 1.32e-05 ± 4e-06, read_std 0 ± 0.0005)
    >>> print(fit.noise)
    NoiseModel(std 0.0019 at light 0.2)
    """

    sensor: NoiseModel
    rounding: NoiseModel
    covariance: Array
    light: Levels
    variance: Levels
    variance_std: Levels
    variance_inflation: Array
    changed: float = 0.0

    def __repr__(self) -> str:
        gain, gain_std = np.mean(self.sensor.gain), np.mean(self.gain_std)
        read, read_std = np.mean(self.sensor.read_std), np.mean(self.read_std_std)
        return f"NoiseFit(gain {gain:.3g} ± {gain_std:.1g}, read_std {read:.3g} ± {read_std:.1g})"

    @property
    def noise(self) -> NoiseModel:
        """Noise of sensor and rounding: that of a LinearImage from such a file."""
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
        """(3,) correlation length of the noise, pixels: 1 if pixels are independent.

        Sums over large areas have the variance of one independent number for each square of this width.
        """
        return np.asarray(np.sqrt(np.maximum(self.variance_inflation.max(axis=1), 1)))

    @property
    def separable(self) -> bool:
        """True if gain or read noise is known to 30 % in every channel, and not only their sum."""
        sensor = self.sensor
        gain_known = self.gain_std < 0.3 * np.asarray(sensor.gain)
        read_known = self.read_std_std < 0.3 * np.asarray(sensor.read_std)
        return bool(np.all(gain_known | read_known))

    def rounding_share(self, light: float) -> Array:
        """(3,) fraction of the variance at this light that is rounding."""
        x = np.full(3, float(light))
        return np.asarray(self.rounding.variance(x) / np.maximum(self.noise.variance(x), _TINY))

    def _of_root(self, term: int) -> Array:
        # Not by the slope of the root: it overestimates the error of a coefficient near zero.
        value = self.sensor.coefficients[:, term]
        std = np.sqrt(self.covariance[:, term, term])
        return np.asarray(np.sqrt(value + std) - np.sqrt(value))


def fit_sensor(x: Array, y: Array, spread: Array, rounding: Array) -> tuple[Array, Array, Array]:
    """The sensor's coefficients, by robust non-negative least squares.

    x, y (K,): levels of light, and variances without rounding.
    spread (K,): standard deviation of y, as a fraction of the total variance, y plus rounding.
    rounding (K,): variance of the rounding there.

    Returns the coefficients (3,), their covariance (3, 3), and the standard deviation (K,) of y.
    No coefficient is negative; that of light² is 0 unless it exceeds twice its standard deviation.
    The covariance is that of the scatter of the levels, at least of `spread`. The prior standard
    deviation of a coefficient is the value that would explain all of the variance.
    """
    A = np.stack([x**0, x, x**2], axis=1)
    theta, weight, y_std = _weighted(A, y, spread, rounding)
    most = np.min((y + y_std)[:, None] / np.maximum(A, _TINY), axis=0, initial=np.inf, where=A > 0)
    unit = np.maximum(most, _TINY)
    information = (A * unit).T @ ((A * unit) * weight[:, None]) + np.eye(3)
    covariance = np.linalg.inv(information) * np.outer(unit, unit)
    if theta[2] < 2 * np.sqrt(covariance[2, 2]):
        theta, _, y_std = _weighted(A[:, :2], y, spread, rounding)
        theta = np.append(theta, 0.0)
    return theta, covariance, y_std


def _weighted(A: Array, y: Array, spread: Array, rounding: Array) -> tuple[Array, Array, Array]:
    """θ, weights of the levels and standard deviations of y; outliers are weighted down.

    The weights are Cauchy's with the scale of the scatter, for the likelihood of a level where
    something moved is not known.
    """
    theta, trust = np.zeros(A.shape[1]), np.ones(len(y))
    y_std = spread * np.maximum(y + rounding, _TINY)
    for _ in range(8):
        root = np.sqrt(trust) / y_std
        theta = nonnegative_least_squares(A * root[:, None], y * root)
        y_std = spread * np.maximum(A @ theta + rounding, _TINY)
        z = np.abs(y - A @ theta) / y_std
        trust = 1 / (1 + (z / (3 * max(robust_std(z), 1.0))) ** 2)
    scatter = float(np.sum(trust * z**2)) / max(len(y) - A.shape[1], 1)
    return theta, trust / y_std**2 / max(scatter, 1.0), y_std


def without_rounding(y: Array, step2: Array, repeated: bool) -> Array:
    """Variances before the rounding to code values.

    y (K,): variances of values that are rounded to code values, light².
    step2 (K,): squared steps of the code values, light²; 0 for none.
    repeated: true for repeated measurements of the same light; else the rounding error is
        independent.
    """
    steps = np.maximum(step2, _TINY)
    if not repeated:
        return np.maximum(y - UNIFORM_VARIANCE * step2, 0)
    sigma2 = np.geomspace(0.02, 3.0, 400) ** 2  # beyond, the sum is negligible
    k = np.arange(1, 60)[:, None]
    same = np.sum(np.exp(-4 * np.pi**2 * k**2 * sigma2) / (2 * np.pi**2 * k**2), axis=0)
    seen = sigma2 + UNIFORM_VARIANCE - same
    inverse = np.interp(y / steps, seen, sigma2, left=0) * steps
    return np.where(y > seen[-1] * steps, y - UNIFORM_VARIANCE * step2, inverse)
