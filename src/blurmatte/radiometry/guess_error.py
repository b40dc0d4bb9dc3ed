"""Light in which the errors of a guessed plate are independent.

Texture changes mostly along one axis of color. Where a plate was guessed before texture, the channels
of its errors are therefore correlated, and an object of another hue stands out although each channel is
uncertain. In the light y = W x, with x linear RGB and W = Σ^(−1/2) up to a factor, errors of the
covariance Σ are independent and equally large. The model of a picture is linear, so that it is the same
in this light.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from blurmatte.checks import Array


@dataclass(frozen=True, eq=False)
class GuessError:
    """Errors of the light of a guessed plate, means over its pixels.

    Parameters
    ----------
    covariance : (3, 3) float
        Of the channels of a pixel, light².
    power : (3, 3) float
        Covariance of sums over squares, over their area: larger than that of a pixel by the number of
        pixels over which errors are correlated.
    """

    covariance: Array
    power: Array

    @property
    def of_sums(self) -> "GuessError":
        """The same as if errors of pixels were independent with the power."""
        return GuessError(self.power, self.power)

    @cached_property
    def whitening(self) -> Array:
        """(3, 3) the symmetric matrix W, of determinant 1."""
        values, vectors = np.linalg.eigh(self.covariance)
        std = np.sqrt(values)
        return np.asarray(vectors * (float(np.exp(np.log(std).mean())) / std) @ vectors.T)

    def variance(self, of_pixels: Array, mean: Array) -> Array:
        """(H, W, 3) of the errors in that light, where channels of pixels have this variance.

        mean (3,): of that variance.
        """
        part = np.mean(of_pixels / mean, axis=-1)
        size = np.linalg.det(self.covariance) ** (1 / 3)
        return np.repeat((size * part)[..., None], 3, axis=-1)
