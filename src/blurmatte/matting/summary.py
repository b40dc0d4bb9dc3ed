"""Sums of a solution over its streak, and their errors."""

from typing import Any, NamedTuple

import numpy as np

from blurmatte.checks import Array
from blurmatte.color.model import ColorModel, perpendicular
from blurmatte.matting.maps import PixelMaps, Quality, has_flag
from blurmatte.radiometry import LinearImage
from blurmatte.streaks import Streak


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


def mean_light(maps: PixelMaps) -> Array | None:
    """(3,) light of the object over its alpha, both summed as in `Solution.layer`.

    None if that alpha sums to nothing.
    """
    unknown = Quality.OUTSIDE | Quality.PLATE_IN_MODEL
    y, x = np.nonzero((maps.alpha > 0) & ~has_flag(maps.quality, unknown))
    known = np.isfinite(maps.alpha_std[y, x]) & np.isfinite(maps.premultiplied_std[y, x]).all(1)
    total = float(np.minimum(maps.alpha[y, x][known], 1).sum(dtype=float))
    if total == 0:
        return None
    light = np.maximum(maps.premultiplied[y, x][known], 0).sum(axis=0, dtype=float)
    return np.asarray(light / total)


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
