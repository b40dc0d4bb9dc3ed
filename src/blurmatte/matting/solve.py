"""solve: image + plate + colors → Solution.

All but `Pixelwise` looks at the streak's surroundings only; beyond them alpha is 0 and OUTSIDE.
"""

import logging
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from blurmatte.background import Match, Matching, fit_match
from blurmatte.calibration import with_noise
from blurmatte.checks import Bools, check_kind, check_map, check_same_size
from blurmatte.color import ColorModel, check_not_gray, may_be_shadow, streak_of_color
from blurmatte.matting.alternatives import alternative, listed
from blurmatte.matting.averaging import AlphaEstimate, averaged
from blurmatte.matting.calibrated import (
    HypothesisSummary,
    calibrated,
    claimed_error,
    error_terms,
    graded,
)
from blurmatte.matting.carried_light import carry_light
from blurmatte.matting.clipped import solve_clipped
from blurmatte.matting.light import light_given
from blurmatte.matting.measures import (
    match_measures,
    noise_measures,
    streak_measures,
    sweep_measures,
)
from blurmatte.matting.mixed_plate import MixedPlate, mixed_plate, solve_mixed_plate
from blurmatte.matting.pixelwise import PixelMaps, Pixelwise
from blurmatte.matting.plate_check import warn_if_plate_differs
from blurmatte.matting.rims import with_faint_rims
from blurmatte.matting.shaded import Shaded
from blurmatte.matting.shadow import mark_shadow
from blurmatte.matting.smooth import Smooth
from blurmatte.matting.solution import Grade, Quality, Solution
from blurmatte.matting.swept import Swept
from blurmatte.radiometry import LinearImage, NoiseModel, check_same_colors
from blurmatte.streaks import (
    Streak,
    check_streak,
    joined_behind,
    require_streaks,
)
from blurmatte.sweep import Hypotheses, Sweep, fit_hypotheses, likeliest_streak
from blurmatte.sweep.assess.calibration import fitted_calibration
from blurmatte.sweep.assess.model_selection import (
    Evidence,
    hypothesis_scores,
    hypothesis_weights,
)

Solver = Pixelwise | Smooth | Swept | Shaded
Box = tuple[int, int, int, int]

_LOG = logging.getLogger("blurmatte")  # INFO at the beginning of each stage
_MARGIN = 16  # pixels around a streak: of surroundings that stand still


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
        How to solve. If not given, sweeps and `Smooth()` are averaged by their evidence;
        `Solution.solver` names the one of the largest weight.
    streak : Streak, optional
        Where the object moved. If not given, the one of `find_streaks` in which most light of the
        color shows; or, if that is not given, the one in which a disc explains most.
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
        If nothing moved.
    ColorModelError
        If no model was given and the streak only took light, as a shadow does, or the pictures are
        gray.

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
    check_not_gray(image, plate)
    if model is not None and model.to_srgb != image.meta.to_srgb:
        model = replace(model, to_srgb=image.meta.to_srgb)
    match = fit_match(image, plate, matching)
    image, plate = with_noise(image, match.apply(plate))
    hidden = np.zeros(image.valid.shape, bool) if occluder is None else occluder
    check_map("occluder", hidden, image.valid.shape, kinds="b")
    image = _without(image, hidden)
    _LOG.info("finding the streak")
    found = [streak] if streak is not None else joined_behind(require_streaks(image, plate), hidden)
    pictures = _Pictures(image, plate, match, hidden)
    case = _case_of(pictures, found, _of_light(solver, model), solver, start)
    warn_if_plate_differs(image, plate, case.found)
    others = [other for other in found if other is not case.found]
    only_lost = may_be_shadow(image, plate, case.found)
    _LOG.info("solving alpha")
    if case.hypotheses is None or isinstance(case.solver, Pixelwise | Smooth):
        maps = _each_alone(case, _box_of(case), out)
        measures = _by_solver(case, maps)
    else:
        case, maps, measures = _by_hypotheses(case, out)
        if only_lost:
            reasons = ["shadow", *measures["grade_reasons"]]
            measures = {**measures, "grade": Grade.ASSUMED, "grade_reasons": reasons}
    streak, doubt = case.streak, 0.0
    if not isinstance(case.solver, Shaded):
        alone = not isinstance(case.solver, Swept)
        doubt = mark_shadow(
            maps, case.image, case.plate, streak, case.model, alone=alone, whole=only_lost
        )
    if not isinstance(case.solver, Pixelwise | Shaded):
        streak = Streak((maps.quality & np.uint8(Quality.OUTSIDE)) == 0)
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
    }
    stats["sum_alpha_std"] = float(np.hypot(stats["sum_alpha_std"], doubt))
    sweep = None if case.hypotheses is None else case.hypotheses.best
    if sweep is not None and "alpha_error" in measures:
        factor = max(measures["alpha_error"] / measures["claimed_error"], 1.0)
        sweep = replace(sweep, covariance=factor**2 * sweep.covariance)
    return Solution(*maps, model=case.model, solver=repr(case.solver), stats=stats, sweep=sweep)


