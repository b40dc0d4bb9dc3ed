"""solve: image + plate + colors → Solution. The one verb.

The closed form runs over the whole picture, for the error of alpha outside the streak is worth
knowing too; everything beyond it looks at the streak's surroundings only.
"""

from copy import deepcopy
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt

from blurmatte.background import Match, Matching, agreement, fit_match
from blurmatte.checks import Bools, check_kind, check_map, check_same_size
from blurmatte.color import ColorModel, only_light_lost, refuse_gray, refuse_shade
from blurmatte.errors import ColorModelError, MotionError
from blurmatte.matting.carried_light import carry_light
from blurmatte.matting.clipped import solve_clipped
from blurmatte.matting.mixed_plate import MixedPlate, mixed_plate, solve_mixed_plate
from blurmatte.matting.pixelwise import PixelMaps, Pixelwise
from blurmatte.matting.plate_check import may_be_swapped, warn_if_plate_differs
from blurmatte.matting.rims import with_faint_rims
from blurmatte.matting.rival import is_rival, widen
from blurmatte.matting.shaded import Shaded
from blurmatte.matting.shadow import mark_shadow
from blurmatte.matting.smooth import Smooth
from blurmatte.matting.solution import Quality, Solution
from blurmatte.matting.swept import Swept
from blurmatte.radiometry import LinearImage, NoiseModel, check_same_colors, with_noise
from blurmatte.streaks import Streak, check_streak, joined_behind, require_streaks
from blurmatte.sweep import Sweep, fit_sweep
from blurmatte.sweep.color import color_of

_NO_COLOR = (
    "an object of any colors is told by its shape and motion, or by a plate full of texture, and here "
    "by neither{}; give its color, or take the pictures so that it moves evenly and alone"
)
Solver = Pixelwise | Smooth | Swept | Shaded

_UNTOLD = (
    0.08  # of the largest alpha: a standard deviation with which it was wrong by 0.2 in trials
)
_MARGIN = 16  # pixels around a streak: enough still surroundings to read a plate's shift off


