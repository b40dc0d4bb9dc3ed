"""fit_sweep: image, plate and streak → Sweep.

Path, silhouette and color are found together, as those for which the least is left of the light
across the color, by Levenberg–Marquardt steps with weights that doubt what cannot be noise; first for
a disc of one paint (`search`), then for other outlines (`outline`) or more colors; at last for any
colors that change little within a fraction of the radius (`field`).
"""

from dataclasses import replace

import numpy as np
import numpy.typing as npt

from blurmatte.checks import check_kind
from blurmatte.color.model import ColorModel
from blurmatte.color.shade import refuse_shade
from blurmatte.errors import ColorModelError, MotionError
from blurmatte.radiometry import LinearImage, Transfer, with_noise
from blurmatte.streaks import (
    Streak,
    check_streak,
    pieces_apart,
    require_streaks,
    strongest_told,
)
from blurmatte.sweep.attempt import Attempt
from blurmatte.sweep.choice import best_of, differ
from blurmatte.sweep.data import Data
from blurmatte.sweep.descent import ROUGHLY, State, descend, main_colors, seen, state_at
from blurmatte.sweep.end import End, ran_together
from blurmatte.sweep.highlighted import may_be_glossy, with_highlight
from blurmatte.sweep.known import known_color
from blurmatte.sweep.occluder import in_front_of
from blurmatte.sweep.outline import is_oval, likelier
from blurmatte.sweep.search import QUICK, Search
from blurmatte.sweep.shadowed import beside_darkness, beside_shadow
from blurmatte.sweep.silhouette import DISC
from blurmatte.sweep.sweep import Sweep
from blurmatte.sweep.turns import RADIUS
from blurmatte.sweep.verdict import (
    MAX_MISFIT,
    can_be,
    is_contested,
    left_beyond_noise,
    misfit,
    stays,
    understated,
)

Array = npt.NDArray[np.float64]
Bools = npt.NDArray[np.bool_]

NO_SHAPE = "no shape on a path explains the streak"

_FOLLOWING = 3  # times that a path may lead out of what was found
_FOLLOWED = 0.2  # of the largest alpha
_SAVED = 0.8  # of what is left, or alpha is off, that may be without what something in front hides
_MOST_PIECES, _MOST_ON_REST = 3, 0.02  # that are asked; of alpha that may lie where others are
_CLEARLY = 1.3  # times less must be left to believe in more colors


def fit_sweep(
    image: LinearImage,
    plate: LinearImage,
    streak: Streak | None = None,
    model: ColorModel | None = None,
    *,
    start: Sweep | None = None,
) -> Sweep:
    """Find path, silhouette and color of an object from the smear that it left.

    A disc of one paint is tried first, then other outlines, also such as turn; where they leave more
    than noise, a disc with a plane of colors: two paints, one paint with highlights, or one in two
    lights; and where that does not help, a disc of any colors. What path and outline are is for the
    evidence to choose.

    Where nothing explains all of a streak that was found, not given, pieces of it are tried around
    which hardly anything moved: something else may have moved beside the object.

    Codecs of clips repeat what stands still as it was, so that noise seems far less than it is where
    something moves: if a disc explains nearly all of the change but for noise that is louder, the
    noise is taken to be that loud; `Sweep.stats["louder"]` says how many times the variance.

    Parameters
    ----------
    image, plate : LinearImage
        With the object, and without; same size.
    streak : Streak, optional
        Where it moved. If not given, the strongest thing that moved and that a sweep explains, of those
        that are whole in the picture before the others; or the strongest.
    model : ColorModel, optional
        What is known of the color, as well as its covariance says; `ColorModel.any()` for an object
        of any colors.
    start : Sweep, optional
        Of another frame of a clip, in which the object went about the same way elsewhere. If a disc on
        such a path, or on a line, explains the streak, nothing else is looked for, which is faster.

    Returns
    -------
    Sweep

    Raises
    ------
    ColorModelError
        If no model was given and the streak only took light: it may be a shadow.
    MotionError
        If nothing moved.
    ValueError
        If the sizes differ.
    """
    check_streak("streak", streak)
    check_kind("model", model, ColorModel | None, 'use blurmatte.ColorModel.from_hex("#d8ff3c")')
    check_kind("start", start, Sweep | None, "use blurmatte.fit_sweep(image, plate)")
    image, plate = with_noise(image, plate)
    if streak is None:
        return _strongest(image, plate, model, start)
    return fit_piece(image, plate, streak, model, start)[0]


