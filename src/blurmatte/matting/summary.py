"""Summary statistics of a solution: sums, errors, noise, match of the plate, sweep."""

from dataclasses import asdict
from typing import Any

import numpy as np

from blurmatte.checks import Array
from blurmatte.color.model import ColorModel, perpendicular
from blurmatte.matting.maps import PixelMaps, Quality, has_flag
from blurmatte.radiometry import LinearImage, NoiseModel
from blurmatte.streaks import Streak
from blurmatte.sweep.sweep import Sweep


def streak_summary(
    maps: PixelMaps, model: ColorModel, image: LinearImage, plate: LinearImage, streak: Streak
) -> dict[str, Any]:
    """Numbers of pixels, sum of alpha, and their errors."""
    y, x = streak.rows_columns
    certain = ~has_flag(maps.quality[y, x], Quality.PLATE_IN_MODEL)
    inside = streak.mask[y, x] & certain & np.isfinite(maps.alpha_std[y, x])
    alpha, std = (np.asarray(m[y, x][inside], float) for m in (maps.alpha, maps.alpha_std))
    flagged = has_flag(maps.quality[y, x][inside], Quality.MISFIT)
    return {
        "pixels": int(np.count_nonzero(streak.mask)),
        "pixels_known": int(np.count_nonzero(inside)),
        "pixels_misfit": int(np.count_nonzero(flagged)),
        "sum_alpha": float(alpha.sum()),
        "sum_alpha_std": float(np.sqrt(np.sum(std**2))),
        "alpha_scale_std": _scale_std(
            model, image, plate, streak, inside & (image.valid & plate.valid)[y, x]
        ),
    }


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


def sweep_summary(sweep: Sweep) -> dict[str, Any]:
    """Path, outline and size."""
    return {
        "sweep": {
            "silhouette": sweep.silhouette.name,
            "path": sweep.family.name,
            "xy": tuple((float(x), float(y)) for x, y in sweep.trajectory.xy[::4]),
            "length": sweep.length,
            "radius": sweep.radius,
            "radius_std": sweep.radius_std,
            "softness": sweep.softness,
            "opacity": sweep.silhouette.opacity,
            "opacity_std": sweep.opacity_std,
            "outlines": tuple(
                tuple((float(x), float(y)) for x, y in sweep.outline_at(t)[::4]) for t in (0, 1)
            ),
            "diagnostics": asdict(sweep.diagnostics),
            "shadow": None if sweep.cast is None else sweep.cast.numbers,
        },
    }


def noise_summary(picture: LinearImage) -> Any:
    """The noise as plain numbers."""
    noise = picture.noise
    if isinstance(noise, NoiseModel):
        names = ("gain", "read_std", "relative_std")
        return {name: getattr(noise, name) for name in names}
    return {"median_std": float(np.sqrt(np.median(picture.variance)))}


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