def solve(
    image: LinearImage,
    plate: LinearImage,
    model: ColorModel | None = None,
    solver: Solver | None = None,
    *,
    streak: Streak | None = None,
    matching: Matching | None = None,
    occluder: Bools | None = None,
    out: PixelMaps | None = None,
    start: Sweep | None = None,
) -> Solution:
    """Separate a moving object from its background: alpha, color, and the error of both.

    Parameters
    ----------
    image, plate : LinearImage
        The picture with the streak, and the same scene without; the same size. Noise that is not
        known is measured from their difference.
    model : ColorModel, optional
        The colors the object may have; found from the streak if not given, as by `fit_color`.
    solver : Pixelwise, Smooth, Swept or Shaded, optional
        How to solve. If not given: `Swept()` where a sweep explains the streak, with the model if one
        is given, else `Smooth()`; `Solution.solver` says which it was.
    streak : Streak, optional
        Where the object moved; the strongest of `find_streaks` if not given.
    matching : Matching, optional
        How the plate may be changed to match the image first (`fit_match`); found from the data if not
        given.
    occluder : (H, W) bool, optional
        Where something still is in front of the object, such as a fence. Nothing is fitted there; alpha
        behind it is carried over from path and shape, or from its neighbors, and OCCLUDED.
    out : PixelMaps, optional
        Arrays to write the result to, for the next picture of the same size.
    start : Sweep, optional
        `Solution.sweep` of another frame of a clip, in which the object went about the same way
        elsewhere; see `fit_sweep`.

    Returns
    -------
    Solution

    Raises
    ------
    TypeError, ValueError
        If image and plate are not `LinearImage` of one size, the streak is of another, the occluder is
        not (H, W) bool, or another argument is of another kind.
    PlateError
        If the pictures are too small or have no unclipped pixel in common, or the plate shows another
        place or too different a light.
    MotionError
        If nothing moved, or a `Swept` solver was asked for and no sweep explains the streak.
    ColorModelError
        If no model was given and the streak does not determine one, or only took light, as a shadow
        does; or the pictures are gray.

    Warns
    -----
    PlateWarning
        If image and plate look swapped, or differ in brightness around the streak.
    """
    check_same_colors("the image", image, "the plate", plate)
    check_same_size("image", image.size, "plate", plate.size)
    _check_choices(model, solver, streak, image)
    check_kind("out", out, PixelMaps | None, "use blurmatte.PixelMaps.empty(height, width)")
    check_kind("start", start, Sweep | None, "use Solution.sweep of another frame")
    refuse_gray(image, plate)
    if model is not None and model.to_srgb != image.meta.to_srgb:
        model = replace(model, to_srgb=image.meta.to_srgb)
    match = fit_match(image, plate, matching)
    image, plate = with_noise(image, match.apply(plate))
    hidden = np.zeros(image.valid.shape, bool) if occluder is None else occluder
    check_map("occluder", hidden, image.valid.shape, kinds="b")
    image = _without(image, hidden)
    found = require_streaks(image, plate) if streak is None else [streak]
    found = joined_behind(found, hidden) if streak is None else found
    streak = found[0]
    warn_if_plate_differs(image, plate, streak)
    only_lost = model is not None and only_light_lost(image, plate, streak)
    if model is not None and model.rank == 3:
        refuse_shade(image, plate, streak)
    model = _of_light(solver, model)
    given = model is not None
    asked = isinstance(solver, Pixelwise | Smooth | Shaded)
    sweep = (
        None if asked and model is not None else fit_sweep(image, plate, streak, model, start=start)
    )
    if sweep is not None:
        image, plate = (_louder(picture, sweep.stats["louder"]) for picture in (image, plate))
    swept = _chosen(solver, sweep)
    most = (swept or Swept()).max_misfit
    if model is None:
        assert sweep is not None
        model = _color_of(sweep, image, plate, streak, most)
    elif swept is not None and sweep is not None and model.covariance.any():
        model = sweep.model  # the streak knows more of it than the caller was sure of
    pixelwise = solver if isinstance(solver, Pixelwise) else Pixelwise()
    flags = _flags(image, plate, streak, hidden)
    maps = _closed_form(pixelwise, image, plate, model, flags, out)
    box = streak.around(_MARGIN)
    C, B, mixed = _within(image, plate, streak, box)
    solve_mixed_plate(maps.within(box), mixed, C, B, model, pixelwise.max_alpha_std)
    together: dict[str, Any] = {}
    rival_off, doubt = 0.0, 0.0
    used: Solver = pixelwise
    if swept is not None and sweep is not None:
        used = swept
        box = _box_of_both(streak, sweep)
        C, B, mixed = _within(image, plate, streak, box)
        left = swept(maps, sweep, C, mixed.widened(B), box)
        if left.any():
            _smooth_patches(maps.within(box), left, C, B, model, mixed)
            if not given:
                _, doubt = widen(maps, sweep, plate, left, box)
        together = _sweep_measures(sweep)
    elif isinstance(solver, Shaded):
        used = solver
        together = _solve_shaded(solver, maps, image, plate, match, model, streak)
    elif not isinstance(solver, Pixelwise):
        used = solver if isinstance(solver, Smooth) else Smooth()
        wide = streak if np.isnan(streak.evidence) else with_faint_rims(streak, image, plate, model)
        box = wide.around(_MARGIN)
        inside = wide.mask[box[1] : box[3], box[0] : box[2]]
        C, B, mixed = _within(image, plate, streak, box)
        together = used(maps, C, B, model, inside, box, mixed)
    if sweep is not None and not given and sweep.misfit > most and is_rival(sweep, model):
        box = streak.around(0)
        inside = streak.mask[box[1] : box[3], box[0] : box[2]]
        rival_off, doubt = widen(maps, sweep, plate, inside, box)
    if not isinstance(used, Shaded):
        alone = used is not swept
        in_shadow = mark_shadow(maps, image, plate, streak, model, alone=alone, whole=only_lost)
        doubt = float(np.hypot(doubt, in_shadow))
    if not isinstance(used, Pixelwise | Shaded):
        carry_light(maps.within(box), image.crop(box), plate.crop(box))
        streak = Streak((maps.quality & np.uint8(Quality.OUTSIDE)) == 0)
    _refuse_the_untold(maps, model, streak, sweep)
    stats = {
        **_measures(maps, model, image, plate, streak),
        "streak_box": streak.box,
        "other_boxes": tuple(other.box for other in found[1:]),
        "image_noise": _spoken(image),
        "plate_noise": _spoken(plate),
        "match": _match_measures(match, image, plate),
        "only_light_lost": only_lost,
        "exposure_time": image.meta.exposure_time,
        **together,
        "rival_off": rival_off,
    }
    stats["sum_alpha_std"] = float(np.hypot(stats["sum_alpha_std"], doubt))
    explains = sweep if swept is not None else None
    return Solution(*maps, model=model, solver=repr(used), stats=stats, sweep=explains)