def _strongest(
    image: LinearImage, plate: LinearImage, model: ColorModel | None, start: Sweep | None
) -> Sweep:
    """That of the strongest streak that one explains, or of the strongest."""
    found, tried = require_streaks(image, plate), {}

    def told_by(streak: Streak) -> Sweep:
        tried[streak], _ = fit_piece(image, plate, streak, model, start)
        if tried[streak].misfit > MAX_MISFIT:
            raise MotionError(NO_SHAPE)
        return tried[streak]

    try:
        return strongest_told(found, told_by)
    except MotionError:
        return tried[found[0]]


def fit_piece(
    image: LinearImage,
    plate: LinearImage,
    streak: Streak,
    model: ColorModel | None = None,
    start: Sweep | None = None,
) -> tuple[Sweep, Streak]:
    """`fit_sweep` of pictures of known noise, and the piece of the streak that it is of.

    All of the streak if that is explained, or none of its pieces is. In louder noise than was measured
    none is: anything might be a piece of something there.
    """
    whole = _fit(image, plate, streak, model, start)
    if whole.misfit <= MAX_MISFIT or np.isnan(streak.evidence):
        return whole, streak  # a streak that was given, not found, is all there is
    for piece in pieces_apart(streak, image, plate)[:_MOST_PIECES]:
        rest = streak.mask & ~piece.mask
        try:
            alone = _fit(replace(image, valid=image.valid & ~rest), plate, piece, model, None)
        except ColorModelError:
            continue  # it only took light
        sure = alone.misfit <= MAX_MISFIT and alone.stats["louder"] == 1
        if sure and _is_apart(alone, rest):
            return alone, piece
    return whole, streak


def _is_apart(sweep: Sweep, rest: Bools) -> bool:
    """Whether it lies beside the rest of a streak: under that it could go on as it likes."""
    x0, y0, x1, y1 = sweep.box
    alpha, _ = sweep.within(sweep.box)
    return bool(alpha[rest[y0:y1, x0:x1]].sum() <= _MOST_ON_REST * alpha.sum())


def _fit(
    image: LinearImage,
    plate: LinearImage,
    streak: Streak,
    model: ColorModel | None,
    start: Sweep | None,
) -> Sweep:
    """`fit_sweep` of all of a streak in pictures whose noise is known."""
    if model is None:
        refuse_shade(image, plate, streak)
    rank = 1 if model is None else model.rank
    known = None if model is None or rank == 3 else known_color(model)
    search = Search.of(streak, image, plate, known)
    disc = _first_disc(search, rank, start)
    found = _as_loud_as_it_seems(Attempt(image, plate, streak, search, disc))
    first = _where_it_leads(found)
    attempt = _beside_any_shadow(first)
    if first is not found and attempt.end.left > MAX_MISFIT:
        # What stands for an object and its shadow may lead anywhere.
        unled = _beside_any_shadow(found)
        if unled is not found and unled.end.misfit <= MAX_MISFIT:
            return unled.end.sweep(image)
    if attempt is not first:  # a shadow may have hidden how loud noise is
        attempt = _as_loud_as_it_seems(attempt)
    told, one_paint = attempt.end, attempt.disc.frame.rank == 1
    if one_paint and told.left > MAX_MISFIT:
        attempt = _in_front_left_out(attempt)
        told = attempt.end
    # A richer outline would take up what is left of the shadow, and hide behind what is in front.
    explained = attempt.search is not first.search and told.misfit <= MAX_MISFIT
    if one_paint and not explained:
        told = _richer(attempt, first.search)
    return told.sweep(image)


