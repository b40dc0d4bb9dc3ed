"""solve: image + plate + colors → Solution. The one verb.

The closed form runs over the whole picture, for the error of alpha outside the streak is worth
knowing too; everything beyond it looks at the streak's surroundings only.
"""

from copy import deepcopy
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from blurmatte.background import Match, Matching, fit_match
from blurmatte.checks import Bools, check_kind, check_map, check_same_size
from blurmatte.color import (
    ColorModel,
    most_of_color,
    only_light_lost,
    refuse_coarse,
    refuse_gray,
    refuse_shade,
)
from blurmatte.errors import ColorModelError, MotionError
from blurmatte.matting.carried_light import carry_light
from blurmatte.matting.clipped import solve_clipped
from blurmatte.matting.measures import (
    match_measures,
    noise_measures,
    streak_measures,
    sweep_measures,
)
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
from blurmatte.radiometry import LinearImage, check_same_colors, with_noise
from blurmatte.streaks import (
    Streak,
    check_streak,
    joined_behind,
    require_streaks,
    strongest_told,
)
from blurmatte.sweep import Sweep, fit_piece
from blurmatte.sweep.color import color_of
from blurmatte.sweep.fit import NO_SHAPE

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
        Where the object moved. If not given, the one of `find_streaks` in which most light of the
        color shows; or, if that is not given, the strongest that a sweep explains, those that are
        whole in the picture before the others; or the strongest. Of what moved close beside the
        object a sweep may explain a piece: `Solution.streak` is that.
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
        does, or a JPEG holds too little color of one so small; or the pictures are gray.

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
    found = [streak] if streak is not None else joined_behind(require_streaks(image, plate), hidden)
    asked = found if model is None else [most_of_color(found, image, plate, model)]

    def told_by(streak: Streak) -> tuple[_Case, Streak]:
        case = _case_of(image, plate, match, streak, hidden, model, solver, start)
        if streak is not asked[0] and not case.is_explained:
            raise MotionError(NO_SHAPE)
        return case, streak

    try:
        case, whole = strongest_told(asked, told_by)
    except (ColorModelError, MotionError):
        warn_if_plate_differs(image, plate, asked[0])  # it may be why nothing is told
        raise
    warn_if_plate_differs(image, plate, whole)
    streak = case.streak
    others = [other for other in found if other is not whole]
    if streak is not whole:
        others.append(Streak(whole.mask & ~streak.mask))
    only_lost = model is not None and only_light_lost(image, plate, streak)
    maps = _each_alone(case, out)
    measures, doubts = _by_solver(case, maps)
    rival_off, doubt = _widened_by_rival(case, maps)
    doubts.append(doubt)
    if not isinstance(case.solver, Shaded):
        alone = not isinstance(case.solver, Swept)
        pictures = case.image, case.plate
        doubts.append(
            mark_shadow(maps, *pictures, streak, case.model, alone=alone, whole=only_lost)
        )
    if not isinstance(case.solver, Pixelwise | Shaded):
        streak = Streak((maps.quality & np.uint8(Quality.OUTSIDE)) == 0)
    _refuse_the_untold(maps, case.model, streak, case.sweep)
    stats = {
        **streak_measures(maps, case.model, case.image, case.plate, streak),
        "streak_box": streak.box,
        "other_boxes": tuple(other.box for other in others),
        "image_noise": noise_measures(case.image),
        "plate_noise": noise_measures(case.plate),
        "match": match_measures(match, case.image, case.plate),
        "only_light_lost": only_lost,
        "exposure_time": image.meta.exposure_time,
        **measures,
        "rival_off": rival_off,
    }
    stats["sum_alpha_std"] = float(np.linalg.norm([stats["sum_alpha_std"], *doubts]))
    return Solution(
        *maps, model=case.model, solver=repr(case.solver), stats=stats, sweep=case.explanation
    )


@dataclass(frozen=True, eq=False)
class _Case:
    """What is solved: pictures that match, where, by which solver, and what is known before.

    Parameters
    ----------
    image, plate : LinearImage
        Noise known; the image is not valid where something is in front.
    match : Match
        What was done to the plate.
    streak : Streak
    hidden : (H, W) bool
        Where something is in front.
    solver : Solver
    model : ColorModel
    given : bool
        Whether the caller knew the colors.
    sweep : Sweep, optional
        Whether it explains the streak or not.
    """

    image: LinearImage
    plate: LinearImage
    match: Match
    streak: Streak
    hidden: Bools
    solver: Solver
    model: ColorModel
    given: bool
    sweep: Sweep | None

    @property
    def is_explained(self) -> bool:
        """Whether a sweep explains the streak, used or not."""
        if isinstance(self.solver, Swept):
            return True
        return self.sweep is not None and self.sweep.misfit <= Swept().max_misfit

    @property
    def explanation(self) -> Sweep | None:
        """The sweep that alpha comes from."""
        return self.sweep if isinstance(self.solver, Swept) else None

    def within(self, box: tuple[int, int, int, int]) -> tuple[LinearImage, LinearImage, MixedPlate]:
        """Both within a box, and where the plate's edges fit badly, as they do beside the streak."""
        inside = self.streak.mask[box[1] : box[3], box[0] : box[2]]
        image, plate = self.image.crop(box), self.plate.crop(box)
        return image, plate, mixed_plate(image, plate, image.valid & plate.valid & ~inside)


