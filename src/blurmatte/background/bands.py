"""Bands: a gain that is periodic over the rows or the columns of a picture.

An electronic shutter reads one row after the other, and lamps on the mains flicker at twice its
frequency. So each row sees the lamps in another phase, and the ratio of two such pictures is a periodic
function of the row; of the column, if the camera was held upright. In this file t is the centered
coordinate across the bands, and with the angular frequency ω

    g(t) = Σⱼ aⱼ cos jωt + bⱼ sin jωt,    j = 1 … J,

per channel, is added to the gain.
"""

from dataclasses import dataclass

import numpy as np

from blurmatte.background.warp import to_centered
from blurmatte.checks import Array


@dataclass(frozen=True, eq=False)
class Bands:
    """A periodic part of the gain of a plate.

    Parameters
    ----------
    axis : int
        0 if the light changes from row to row, 1 if from column to column.
    frequency : float
        ω, radians per unit of the centered coordinate.
    coefficients : (2 J, 3) float
        a₁, b₁, a₂, b₂, … per channel.
    covariance : (3, 2 J, 2 J) float
        Of the coefficients of each channel.
    """

    axis: int
    frequency: float
    coefficients: Array
    covariance: Array

    def gain(self, size: tuple[int, int]) -> Array:
        """(n, 3) their part of the gain in the rows or columns of a picture of `size`."""
        return np.asarray(self._functions(size) @ self.coefficients)

    def gain_std(self, size: tuple[int, int]) -> Array:
        """(n, 3) standard deviation of `gain`."""
        functions = self._functions(size)
        variance = np.einsum("ni,cij,nj->nc", functions, self.covariance, functions)
        return np.asarray(np.sqrt(np.maximum(variance, 0)))

    def across(self, profile: Array) -> Array:
        """(n, 1, 3) or (1, n, 3): a profile (n, 3) over rows or columns, to multiply pictures with."""
        return np.asarray(profile[:, None] if self.axis == 0 else profile[None])

    def period(self, size: tuple[int, int]) -> float:
        """Pixels from one band to the next in a picture of `size`."""
        return float(2 * np.pi / self.frequency / to_centered(size)[0, 0])

    @property
    def amplitude(self) -> float:
        """Half of the range of the gain, of the channel in which it is largest."""
        t = np.linspace(0, 2 * np.pi, 200) / self.frequency
        gain = (
            functions_of_bands(t, self.frequency, len(self.coefficients) // 2) @ self.coefficients
        )
        return float(np.ptp(gain, axis=0).max() / 2)

    def in_words(self, size: tuple[int, int]) -> str:
        """Their kind, period and amplitude."""
        kind = ("rows", "columns")[self.axis]
        return f"in bands of {self.period(size):.0f} {kind} by ±{self.amplitude:.1%}"

    def _functions(self, size: tuple[int, int]) -> Array:
        t = coordinates_across(size, self.axis)
        return functions_of_bands(t, self.frequency, len(self.coefficients) // 2)


def functions_of_bands(t: Array, frequency: float, harmonics: int) -> Array:
    """(n, 2 J) cosines and sines at coordinates t (n,)."""
    angle = np.outer(t, frequency * np.arange(1, harmonics + 1))
    return np.stack([np.cos(angle), np.sin(angle)], axis=-1).reshape(len(t), -1)


def coordinates_across(size: tuple[int, int], axis: int) -> Array:
    """(n,) t of the rows or columns of a picture."""
    to, k = to_centered(size), 1 - axis
    return np.asarray(np.arange(size[k]) * to[k, k] + to[k, 2])
