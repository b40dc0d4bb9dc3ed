"""Alternatives: the hypotheses that fit a streak, each with its color and total alpha.

Where the plate has one hue, an object with more alpha and a color nearer to the plate's gives the same
light. Only a shape or an assumption about color separates them, so hypotheses differ in color and in a
factor common to all alpha.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from blurmatte.checks import Array, check_not_negative
from blurmatte.matting.averaging import MIN_WEIGHT
from blurmatte.matting.calibration import GRADE_LIMITS
from blurmatte.matting.maps import Grade

MAX_ALTERNATIVES = 5  # listed, the result itself included


@dataclass(frozen=True)
class Alternative:
    """A hypothesis and its difference from the result.

    Parameters
    ----------
    name : str
        Such as "disc on a parabola, one paint".
    rgb : (float, float, float)
        Its mean light, weighted by alpha, in the primaries of the image.
    hex : str
        The color that names the object, as `ColorModel.color`: sRGB-coded #rrggbb.
    weight : float
        Posterior probability, 0…1.
    alpha_factor : float
        Sum of its alpha over that of the result, where both are known.
    alpha_difference : float
        Root mean square difference of its alpha from that of the result.
    radius : float or None
        Pixels; None if it has no shape.

    Raises
    ------
    ValueError
        If a number is negative or not finite.
    """

    name: str
    rgb: tuple[float, float, float]
    hex: str
    weight: float
    alpha_factor: float
    alpha_difference: float
    radius: float | None

    def __post_init__(self) -> None:
        for name in ("weight", "alpha_factor", "alpha_difference"):
            check_not_negative(name, getattr(self, name))

    @property
    def matters(self) -> bool:
        """Whether its weight is large enough for it to be averaged."""
        return self.weight >= MIN_WEIGHT

    @property
    def disagrees(self) -> bool:
        """Whether its alpha differs from the result's by more than a confirmed error."""
        error, scale = GRADE_LIMITS[Grade.CONFIRMED]
        return self.alpha_difference > error or abs(self.alpha_factor - 1) > scale


def listed(alternatives: Sequence[Alternative], scores: Array) -> list[Alternative]:
    """Alternatives that matter or disagree with the result, in order of likelihood.

    scores (n,): negative log of their weights, up to a constant. The likeliest is the result's own.
    """
    own, *others = np.argsort(scores, kind="stable")
    kept = [alternatives[own]]
    for one in (alternatives[i] for i in others):
        if one.matters or one.disagrees:
            kept.append(one)
    return kept[:MAX_ALTERNATIVES]