def _check_choices(
    model: ColorModel | None, solver: Solver | None, streak: Streak | None, image: LinearImage
) -> None:
    """Raise TypeError or ValueError unless they are what `solve` takes."""
    hint = 'use blurmatte.ColorModel.from_hex("#d8ff3c"); a solver comes after it, or as solver='
    check_kind("model", model, ColorModel | None, hint)
    check_kind("solver", solver, Solver | None, "such as blurmatte.Smooth()")
    check_streak("streak", streak)
    if streak is not None:
        check_map("streak.mask", streak.mask, image.valid.shape, kinds="b")


def _color_of(
    sweep: Sweep, image: LinearImage, plate: LinearImage, streak: Streak, most: float
) -> ColorModel:
    """What the streak tells of the color; its refusal also asks whether the pictures are swapped."""
    try:
        return color_of(sweep, image, plate, streak, np.inf, most)
    except ColorModelError as error:
        if not may_be_swapped(image, plate, streak):
            raise
        raise ColorModelError(
            f"{error}. Are image and plate swapped? The plate's texture is fainter than the image's "
            "where something moved, and the plate is the picture without the object"
        ) from error


def _of_light(solver: Solver | None, model: ColorModel | None) -> ColorModel | None:
    """The model, or that of the object's light if it is known."""
    if not isinstance(solver, Shaded):
        return model
    if solver.light is not None:
        return ColorModel.from_samples(np.array([solver.light]), std=1e-9)
    if model is not None and model.rank != 1:
        raise ValueError(f"a plate in shadow needs a model of rank 1, got rank {model.rank}")
    return model


def _solve_shaded(
    solver: Shaded,
    maps: PixelMaps,
    image: LinearImage,
    plate: LinearImage,
    match: Match,
    model: ColorModel,
    streak: Streak,
) -> dict[str, Any]:
    """Around the streak, alpha and shadow of each pixel."""
    box = streak.around(_MARGIN)
    shaded = None
    if solver.plate is not None:
        shaded = match.apply(solver.plate).crop(box)
    S = solver(maps.within(box), image.crop(box), plate.crop(box), shaded, model)
    inside = streak.mask[box[1] : box[3], box[0] : box[2]]
    return {"sum_shadow": float(S[inside].sum())}


def _smooth_patches(
    maps: PixelMaps,
    patches: Bools,
    image: LinearImage,
    plate: LinearImage,
    model: ColorModel,
    mixed: MixedPlate,
) -> None:
    """Where the sweep left pixels to themselves, what all of them together say."""
    h, w = patches.shape
    inside = (maps.quality & np.uint8(Quality.OUTSIDE)) == 0
    together = deepcopy(maps)
    Smooth()(together, image, plate, model, inside, (0, 0, w, h), mixed)
    for target, values in zip(maps[:4], together, strict=False):
        target[patches] = values[patches]


def _refuse_the_untold(
    maps: PixelMaps, model: ColorModel, streak: Streak, sweep: Sweep | None
) -> None:
    """Raise ColorModelError if nothing tells the alpha of an object of any colors."""
    if model.rank < 3:
        return
    alpha, std = maps.alpha[streak.mask], maps.alpha_std[streak.mask]
    if np.median(std) <= _UNTOLD * np.percentile(alpha, 99) and alpha.sum() > 0:
        return
    left = "" if sweep is None else f" ({sweep.complaint(Swept().max_misfit)})"
    raise ColorModelError(_NO_COLOR.format(left))


def _chosen(solver: Solver | None, sweep: Sweep | None) -> Swept | None:
    """The solver that uses the sweep, if it is to be used."""
    if sweep is None or isinstance(solver, Pixelwise | Smooth | Shaded):
        return None
    swept = solver or Swept()
    if sweep.misfit <= swept.max_misfit:
        return swept
    if solver is None:
        return None
    raise MotionError(
        f"the shape of the streak does not tell alpha: {sweep.complaint(swept.max_misfit)}; use "
        "Smooth() and give the object's color"
    )


def _box_of_both(streak: Streak, sweep: Sweep) -> tuple[int, int, int, int]:
    """Around streak and sweep, with something still beside them."""
    (a, b, c, d), (e, f, g, h) = streak.around(_MARGIN), sweep.box
    return min(a, e), min(b, f), max(c, g), max(d, h)


