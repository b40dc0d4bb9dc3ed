"""solve: image + plate + colors → Solution."""

import logging
from dataclasses import dataclass, replace

import numpy as np
from threadpoolctl import threadpool_limits

from blurmatte.background import Matching, PlateGuess, fit_match
from blurmatte.background.fit_match import agreement
from blurmatte.calibration import with_noise
from blurmatte.checks import Bools, check_kind, check_map, check_same_size, enclosing, rows_columns
from blurmatte.color.model import ColorModel
from blurmatte.color.shadows import may_be_shadow
from blurmatte.color.streak import check_not_gray, streak_of_color
from blurmatte.errors import BlurmatteError
from blurmatte.matting.averaging import AlphaEstimate
from blurmatte.matting.calibration import MIN_ALPHA
from blurmatte.matting.case import Answer, Case, Pictures, Solver
from blurmatte.matting.hypotheses import Averaged, Swept, WeightedHypotheses
from blurmatte.matting.imputation import QuickSolver, solve_before_guess
from blurmatte.matting.maps import Grade, PixelMaps, Quality, has_flag
from blurmatte.matting.plate_check import warn_if_plate_differs
from blurmatte.matting.shaded import mark_shadow
from blurmatte.matting.smooth import Smooth
from blurmatte.matting.solution import Solution
from blurmatte.matting.stats import MatchSummary, SolutionStats, SweepSummary, noise_of
from blurmatte.matting.summary import StreakSums, streak_sums, with_mean_light
from blurmatte.radiometry import LinearImage, check_has_light, check_same_colors
from blurmatte.statistics import larger_covariance
from blurmatte.streaks import (
    Streak,
    check_streak,
    find_streaks,
    merge_across_occluder,
    require_streaks,
)
from blurmatte.streaks.evidence import without_outliers
from blurmatte.sweep.assess.diagnostics import with_perspective_error
from blurmatte.sweep.fit_sweep import fit_hypotheses, likeliest_streak
from blurmatte.sweep.fitting_size import FittingSize
from blurmatte.sweep.hypotheses import Disc
from blurmatte.sweep.model.priors import MotionPrior
from blurmatte.sweep.sweep import Sweep

_LOG = logging.getLogger("blurmatte")  # INFO at the beginning of each stage


@dataclass(frozen=True)
class _Request:
    """What `solve` is asked to do with two pictures."""

    model: ColorModel | None
    solver: Solver
    streak: Streak | None
    start: Sweep | None = None
    prior: MotionPrior | None = None
    out: PixelMaps | None = None


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
    prior: MotionPrior | None = None,
) -> Solution:
    """Separate a moving object from its background: alpha, color, and the error of both.

    Parameters
    ----------
    image, plate : LinearImage
        The picture with the streak, and the same scene without it. Unknown noise is measured.
    model : ColorModel, optional
        Colors of the object; fitted to the streak if not given, as by `fit_color`.
    solver : Solver, optional
        Such as `Pixelwise()`; if not given, sweeps and `Smooth()` are averaged by their evidence.
    streak : Streak, optional
        Where the object moved; if not given, the most likely of `find_streaks`.
    matching : Matching, optional
        Permitted changes of the plate (`fit_match`); estimated from the data if not given.
    occluder : (H, W) bool, optional
        A static object in front, such as a fence. Alpha behind it is flagged OCCLUDED.
    out : PixelMaps, optional
        Arrays to write the result to, for pictures of the same size.
    start : Sweep, optional
        `Solution.sweep` of another frame of the same motion; see `fit_sweep`.
    prior : MotionPrior, optional
        Radius and path from other frames, and whether the silhouette is known to be a disc.

    Raises
    ------
    TypeError, ValueError
        If an argument has another type, or a size other than that of the image.
    PlateError, MotionError, ColorModelError
        If the plate does not fit the image; if nothing moved; if no model was given and the streak only
        lost light, or one was given for gray pictures.

    Warns
    -----
    PlateWarning
        If image and plate look swapped, or differ in brightness around the streak.

    Examples
    --------
    >>> solution = bm.solve(image, plate)
    >>> print(bm.explain(solution)[0])
    confirmed: alpha within 0.0022, its sum within 0.6 %.
    """
    _check(image, plate, model, solver, streak, out, start)
    request = _Request(model, solver or Averaged(), streak, start, prior, out)
    if isinstance(plate, PlateGuess):
        return _before_guess(image, plate, request, occluder)
    return _solved(_matched(image, plate, matching, occluder), request)


