"""refined: from the disc that fits best to the silhouette that the data ask for.

A richer silhouette is taken only where the likelihood gains clearly more than its parameters cost
[Schwarz 1978]; a likelihood counts less where residuals hang together, for then fewer of them are
evidence. It is looked for on large pixels, from the disc's path and from others: a disc that stands
for something else takes detours.

Before a plate of one color an object of one color may as well be thinner and brighter, if only its
path fits; what would be brighter than anything in a picture is left out.
"""

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from blurmatte.sweep.choice import CLEARLY, contested, differ, most_apart, price
from blurmatte.sweep.data import Data
from blurmatte.sweep.descent import ROUGHLY, State, descend, seen
from blurmatte.sweep.outline_start import (
    bulgy,
    crosswise,
    exchanged,
    on_path,
    rescaled,
    shaped,
    straighter,
    stretched,
    turning,
)
from blurmatte.sweep.path import ARC, CUBIC, LINE, PARABOLA
from blurmatte.sweep.side_by_side import side_by_side
from blurmatte.sweep.smooth_light import smooth_light
from blurmatte.sweep.verdict import (
    HOPELESS,
    MAX_MISFIT,
    can_be,
    coherence,
    coherence_beside,
    left_beyond_noise,
    misfit,
    overstated,
)

Array = npt.NDArray[np.float64]

_RADIUS, _SOFT_RADIUS = 8.0, 4.0  # pixels: enough to tell bulges apart, few enough to be quick
_OTHERS, _MORE = (2, 4, 8), (4, 8, 12, 16)  # bulges
_LEAST, _MOST = 0.25, 2.5  # of the disc's radius
_LUCK = 0.02  # probability that noise alone makes a richer shape look so much better
_SMALL = 1000  # pixels, of a streak: much explains it
_SHORT = 4.0  # radii, a way on which a long thing that went across leaves much the same
_RIVALS = 1.4  # misfit: outlines err by the bulges that they cannot have, and may be as true
# Units of log likelihood that rule out what has another shape: wrong ones were likelier by up to 84.
_RULED_OUT = 100.0
_ASTRAY = 0.4  # of alpha: right outlines, with as many bulges as they needed, left up to 0.17
_RIMS = 0.07  # of alpha, what bulges leave: sheets that differ in scale alone left 0.03 to 0.05
_EXPLAINED = 1.3  # coherence of residuals in which nothing is left to be found


def refined(data: Data, disc: State) -> State:
    """The silhouette, path and color that explain the data best, starting from a disc's.

    Parameters
    ----------
    data : Data
    disc : State
        Where a descent with a disc ended.

    Returns
    -------
    State
        The disc unless another silhouette explains the data clearly better; contested if one that
        does not has another alpha.
    """
    bounds = _LEAST * disc.shape[0], _MOST * disc.shape[0]
    radius = _SOFT_RADIUS if disc.silhouette.soft else _RADIUS
    coarse = data.coarse_enough(float(disc.shape[0]), radius)
    start = descend(coarse, seen(coarse, disc), bounds)
    richer = [bulgy(start), replace(bulgy(start), bulges=2)]
    found = _roughly(coarse, (shaped(coarse, start, s) for s in richer), bounds)
    explained = misfit(data, disc) <= MAX_MISFIT
    small = bool(np.count_nonzero(disc.swept.alpha) * data.scale**2 < _SMALL)
    if not small and not _could_pay(coarse, start, found[0]):
        if not explained or _is_short(start):
            found += _roughly(coarse, crosswise(coarse, start, start), bounds)
        # What went little looks like much that went far; what is slow at both ends, like a longer one.
        if explained and (_is_short(start) or start.family is CUBIC):
            found += _roughly(coarse, stretched(coarse, start, start), bounds)
        if explained and _best(coarse, [start, *found]) is start:
            return _remaining(data, disc, bounds, _lucky(coarse, start, found))
    found = _search(coarse, start, found, bounds, everything=small)
    best = _best(coarse, [start, *found])
    others = [shaped(coarse, best, replace(best.silhouette, bulges=k)) for k in _OTHERS]
    others += [on_path(coarse, best, f) for f in (LINE, ARC, PARABOLA) if f is not best.family]
    ends = [start, *found, *_roughly(coarse, others, bounds)]
    order = _ordered(coarse, ends)
    if order[0][1] is start:
        return _remaining(data, disc, bounds, _lucky(coarse, start, found))
    best = contested(coarse, order)
    end = _bulgier(data, descend(data, seen(data, best), bounds), bounds)
    rivals = side_by_side(
        lambda rival: descend(data, _bulging_as(data, rival, end), bounds),
        _rivals(coarse, best, bounds),
    )
    # The rims of some are harder to describe, and would seem worse with as many bulges.
    near = [s for s in rivals if s.cost < end.cost or _explains(data, s)]
    ends = [end, *side_by_side(lambda s: _bulgier(data, s, bounds), near)]
    order = _ordered(data, ends)
    least, end = order[0]
    others = [s for score, s in order[1:] if not _is_ruled_out(data, end, s, score - least)]
    rivals = [s for s in others if differ(end, s) and _explains(data, s)]
    return replace(end, contested=max(best.contested, most_apart(end, rivals)))


