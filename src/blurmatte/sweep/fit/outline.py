"""Outlines: from the best disc to the shape that the observation asks for.

Fits of ellipses and of outlines of higher order start from the disc's path and from others on large
pixels, for a disc that stands for something else takes detours. The shape of the least Bayesian
information criterion goes on to small pixels, where its order grows as long as that pays.
"""

from collections.abc import Iterable
from dataclasses import replace

from blurmatte.sweep.fit.levenberg_marquardt import ROUGH_TOLERANCE, minimize
from blurmatte.sweep.fit.outline_start import (
    changing,
    crosswise,
    outlined,
    straighter,
    stretched,
    turning,
)
from blurmatte.sweep.fit.ranking import (
    DECISIVE_LOG_BAYES_FACTOR,
    best_of,
    bic_penalty,
)
from blurmatte.sweep.fit.residuals import variance_inflation
from blurmatte.sweep.model.path import ARC, LINE, PARABOLA
from blurmatte.sweep.model.state import State

_RADIUS, _SOFT_RADIUS = 8.0, 4.0  # pixels of a disc on large pixels
_COARSE_ORDERS, _FINE_ORDERS = (2, 4, 8), (4, 8, 12)
_MIN_RADIUS, _MAX_RADIUS = 0.25, 2.5  # of the disc's radius
_MAX_COARSE_STEPS, _MAX_FINE_STEPS = 20, 15
_EXPLAINED_INFLATION = 1.3  # of variance, of residuals that no shape improves


def fit_outline(disc: State) -> State:
    """The shape of the least Bayesian information criterion; the disc if that is one.

    Parameters
    ----------
    disc : State
        Where a fit of a disc of one paint ended.
    """
    bounds = _MIN_RADIUS * disc.shape[0], _MAX_RADIUS * disc.shape[0]
    radius = _SOFT_RADIUS if disc.silhouette.soft else _RADIUS
    coarse = disc.observation.coarse_enough(float(disc.shape[0]), radius)
    start = minimize(disc.on(coarse), bounds, _MAX_COARSE_STEPS, ROUGH_TOLERANCE)
    shapes = [outlined(start), replace(outlined(start), order=2)]
    found = _fitted((start.of_kind(shape) for shape in shapes), bounds)
    if not _could_pay(start, best_of(found)) and variance_inflation(start) < _EXPLAINED_INFLATION:
        return disc
    for starts in (straighter, stretched, crosswise, turning, changing):
        found += _fitted(starts(start, best_of(found)), bounds)
        if variance_inflation(best_of(found)) < _EXPLAINED_INFLATION:
            break
    best = best_of([start, *found])
    if best is start:
        return disc
    others = [best.of_kind(replace(best.silhouette, order=k)) for k in _COARSE_ORDERS]
    others += [best.along(family) for family in (LINE, ARC, PARABOLA) if family is not best.family]
    best = best_of([start, best, *_fitted(others, bounds)])
    if best is start:
        return disc
    fine = minimize(best.on(disc.observation), bounds, _MAX_FINE_STEPS, ROUGH_TOLERANCE)
    return best_of([disc, _of_higher_order(fine, bounds)])


def _fitted(starts: Iterable[State], bounds: tuple[float, float]) -> list[State]:
    """Fits on large pixels."""
    return [minimize(s, bounds, _MAX_COARSE_STEPS, ROUGH_TOLERANCE) for s in starts]


def _could_pay(disc: State, richest: State) -> bool:
    """Whether an ellipse would be taken if it gained as much as the richest shape."""
    gain = (disc.cost - richest.cost) / variance_inflation(richest)
    return gain > bic_penalty(disc.observation, 2) + DECISIVE_LOG_BAYES_FACTOR


def _of_higher_order(state: State, bounds: tuple[float, float]) -> State:
    """The same with an order that is higher as long as that pays: small pixels show more."""
    for order in _FINE_ORDERS:
        if order <= state.silhouette.order:
            continue
        richer = state.of_kind(replace(state.silhouette, order=order))
        richer = minimize(richer, bounds, _MAX_FINE_STEPS, ROUGH_TOLERANCE)
        if best_of([state, richer]) is state:
            break
        state = richer
    return state