def _before_guess(
    image: LinearImage, plate: PlateGuess, request: _Request, occluder: Bools | None
) -> Solution:
    """The solution before a guessed plate; before its draws by a quick solver, from the first one.

    Of the surroundings alone, as elsewhere image and guess are one picture, unless sweeps are given in
    pixels of the whole picture, or arrays for it. Without hypotheses of shadows if the error of the
    guess is as large as their changes.
    """
    if plate.is_rough:
        request = replace(request, solver=request.solver.without_plate_changes())
    box, size, streak = plate.surroundings, image.size, request.streak
    is_part = request.start is None and request.prior is None and request.out is None
    if is_part:
        if streak is not None:
            box = enclosing([box, streak.box])
            request = replace(request, streak=replace(streak, mask=streak.mask[rows_columns(box)]))
        if occluder is not None:
            occluder = check_map("occluder", occluder, image.valid.shape, "b")[rows_columns(box)]
        image, plate = image.crop(box), plate.around_hidden(box)
    if image.noise is None:
        image = image.with_noise(plate.image_noise)
    guess = plate

    def matched(plate: LinearImage) -> Pictures:
        """The image and a plate of which nothing is a guess."""
        return _matched(image, plate, Matching.NONE, occluder)

    def first(plate: LinearImage) -> Solution:
        """The solution before the mean of the guess; where no streak stands out, of the region."""
        pictures, asked = matched(plate), request
        if asked.streak is None and not find_streaks(pictures.image, pictures.plate):
            asked = replace(asked, streak=Streak(guess.hidden))
        # The light of a rough guess differs from the scene's in any case.
        return _solved(pictures, asked, warns=plate.meta.guess_error is None)

    def again(known: Solution) -> QuickSolver:
        """Quick solutions that start from another, of a wide streak on cells."""
        solver = Swept((Disc(),)) if known.stats.has_shape else Smooth()
        found, sweep = Streak(known.streak), known.sweep
        quick = _Request(known.model, solver, found, sweep, request.prior)
        width = request.solver.fitted_width
        size = FittingSize.of(found, width) if quick.prior is None else None
        if size is None:
            return QuickSolver(lambda one: _solved(matched(one), quick, warns=False))
        start = None if sweep is None else size.sweep(sweep)
        small = replace(quick, streak=size.streak(found), start=start)

        def on_cells(plate: LinearImage) -> Solution:
            """The solution before a plate, on means over cells."""
            return _solved(_in_cells(size, matched(plate), found), small, warns=False)

        return QuickSolver(on_cells, size)

    solution = _where_guessed(solve_before_guess(plate, first, again), image, plate)
    if plate.is_rough:
        solution = replace(solution, stats=replace(solution.stats, rough_guess=plate.error))
    return solution.in_picture(box, size) if is_part else solution


def _where_guessed(solution: Solution, image: LinearImage, guess: PlateGuess) -> Solution:
    """The solution without an object where the guess is the image: over that it would be seen twice.

    Its maps, which nothing else holds, are changed in place. If its shape on a path lies partly beyond
    the region where the guess is the image, its errors say that the guess shows the object. The plate
    of a burst is not the image there.
    """
    outside = ~guess.hidden & np.all(image.rgb == guess.rgb, axis=-1)
    for values in (solution.alpha, solution.alpha_std):
        values[outside] = 0
    for light in (solution.premultiplied, solution.premultiplied_std):
        light[outside] = 0
    solution.quality[outside] |= np.uint8(Quality.OUTSIDE)
    sweep = solution.sweep
    if sweep is not None:
        beyond = (outside & ~guess.region)[rows_columns(sweep.box)]
        if (sweep.alpha_within(sweep.box)[beyond] > MIN_ALPHA).any():
            return _cut_by_region(solution)
    return replace(solution)


def _cut_by_region(solution: Solution) -> Solution:
    """The solution of an object that the guess shows beyond the region.

    Which part of it the guess holds is not known: the error of the sum of alpha is at least the sum.
    """
    stats, sweep = solution.stats, solution.sweep
    factor = max(1.0, (stats.sum_alpha or 0.0) / max(stats.sum_alpha_std or 0.0, 1e-9))
    if sweep is not None:
        sweep = replace(sweep, covariance=factor**2 * sweep.covariance)
    solution = solution.with_errors_times(factor)
    return replace(solution, stats=solution.stats.assumed("region"), sweep=sweep)


def _solved(pictures: Pictures, request: _Request, warns: bool = True) -> Solution:
    """The solution of matched pictures."""
    with threadpool_limits(1):  # the matrices are small: threads wait longer than they work
        case, others = _case_of(pictures, request)
        if warns:
            warn_if_plate_differs(*case.compared)
        return _solution(case, request.solver, others, request.out)