def is_oval(data: Data, disc: State) -> bool:
    """Whether an ellipse explains the data clearly better than a disc of any colors."""
    bounds = _LEAST * disc.shape[0], _MOST * disc.shape[0]
    start = shaped(data, disc, replace(disc.silhouette, bulges=2))
    return likelier((data, disc), (data, descend(data, start, bounds)))


def _rivals(data: Data, best: State, bounds: tuple[float, float]) -> list[State]:
    """Not hopeless ends of descents from what has nearly the same alpha as the best, but for scale."""
    ends = _roughly(data, rescaled(data, best, bounds), bounds)
    for start in exchanged(data, best, bounds):
        # Sides say the size; what may shrink at first ends as light that no object has.
        ends += _roughly(data, [start], (float(start.shape[0]), bounds[1]))
    return _distinct([s for s in ends if can_be(data, s) and left_beyond_noise(data, s) < HOPELESS])


def _bulging_as(data: Data, rival: State, end: State) -> State:
    """A rival with as many bulges as the end."""
    turns = rival.silhouette.turns or end.silhouette.turns
    return shaped(data, rival, replace(end.silhouette, turns=turns))


def _remaining(data: Data, disc: State, bounds: tuple[float, float], rivals: list[State]) -> State:
    """The disc, contested if what is not clearly better on large pixels is another answer.

    On small pixels it must leave as little as a rival does, gain more than noise gives, and not need
    light that changes as no paint does.
    """
    ends = side_by_side(lambda s: descend(data, seen(data, s), bounds), _distinct(rivals))
    ends = [end for end in ends if left_beyond_noise(data, end) <= _RIVALS]
    by = most_apart(disc, [e for e in _lucky(data, disc, ends) if not _is_astray(data, e)])
    return replace(disc, contested=by) if by > disc.contested else disc


def _is_astray(data: Data, rival: State) -> bool:
    """Whether smooth light finds another alpha than a rival's; few bulges are not all of an outline."""
    if data.known is not None:
        return False  # it tells alpha by itself
    return smooth_light(data, rival).astray_of_places > _ASTRAY


def _lucky(data: Data, disc: State, others: list[State]) -> list[State]:
    """Those with another alpha than a disc's that gain more than noise gives by luck.

    Of noise alone twice the gain of so many more parameters is χ² of as many [Wilks 1938]; where
    noise hangs together beside a disc, so it does within whatever takes its place.
    """
    from scipy.special import chdtrc

    noise, lucky = coherence_beside(data, disc), []
    for other in others:
        gain = (disc.cost - other.cost) / max(overstated(data, other), noise)
        more = other.size - disc.size
        if more > 0 and differ(disc, other) and chdtrc(more, 2 * max(gain, 0)) < _LUCK:
            lucky.append(other)
    return lucky


def _distinct(states: list[State]) -> list[State]:
    """The likeliest of those that are the same answer."""
    kept: list[State] = []
    for state in sorted(states, key=lambda state: state.cost):
        if all(differ(state, other) for other in kept):
            kept.append(state)
    return kept