def _match_measures(match: Match, image: LinearImage, plate: LinearImage) -> dict[str, Any]:
    """What was done to the plate, and how well it fits now."""
    everywhere, at_edges = agreement(image, plate)
    return {**match.facts, "agreement": everywhere, "edge_agreement": at_edges}


def _sweep_measures(sweep: Sweep) -> dict[str, Any]:
    return {
        "sum_alpha_std": sweep.area_std(),
        "alpha_scale_std": 0.0,  # the color's part is in the area's already
        "sweep": {
            "silhouette": sweep.silhouette.name,
            "path": sweep.family.name,
            "xy": tuple((float(x), float(y)) for x, y in sweep.trajectory.xy[::4]),
            "length": sweep.length,
            "radius": sweep.radius,
            "radius_std": sweep.radius_std,
            "softness": sweep.softness,
            "outlines": tuple(
                tuple((float(x), float(y)) for x, y in sweep.outline_at(t)[::4]) for t in (0, 1)
            ),
            "misfit": sweep.misfit,
            "texture": sweep.stats["texture"] if np.isfinite(sweep.stats["texture"]) else None,
            "shadow": None if sweep.cast is None else sweep.cast.numbers,
            "highlight": sweep.stats["highlight"],
        },
    }


def _without(image: LinearImage, hidden: Bools) -> LinearImage:
    """The image, not valid where something is in front; nor clipped there, for no channel tells."""
    rgb = np.where((hidden & ~image.valid)[..., None], image.rgb.dtype.type(0), image.rgb)
    return replace(image, rgb=rgb, valid=image.valid & ~hidden) if hidden.any() else image


def _closed_form(
    solver: Pixelwise,
    image: LinearImage,
    plate: LinearImage,
    model: ColorModel,
    flags: npt.NDArray[np.uint8],
    out: PixelMaps | None,
) -> PixelMaps:
    """Each pixel alone, also by two channels where the third is clipped."""
    maps = solver(
        image.rgb, plate.rgb, model, _noise(image), _noise(plate), flags=flags, out=out
    )  # fmt: skip
    solve_clipped(maps, image, plate, model, solver.max_alpha_std)
    return maps


def _within(
    image: LinearImage, plate: LinearImage, streak: Streak, box: tuple[int, int, int, int]
) -> tuple[LinearImage, LinearImage, MixedPlate]:
    """Both within a box, and where the plate's edges fit badly, as they do beside the streak."""
    inside = streak.mask[box[1] : box[3], box[0] : box[2]]
    image, plate = image.crop(box), plate.crop(box)
    return image, plate, mixed_plate(image, plate, image.valid & plate.valid & ~inside)


def _noise(picture: LinearImage) -> Any:
    """The noise, of which `with_noise` has seen to it that it is not None."""
    return picture.noise


def _louder(picture: LinearImage, by: float) -> LinearImage:
    """With the noise that a sweep found where a codec hides it; see `fit_sweep`."""
    return picture if by == 1 else picture.with_noise(by * picture.variance)


def _spoken(picture: LinearImage) -> Any:
    """The noise as plain numbers for a report."""
    noise = picture.noise
    if isinstance(noise, NoiseModel):
        names = ("gain", "read_std", "relative_std")
        return {name: getattr(noise, name) for name in names}
    return {"median_std": float(np.sqrt(np.median(picture.variance)))}


def _flags(
    image: LinearImage, plate: LinearImage, streak: Streak, hidden: Bools
) -> npt.NDArray[np.uint8]:
    saturated = ~(image.valid & plate.valid) & ~hidden
    return np.asarray(
        saturated * np.uint8(Quality.SATURATED)
        | ~streak.mask * np.uint8(Quality.OUTSIDE)
        | hidden * np.uint8(Quality.OCCLUDED),
        np.uint8,
    )


def _measures(
    maps: PixelMaps, model: ColorModel, image: LinearImage, plate: LinearImage, streak: Streak
) -> dict[str, Any]:
    """Numbers about the streak that people ask for first."""
    y, x = streak.rows_columns
    told = (maps.quality[y, x] & np.uint8(Quality.PLATE_IN_MODEL)) == 0
    inside = streak.mask[y, x] & told & np.isfinite(maps.alpha_std[y, x])
    alpha, std = (np.asarray(m[y, x][inside], float) for m in (maps.alpha, maps.alpha_std))
    flagged = (maps.quality[y, x][inside] & np.uint8(Quality.MISFIT)) != 0
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
