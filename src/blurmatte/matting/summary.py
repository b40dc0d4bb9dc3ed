"""Numbers about a solution: sums over its streak with their errors, and alternative hypotheses.

Where the plate has one hue, an object with more alpha and a color nearer to the plate's gives the same
light. Only a shape or an assumption about color separates them, so hypotheses differ in color and in a
factor common to all alpha.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from blurmatte.checks import Array, Indices, check_not_negative
from blurmatte.color.model import ColorModel, perpendicular
from blurmatte.matting.averaging import MIN_WEIGHT
from blurmatte.matting.calibration import GRADE_LIMITS
from blurmatte.matting.maps import Grade, PixelMaps, Quality, has_flag
from blurmatte.radiometry import LinearImage
from blurmatte.statistics import larger_covariance
from blurmatte.streaks import Streak

MAX_ALTERNATIVES = 5  # listed, the result itself included


class StreakSums(NamedTuple):
    """Numbers of pixels and the sum of alpha, as in `SolutionStats`."""

    pixels: int
    pixels_known: int
    pixels_misfit: int
    sum_alpha: float
    sum_alpha_std: float  #: without the error of a common factor
    alpha_scale_std: float

    def with_errors(self, sum_std: float | None, scale_std: float | None) -> "StreakSums":
        """The same with the errors of a solver, where it has its own."""
        return self._replace(
            sum_alpha_std=self.sum_alpha_std if sum_std is None else sum_std,
            alpha_scale_std=self.alpha_scale_std if scale_std is None else scale_std,
        )


def streak_sums(
    maps: PixelMaps, model: ColorModel, image: LinearImage, plate: LinearImage, streak: Streak
) -> StreakSums:
    """Numbers of pixels, sum of alpha, and its errors: those of independent pixels of this color."""
    y, x = streak.rows_columns
    certain = ~has_flag(maps.quality[y, x], Quality.PLATE_IN_MODEL)
    inside = streak.mask[y, x] & certain & np.isfinite(maps.alpha_std[y, x])
    alpha, std = (np.asarray(m[y, x][inside], float) for m in (maps.alpha, maps.alpha_std))
    flagged = has_flag(maps.quality[y, x][inside], Quality.MISFIT)
    valid = (image.valid & plate.valid)[y, x]
    return StreakSums(
        pixels=int(np.count_nonzero(streak.mask)),
        pixels_known=int(np.count_nonzero(inside)),
        pixels_misfit=int(np.count_nonzero(flagged)),
        sum_alpha=float(alpha.sum()),
        sum_alpha_std=float(np.sqrt(np.sum(std**2))),
        alpha_scale_std=_scale_std(model, image, plate, streak, inside & valid),
    )


def mean_light(maps: PixelMaps, y: Indices, x: Indices, alpha: Array) -> Array | None:
    """(3,) light of the object over its alpha, both summed over the pixels of `known_alpha`.

    None if that alpha sums to nothing.
    """
    if not alpha.any():
        return None
    light = np.maximum(maps.premultiplied[y, x], 0).sum(axis=0, dtype=float)
    return np.asarray(light / alpha.sum())


def with_mean_light(
    model: ColorModel, maps: PixelMaps, plate: LinearImage, sums: StreakSums
) -> ColorModel:
    """Colors with the mean light of the object, and with the error that the sum of alpha gives them.

    The mean light is l = Σ (C − (1 − α) B) / Σ α, with the image's light C and the plate's B. If all
    alpha is larger by a factor 1 + ε, it is (l + ε b) / (1 + ε), with b = Σ α B / Σ α. So ε, the
    relative error of the sum of alpha, turns it by the part of ε b / |l| across l. Colors without an
    error, given ones or any, stay.
    """
    y, x, alpha = known_alpha(maps)
    mean, covariance = mean_light(maps, y, x, alpha), model.covariance
    if mean is not None and mean.any() and sums.sum_alpha > 0 and covariance.any():
        length = np.linalg.norm(mean)
        by_factor = alpha @ plate.rgb[y, x] / (alpha.sum() * length)
        relative_std = sums.sum_alpha_std / sums.sum_alpha
        turn = relative_std * _turned(model, mean / length, by_factor)
        covariance = larger_covariance(covariance, np.outer(turn, turn))
    return replace(model, mean=mean, covariance=covariance)


def known_alpha(maps: PixelMaps) -> tuple[Indices, Indices, Array]:
    """Rows, columns and alpha (n,), 0 to 1, of pixels of the layer whose alpha and light are known."""
    unknown = Quality.OUTSIDE | Quality.PLATE_IN_MODEL
    y, x = np.nonzero((maps.alpha > 0) & ~has_flag(maps.quality, unknown))
    known = np.isfinite(maps.alpha_std[y, x]) & np.isfinite(maps.premultiplied_std[y, x]).all(1)
    y, x = y[known], x[known]
    return y, x, np.minimum(maps.alpha[y, x], 1).astype(float)


def _turned(model: ColorModel, direction: Array, change: Array) -> Array:
    """Change (3,) of the pole if the direction (3,) of a color that the model contains changes."""
    pole = model.pole
    if model.rank == 1:
        return np.asarray(change - (change @ pole) * pole)
    return np.asarray(-(change @ pole) * direction)


def _scale_std(
    model: ColorModel, image: LinearImage, plate: LinearImage, streak: Streak, inside: Any
) -> float:
    """Relative standard deviation of the sum of alpha by the uncertainty of the color.

    All pixels share this error, so standard deviations of pixels do not contain it.
    """
    if not inside.any() or not model.covariance.any():
        return 0.0
    y, x = streak.rows_columns
    C, B = (np.asarray(p.rgb[y, x][inside], float) for p in (image, plate))

    def total(pole: Array) -> float:
        """Sum of alpha for a pole of the color model."""
        normals = perpendicular(pole) if model.rank == 1 else pole[:, None]
        b, d = B @ normals, (B - C) @ normals
        return float(np.sum(np.sum(b * d, axis=1) / (np.sum(b * b, axis=1) + 1e-30)))

    values, directions = np.linalg.eigh(model.covariance)
    change = 0.0
    for value, direction in zip(values[1:], directions.T[1:], strict=True):
        step = np.sqrt(max(value, 0.0)) * direction
        change += ((total(model.pole + step) - total(model.pole - step)) / 2) ** 2
    return float(np.sqrt(change) / max(abs(total(model.pole)), 1e-12))


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
    def hides_nothing(self) -> bool:
        """Whether its alpha is 0 in two decimals: the picture is the plate and light added to it."""
        return round(self.alpha_factor, 2) == 0

    @property
    def disagrees(self) -> bool:
        """Whether its alpha differs from the result's by more than a confirmed error."""
        error, scale = GRADE_LIMITS[Grade.CONFIRMED]
        return self.alpha_difference > error or abs(self.alpha_factor - 1) > scale


def ordered(alternatives: Sequence[Alternative], weights: Array, own: int) -> list[Alternative]:
    """That of the result, and those that matter or disagree with it, in order of weights (n,)."""
    others = [i for i in np.argsort(-weights, kind="stable") if i != own]
    kept = [alternatives[own]]
    for one in (alternatives[i] for i in others):
        if one.matters or one.disagrees:
            kept.append(one)
    return kept[:MAX_ALTERNATIVES]