@dataclass(frozen=True, eq=False)
class _Pictures:
    """Pictures that match, noise known; the image is not valid where something is in front."""

    image: LinearImage
    plate: LinearImage
    match: Match
    hidden: Bools


@dataclass(frozen=True, eq=False)
class _Case:
    """What is solved: where, by which solver, with which colors and sweeps.

    Parameters
    ----------
    pictures : _Pictures
    found : Streak
        What moved before the plate as it is.
    model : ColorModel
    solver : Solver or None
        None averages all hypotheses.
    hypotheses : Hypotheses, optional
    """

    pictures: _Pictures
    found: Streak
    model: ColorModel
    solver: Solver | None
    hypotheses: Hypotheses | None

    @property
    def is_exact(self) -> bool:
        """Whether the colors were given, and without an error."""
        return not self.model.covariance.any()

    @cached_property
    def image(self) -> LinearImage:
        """With the noise that the sweep found, which codecs hide; see `Diagnostics.noise_inflation`."""
        return _noisier(self.pictures.image, self.hypotheses)

    @cached_property
    def plate(self) -> LinearImage:
        """The same of the plate, in the light that the object left it if sweeps were fitted."""
        plate = self.pictures.plate if self.hypotheses is None else self.hypotheses.plate
        return _noisier(plate, self.hypotheses)

    @property
    def streak(self) -> Streak:
        """What moved before that plate."""
        return self.found if self.hypotheses is None else self.hypotheses.streak

    def within(self, box: Box) -> tuple[LinearImage, LinearImage, MixedPlate]:
        """Both within a box, and where the plate's edges fit badly, as they do around the streak."""
        inside = self.streak.mask[box[1] : box[3], box[0] : box[2]]
        image, plate = self.image.crop(box), self.plate.crop(box)
        return image, plate, mixed_plate(image, plate, image.valid & plate.valid & ~inside)


def _case_of(
    pictures: _Pictures,
    found: list[Streak],
    model: ColorModel | None,
    solver: Solver | None,
    start: Sweep | None,
) -> _Case:
    """The streak, its sweeps unless the solver needs none, and the colors."""
    image, plate = pictures.image, pictures.plate
    if model is not None:
        found = [streak_of_color(found, image, plate, model)]
        if isinstance(solver, Pixelwise | Smooth | Shaded):
            return _Case(pictures, found[0], model, solver, None)
    else:
        found = [likeliest_streak(image, plate, found)]
    _LOG.info("fitting the sweep")
    hypotheses = fit_hypotheses(image, plate, found[0], model, start)
    sweep = hypotheses.best
    if model is None or model.covariance.any():
        model = sweep.model  # the streak knows more of it than the caller was sure of
    return _Case(pictures, found[0], model, solver, hypotheses)