def shape_odds(
    image: LinearImage,
    plate: LinearImage,
    model: ColorModel | None,
    *,
    streak: Streak | None,
    start: Sweep | None,
    prior: MotionPrior,
    occluder: Bools | None,
) -> tuple[Sweep, tuple[float, float]]:
    """The likeliest sweep and `SolutionStats.shape_log_odds`, as `solve` has them; nothing else.

    The plate is taken as it is. Raises as `solve`.
    """
    pictures = _matched(image, plate, Matching.NONE, occluder)
    case, _ = _case_of(pictures, _Request(model, Averaged(), streak, start, prior))
    assert case.hypotheses is not None
    found = WeightedHypotheses.of(case, without_shape=True)
    return case.hypotheses.best, found.shape_log_odds()


def _check(
    image: LinearImage,
    plate: LinearImage,
    model: ColorModel | None,
    solver: Solver | None,
    streak: Streak | None,
    out: PixelMaps | None,
    start: Sweep | None,
) -> None:
    """Raise TypeError, ValueError or ColorModelError unless `solve` accepts the arguments."""
    check_same_colors("the image", image, "the plate", plate)
    for name, picture in (("the image", image), ("the plate", plate)):
        check_has_light(name, picture)
    check_same_size("image", image.size, "plate", plate.size)
    hint = 'use blurmatte.ColorModel.from_hex("#d8ff3c"); a solver comes after it, or as solver='
    check_kind("model", model, ColorModel | None, hint)
    check_kind("solver", solver, Solver | None, "such as blurmatte.Smooth()")
    check_streak("streak", streak)
    if streak is not None:
        check_map("streak.mask", streak.mask, image.valid.shape, kinds="b")
    check_kind("out", out, PixelMaps | None, "use blurmatte.matting.PixelMaps.empty(height, width)")
    check_kind("start", start, Sweep | None, "use Solution.sweep of another frame")
    if model is not None or not (solver is None or solver.takes_gray):
        check_not_gray(image, plate)


def _matched(
    image: LinearImage, plate: LinearImage, matching: Matching | None, occluder: Bools | None
) -> Pictures:
    """Match the plate to the image, measure unknown noise, and exclude occluded pixels."""
    match = fit_match(image, plate, matching)
    measured = image.noise is None and plate.noise is None
    image, plate = with_noise(image, match.apply(plate))
    image = without_outliers(image, plate)
    shape = image.valid.shape
    hidden = (
        np.zeros(shape, bool) if occluder is None else check_map("occluder", occluder, shape, "b")
    )
    if hidden.any():
        # Clipped light is set to 0 there: no channel of an occluded pixel has information.
        rgb = np.where((hidden & ~image.valid)[..., None], image.rgb.dtype.type(0), image.rgb)
        image = replace(image, rgb=rgb, valid=image.valid & ~hidden)
    return Pictures(image, plate, match, hidden, measured)


def _case_of(pictures: Pictures, request: _Request) -> tuple[Case, list[Streak]]:
    """Streak, colors, and sweeps unless the solver needs none; and the other streaks found."""
    image, plate, solver = pictures.image, pictures.plate, request.solver
    _LOG.info("finding the streak")
    streaks = [request.streak] if request.streak is not None else []
    if not streaks:
        streaks = merge_across_occluder(require_streaks(image, plate), pictures.hidden)
    model = request.model
    if model is not None and model.to_srgb != image.meta.to_srgb:
        model = replace(model, to_srgb=image.meta.to_srgb)
    model = solver.colors(model)
    if model is None:
        chosen = likeliest_streak(image, plate, streaks)
    else:
        chosen = streak_of_color(streaks, image, plate, model)
    others = [other for other in streaks if other is not chosen]
    if model is not None and not solver.needs_sweep:
        return Case(pictures, chosen, model, None), others
    _LOG.info("fitting the sweep")
    start, prior = request.start, request.prior
    # Of a frame of a clip, start and prior are in its pixels.
    is_alone = start is None and prior is None
    size = FittingSize.of(chosen, solver.fitted_width) if is_alone else None
    streak, small = chosen, pictures
    if size is not None:
        streak, small = size.streak(chosen), _in_cells(size, pictures, chosen)
    searched = solver.hypotheses, solver.seconds, solver.opacity
    found = fit_hypotheses(small.image, small.plate, streak, model, start, prior, *searched)
    # The streak adds information to uncertain colors.
    known = found.best.model if model is None or model.covariance.any() else model
    case = Case(small, streak, known, found, cells=size)
    if size is not None:
        enlarged = size.hypotheses(found, (small.plate, plate), (streak, chosen))
        case = Case(pictures, chosen, known, enlarged, fitted=case)
    return case, others


