"""solve: image + plate + colors → Solution. The one verb.

The closed form runs over the whole picture, for the error of alpha outside the streak is worth
knowing too; everything beyond it looks at the streak's surroundings only.
"""

from typing import Any

import numpy as np
import numpy.typing as npt

from blurmatte.checks import check_same_size
from blurmatte.color import ColorModel, fit_color, refuse_gray
from blurmatte.matting.pixelwise import PixelMaps, Pixelwise
from blurmatte.matting.plate_check import warn_if_plate_differs
from blurmatte.matting.solution import Quality, Solution
from blurmatte.radiometry import LinearImage, NoiseModel, with_noise
from blurmatte.streaks import Streak, require_streaks, shift_variance

_MARGIN = 16  # pixels around a streak: enough still surroundings to read a plate's shift off


def solve(
    image: LinearImage,
    plate: LinearImage,
    model: ColorModel | None = None,
    solver: Pixelwise | None = None,
    *,
    streak: Streak | None = None,
    out: PixelMaps | None = None,
) -> Solution:
    """Separate a moving object from its background: alpha, color, and the error of both.

    Parameters
    ----------
    image, plate : LinearImage
        The picture with the streak, and the same scene without; the same size. Noise that is not
        known is measured from their difference.
    model : ColorModel, optional
        The colors the object may have; found by `fit_color` from the streak if not given.
    solver : Pixelwise, optional
        How to solve; `Pixelwise()` if not given.
    streak : Streak, optional
        Where the object moved; the strongest of `find_streaks` if not given.
    out : PixelMaps, optional
        Arrays to write the result to, for the next picture of the same size.

    Returns
    -------
    Solution

    Raises
    ------
    TypeError, ValueError
        If image and plate are not `LinearImage` of one size.
    PlateError
        If the pictures are too small or have no unclipped pixel in common.
    MotionError
        If nothing moved.
    ColorModelError
        If no model was given and the streak does not determine one, or the pictures are gray.

    Warns
    -----
    PlateWarning
        If image and plate look swapped, or differ in brightness around the streak.
    """
    for name, picture in (("image", image), ("plate", plate)):
        if not isinstance(picture, LinearImage):
            raise TypeError(
                f"{name} must be a LinearImage, got {type(picture).__name__}; "
                "use blurmatte.read(file) or blurmatte.LinearImage(array of linear light)"
            )
    check_same_size("image", image.size, "plate", plate.size)
    refuse_gray(image, plate)
    image, plate = with_noise(image, plate)
    found = require_streaks(image, plate) if streak is None else [streak]
    streak = found[0]
    warn_if_plate_differs(image, plate, streak)
    if model is None:
        model = fit_color(image, plate, streak)
    solver = solver or Pixelwise()
    maps = solver(
        image.rgb, plate.rgb, model, _noise(image), _noise(plate),
        flags=_flags(image, plate, streak), out=out,
    )  # fmt: skip
    _solve_again_near_edges(maps, image, plate, model, solver, streak)
    stats = {
        **_measures(maps, model, image, plate, streak),
        "streak_box": streak.box,
        "other_boxes": tuple(other.box for other in found[1:]),
        "image_noise": _spoken(image),
        "plate_noise": _spoken(plate),
    }
    return Solution(*maps, model=model, solver=repr(solver), stats=stats)


def _solve_again_near_edges(
    maps: PixelMaps,
    image: LinearImage,
    plate: LinearImage,
    model: ColorModel,
    solver: Pixelwise,
    streak: Streak,
) -> None:
    """Around the streak, let pixels at the plate's edges know that it may be slightly shifted."""
    box = streak.around(_MARGIN)
    place = slice(box[1], box[3]), slice(box[0], box[2])
    image, plate = image.crop(box), plate.crop(box)
    extra = shift_variance(image, plate, image.valid & plate.valid & ~streak.mask[place])
    if not extra.any():
        return
    known = np.uint8(Quality.SATURATED | Quality.OUTSIDE)
    again = solver(
        image.rgb, plate.rgb, model, _noise(image), plate.variance + extra,
        flags=maps.quality[place] & known,
        out=PixelMaps.empty(box[3] - box[1], box[2] - box[0], maps.alpha.dtype),
    )  # fmt: skip
    for whole, part in zip(maps, again, strict=True):
        whole[place] = part


def _noise(picture: LinearImage) -> Any:
    """The noise, of which `with_noise` has seen to it that it is not None."""
    return picture.noise


def _spoken(picture: LinearImage) -> Any:
    """The noise as plain numbers for a report."""
    noise = picture.noise
    if isinstance(noise, NoiseModel):
        names = ("gain", "read_std", "relative_std")
        return {name: getattr(noise, name) for name in names}
    return {"median_std": float(np.sqrt(np.median(picture.variance)))}


def _flags(image: LinearImage, plate: LinearImage, streak: Streak) -> npt.NDArray[np.uint8]:
    saturated = ~(image.valid & plate.valid)
    return np.asarray(
        saturated * np.uint8(Quality.SATURATED) | ~streak.mask * np.uint8(Quality.OUTSIDE), np.uint8
    )


def _measures(
    maps: PixelMaps, model: ColorModel, image: LinearImage, plate: LinearImage, streak: Streak
) -> dict[str, Any]:
    """Numbers about the streak that people ask for first."""
    y, x = streak.rows_columns
    unknown = np.uint8(Quality.SATURATED | Quality.PLATE_IN_MODEL)
    inside = streak.mask[y, x] & ((maps.quality[y, x] & unknown) == 0)
    alpha, std = (np.asarray(m[y, x][inside], float) for m in (maps.alpha, maps.alpha_std))
    flagged = (maps.quality[y, x][inside] & np.uint8(Quality.MISFIT)) != 0
    return {
        "pixels": int(np.count_nonzero(streak.mask)),
        "pixels_known": int(np.count_nonzero(inside)),
        "pixels_misfit": int(np.count_nonzero(flagged)),
        "sum_alpha": float(alpha.sum()),
        "sum_alpha_std": float(np.sqrt(np.sum(std**2))),
        "alpha_scale_std": _scale_std(model, image, plate, streak, inside),
    }


def _scale_std(
    model: ColorModel, image: LinearImage, plate: LinearImage, streak: Streak, inside: Any
) -> float:
    """By which fraction the uncertain color may scale all of alpha together.

    A standard deviation per pixel cannot say this, for the color errs alike in all of them.
    """
    if not inside.any() or not model.covariance.any():
        return 0.0
    y, x = streak.rows_columns
    C, B = (np.asarray(p.rgb[y, x][inside], float) for p in (image, plate))

    def total(pole: npt.NDArray[np.float64]) -> float:
        normals = np.linalg.svd(pole[:, None])[0][:, 1:] if model.rank == 1 else pole[:, None]
        b, d = B @ normals, (B - C) @ normals
        return float(np.sum(np.sum(b * d, axis=1) / (np.sum(b * b, axis=1) + 1e-30)))

    values, directions = np.linalg.eigh(model.covariance)
    change = 0.0
    for value, direction in zip(values[1:], directions.T[1:], strict=True):
        step = np.sqrt(max(value, 0.0)) * direction
        change += ((total(model.pole + step) - total(model.pole - step)) / 2) ** 2
    return float(np.sqrt(change) / max(abs(total(model.pole)), 1e-12))