def _box_of(case: _Case) -> Box:
    """Where alpha may be other than 0; of `Pixelwise` everywhere."""
    if isinstance(case.solver, Pixelwise):
        return (0, 0, *case.pictures.image.size)
    if isinstance(case.solver, Smooth):
        return _wide(case).around(_MARGIN)
    return _box_of_all(case.streak, () if case.hypotheses is None else case.hypotheses.sweeps)


def _wide(case: _Case) -> Streak:
    """The streak, with its faint rims if it was found."""
    if np.isnan(case.streak.evidence):
        return case.streak
    return with_faint_rims(case.streak, case.image, case.plate, case.model)


def _each_alone(case: _Case, box: Box, out: PixelMaps | None) -> PixelMaps:
    """The closed form within a box, by two channels where the third is clipped, and at mixed edges."""
    solver = case.solver if isinstance(case.solver, Pixelwise) else Pixelwise()
    flags = _flags(case.image, case.plate, case.streak, case.pictures.hidden)
    image, plate, model = case.image.crop(box), case.plate.crop(box), case.model
    whole = image.size == case.image.size
    place = _rows_columns(box, (0, 0, *case.image.size))
    near = solver(
        image.rgb, plate.rgb, model, _noise(image), _noise(plate),
        flags=flags[place], out=out if whole else None,
    )  # fmt: skip
    solve_clipped(near, image, plate, model, solver.max_alpha_std)
    maps = near if whole else _spread(near, box, flags, out)
    around = case.streak.around(_MARGIN)
    C, B, mixed = case.within(around)
    solve_mixed_plate(maps.within(around), mixed, C, B, model, solver.max_alpha_std)
    return maps


def _spread(
    near: PixelMaps, box: Box, flags: npt.NDArray[np.uint8], out: PixelMaps | None
) -> PixelMaps:
    """The maps of a box in those of a picture, 0 elsewhere."""
    height, width = flags.shape
    maps = PixelMaps.zeros(height, width, near.alpha.dtype) if out is None else out
    if out is not None:
        check_map("out", out.premultiplied, (height, width, 3))
        for values in out:
            values[...] = 0
    maps.quality[...] = flags
    maps.write(box, near)
    return maps


def _by_solver(case: _Case, maps: PixelMaps) -> dict[str, Any]:
    """Write what the solver makes of the closed form; its measures."""
    if isinstance(case.solver, Pixelwise):
        return {}
    if isinstance(case.solver, Shaded):
        return _with_shadow(case.solver, case, maps)
    assert isinstance(case.solver, Smooth)
    return _by_all_pixels(case.solver, case, maps, _wide(case))


