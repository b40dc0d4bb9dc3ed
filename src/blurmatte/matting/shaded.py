"""Shaded: alpha of each pixel alone where the object's own shadow may lie on the plate.

In this file C is the image's light, B the plate's, P the object's and S the fraction of the exposure in
which a pixel's plate was in shadow: C = P + (1 − α − S) B + S B', with B' the plate in shadow. A color
model alone cannot separate α from S, because a shadow without hue looks like a black object. Either of
two more quantities can:

    the object's light o, constant over it         C − B = α (o − B) − S B           two unknowns
    the plate in shadow, of another hue            C − B = k l − α B + S (B' − B)    three

The first assumes a black shadow, and S is the lost fraction; l is the direction of a line of colors.
Each is a weighted least-squares fit, and its covariance gives the errors.

If no sweep locates the object, pixels of the streak that only lost light are flagged. Black parts of
an object look the same, and alpha is that of such a part. If it is a shadow, alpha is only the light
divided by the object's brightness; the difference is added to the error.
"""

from dataclasses import dataclass, replace

import numpy as np

from blurmatte.background import Match
from blurmatte.checks import Array, Bools, check_same_size, rows_columns
from blurmatte.color.model import ColorModel
from blurmatte.color.shadows import MARGIN_PX, cast_shadow_mask, darker_pixels
from blurmatte.errors import ColorModelError
from blurmatte.matting.case import Answer, Case, Solver
from blurmatte.matting.maps import (
    MAX_CHI2,
    MAX_RANGE_STDS,
    MIN_VARIANCE,
    PixelMaps,
    Quality,
    alpha_flags,
    has_flag,
)
from blurmatte.matting.pixelwise import closed_form
from blurmatte.matting.stats import SolutionStats
from blurmatte.radiometry import LinearImage
from blurmatte.streaks import Streak


@dataclass(frozen=True, eq=False)
class Shaded(Solver):
    """Solve each pixel alone for alpha and the object's shadow on the plate.

    Give exactly one of `light` and `plate`.

    Parameters
    ----------
    light : three floats, optional
        The object's linear light at alpha 1, constant over it: a matt object in uniform light.
    plate : LinearImage, optional
        The plate in the object's shadow, wherever the shadow may have been. If the shadow does not
        change the hue, there is no information, and the error is large.
    max_alpha_std : float
        A pixel with a larger standard deviation of alpha is marked PLATE_IN_MODEL, > 0.

    Raises
    ------
    ValueError
        If not exactly one is given, the light is not positive, or `max_alpha_std` is not positive.

    Examples
    --------
    >>> answer = bm.solve(image, plate, solution.model, bm.matting.Shaded(light=orange))
    >>> answer.stats.sum_shadow is not None
    True
    """

    light: tuple[float, float, float] | None = None
    plate: LinearImage | None = None
    max_alpha_std: float = 0.3

    def __post_init__(self) -> None:
        if (self.light is None) == (self.plate is None):
            raise ValueError("give the object's light or the plate in shadow: exactly one of both")
        if self.light is not None:
            light = np.asarray(self.light, dtype=float)
            if light.shape != (3,) or not np.all(np.isfinite(light)) or not light.max() > 0:
                raise ValueError(
                    f"light must be three finite numbers, some above 0, got {self.light}"
                )
            object.__setattr__(self, "light", tuple(light.tolist()))
        if not self.max_alpha_std > 0:
            raise ValueError(f"max_alpha_std must be positive, got {self.max_alpha_std}")

    def __repr__(self) -> str:
        known = f"light={self.light}" if self.plate is None else "plate in shadow"
        return f"Shaded({known})"

    def colors(self, model: ColorModel | None) -> ColorModel | None:
        """The line of the object's light if it is known, else the given line."""
        if self.light is not None:
            return ColorModel.from_samples(np.array([self.light]), std=1e-9)
        if model is None:
            raise ColorModelError(
                "give the color of the object (--color): with a plate in shadow it separates object "
                "and shadow, and a streak that holds both does not show it"
            )
        if model.rank != 1:
            raise ValueError(f"a plate in shadow needs a model of rank 1, got rank {model.rank}")
        return model

    def matched(self, match: Match) -> "Shaded":
        """With its plate in shadow matched."""
        return self if self.plate is None else replace(self, plate=match.apply(self.plate))

    @property
    def refusal_in_clips(self) -> str:
        """A plate in shadow is of one picture."""
        if self.plate is None:
            return ""
        return "in a clip Shaded needs the object's light: the shadow moves with the object"

    def answer(self, case: Case, out: PixelMaps | None) -> Answer:
        """Solve the streak of a case."""
        box, model = case.streak.around(MARGIN_PX), case.model
        maps = closed_form(case, case.box_with(()), out)
        near, image, plate = maps.within(box), case.image.crop(box), case.plate.crop(box)
        C, B = (np.asarray(picture.rgb, float) for picture in (image, plate))
        known = image.valid & plate.valid
        if self.plate is None:
            o = np.asarray(self.light)
            X = np.stack([o - B, -B], axis=-1)
        else:
            shaded = case.pictures.match.apply(self.plate).crop(box)
            check_same_size("the plate in shadow", shaded.size, "the image", image.size)
            l = np.broadcast_to(model.basis[:, 0], B.shape)
            X = np.stack([-B, shaded.rgb - B, l], axis=-1)
            known = known & shaded.valid
        found, covariance, chi2 = _least_squares(X, C - B, image, plate)
        std = np.sqrt(np.maximum(np.diagonal(covariance, axis1=-2, axis2=-1), 0))
        alpha, alpha_std, S = found[..., 0], std[..., 0], found[..., 1]
        if self.plate is None:
            P, P_std = alpha[..., None] * o, alpha_std[..., None] * np.abs(o)
        else:
            P, P_std = found[..., 2:] * l, std[..., 2:] * np.abs(l)
        for target, values in zip(near, (alpha, alpha_std, P, P_std), strict=False):
            target[known] = values[known]
        dark = (std[..., 1] * MAX_RANGE_STDS < S) & ~has_flag(near.quality, Quality.OUTSIDE)
        flags = (
            near.quality & np.uint8(Quality.OUTSIDE)
            | alpha_flags(alpha, alpha_std, self.max_alpha_std)
            | dark * np.uint8(Quality.SHADOW)
            | (chi2 > MAX_CHI2) * np.uint8(Quality.MISFIT)
        )
        near.quality[known] = flags[known]
        inside = case.streak.mask[rows_columns(box)] & known
        stats = SolutionStats(sum_shadow=float(S[inside].sum()))
        # The light of an object is rarely constant, and no factor of it is fitted.
        assumes = "" if self.light is None else "light"
        return Answer(maps, model, case.streak, stats, assumes=assumes, separates_shadow=True)