def _explains(data: Data, rival: State) -> bool:
    """Whether it leaves little; where its descent had no end yet, it would have left even less."""
    return misfit(data, replace(rival, converged=True)) <= _RIVALS


def _is_ruled_out(data: Data, end: State, rival: State, behind: float) -> bool:
    """Whether a rival cannot be, that is so many units of log likelihood behind the end.

    Not where its residuals hang together less than those of the end: what it has against it is then no
    shape, but the noise of single pixels.
    """
    close = behind < _RULED_OUT or _is_scaled(end, rival)
    return not close and left_beyond_noise(data, rival) > left_beyond_noise(data, end)


def _is_scaled(end: State, rival: State) -> bool:
    """Whether its alpha is the same but for scale, and for what rims of few bulges cannot describe."""
    a, b = end.swept.alpha, rival.swept.alpha
    scale = (a * b).sum() / max((b * b).sum(), 1e-9)
    return bool(((scale * b - a) ** 2).sum() < _RIMS**2 * (a**2).sum())


def _is_short(disc: State) -> bool:
    """Whether it went less far than a few times its radius."""
    way = np.linalg.norm(np.diff(disc.curve, axis=0), axis=1).sum()
    return bool(way < _SHORT * disc.shape[0])


def _roughly(data: Data, starts: Iterable[State], bounds: tuple[float, float]) -> list[State]:
    """The ends of descents on large pixels."""
    return [descend(data, start, bounds, enough=ROUGHLY) for start in starts]


def _bulgier(data: Data, state: State, bounds: tuple[float, float]) -> State:
    """The same with as many more bulges as pay: large pixels do not show them all."""
    for bulges in _MORE:
        if bulges <= state.silhouette.bulges:
            continue
        start = shaped(data, state, replace(state.silhouette, bulges=bulges))
        richer = _best(data, [state, descend(data, start, bounds)])
        if richer is state:
            break
        state = richer
    return state


def _search(
    data: Data, disc: State, found: list[State], bounds: tuple[float, float], everything: bool
) -> list[State]:
    """Ends of descents from other paths and with turning, of all, or until one leaves nothing."""
    for starts in (straighter, stretched, crosswise, turning):
        begin = starts(data, disc, _best(data, found))
        found = [*found, *_roughly(data, begin, bounds)]
        if not everything and coherence(data, _best(data, found)) < _EXPLAINED:
            break
    return found


def _could_pay(data: Data, disc: State, richest: State) -> bool:
    """Whether an ellipse would be taken if it gained as much as the richest shape."""
    return (disc.cost - richest.cost) / overstated(data, richest) > _price(data, 2)


def likelier(simple: tuple[Data, State], rich: tuple[Data, State]) -> bool:
    """Whether one of two ends is the better, though it needs more parameters; see `gained`."""
    return gained(simple, rich) > 0


def gained(simple: tuple[Data, State], rich: tuple[Data, State]) -> float:
    """By how much one of two ends is likelier than another and the parameters that it needs cost.

    Parameters
    ----------
    simple, rich : (Data, State)
        Each with the light that it is to explain.
    """
    if not (can_be(*simple) and can_be(*rich)):
        return np.inf if can_be(*rich) else -np.inf
    trust = min(overstated(*simple), overstated(*rich))
    gain = (simple[1].cost - rich[1].cost) / trust
    return gain - _price(rich[0], rich[1].size - simple[1].size)


def _best(data: Data, states: Sequence[State]) -> State:
    """The one of the best penalised likelihood, of those that can be if there are any."""
    return _ordered(data, states)[0][1]


def _ordered(data: Data, states: Sequence[State]) -> list[tuple[float, State]]:
    """States that can be, if any can, and how much worse they are than the first; the best first."""
    first = states[0]
    believable = [s for s in states if can_be(data, s)] or [first]
    trust = min(overstated(data, s) for s in believable)
    scores = [(s.cost - first.cost) / trust + _price(data, s.size - first.size) for s in believable]
    return sorted(zip(scores, believable, strict=True), key=lambda pair: pair[0])


def _price(data: Data, parameters: int) -> float:
    """What the log likelihood must gain by so many more parameters, or may lose by fewer."""
    return price(data, parameters) + (CLEARLY if parameters > 0 else 0)