def fit_disc(
    image: LinearImage, plate: LinearImage, streak: Streak, model: ColorModel | None = None
) -> Sweep:
    """A disc on a throw: the quick part of `fit_sweep`, for the frames of a clip.

    Parameters
    ----------
    image, plate : LinearImage
        Of one size, noise known.
    streak : Streak
        Where the object moved.
    model : ColorModel, optional
        As for `fit_sweep`; one paint if not given.

    Returns
    -------
    Sweep
        It need not explain the streak: `Sweep.misfit` says. Colors that the file let run together are
        taken as they are; errors say so.
    """
    rank = 1 if model is None else model.rank
    known = None if model is None or rank == 3 else known_color(model)
    search = Search.of(streak, image, plate, known, QUICK)
    disc = search.quick(rank)
    louder = understated(search.data, disc)
    if louder > 1:
        search = search.raised(louder)
        disc = search.quick(rank)
    blur = disc.silhouette.softness(disc.shape) if ran_together(search.data, disc) else 0.0
    return End(search, disc, blur).sweep(image)


def _first_disc(search: Search, rank: int, start: Sweep | None) -> State:
    """A disc on a path like that of another frame if it explains the streak, or the best of all."""
    if start is not None:
        disc = search.near(start, rank)
        if misfit(search.data, disc) <= MAX_MISFIT:
            return disc
    return search.best(rank)


def _as_loud_as_it_seems(attempt: Attempt) -> Attempt:
    """The best disc in louder noise, if a disc explains all but that; see `understated`."""
    louder = understated(attempt.search.data, attempt.disc)
    if louder == 1:
        return attempt
    image, plate = (p.with_noise(louder * p.variance) for p in (attempt.image, attempt.plate))
    search = attempt.search.raised(louder)
    disc = search.best(attempt.disc.frame.rank)
    return replace(attempt, image=image, plate=plate, search=search, disc=disc)


def _where_it_leads(found: Attempt) -> Attempt:
    """The best disc where that of what was found leads, if it leaves it."""
    attempt, data = found, found.search.data
    for _ in range(_FOLLOWING):
        if stays(attempt.search.data, attempt.disc) or np.isnan(found.streak.evidence):
            break  # a streak that was given, not found, is all there is
        end = End(attempt.search, attempt.disc)
        streak = _followed(attempt.streak, end.sweep(found.image))
        search = Search.of(streak, found.image, found.plate, data.known, louder=data.louder)
        disc = search.best(attempt.disc.frame.rank)
        attempt = replace(found, streak=streak, search=search, disc=disc)
    return attempt


def _beside_any_shadow(first: Attempt) -> Attempt:
    """A disc beside a shadow that its color tells, or that only darkness does; the first if neither."""
    attempt = beside_shadow(first)
    if attempt is first and first.disc.frame.rank == 1 and first.end.left > MAX_MISFIT:
        return _unless_shaped(first, beside_darkness(first))
    return attempt


def _unless_shaped(first: Attempt, simpler: Attempt) -> Attempt:
    """A disc of less of the light, or the first of all of it if an outline is likelier than both."""
    if simpler.search is first.search:
        return simpler
    shaped = first.shaped
    ends = (simpler.end.search.data, simpler.end.state), (shaped.search.data, shaped.state)
    return first if shaped.left <= MAX_MISFIT and likelier(*ends) else simpler


def _in_front_left_out(attempt: Attempt) -> Attempt:
    """Search again without what something still in front hides, if that explains the streak."""
    image = attempt.image
    hidden = in_front_of(attempt.search.data, attempt.disc, (image.size[1], image.size[0]))
    if not hidden.any():
        return attempt
    free = replace(image, valid=image.valid & ~hidden)
    data = attempt.search.data
    rest = Search.of(attempt.streak, free, attempt.plate, data.known, louder=data.louder)
    again = rest.best(attempt.disc.frame.rank)
    before, after = End(attempt.search, attempt.disc), End(rest, again)
    less = after.beyond_noise <= _SAVED * before.beyond_noise
    less |= after.astray < _SAVED * before.astray
    if after.misfit > MAX_MISFIT or not less:
        return attempt
    return _unless_shaped(attempt, replace(attempt, search=rest, disc=again))


def _followed(streak: Streak, sweep: Sweep) -> Streak:
    """The streak, and where a path leads that leaves it: of a faint one only parts may be found."""
    x0, y0, x1, y1 = sweep.box
    alpha, _ = sweep.within(sweep.box)
    mask = streak.mask.copy()
    mask[y0:y1, x0:x1] |= alpha > _FOLLOWED * alpha.max(initial=0)
    return replace(streak, mask=mask)