def _least_squares(
    X: Array, y: Array, image: LinearImage, plate: LinearImage
) -> tuple[Array, Array, Array]:
    """Unknowns (h, w, p) of X (h, w, 3, p) and y (h, w, 3), their covariance, and residual χ².

    With the shadow there are two or three unknowns; the closed form of `pixelwise` has one, alpha.
    """
    through = np.ones(y.shape[:2])
    for _ in range(2):  # the weights depend on α and S
        variance = image.variance + through[..., None] ** 2 * plate.variance + MIN_VARIANCE
        weighted = X / variance[..., None]
        normal = np.swapaxes(weighted, -1, -2) @ X
        # The small diagonal keeps undetermined unknowns finite, with a huge error.
        covariance = np.linalg.inv(normal + 1e-12 * np.eye(X.shape[-1]))
        found = np.einsum("hwpq,hwcq,hwc->hwp", covariance, weighted, y)
        through = 1 - np.clip(found[..., 0] + found[..., 1], 0, 1)
    residual = y - np.einsum("hwcp,hwp->hwc", X, found)
    return np.asarray(found), np.asarray(covariance), np.sum(residual**2 / variance, axis=-1)


def mark_shadow(
    maps: PixelMaps,
    image: LinearImage,
    plate: LinearImage,
    streak: Streak,
    model: ColorModel,
    without_sweep: bool,
    whole: bool,
) -> float:
    """Set the flag SHADOW where the image is only darker than the plate, and increase the error there.

    maps: a solution; flags and errors are changed in place.
    image, plate: noise known.
    without_sweep: whether no sweep locates the object. Then, if it has one color, pixels with
        clearly less light than the rest of the object are shadow.
    whole: whether the whole streak only lost light.

    Returns the error of the sum of alpha if the marked pixels are the object's shadow.
    """
    box = streak.box
    place = rows_columns(box)
    if not whole and not (without_sweep and model.rank == 1):
        return 0.0
    shadow = streak.mask
    if not whole:
        brightness = _brightness(maps, model, streak.mask)
        shadow = cast_shadow_mask(image, plate, streak, model.pole, brightness)
    marked = (shadow & streak.mask)[place] & darker_pixels(image.crop(box), plate.crop(box))
    maps.quality[place] |= marked * np.uint8(Quality.SHADOW)
    if whole or not marked.any():
        return 0.0
    lit = _brightness(maps, model, streak.mask & ~has_flag(maps.quality, Quality.SHADOW))
    return _widen(maps.within(box), marked, model, lit)


def _widen(maps: PixelMaps, marked: Bools, model: ColorModel, brightness: float) -> float:
    """Add the alpha in excess of the light to the error; the sum of the excess."""
    alpha = maps.alpha[marked].astype(float)
    light = np.nan_to_num(maps.premultiplied[marked] @ model.pole)
    excess = np.maximum(alpha - np.clip(light / max(brightness, 1e-12), 0, 1), 0)
    maps.alpha_std[marked] = np.hypot(maps.alpha_std[marked], excess)
    return float(excess.sum())


def _brightness(maps: PixelMaps, model: ColorModel, inside: Bools) -> float:
    """Light of the object along its color at alpha 1."""
    y, x = np.nonzero(inside)
    known = np.isfinite(maps.premultiplied_std[y, x]).all(axis=-1)
    known &= ~has_flag(maps.quality[y, x], Quality.PLATE_IN_MODEL)
    y, x = y[known], x[known]
    alpha = np.clip(maps.alpha[y, x], 0, 1).astype(float)
    light = maps.premultiplied[y, x] @ model.pole
    return float(np.sum(light * alpha) / max(float(np.sum(alpha**2)), 1e-12))
