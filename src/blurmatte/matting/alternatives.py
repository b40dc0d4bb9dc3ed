"""Alternatives: the hypotheses that fit a streak, each with its color and total alpha.

Where the plate has one hue, an object with more alpha and a color nearer to the plate's gives the same
light. Only a shape or an assumption about color separates them, so hypotheses differ in color and in a
factor common to all alpha.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from blurmatte.checks import Array, check_not_negative
from blurmatte.color.model import ColorModel
from blurmatte.matting.averaging import MIN_WEIGHT, AlphaEstimate
from blurmatte.matting.calibration import GRADE_LIMITS, rms_difference
from blurmatte.matting.maps import Grade
from blurmatte.matting.object_light import light_given
from blurmatte.radiometry import LinearImage
from blurmatte.sweep.sweep import Sweep

MAX_ALTERNATIVES = 5  # listed, the result itself included
_COLORS = "one paint", "two paints", "any colors"  # of rank 1, 2, 3
_PATHS = {
    "line": "a straight line",
    "parabola": "a parabola",
    "cubic": "a cubic curve",
    "arc": "an arc",
    "bounce": "a path that bounces",
    "from rest": "a path from rest",
}


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


def alternative(
    hypothesis: Sweep | ColorModel,
    weight: float,
    estimate: AlphaEstimate,
    result: AlphaEstimate,
    pictures: tuple[LinearImage, LinearImage],
    box: tuple[int, int, int, int],
) -> Alternative:
    """Compare a hypothesis with the result.

    hypothesis: a shape on a path, or the colors of a hypothesis without a shape.
    estimate, result: its alpha in the box, and that of the result.
    pictures: image and plate in the box, noise known.
    """
    image, plate = pictures
    model, radius = hypothesis, None
    if isinstance(hypothesis, Sweep):
        model, radius = hypothesis.model, hypothesis.radius
        plate = hypothesis.in_shadow(plate, box)
    assert isinstance(model, ColorModel)
    mean = _mean_color(estimate, model, image, plate)
    r, g, b = mean.tolist()
    return Alternative(
        _name(hypothesis),
        (r, g, b),
        replace(model, mean=mean).color,
        float(weight),
        _alpha_factor(estimate, result),
        rms_difference(result, estimate),
        radius,
    )


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


def _mean_color(
    estimate: AlphaEstimate, model: ColorModel, image: LinearImage, plate: LinearImage
) -> Array:
    """(3,) light of an object divided by its alpha; 0 if no light is known."""
    known = np.isfinite(estimate.alpha) & np.isfinite(estimate.alpha_std)
    alpha, std = (np.where(known, x, 0) for x in (estimate.alpha, estimate.alpha_std))
    P, P_std, _ = light_given(alpha, std, model, image, plate)
    use = (alpha > 0) & np.isfinite(P_std).all(axis=-1)
    total = max(float(alpha[use].sum()), 1e-9)
    return np.asarray(np.maximum(P[use].sum(axis=0) / total, 0))


def _alpha_factor(estimate: AlphaEstimate, result: AlphaEstimate) -> float:
    """Sum of alpha over that of the result, where both are known."""
    both = np.isfinite(estimate.alpha) & np.isfinite(estimate.alpha_std)
    both &= np.isfinite(result.alpha) & np.isfinite(result.alpha_std)
    total = float(np.sum(np.asarray(result.alpha)[both]))
    own = float(np.sum(np.asarray(estimate.alpha)[both]))
    return max(own / total, 0.0) if total > 0 else 1.0


def _name(hypothesis: Sweep | ColorModel) -> str:
    """Readable name."""
    if isinstance(hypothesis, ColorModel):
        return f"no shape, {_COLORS[hypothesis.rank - 1]}"
    path = _PATHS.get(hypothesis.family.name, f"a {hypothesis.family.name}")
    shadow = " with its shadow" if hypothesis.cast is not None else ""
    colors = _COLORS[hypothesis.model.rank - 1]
    return f"{hypothesis.silhouette.name}{shadow} on {path}, {colors}"