def _by_hypotheses(case: _Case, out: PixelMaps | None) -> tuple[_Case, PixelMaps, dict[str, Any]]:
    """Average the sweeps, and alpha without a shape unless `Swept` was asked for.

    Returns the case with solver and colors of the likeliest hypothesis, maps, and measures.
    """
    hypotheses = case.hypotheses
    assert hypotheses is not None
    sweeps = hypotheses.sweeps
    if case.solver is None:
        _LOG.info("solving alpha without a shape")
    free = [] if case.solver is not None else _without_shape(case)
    evidence = [*hypotheses.evidence, *(one.evidence for one in free)]
    weights = hypothesis_weights(evidence)
    box = _box_of_all(case.streak, sweeps)
    estimates = [_of_sweep(sweep, box) for sweep in sweeps]
    estimates += [one.within(box) for one in free]
    average = averaged(estimates, weights)
    best = int(np.argmax(weights))
    ranks = [sweep.model.rank for sweep in sweeps] + [one.model.rank for one in free]
    summaries = [
        HypothesisSummary(float(w), rank, i < len(sweeps), one.inflation)
        for i, (w, rank, one) in enumerate(zip(weights, ranks, evidence, strict=True))
    ]
    terms = error_terms(average, estimates, summaries, hypotheses.best.diagnostics)
    claim = claimed_error(average)
    average = calibrated(average, estimates, terms, case.image.meta.sharing is not None)
    solver: Solver = Swept() if best < len(sweeps) else Smooth()
    maps = _each_alone(case, box, out)
    C, B, mixed = case.within(box)
    what: list[Sweep | ColorModel] = [*sweeps, *(one.model for one in free)]
    alternatives = [
        alternative(one, weight, estimate, average, (C, B), box)
        for one, weight, estimate in zip(what, weights, estimates, strict=True)
    ]
    if best < len(sweeps):
        model = case.model if case.is_exact else sweeps[best].model
        Swept()(maps, sweeps[best], average, C, mixed.widened(B), box)
    else:
        likeliest = free[best - len(sweeps)]
        model = likeliest.model
        _write(maps, likeliest, average, C, B, box)
    carry_light(maps.within(box), C, B)
    return (
        replace(case, model=model, solver=solver),
        maps,
        {
            **sweep_measures(sweeps[0]),
            "sum_alpha_std": average.sum_std,
            "alpha_scale_std": average.scale_std,
            "weights": weights.tolist(),
            "alternatives": tuple(map(asdict, listed(alternatives, hypothesis_scores(evidence)))),
            "claimed_error": claim,
            "error_terms": asdict(terms),
            "grade_reasons": fitted_calibration().reasons(terms),
            **graded(average),
        },
    )


@dataclass(frozen=True, eq=False)
class _Shapeless:
    """Alpha by `Smooth` with some colors, the maps of its box, and the evidence for it."""

    model: ColorModel
    maps: PixelMaps
    box: Box
    sum_std: float
    scale_std: float
    evidence: Evidence

    def within(self, box: Box) -> AlphaEstimate:
        """Its alpha in a box."""
        inside = (self.maps.quality & np.uint8(Quality.OUTSIDE)) == 0
        both = [max(a, b) for a, b in zip(self.box[:2], box[:2], strict=True)]
        both += [min(a, b) for a, b in zip(self.box[2:], box[2:], strict=True)]
        alpha, std = np.zeros((2, box[3] - box[1], box[2] - box[0]))
        for values, source in ((alpha, self.maps.alpha), (std, self.maps.alpha_std)):
            own = np.where(inside, source, 0)[_rows_columns(both, self.box)]
            values[_rows_columns(both, box)] = own
        return AlphaEstimate(alpha, std, self.sum_std, self.scale_std)


def _rows_columns(part: Sequence[int], box: Box) -> tuple[slice, slice]:
    """Where a part (x0, y0, x1, y1) of the picture is in a box of it."""
    (x, y), (x0, y0, x1, y1) = box[:2], part
    return slice(y0 - y, y1 - y), slice(x0 - x, x1 - x)


def _without_shape(case: _Case) -> list[_Shapeless]:
    """With the likeliest line of colors, and the likeliest plane if that is likelier."""
    assert case.hypotheses is not None
    if case.is_exact:
        return [_smoothed(case)]
    models: dict[int, ColorModel] = {}
    for sweep in case.hypotheses.sweeps:
        if sweep.model.rank < 3:
            models.setdefault(sweep.model.rank, sweep.model)
        if sweep.model.rank == 1:
            break
    return [_smoothed(replace(case, model=model)) for model in models.values()]


def _smoothed(case: _Case) -> _Shapeless:
    """Alpha by `Smooth` with the colors of the case."""
    assert case.hypotheses is not None
    wide = _wide(case)
    box = wide.around(_MARGIN)
    maps = _each_alone(case, box, None)
    measures = _by_all_pixels(Smooth(), case, maps, wide)
    pictures = case.image, case.plate
    scale_std = streak_measures(maps, case.model, *pictures, case.streak)["alpha_scale_std"]
    near = maps.within(box)
    std = np.hypot(near.alpha_std, scale_std * near.alpha)
    known = np.isfinite(std) & ((near.quality & np.uint8(Quality.OUTSIDE)) == 0)
    alpha, alpha_std = (np.zeros(maps.alpha.shape) for _ in range(2))
    place = _rows_columns(box, (0, 0, *case.image.size))
    alpha[place], alpha_std[place] = np.where(known, near.alpha, 0), np.where(known, std, 0)
    evidence = case.hypotheses.evidence_of(alpha, alpha_std)
    return _Shapeless(case.model, near.copied, box, measures["sum_alpha_std"], scale_std, evidence)


