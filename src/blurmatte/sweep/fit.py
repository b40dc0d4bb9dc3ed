"""fit_sweep: image, plate and streak → Sweep.

Path, silhouette and color are found together, as those for which the least is left of the light
across the color, by Levenberg–Marquardt steps with weights that doubt what cannot be noise; first for
a disc of one paint (`search`), then for other outlines (`outline`) or more colors; at last for any
colors that change little within a fraction of the radius (`field`).
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt

from blurmatte.color.model import ColorModel
from blurmatte.color.shade import refuse_shade
from blurmatte.radiometry import SRGB, LinearImage, Transfer, with_noise
from blurmatte.streaks import Streak, require_streaks
from blurmatte.sweep.choice import differ
from blurmatte.sweep.chroma import left_untold
from blurmatte.sweep.data import Data
from blurmatte.sweep.descent import State, descend, seen, sharp
from blurmatte.sweep.known import KnownColor, known_color
from blurmatte.sweep.occluder import in_front_of, mostly_seen
from blurmatte.sweep.outline import likelier, refined
from blurmatte.sweep.search import QUICK, Search
from blurmatte.sweep.shadow import shadow_beside
from blurmatte.sweep.smooth_light import SmoothLight, smooth_light
from blurmatte.sweep.student import VARIANCE
from blurmatte.sweep.sweep import Sweep
from blurmatte.sweep.verdict import (
    MAX_MISFIT,
    can_be,
    colors_ran_together,
    doubtful_share,
    misfit,
    overstated,
    stays,
    understated,
)

Array = npt.NDArray[np.float64]
Bools = npt.NDArray[np.bool_]

# Of a radius, by rank, the standard deviation of one that means anything. A plane takes up what a wrong
# shape leaves: in compressed pictures such as were known to 4 to 6 % were wrong by 10 to 20 %.
_MOST_UNSURE = {1: 0.25, 2: 0.03, 3: 0.25}
_FOLLOWING = 3  # times that a path may lead out of what was found
_SHADOWS = 2  # times that a streak is looked at without what is found of its shadow
_FOLLOWED = 0.2  # of the largest alpha
_MOST_OF_IT = 0.5  # of a streak, where the plate's texture must tell alpha to believe in any colors
_AGAINST = 3.0  # what it may tell against them
_EXACTLY = 0.05  # of alpha, to which it may tell it instead: paint is finer than a field
# Of alpha, by rank: balls with holes and codecs leave 0.1, wrong shapes up to 0.5. A plane, which takes
# up more, is asked place by place: right ones left up to 0.1, wrong ones 0.3.
_MOST_ASTRAY = {1: 0.125, 2: 0.2, 3: 0.125}
_AGAIN, _NEARBY = 2, 2.0  # times, and by which factor another radius may come out then
_CLEARLY = 1.3  # times less must be left to believe in more colors


@dataclass(frozen=True, eq=False)
class _Told:
    """An end of a search, in the data that it explains.

    Parameters
    ----------
    search : Search
        Of the light before colors ran together.
    state : State
    blur : float
        Pixels by which they did, 0 if not.
    """

    search: Search
    state: State
    blur: float

    @property
    def misfit(self) -> float:
        """See `verdict.misfit`; infinite too for what only light of odd patterns would explain."""
        return np.inf if self.state.contested else self.left

    @cached_property
    def left(self) -> float:
        """The same, whether it is contested or not."""
        left = misfit(self.search.data, replace(self.state, contested=False))
        if self.state.frame.rank == 3 and self._is_told_exactly:
            return 1.0
        most = _MOST_ASTRAY[self.state.frame.rank]
        return left if np.isinf(left) or self.astray <= most else np.inf

    @property
    def astray(self) -> float:
        """See `smooth_light`; a color that is known tells alpha of each pixel, and needs no other."""
        if self.search.data.known is not None:
            return 0.0
        return self.said.astray_of_places if self.state.frame.rank == 2 else self.said.astray

    @cached_property
    def said(self) -> SmoothLight:
        return smooth_light(self.search.data, self.state)

    @property
    def _is_told_exactly(self) -> bool:
        """Whether the plate's texture tells alpha so well that paint may be finer than a field."""
        exactly = self.said.share > _MOST_OF_IT and self.said.scatter < _EXACTLY
        return exactly and self.state.converged and can_be(self.search.data, self.state)


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

    Codecs of clips repeat what stands still as it was, so that noise seems far less than it is where
    something moves: if a disc explains nearly all of the change but for noise that is louder, the
    noise is taken to be that loud; `Sweep.stats["louder"]` says how many times the variance.

    Parameters
    ----------
    image, plate : LinearImage
        With the object, and without; same size.
    streak : Streak, optional
        Where it moved. If not given, the strongest thing that moved.
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
    image, plate = with_noise(image, plate)
    if streak is None:
        streak = require_streaks(image, plate)[0]
    if model is None:
        refuse_shade(image, plate, streak)
    rank = 1 if model is None else model.rank
    known = None if model is None or rank == 3 else known_color(model)
    search = Search.of(streak, image, plate, known)
    disc = _first_disc(search, rank, start)
    louder = understated(search.data, disc)
    if louder > 1:
        image, plate = (p.with_noise(louder * p.variance) for p in (image, plate))
        search = search.louder(louder)
        disc = search.best(rank)
    for _ in range(_FOLLOWING):
        if stays(search.data, disc) or np.isnan(streak.evidence):
            break  # a streak that was given, not found, is all there is
        streak = _followed(streak, _ended(_Told(search, disc, 0.0), image, louder))
        search = Search.of(streak, image, plate, known)
        disc = search.best(rank)
    first = search
    for _ in range(_SHADOWS):
        shadow = _shadow_of(disc, image, plate, streak)
        if not shadow.any():
            break
        image = replace(image, valid=image.valid & ~shadow)
        streak = replace(streak, mask=streak.mask & ~shadow)
        search = Search.of(streak, image, plate, known)
        disc = search.best(rank)
    if misfit(search.data, disc) > MAX_MISFIT and disc.frame.rank == 1:
        search, disc = _in_front_left_out(search, disc, image, plate, streak, known)
    transfer = image.meta.transfer or SRGB
    told = _before_bleeding(search, disc, transfer)
    # A richer outline would take up what is left of the shadow, and hide behind what is in front.
    explained = search is not first and told.misfit <= MAX_MISFIT
    if not explained and disc.frame.rank == 1:
        told = _richer(search, disc, told, transfer)
    return _ended(told, image, louder)


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
        search = search.louder(louder)
        disc = search.quick(rank)
    blur = disc.silhouette.softness(disc.shape) if _ran_together(search.data, disc) else 0.0
    return _ended(_Told(search, disc, blur), image, louder)