def _richer(attempt: Attempt, whole: Search) -> End:
    """One paint of any shape, unless only several, or any, on a disc explain the streak.

    Of a disc with a second paint it is the whole streak: what is dark for the first may be that.
    """
    told, line = attempt.end, attempt.shaped
    left, simple = line.left, line.state.silhouette.bulges == 1
    glossy = with_highlight(attempt) if may_be_glossy(line) else None
    explained = line.beyond_noise <= MAX_MISFIT
    if glossy is not None and (not explained or glossy.end.is_clearly_likelier_than(line)):
        return glossy.end
    if (explained and is_contested(line.state)) or line.search.data.known is not None:
        return line
    enough = left <= MAX_MISFIT and simple
    of_two = _of_two(line) if enough else None
    if enough and of_two is None:
        return line
    plane = _plane(whole.as_measured, line, attempt.transfer)
    # Where one paint leaves nothing it is its shape that is wrong: more colors would only hide that.
    left = min(_left_across(line, plane) if enough else left, told.beyond_noise)
    if plane.misfit <= min(left / _CLEARLY, MAX_MISFIT):
        return plane.contested_as(line)
    if of_two is not None:
        return line.contested_by(of_two)
    if not simple and plane.misfit <= MAX_MISFIT:
        return line.contested_by(seen(line.search.data, plane.state))
    line = plane if plane.plausible and not line.plausible else line
    if left <= MAX_MISFIT or not told.is_before_texture:
        return line
    any_colors = End(whole, whole.best(3))
    if not any_colors.is_confirmed or any_colors.misfit > MAX_MISFIT:
        return line
    # A field of colors takes up what a wrong shape leaves, all but that another is likelier.
    return line if is_oval(whole.data, any_colors.state) else any_colors


def _of_two(line: End) -> State | None:
    """A plane of colors, from where a line ended, if it leaves clearly less with another alpha.

    In compressed pictures one paint may leave no more than noise of an object of two.
    """
    coarse, roughly = _roughly_freed(line.search, line.state)
    if not differ(seen(coarse, line.state), roughly):
        return None
    plane = End(line.search, _freed(line.search, roughly))
    found = plane.state.converged and can_be(line.search.data, plane.state)
    less = found and plane.beyond_noise <= _left_across(line, plane) / _CLEARLY
    return plane.state if less and differ(line.state, plane.state) else None


def _left_across(line: End, plane: End) -> float:
    """What a line leaves beyond noise, of all colors or only of those that a plane cannot have.

    What a plane does not ask for may be all that it gains: files spare some colors more than others.
    """
    data, one = line.search.data, line.state
    across = state_at(data, one.family, one.path, one.silhouette, one.shape, plane.state.frame)
    return min(line.left, left_beyond_noise(data, across))


def _plane(search: Search, line: End, transfer: Transfer) -> End:
    """A disc with a plane of colors: the best of all paths, or from where a line ended.

    Highlights and shades are no more than a little beside one paint, and a plane that is free from the
    beginning may end as something else.
    """
    data, best = search.data, search.best(2)
    near = _freed(search, _roughly_freed(search, line.state)[1])
    possible = [state for state in (best, near) if state.converged and can_be(data, state)]
    return End.before_bleeding(search, best_of(data, possible or [best]), transfer)


def _roughly_freed(search: Search, line: State) -> tuple[Data, State]:
    """Large pixels, and where a descent on them ends that begins with a path and size of one paint.

    As a disc of a plane.
    """
    data, shape = search.data, line.shape[: DISC.size]
    coarse = data.coarse_enough(float(shape[0]), RADIUS)
    frame = main_colors(coarse, DISC.sweep(line.family, line.path, shape, coarse).alpha, 2)
    start = state_at(coarse, line.family, line.path, DISC, shape, frame)
    return coarse, descend(coarse, start, search.bounds, enough=ROUGHLY)


def _freed(search: Search, roughly: State) -> State:
    """Where one goes on from there on small pixels."""
    return descend(search.data, seen(search.data, roughly), search.bounds)
