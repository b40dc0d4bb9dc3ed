"""HYPOTHESES: the shapes on paths that compete for a streak, when each is worth a fit, and its fits.

Hypotheses are fitted in the order of the list; each knows the fits of those before it. Every fit is a
candidate. Its odds are its marginal likelihood with half a log of the number of pixels for each
parameter (`assess.model_selection`), and the sweep that it becomes describes itself (`Sweep.in_words`).
A solver may add alpha without a shape (`matting.hypotheses`).
"""

import math
import time
from abc import ABC, abstractmethod
from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from itertools import chain
from typing import ClassVar

from blurmatte.color.shadows import darkness
from blurmatte.radiometry import LinearImage
from blurmatte.streaks import Streak
from blurmatte.sweep.fit import outline
from blurmatte.sweep.fit.free import fit_free
from blurmatte.sweep.fit.multistart import QUICK_RADII, Multistart, with_varied_colors
from blurmatte.sweep.fit.pattern import fit_patterns, has_pattern
from blurmatte.sweep.fit.ranking import Candidate, noise_inflation, residual_excess
from blurmatte.sweep.fit.shadow import fit_with_shadow, may_be_shaded
from blurmatte.sweep.model.cast_shadow import CastShadow
from blurmatte.sweep.model.color_field import ColorPrior
from blurmatte.sweep.model.observation import Observation
from blurmatte.sweep.model.state import State
from blurmatte.sweep.model.student_t import VARIANCE
from blurmatte.sweep.sweep import MAX_RESIDUAL_EXCESS, Sweep

# Variance inflation of residuals that another shape or light does not reduce
_MAX_EXPLAINED_INFLATION = 1.2


@dataclass(frozen=True)
class TimeLimit:
    """A limit of the time after which no further hypothesis is fitted."""

    seconds: float = math.inf  # of all threads of this process
    begun: float = field(default_factory=time.process_time)

    @property
    def is_over(self) -> bool:
        """Whether it has passed."""
        return time.process_time() - self.begun > self.seconds


@dataclass(frozen=True, eq=False)
class Fits:
    """What hypotheses are fitted to, and the fits so far."""

    search: Multistart  # with the noise that the discs estimate
    image: LinearImage
    plate: LinearImage
    streak: Streak
    # Discs with their opacity, the best first: of one paint, and of varied colors unless these are
    # known to be one paint
    one_paint: tuple[State, ...]
    varied: tuple[State, ...]
    candidates: tuple[Candidate, ...] = ()
    # The first hypothesis that leaves nothing to explain for one paint, and its fit
    explained: "tuple[Hypothesis, State] | None" = None

    @property
    def disc(self) -> State:
        """The best disc of one paint."""
        return self.one_paint[0]

    @property
    def of_one_paint(self) -> list[State]:
        """Fits of one paint so far, before the plate as it is."""
        states = [one.state for one in self.candidates if one.cast is None]
        return [state for state in states if state.observation.color.varied == 1]

    def with_fits_of(self, hypothesis: "Hypothesis") -> "Fits":
        """With the fits of a hypothesis."""
        found = tuple(hypothesis.fits(self))
        explained = self.explained
        # A pattern also explains other shapes: whether these are worth a fit, a disc without shows.
        states = [c.state if c.covariance is None else self.disc for c in found]
        one_paint = [state for state in states if state.observation.color.varied == 1]
        if explained is None and one_paint and is_explained_by(one_paint[0]):
            explained = hypothesis, one_paint[0]
        return replace(self, candidates=(*self.candidates, *found), explained=explained)


class Hypothesis(ABC):
    """A kind of shape on a path."""

    in_words: ClassVar[str] = "a shape"  #: with its article
    #: Whether it may explain a shadow as a part of the object
    follows_shadow: ClassVar[bool] = False
    changes_plate: ClassVar[bool] = False  #: whether the object changes the light of the plate

    def is_worth_fitting(self, fits: Fits) -> bool:
        """Whether it may be likelier than those before it: if they leave something to explain."""
        return fits.explained is None

    @abstractmethod
    def fits(self, fits: Fits) -> Iterable[Candidate]:
        """Its fits, of one paint first; none if it is not likelier than what it generalizes."""


@dataclass(frozen=True)
class Disc(Hypothesis):
    """A disc of one paint or of varied colors, or in gray pictures with a pattern.

    The fits of others start from it.
    """

    in_words = "a disc"

    def fits(self, fits: Fits) -> Iterable[Candidate]:
        """All that the search found."""
        if has_pattern(fits.disc):
            found = (fit_patterns(disc, fits.search.bounds) for disc in fits.one_paint)
            return chain.from_iterable(found)
        return (Candidate(disc) for disc in (*fits.one_paint, *fits.varied))


@dataclass(frozen=True)
class GrowingDisc(Hypothesis):
    """A disc whose size changes."""

    in_words = "a growing disc"

    def is_worth_fitting(self, fits: Fits) -> bool:
        """Not if the size is known to be constant."""
        return not fits.search.observation.is_known_disc and super().is_worth_fitting(fits)

    def fits(self, fits: Fits) -> Iterable[Candidate]:
        """From the best disc of one paint, and from that of varied colors."""
        for discs in filter(None, (fits.one_paint, fits.varied)):
            grown = outline.fit_growing(discs[0], fits.search.bounds)
            if grown is not discs[0]:
                yield Candidate(grown)