def _first_disc(search: Search, rank: int, start: Sweep | None) -> State:
    """A disc on a path like that of another frame if it explains the streak, or the best of all."""
    if start is not None:
        disc = search.near(start, rank)
        if misfit(search.data, disc) <= MAX_MISFIT:
            return disc
    return search.best(rank)


def _shadow_of(disc: State, image: LinearImage, plate: LinearImage, streak: Streak) -> Bools:
    """Where there is a shadow; nowhere if the object may have any colors."""
    if disc.frame.rank == 3:
        return np.zeros(streak.mask.shape, bool)
    return shadow_beside(image, plate, streak, disc.main, disc.brightness)


def _in_front_left_out(
    search: Search,
    disc: State,
    image: LinearImage,
    plate: LinearImage,
    streak: Streak,
    known: KnownColor | None,
) -> tuple[Search, State]:
    """Search again without what something still in front hides, if that explains the streak."""
    hidden = in_front_of(search.data, disc, (image.size[1], image.size[0]))
    if not hidden.any():
        return search, disc
    rest = Search.of(streak, replace(image, valid=image.valid & ~hidden), plate, known)
    again = rest.best(disc.frame.rank)
    better = misfit(rest.data, again) <= MAX_MISFIT and mostly_seen(rest.data, again)
    return (rest, again) if better else (search, disc)


def _followed(streak: Streak, sweep: Sweep) -> Streak:
    """The streak, and where a path leads that leaves it: of a faint one only parts may be found."""
    x0, y0, x1, y1 = sweep.box
    alpha, _ = sweep.within(sweep.box)
    mask = streak.mask.copy()
    mask[y0:y1, x0:x1] |= alpha > _FOLLOWED * alpha.max(initial=0)
    return replace(streak, mask=mask)


def _richer(search: Search, disc: State, told: _Told, transfer: Transfer) -> _Told:
    """One paint of any shape, unless only several, or any, on a disc explain the streak."""
    line = _shaped(search, disc, told, transfer)
    left, simple = line.left, line.state.silhouette.bulges == 1
    enough = left <= MAX_MISFIT and (simple or line.state.contested)
    if enough or search.data.known is not None:
        return line
    plane = _before_bleeding(search, search.best(2), transfer)
    if plane.misfit <= min(left / _CLEARLY, MAX_MISFIT):
        return plane
    if not simple and plane.misfit <= MAX_MISFIT:  # an odd outline of one paint, or a disc of two
        return replace(line, state=replace(line.state, contested=differ(line.state, plane.state)))
    if left <= MAX_MISFIT or not _textured(told.search.data, told.state):
        return line
    any_colors = _Told(search, search.best(3), 0.0)
    agrees = _textured(search.data, any_colors.state) and any_colors.misfit <= MAX_MISFIT
    return any_colors if agrees else line


