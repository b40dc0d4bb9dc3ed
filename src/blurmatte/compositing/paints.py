"""Exposure fractions of the paints of an object: alpha, split by color.

The premultiplied light is a mixture P = s (a₁ c₁ + a₂ c₂ + …) of the paints' colors cᵢ with their
exposure fractions aᵢ and a common shading factor s. The fractions sum to alpha, so with
P = x₁ c₁ + x₂ c₂ + … they are aᵢ = alpha · xᵢ / Σ x, for any shading ([GC07 §4]).
"""

from dataclasses import dataclass

import numpy as np

from blurmatte.checks import Array, Bools, Floats
from blurmatte.layer import Color, colors_of, split
from blurmatte.matting.solution import Solution, check_solution
from blurmatte.radiometry import light_in_srgb


@dataclass(frozen=True, eq=False)
class Exposures:
    """Exposure fraction of each paint in every pixel.

    Parameters
    ----------
    fraction : (H, W, n) float
        Exposure fraction of each of n paints; the sum is alpha. 0 where it is unknown.
    fraction_std : (H, W, n) float
        Upper bound of its standard deviation: the errors of alpha and of the channels in one pixel are
        correlated, so their absolute values are added. Infinite where the fraction is unknown.
    paints : (n, 3) float
        Linear light.

    Examples
    --------
    >>> paints = bm.compositing.split_exposure(solution, "#ff0000", "#00ff00")
    >>> paints.fraction.shape, int(paints.known.sum())
    ((72, 128, 2), 1592)
    """

    fraction: Floats
    fraction_std: Floats
    paints: Array

    @property
    def known(self) -> Bools:
        """(H, W) True where the split is known."""
        return np.asarray(np.isfinite(self.fraction_std).all(axis=-1))


def split_exposure(solution: Solution, *paints: Color) -> Exposures:
    """Split alpha into the exposure fractions of an object's paints.

    Parameters
    ----------
    solution : Solution
        Usually with a color model of rank 2, for two paints.
    *paints : str or (3,) float
        Two or three colors under the object's lighting, sRGB-coded hex or linear light. Only their
        ratios matter, not a common factor.

    Returns
    -------
    Exposures

    Raises
    ------
    ValueError
        If there is only one paint, or the colors are almost linearly dependent.

    Examples
    --------
    >>> paints = bm.compositing.split_exposure(solution, "#ff0000", "#00ff00")
    >>> total = paints.fraction.sum(axis=-1)
    >>> print(f"{total.max():.2f}, alpha {solution.alpha.max():.2f}")
    0.34, alpha 0.34
    """
    check_solution("solution", solution)
    colors = colors_of(paints)
    if len(colors) < 2:
        raise ValueError("one paint was there for all of alpha; give two or three")
    light = light_in_srgb(solution.premultiplied, solution.model.to_srgb)
    x = split(light, colors)
    whole = x.sum(axis=-1, keepdims=True)
    known = solution.streak & solution.known & (whole[..., 0] > 0)
    with np.errstate(divide="ignore", invalid="ignore"):
        share = x / whole
        fraction = solution.alpha[..., None] * share
        std = solution.alpha_std[..., None] * np.abs(share) + _std_from_light(
            solution, colors, x, whole
        )
    fraction = np.where(known[..., None], fraction, 0)
    std = np.where(known[..., None] & np.isfinite(std), std, np.inf)
    kind = solution.alpha.dtype
    return Exposures(fraction.astype(kind), std.astype(kind), colors)


def _std_from_light(solution: Solution, colors: Array, x: Floats, whole: Floats) -> Floats:
    """Contribution of errors of the light: ∂aᵢ/∂x = alpha (δ − share) / Σx, x linear in light."""
    to_sum = np.linalg.pinv(colors)  # (3, n): light to x
    std = np.zeros_like(x)
    for channel, row in enumerate(to_sum):
        slope = (row - x / whole * row.sum()) / whole
        std += np.abs(slope) * solution.premultiplied_std[..., channel, None]
    return np.asarray(np.abs(solution.alpha[..., None]) * std)