def _write(
    maps: PixelMaps,
    likeliest: _Shapeless,
    average: AlphaEstimate,
    image: LinearImage,
    plate: LinearImage,
    box: Box,
) -> None:
    """An average in which an alpha without a shape has the largest weight, and the light it leaves."""
    maps.write(likeliest.box, likeliest.maps)
    near = maps.within(box)
    alpha, std = average.alpha, average.alpha_std
    P, P_std, _ = light_given(alpha, std, likeliest.model, image, plate)
    for target, values in zip(near, (alpha, std, P, P_std), strict=False):
        target[...] = values
    near.quality[alpha > 0] &= ~np.uint8(Quality.OUTSIDE)


def _of_sweep(sweep: Sweep, box: Box) -> AlphaEstimate:
    """Alpha of a sweep in a box."""
    return AlphaEstimate(*sweep.within(box), sweep.area_std())


def _by_all_pixels(solver: Smooth, case: _Case, maps: PixelMaps, wide: Streak) -> dict[str, Any]:
    """Alpha of all pixels of a streak with its faint rims together."""
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
        shaded = case.pictures.match.apply(solver.plate).crop(box)
    pictures = case.image.crop(box), case.plate.crop(box), shaded
    S = solver(maps.within(box), *pictures, case.model)
    inside = case.streak.mask[box[1] : box[3], box[0] : box[2]]
    return {"sum_shadow": float(S[inside].sum())}


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


def _of_light(solver: Solver | None, model: ColorModel | None) -> ColorModel | None:
    """The model, or that of the object's light if it is known."""
    if not isinstance(solver, Shaded):
        return model
    if solver.light is not None:
        return ColorModel.from_samples(np.array([solver.light]), std=1e-9)
    if model is not None and model.rank != 1:
        raise ValueError(f"a plate in shadow needs a model of rank 1, got rank {model.rank}")
    return model


def _box_of_all(streak: Streak, sweeps: Sequence[Sweep]) -> Box:
    """Around streak and sweeps, with surroundings that stand still."""
    boxes = np.array([streak.around(_MARGIN), *(sweep.box for sweep in sweeps)])
    x0, y0 = boxes[:, :2].min(axis=0)
    x1, y1 = boxes[:, 2:].max(axis=0)
    return int(x0), int(y0), int(x1), int(y1)


def _without(image: LinearImage, hidden: Bools) -> LinearImage:
    """The image, not valid where something is in front; nor clipped there, for no channel tells."""
    if not hidden.any():
        return image
    rgb = np.where((hidden & ~image.valid)[..., None], image.rgb.dtype.type(0), image.rgb)
    return replace(image, rgb=rgb, valid=image.valid & ~hidden)


def _noise(picture: LinearImage) -> Any:
    """The noise, of which `with_noise` has seen to it that it is not None."""
    return picture.noise


def _noisier(picture: LinearImage, hypotheses: Hypotheses | None) -> LinearImage:
    """With the noise that a sweep found where a codec hides it."""
    by = 1.0 if hypotheses is None else hypotheses.best.diagnostics.noise_inflation
    if by == 1:
        return picture
    noise = picture.noise
    if isinstance(noise, NoiseModel):  # not a variance for each of millions of pixels
        return picture.with_noise(NoiseModel.from_coefficients(by * noise.coefficients))
    return picture.with_noise(by * picture.variance)


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