def _shaped(search: Search, disc: State, told: _Told, transfer: Transfer) -> _Told:
    """The silhouette that the evidence asks for, if but noise is left of it; or the disc.

    Each is asked to explain the light that it tells itself: told by another it would seem worse. What
    an outline leaves it could not take up, free as it is, so that something else is wrong.
    """
    best = refined(search.data, disc)
    if best is disc:
        return told
    shaped = _before_bleeding(search, best, transfer)
    ends = (told.search.data, told.state), (shaped.search.data, shaped.state)
    return shaped if shaped.left <= MAX_MISFIT and likelier(*ends) else told


def _textured(data: Data, state: State) -> bool:
    """Whether the plate's texture would tell a wrong alpha of any colors, and does not of theirs."""
    said = smooth_light(data, state)
    agrees = state.frame.rank < 3 or said.against < _AGAINST or said.scatter < _EXACTLY
    return said.share > _MOST_OF_IT and agrees


def _before_bleeding(search: Search, state: State, transfer: Transfer) -> _Told:
    """What a state becomes of the light before a file let colors run together, if it did."""
    data, blur, contested = search.data, 0.0, state.contested
    if _ran_together(data, state):
        first = search.softest(seen(data, state))
        blur = first.silhouette.softness(first.shape)
    for _ in range(_AGAIN if blur else 0):
        bounds = state.shape[0] / _NEARBY, state.shape[0] * _NEARBY
        alpha = sharp(data, state).swept.alpha
        before = data.before_bleeding(alpha, state.frame.within, blur, transfer)
        search = replace(search, data=before, bounds=bounds)
        state = search.softened(descend(before, sharp(before, state), bounds))
        # Luma was not blurred: a rim seems less soft than the chroma of it is.
        blur = float(np.hypot(blur, state.silhouette.softness(state.shape)))
    return _Told(search, replace(state, contested=contested), blur)


def _ran_together(data: Data, state: State) -> bool:
    """Whether a file blurred the colors of a model."""
    return state.frame.rank < 3 and colors_ran_together(data, state)


def _ended(told: _Told, image: LinearImage, louder: float) -> Sweep:
    """A descent's end. If it was the file that blurred the colors of its rim, the rim is sharp."""
    data, state, blur = told.search.data, told.state, told.blur
    trust = overstated(data, state)
    H, _ = state.information(data)
    covariance = np.asarray(np.linalg.pinv(H, hermitian=True), float) * trust * VARIANCE
    model = _model(state, covariance[-2:, -2:])
    k = len(state.path)
    covariance[: k + 1, : k + 1] += left_untold(state.family, state.path, blur)
    known = covariance[k, k] < (_MOST_UNSURE[state.frame.rank] * state.shape[0]) ** 2
    soft = state.silhouette.soft and blur == 0 and not colors_ran_together(data, state)
    silhouette = replace(state.silhouette, soft=soft)
    n = k + silhouette.size
    stats = {
        "converged": state.converged,
        "misfit": told.misfit if known else np.inf,
        "coherence": trust,
        "contested": state.contested,
        "doubtful": doubtful_share(data, state),
        "astray": told.astray,
        "texture": told.said.scatter if state.frame.rank == 3 else np.inf,
        "rim": blur or state.silhouette.softness(state.shape),
        "louder": louder,
    }
    return Sweep(
        state.family,
        state.path,
        silhouette,
        state.shape[: silhouette.size],
        replace(model, to_srgb=image.meta.to_srgb),
        covariance[:n, :n],
        image.size,
        stats,
    )


def _model(state: State, turns: Array) -> ColorModel:
    """The color model, with the covariance of the one direction that stands for it."""
    frame = state.frame
    if frame.rank == 3:
        return ColorModel.any()
    moving = frame.across if frame.rank == 1 else frame.within
    basis = state.main[:, None] if frame.rank == 1 else frame.within
    return ColorModel(
        basis,
        moving @ turns @ moving.T,
        {"shape": float(np.degrees(np.sqrt(np.trace(turns) / 2)))},
    )