def _in_cells(size: FittingSize, pictures: Pictures, streak: Streak) -> Pictures:
    """Pictures of means over cells."""
    image, plate = size.pictures(pictures.image, pictures.plate, streak, pictures.measured)
    return Pictures(image, plate, pictures.match, size.touched(pictures.hidden))


def _solution(case: Case, solver: Solver, others: list[Streak], out: PixelMaps | None) -> Solution:
    """Solve a case."""
    only_lost = may_be_shadow(*case.compared)
    _LOG.info("solving alpha")
    answer = solver.answer(case, out)
    maps, model, streak, stats = answer.maps, answer.model, answer.streak, answer.stats
    image, plate, shadow_std = case.image, case.plate, 0.0
    if not answer.separates_shadow:
        marked = case.streak, model, not answer.locates, only_lost
        shadow_std = mark_shadow(maps, image, plate, *marked)
    sums = streak_sums(maps, model, image, plate, streak)
    sums = sums.with_errors(stats.sum_alpha_std, stats.alpha_scale_std)
    if stats.grade is None:
        stats = _graded_alone(answer, case, sums)
    for assumption in filter(None, (answer.assumes, "shadow" if only_lost else "")):
        stats = stats.assumed(assumption)
    parts = sums.sum_alpha_std, shadow_std, sums.alpha_scale_std * sums.sum_alpha
    sums = sums._replace(sum_alpha_std=float(np.linalg.norm(parts)))
    stats = replace(
        stats,
        **sums._asdict(),
        streak_box=streak.box,
        other_boxes=tuple(other.box for other in others if other.significant),
        insignificant_others=sum(not other.significant for other in others),
        image_noise=noise_of(image),
        plate_noise=noise_of(plate),
        match=MatchSummary.of(case.pictures.match, *agreement(image, plate)),
        may_be_shadow=only_lost,
        exposure_time=image.meta.exposure_time,
        readout=image.meta.readout,
    )
    _check_numbers(maps, case)
    sweep = None if case.hypotheses is None else case.hypotheses.best
    if sweep is not None:
        covariance = answer.error_factor**2 * sweep.covariance
        if answer.between is not None:
            covariance = larger_covariance(covariance, answer.between)
        sweep = with_perspective_error(replace(sweep, covariance=covariance)).with_assumed_error
        if stats.sweep is not None:
            stats = replace(stats, sweep=SweepSummary.of(sweep))
    model = replace(model, covariance=answer.error_factor**2 * model.covariance)
    model = with_mean_light(model, maps, plate, sums)
    name = repr(answer.chosen or solver)
    return Solution(*maps, model=model, solver=name, stats=stats, sweep=sweep)


def _graded_alone(answer: Answer, case: Case, sums: StreakSums) -> SolutionStats:
    """The stats of a solver without other hypotheses with its grade and errors.

    The maps keep their standard errors.
    """
    maps, stats = answer.maps, answer.stats
    unknown = Quality.OUTSIDE | Quality.PLATE_IN_MODEL
    known = ~has_flag(maps.quality, unknown) & np.isfinite(maps.alpha_std)
    if not known.any():
        return replace(stats, grade=Grade.ASSUMED, alpha_error=1.0, grade_reasons=("color",))
    alpha, std = np.where(known, maps.alpha, 0), np.where(known, maps.alpha_std, np.inf)
    estimate = AlphaEstimate(alpha, std, sums.sum_alpha_std, sums.alpha_scale_std)
    return stats.graded_alone(estimate, answer.errors_like, case.is_compressed, case.is_exact)


def _check_numbers(maps: PixelMaps, case: Case) -> None:
    """Raise BlurmatteError if light or noise was beyond what 32-bit floats can square."""
    missing = sum(int(np.isnan(values).sum()) for values in maps[:4])
    if missing:
        light = max(float(np.abs(p.rgb).max()) for p in (case.image, case.plate))
        std = max(float(p.variance.max()) ** 0.5 for p in (case.image, case.plate))
        raise BlurmatteError(
            f"{missing} numbers of alpha and color are undefined: light up to {light:.2g} with noise "
            f"up to {std:.2g} (1 is white) is too much; repair the pictures, or give another noise "
            "(--noise)"
        )
