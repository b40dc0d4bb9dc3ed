"""The variance of noise as a function of light.

In this file `light` is linear (1 = sensor white) and σ² a variance in light². A sensor's noise is the
sum of read noise, whose variance is constant, shot noise, whose variance is proportional to light, and
pixel response non-uniformity, whose standard deviation is proportional to light. Noise that is
constant in code values, such as rounding to 8 bits, is nearly a sum of the last two: the slope of
sRGB is ∝ light^0.58.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from blurmatte.checks import MAX_LIGHT, Floats, check_kind
from blurmatte.radiometry.transfer import TRANSFER_HINT, Transfer
from blurmatte.statistics import UNIFORM_VARIANCE, nonnegative_least_squares

PerChannel = tuple[float, float, float]


class Noise(ABC):
    """The variance of independent noise at each light; pictures take any subclass.

    Examples
    --------
    >>> class Constant(bm.radiometry.Noise):
    ...     def variance(self, light):
    ...         return np.full_like(light, 1e-6)
    ...     def times(self, factor):
    ...         return bm.NoiseModel(read_std=1e-3 * factor**0.5)
    >>> noisy = image.with_noise(Constant())
    """

    @abstractmethod
    def variance(self, light: Floats) -> Floats:
        """σ² of linear `light`, shape (..., 3); in the dtype of `light`."""

    @abstractmethod
    def times(self, factor: float) -> Noise:
        """The noise of this factor, above 0, times the variance."""


@dataclass(frozen=True)
class NoiseModel(Noise):
    """Variance of a linear value: read_std² + gain · light + (relative_std · light)².

    Parameters
    ----------
    gain : float or three floats
        Light per photo-electron, >= 0.
    read_std : float or three floats
        Standard deviation of read noise, light, >= 0.
    relative_std : float or three floats
        Standard deviation of the pixels' response, a fraction of the light, >= 0.

    Raises
    ------
    ValueError
        If a number is negative, NaN, or above a million.

    Examples
    --------
    >>> noise = bm.NoiseModel(gain=1e-5, read_std=4e-4)
    >>> print(noise)
    NoiseModel(std 0.0015 at light 0.2)
    >>> np.sqrt(noise.variance(np.array([0.0, 0.2, 1.0]))).round(5)
    array([0.0004 , 0.00147, 0.00319])
    """

    # All fields have defaults: a mapping with other keys is another kind of noise.
    __pydantic_config__: ClassVar[Any] = {"extra": "forbid"}

    gain: PerChannel | float = (0.0, 0.0, 0.0)
    read_std: PerChannel | float = (0.0, 0.0, 0.0)
    relative_std: PerChannel | float = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        for name in ("gain", "read_std", "relative_std"):
            value = np.broadcast_to(np.asarray(getattr(self, name), dtype=float), (3,))
            if not np.all((value >= 0) & (value <= MAX_LIGHT)):
                raise ValueError(
                    f"{name} must lie between 0 and {MAX_LIGHT:g} (1 is white), got {value.tolist()}"
                )
            object.__setattr__(self, name, tuple(value.tolist()))

    def __repr__(self) -> str:
        middle = np.sqrt(self.variance(np.full(3, 0.2))).mean()
        return f"NoiseModel(std {middle:.2g} at light 0.2)"

    @property
    def coefficients(self) -> Floats:
        """(3 channels, 3) of 1, light and light² in the variance."""
        read, gain, relative = map(np.asarray, (self.read_std, self.gain, self.relative_std))
        return np.stack([read**2, gain, relative**2], axis=1)

    @classmethod
    def from_coefficients(cls, coefficients: Floats) -> NoiseModel:
        """The model with these (3 channels, 3) coefficients of 1, light and light²."""
        constant, linear, quadratic = np.asarray(coefficients, dtype=float).T
        return cls(tuple(linear), tuple(constant**0.5), tuple(quadratic**0.5))

    @classmethod
    def rounding(cls, levels: int, transfer: Transfer) -> NoiseModel:
        """Noise of rounding to `levels` code values, to about 10 %."""
        check_kind("transfer", transfer, Transfer, TRANSFER_HINT)
        light = np.append(0, np.geomspace(0.005, 1, 100))
        variance = UNIFORM_VARIANCE * (transfer.slope(light) / (levels - 1)) ** 2
        coefficients = fit_coefficients(light[1:], variance[1:])
        coefficients[0] = max(coefficients[0], variance[0])
        return cls.from_coefficients(np.tile(coefficients, (3, 1)))

    def times(self, factor: float) -> NoiseModel:
        """The noise of this factor, above 0, times the variance."""
        return NoiseModel.from_coefficients(factor * self.coefficients)

    def variance(self, light: Floats) -> Floats:
        """σ² of linear `light`, shape (..., 3); in the dtype of `light`."""
        check_kind("light", light, np.ndarray, "use numpy.asarray(light, float)")
        # Coefficients repeated for a row of pixels: NumPy is several times as fast.
        constant, linear, quadratic = (
            np.array(np.broadcast_to(one, light.shape[-2:]), order="C")
            for one in self.coefficients.T.astype(light.dtype)
        )
        positive = np.maximum(light, 0)
        variance: Floats = quadratic * positive
        variance += linear
        variance *= positive
        variance += constant
        return variance


def fit_coefficients(light: Floats, variance: Floats, weight: Floats | float = 1.0) -> Floats:
    """(3,) coefficients of 1, light and light² in a variance, by non-negative least squares.

    The variances (K,), light², are above 0; `weight` is that of their relative errors.
    """
    x = np.maximum(light, 0)
    relative = np.broadcast_to(np.asarray(weight) / variance, x.shape)
    columns = np.stack([x**0, x, x**2], axis=1) * relative[:, None]
    return nonnegative_least_squares(columns, relative * variance)
