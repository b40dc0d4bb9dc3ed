"""How long each paint of an object was there: alpha, split by the colors of what covered a pixel.

Light of the object is a mixture, P = s (a₁ c₁ + a₂ c₂ + …), of its paints' colors c with the fraction
of the exposure aᵢ that each was there and a shade s that is the same for all. The fractions add up
to alpha, so with P = x₁ c₁ + x₂ c₂ + … they are aᵢ = alpha · xᵢ / Σ x, whatever the shade
([GC07 §4], "patterns left by differently pigmented parts").
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from blurmatte.checks import Bools, Floats
from blurmatte.layer import Color, colors_of, split
from blurmatte.matting import Solution
from blurmatte.matting.solution import check_solution
from blurmatte.radiometry import light_in_srgb


@dataclass(frozen=True, eq=False)
class Exposures:
    """How long each paint was there, pixel by pixel.

    Parameters
    ----------
    fraction : (H, W, n) float
        Of the exposure, for each of n paints; they add up to alpha. 0 where nothing is known.
    fraction_std : (H, W, n) float
        An upper bound of its standard deviation: errors of alpha and of each channel's light are taken
        to add up, for in one pixel they hang together. Infinite where nothing is known.
    paints : (n, 3) float
        Linear light.
    """

    fraction: Floats
    fraction_std: Floats
    paints: npt.NDArray[np.float64]

    @property
    def known(self) -> Bools:
        """(H, W) True where the split is known at all."""
        return np.asarray(np.isfinite(self.fraction_std).all(axis=-1))


def split_exposure(solution: Solution, *paints: Color) -> Exposures:
    """Split alpha among the paints of an object of several colors.

    Parameters
    ----------
    solution : Solution
        Usually of rank 2, e.g. of two paints.
    *paints : str or (3,) float
        Two or three colors in the object's own light, sRGB-coded hex or linear light: how bright each
        is beside the others matters, how bright all are does not.

    Returns
    -------
    Exposures

    Raises
    ------
    ValueError
        If there is one paint, or they are too alike.
    """
    check_solution("solution", solution)
    colors = colors_of(paints)
    if len(colors) < 2:
        raise ValueError("one paint was there for all of alpha; give two or three")
    light = light_in_srgb(solution.premultiplied, solution.model.to_srgb)
    x = split(light, colors)
    whole = x.sum(axis=-1, keepdims=True)
    told = solution.streak & solution.known & (whole[..., 0] > 0)
    with np.errstate(divide="ignore", invalid="ignore"):
        share = x / whole
        fraction = solution.alpha[..., None] * share
        std = solution.alpha_std[..., None] * np.abs(share) + _by_light(solution, colors, x, whole)
    fraction = np.where(told[..., None], fraction, 0)
    std = np.where(told[..., None] & np.isfinite(std), std, np.inf)
    kind = solution.alpha.dtype
    return Exposures(fraction.astype(kind), std.astype(kind), colors)


def _by_light(
    solution: Solution, colors: npt.NDArray[np.float64], x: Floats, whole: Floats
) -> Floats:
    """What the error of the light adds: ∂aᵢ/∂x = alpha (δ − share) / Σx, and x is linear in light."""
    to_sum = np.linalg.pinv(colors)  # (3, n): light to x
    std = np.zeros_like(x)
    for channel, row in enumerate(to_sum):
        slope = (row - x / whole * row.sum()) / whole
        std += np.abs(slope) * solution.premultiplied_std[..., channel, None]
    return np.asarray(np.abs(solution.alpha[..., None]) * std)