def _case_of(
    image: LinearImage,
    plate: LinearImage,
    match: Match,
    streak: Streak,
    hidden: Bools,
    model: ColorModel | None,
    solver: Solver | None,
    start: Sweep | None,
) -> _Case:
    """The sweep, the colors if they were not given, and the solver if none was asked for."""
    model = _of_light(solver, model)
    if model is not None and model.rank == 3:
        refuse_shade(image, plate, streak)
    if model is None or model.rank == 3:
        refuse_coarse(image, streak)
    given, sweep = model is not None, None
    if not given or not isinstance(solver, Pixelwise | Smooth | Shaded):
        sweep, streak = fit_piece(image, plate, streak, model, start)
        image, plate = (_louder(picture, sweep.stats["louder"]) for picture in (image, plate))
    swept = _chosen(solver, sweep)
    if model is None:
        assert sweep is not None
        most = (swept or Swept()).max_misfit
        model = _color_of(sweep, image, plate, streak, most)
    elif swept is not None and sweep is not None and model.covariance.any():
        model = sweep.model  # the streak knows more of it than the caller was sure of
    used = swept or solver or Smooth()
    return _Case(image, plate, match, streak, hidden, used, model, given, sweep)


def _each_alone(case: _Case, out: PixelMaps | None) -> PixelMaps:
    """The closed form, by two channels where the third is clipped, and at mixed edges of the plate."""
    solver = case.solver if isinstance(case.solver, Pixelwise) else Pixelwise()
    image, plate, model = case.image, case.plate, case.model
    flags = _flags(image, plate, case.streak, case.hidden)
    maps = solver(image.rgb, plate.rgb, model, _noise(image), _noise(plate), flags=flags, out=out)
    solve_clipped(maps, image, plate, model, solver.max_alpha_std)
    box = case.streak.around(_MARGIN)
    C, B, mixed = case.within(box)
    solve_mixed_plate(maps.within(box), mixed, C, B, model, solver.max_alpha_std)
    return maps


def _by_solver(case: _Case, maps: PixelMaps) -> tuple[dict[str, Any], list[float]]:
    """What the solver makes of the closed form; its measures, and doubts of the sum of alpha."""
    if isinstance(case.solver, Swept):
        return _by_sweep(case.solver, case, maps)
    if isinstance(case.solver, Smooth):
        return _by_all_pixels(case.solver, case, maps), []
    if isinstance(case.solver, Shaded):
        return _with_shadow(case.solver, case, maps), []
    return {}, []


def _by_sweep(solver: Swept, case: _Case, maps: PixelMaps) -> tuple[dict[str, Any], list[float]]:
    """Alpha of the sweep; patches that it does not explain as all of their pixels say."""
    sweep, doubts = case.sweep, []
    assert sweep is not None
    box = _box_of_both(case.streak, sweep)
    C, B, mixed = case.within(box)
    left = solver(maps, sweep, C, mixed.widened(B), box)
    if left.any():
        _smooth_patches(maps.within(box), left, C, B, case.model, mixed)
        if not case.given:
            doubts.append(widen(maps, sweep, case.plate, left, box)[1])
    carry_light(maps.within(box), C, B)
    return sweep_measures(sweep), doubts


def _by_all_pixels(solver: Smooth, case: _Case, maps: PixelMaps) -> dict[str, Any]:
    """Alpha of all pixels of the streak together, and of its faint rims if it was found."""
    wide = case.streak
    if not np.isnan(wide.evidence):
        wide = with_faint_rims(wide, case.image, case.plate, case.model)
    box = wide.around(_MARGIN)
    inside = wide.mask[box[1] : box[3], box[0] : box[2]]
    C, B, mixed = case.within(box)
    measures = solver(maps, C, B, case.model, inside, box, mixed)
    carry_light(maps.within(box), C, B)
    return measures


def _with_shadow(solver: Shaded, case: _Case, maps: PixelMaps) -> dict[str, Any]:
    """Around the streak, alpha and shadow of each pixel."""
    box = case.streak.around(_MARGIN)
    shaded = None
    if solver.plate is not None:
        shaded = case.match.apply(solver.plate).crop(box)
    pictures = case.image.crop(box), case.plate.crop(box), shaded
    S = solver(maps.within(box), *pictures, case.model)
    inside = case.streak.mask[box[1] : box[3], box[0] : box[2]]
    return {"sum_shadow": float(S[inside].sum())}


def _widened_by_rival(case: _Case, maps: PixelMaps) -> tuple[float, float]:
    """By how much a sweep that is not believed differs, as `widen` says; 0 if it is no rival."""
    sweep = case.sweep
    if sweep is None or case.given or case.is_explained or not is_rival(sweep, case.model):
        return 0.0, 0.0
    box = case.streak.around(0)
    inside = case.streak.mask[box[1] : box[3], box[0] : box[2]]
    return widen(maps, sweep, case.plate, inside, box)


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


def _without(image: LinearImage, hidden: Bools) -> LinearImage:
    """The image, not valid where something is in front; nor clipped there, for no channel tells."""
    rgb = np.where((hidden & ~image.valid)[..., None], image.rgb.dtype.type(0), image.rgb)
    return replace(image, rgb=rgb, valid=image.valid & ~hidden) if hidden.any() else image


def _noise(picture: LinearImage) -> Any:
    """The noise, of which `with_noise` has seen to it that it is not None."""
    return picture.noise


def _louder(picture: LinearImage, by: float) -> LinearImage:
    """With the noise that a sweep found where a codec hides it; see `fit_sweep`."""
    return picture if by == 1 else picture.with_noise(by * picture.variance)


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