@dataclass(frozen=True)
class Outline(Hypothesis):
    """An ellipse or an outline of higher order, which may turn and change."""

    in_words = "an outline"
    follows_shadow = True

    def is_worth_fitting(self, fits: Fits) -> bool:
        """Not if the shape is known."""
        return not fits.search.observation.is_known_disc and super().is_worth_fitting(fits)

    def fits(self, fits: Fits) -> Iterable[Candidate]:
        """Of one paint: the best, and the same that exchanged its length and that of its path."""
        best = outline.fit_outline(fits.disc)
        other = None if best is fits.disc else outline.exchanged(best, fits.disc)
        if other is None:
            return [Candidate(best)]
        gains = [outline.gain_of_resolution(one, fits.search.bounds) for one in (best, other)]
        return [
            Candidate(one, unresolved=gain - min(gains))
            for one, gain in zip((best, other), gains, strict=True)
        ]


@dataclass(frozen=True)
class FreeSilhouette(Hypothesis):
    """Any silhouette that neither turns nor changes, with holes and several parts."""

    in_words = "a free silhouette"
    follows_shadow = True

    def is_worth_fitting(self, fits: Fits) -> bool:
        """Also if only an outline of the highest order explains it; not if it is seen through."""
        disc = fits.disc
        if (
            fits.search.observation.is_known_disc
            or disc.silhouette.opacity < 1
            or disc.observation.light_alone
        ):
            return False
        return fits.explained is None or fits.explained[1].silhouette.order == outline.HIGHEST_ORDER

    def fits(self, fits: Fits) -> Iterable[Candidate]:
        """Of one paint, from the paths of the other shapes."""
        found = fit_free(fits.of_one_paint)
        return [] if found is None else [Candidate(found)]


@dataclass(frozen=True)
class DiscWithShadow(Hypothesis):
    """A disc and the shadow that it casts, of constant size and growing."""

    in_words = "a disc with its shadow"
    changes_plate = True

    def is_worth_fitting(self, fits: Fits) -> bool:
        """Also if a shape explains the streak that may have followed the shadow."""
        if fits.explained is None:
            return True
        hypothesis, state = fits.explained
        return hypothesis.follows_shadow and may_be_shaded(fits.disc, state)

    def fits(self, fits: Fits) -> Iterable[Candidate]:
        """From the disc, or from the part of the streak that is not only darker."""
        shaded = self._shaded(fits)
        if shaded is None:
            return []
        state, cast = shaded
        if fits.search.observation.is_known_disc:
            return [Candidate(state, cast)]
        alike = dict.fromkeys((state, outline.fit_growing(state, fits.search.bounds)))
        return [Candidate(each, cast) for each in alike]

    def _shaded(self, fits: Fits) -> tuple[State, CastShadow] | None:
        """The disc of constant size, and its shadow."""
        image, streak, disc = fits.image, fits.streak, fits.disc
        rival = min(fits.of_one_paint, key=lambda state: state.cost, default=disc)
        shaded = fit_with_shadow(disc, fits.search, rival)
        dark = darkness(image, fits.plate, streak)
        if shaded is not None or not dark.any() or not (streak.mask & ~dark).any():
            return shaded
        lit = replace(image, valid=image.valid & ~dark)
        rest = replace(streak, mask=streak.mask & ~dark)
        color = fits.search.observation.of_one_paint.color
        start = quick_search(rest, lit, fits.plate, color).quick()
        return fit_with_shadow(start.on(disc.observation), fits.search, rival)


HYPOTHESES: tuple[Hypothesis, ...] = (
    Disc(),
    GrowingDisc(),
    Outline(),
    FreeSilhouette(),
    DiscWithShadow(),
)


def is_explained_by(state: State) -> bool:
    """Whether a fit leaves no residuals for other shapes or light to explain."""
    return is_explained(state.observation, state.variance_inflation, residual_excess(state))


def is_explained(observation: Observation, inflation: float, excess: float) -> bool:
    """Whether residuals of this variance inflation and excess have nothing more to explain.

    If other frames know path and silhouette, residuals that correlate no more than the noise around
    them are that noise.
    """
    if observation.is_known_disc and excess <= MAX_RESIDUAL_EXCESS:
        return True
    return inflation <= _MAX_EXPLAINED_INFLATION


def quick_search(
    streak: Streak, image: LinearImage, plate: LinearImage, color: ColorPrior
) -> Multistart:
    """The search from discs of one radius."""
    return Multistart.of(streak, image, plate, color, QUICK_RADII)


def best_discs(
    search: Multistart, start: Sweep | None
) -> tuple[Multistart, list[State], list[State]]:
    """The best discs of one paint and of colors that vary, with the noise that they estimate."""

    def best(search: Multistart) -> tuple[list[State], list[State]]:
        """Discs of one paint and of varied colors, from the search or from `start`."""
        if start is None:
            return search.best()
        curve = start.family.curve(start.path)
        disc = search.of_one_paint.near(start.family, curve, start.radius)
        is_one_paint = search.observation.color.rank == 1
        return [disc], [] if is_one_paint else [with_varied_colors(disc)]

    prior, search = search.observation.prior, search.without_prior  # it would hide a misfit
    discs = best(search)
    inflation = noise_inflation(discs[0][0])
    if inflation > 1:
        search = search.with_noise_inflated(inflation)
        discs = best(search)
    if prior is not None:
        weight = discs[0][0].variance_inflation * VARIANCE * prior.scatter**2
        search = search.with_prior(replace(prior, weight=weight))
        discs = best(search)
    return search, *discs
