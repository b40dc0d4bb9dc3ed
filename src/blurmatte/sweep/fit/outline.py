"""Search for shapes other than a disc of constant size: outlines, and growing discs.

Fits of ellipses and of outlines of higher order start on large pixels from the disc's path and from
other paths, for the path of a disc fitted to another shape is biased. The shape of the least Bayesian
information criterion is refined on small pixels, where its order increases while the criterion falls.

A growing disc is a ball that approaches or recedes; only which end of the path is larger is observable.
"""

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from blurmatte.checks import Array
from blurmatte.statistics import DECISIVE_LOG_BAYES_FACTOR
from blurmatte.sweep.fit.levenberg_marquardt import ROUGH_TOLERANCE, minimize
from blurmatte.sweep.fit.ranking import best_of, bic_penalty
from blurmatte.sweep.model.observation import Observation
from blurmatte.sweep.model.path import ARC, LINE, PARABOLA
from blurmatte.sweep.model.shape import OUTLINE_POINTS
from blurmatte.sweep.model.silhouette import Silhouette, as_silhouette
from blurmatte.sweep.model.state import State, state_at

# Radius of a disc on large pixels, with a sharp and with a soft rim
_COARSE_RADIUS_PX = 5.0
_SOFT_COARSE_RADIUS_PX = 4.0
HIGHEST_ORDER = 12  # of the outlines that are fitted
_RESOLVED_ORDER = 32  # at which corners of outlines of 30 pixels are sharp to about a pixel
_FIRST_ORDER = 6  # of the outlines that all searches start with
# Tried on large pixels from the best outline, and on small pixels in turn
_COARSE_ORDERS = (2, 4, 8)
_FINE_ORDERS = (4, 8, HIGHEST_ORDER)
_RADIUS_BOUNDS = (0.25, 2.5)  # of the disc's radius
_MAX_COARSE_STEPS = 20
_MAX_FINE_STEPS = 15
_MIN_EXCHANGED_PX = 2.0  # of a path or an outline that change places: a lens blurs shorter ones
# Of outlines that turn about an end: ends that are tried, of the outermost points in all directions
_MAX_ENDS, _DIRECTIONS = 2, 24
_SLENDER = (0.12, 0.3)  # width over length
_COARSE_WIDTH_PX = 3.0  # of the most slender one on large pixels
_WITHIN = 0.97  # of the pixels of a fan: without stray ones
_MAX_GROWTH_STEPS = 15  # of a growing disc on large pixels
_GROWTHS = (-0.5, 0.5)  # log growth that fits start from
# Variance inflation of residuals that other shapes do not reduce
_MAX_EXPLAINED_INFLATION = 1.3


def fit_outline(disc: State) -> State:
    """The shape of the least Bayesian information criterion, from a fitted disc of one paint."""
    found = _fit_from_disc(disc)
    if found.variance_inflation < _MAX_EXPLAINED_INFLATION:
        return found
    return _about_an_end(found, disc)


def _fit_from_disc(disc: State) -> State:
    """The best outline, from the disc, its path and other paths."""
    bounds = _bounds_around(disc)
    (start,) = _fitted([_on_large_pixels(disc)], bounds)
    shapes = [outlined(start), replace(outlined(start), order=2)]
    explained = _MAX_EXPLAINED_INFLATION
    found = _fitted((start.of_kind(shape) for shape in shapes), bounds)
    if not _could_pay(start, best_of(found)) and start.variance_inflation < explained:
        return disc
    for starts in (straighter, stretched, crosswise, turning, changing):
        found += _fitted(starts(start, best_of(found)), bounds, rival=best_of([start, *found]))
        if best_of(found).variance_inflation < explained:
            break
    best = best_of([start, *found])
    if best is start:
        return disc
    others = [
        best.of_kind(replace(as_silhouette(best.silhouette), order=k)) for k in _COARSE_ORDERS
    ]
    others += [best.along(family) for family in (LINE, ARC, PARABOLA) if family is not best.family]
    best = best_of([start, best, *_fitted(others, bounds, rival=best)])
    if best is start:
        return disc
    fine = minimize(best.on(disc.observation), bounds, _MAX_FINE_STEPS, ROUGH_TOLERANCE)
    return best_of([disc, _of_higher_order(fine, bounds)])


def fit_growing(disc: State, bounds: tuple[float, float]) -> State:
    """The growing disc of the least Bayesian information criterion; the disc if its own is less."""
    coarse = _on_large_pixels(disc)
    best = best_of([coarse, *_fitted(growing(coarse), bounds, _MAX_GROWTH_STEPS)])
    if best is coarse:
        return disc
    fine = minimize(best.on(disc.observation), bounds, _MAX_FINE_STEPS, ROUGH_TOLERANCE)
    return best_of([disc, fine])


def _about_an_end(found: State, disc: State) -> State:
    """An outline that turns about an end of it, if it is likelier than what was found from a disc."""
    starts = list(pivoting(disc))
    if not starts:
        return found
    rival, bounds = found.on(starts[0].observation), _bounds_around(starts[0])
    best = best_of([rival, *_fitted(starts, bounds, rival=rival)])
    if best is rival:
        return found
    fine = minimize(best.on(disc.observation), bounds, _MAX_FINE_STEPS, ROUGH_TOLERANCE)
    return best_of([found, _of_higher_order(fine, bounds)])


def exchanged(found: State, disc: State) -> State | None:
    """A fit of an outline as long as its path, on a path as long as it was; None if it turns.

    Before a plate of one hue both leave nearly the same light: a length a that moves by b is seen as a
    length b that moves by a. Their alphas differ by the factor a / b.

    disc: from which the outline was fitted.
    """
    silhouette = found.silhouette
    if not isinstance(silhouette, Silhouette) or silhouette.is_disc or silhouette.turns:
        return None
    curve = found.curve
    chord = curve[-1] - curve[0]
    moved = float(np.linalg.norm(chord))
    along = chord / max(moved, 1e-9)
    length = float(np.ptp(silhouette.outline(found.shape, OUTLINE_POINTS) @ along))
    if min(moved, length) < _MIN_EXCHANGED_PX:
        return None
    longer = np.eye(2) + (moved / length - 1) * np.outer(along, along)
    shape = silhouette.mapped(found.shape, longer)
    middle = curve[[0, -1]].mean(axis=0)
    path = found.family.starts(middle + (curve - middle) * length / moved)[0]
    start = state_at(found.observation, found.family, path, silhouette, shape)
    return minimize(start, _bounds_around(disc), _MAX_FINE_STEPS, ROUGH_TOLERANCE)


def gain_of_resolution(found: State, bounds: tuple[float, float]) -> float:
    """Nats that an outline of the highest order would gain if its corners were sharper, 0 or more.

    Of two outlines that leave nearly the same light the one with more of its corners in the picture
    would otherwise be the less likely.
    """
    silhouette = as_silhouette(found.silhouette)
    if silhouette.order < HIGHEST_ORDER:
        return 0.0
    sharper = found.of_kind(replace(silhouette, order=_RESOLVED_ORDER))
    return found.cost - minimize(sharper, bounds, _MAX_FINE_STEPS, ROUGH_TOLERANCE).cost


def _bounds_around(disc: State) -> tuple[float, float]:
    low, high = _RADIUS_BOUNDS
    return low * disc.radius, high * disc.radius


def _on_large_pixels(disc: State) -> State:
    soft, sharp = _SOFT_COARSE_RADIUS_PX, _COARSE_RADIUS_PX
    radius = soft if disc.silhouette.has("blur") else sharp
    return disc.on(disc.observation.coarse_enough(disc.radius, radius))


def _fitted(
    starts: Iterable[State],
    bounds: tuple[float, float],
    max_steps: int = _MAX_COARSE_STEPS,
    rival: State | None = None,
) -> list[State]:
    """Fits on large pixels; those that cannot be preferred to a rival or to each other stop early."""
    found: list[State] = []
    for start in starts:
        cost = np.inf if rival is None else _cost_to_beat(rival, start)
        fit = minimize(start, bounds, max_steps, ROUGH_TOLERANCE, cost)
        found.append(fit)
        if rival is not None and best_of([rival, fit]) is fit:
            rival = fit
    return found


def _cost_to_beat(rival: State, other: State) -> float:
    """Above this cost another fit is not preferred to a rival."""
    fewer = rival.parameters - other.parameters
    return rival.cost + rival.variance_inflation * bic_penalty(rival.observation, fewer)


def _could_pay(disc: State, most_general: State) -> bool:
    """True if an ellipse would be preferred with the gain of the most general shape."""
    gain = (disc.cost - most_general.cost) / most_general.variance_inflation
    return gain > bic_penalty(disc.observation, 2) + DECISIVE_LOG_BAYES_FACTOR


def _of_higher_order(state: State, bounds: tuple[float, float]) -> State:
    """The same with the order increased while the criterion falls: small pixels show more detail."""
    for order in _FINE_ORDERS:
        silhouette = as_silhouette(state.silhouette)
        if order <= silhouette.order:
            continue
        richer = state.of_kind(replace(silhouette, order=order))
        richer = minimize(richer, bounds, _MAX_FINE_STEPS, ROUGH_TOLERANCE)
        if best_of([state, richer]) is state:
            break
        state = richer
    return state


def straighter(disc: State, best: State) -> Iterable[State]:
    """The disc's path as a line and as an arc."""
    for family in (LINE, ARC):
        if family is not disc.family:
            yield disc.along(family).of_kind(outlined(disc))


def stretched(disc: State, best: State) -> Iterable[State]:
    """Ellipses stretched along the disc's path, on lines shortened or extended by as much."""
    silhouette, radius = outlined(disc), disc.radius
    ends = disc.along(LINE).curve[[0, -1]]
    direction = (ends[1] - ends[0]) / max(float(np.linalg.norm(ends[1] - ends[0])), 1e-9)
    angle = np.arctan2(direction[1], direction[0])
    for ratio in (0.5, 1.7, 3.0):  # of the radii along and across the path
        out = (1 - ratio) * radius * direction
        if (ends[1] - ends[0] + 2 * out) @ direction <= 0:
            continue
        shape = silhouette.like(disc.silhouette, disc.shape)
        shape[silhouette.at("radius")] = radius * np.sqrt(ratio)
        shape[silhouette.at("stretch")] = (
            0.5 * np.log(ratio) * np.array([np.cos(2 * angle), np.sin(2 * angle)])
        )
        longer = np.linspace(ends[0] - out, ends[1] + out, 33)
        yield state_at(disc.observation, LINE, LINE.starts(longer)[0], silhouette, shape)


def crosswise(disc: State, best: State) -> Iterable[State]:
    """An ellipse as long as the disc's path, on short lines along and across that."""
    xy, _ = disc.family.at(disc.path, np.linspace(0, 1, 65))
    middle, spread = xy.mean(axis=0), np.cov(xy.T)
    variances, axes = np.linalg.eigh(spread)
    width, silhouette = disc.radius, outlined(disc)
    length = width + np.sqrt(3 * variances[1])
    angle, stretch = np.arctan2(axes[1, 1], axes[0, 1]), 0.5 * np.log(length / width)
    shape = silhouette.like(disc.silhouette, disc.shape)
    shape[silhouette.at("radius")] = 0.85 * np.sqrt(length * width)
    shape[silhouette.at("stretch")] = stretch * np.cos(2 * angle), stretch * np.sin(2 * angle)
    for axis in axes.T:
        path = LINE.starts(middle + np.linspace(-0.4, 0.4, 33)[:, None] * width * axis)[0]
        yield state_at(disc.observation, LINE, path, silhouette, shape)


def turning(disc: State, best: State) -> Iterable[State]:
    """The best shape so far, and discs on its path, a line and an arc, turning in both senses."""
    yield best.of_kind(replace(outlined(disc), turns=True))
    for family in dict.fromkeys((best.family, LINE, ARC)):
        start = disc.along(family).of_kind(replace(outlined(disc), turns=True))
        for turn in (-1.0, 1.0):  # radians
            yield start.with_parameter("turn", turn)


def pivoting(disc: State) -> Iterable[State]:
    """Outlines that turn about an end: sticks, clubs and limbs, which leave a fan.

    In a fan alpha falls with the distance from the end that rests. Ends are the outermost points of the
    streak around which the light of the plate changed most.
    """
    silhouette = replace(outlined(disc), turns=True)
    fans = [fan for fan in _fans(disc.observation) if fan[0] > 1]
    fans = sorted(fans, key=lambda fan: -fan[0])[:_MAX_ENDS]
    width = min(_SLENDER) * min((length for _, _, length, _ in fans), default=0.0)
    pixels = disc.observation.coarse_enough(width / 2, _COARSE_WIDTH_PX / 2)
    for _, end, length, (first, last) in fans:
        middle = (first + last) / 2
        for slender in _SLENDER:
            turn = last - first - slender
            if turn <= 0:
                continue
            angles = middle + np.linspace(-turn / 2, turn / 2, 33)
            curve = end + length / 2 * np.stack([np.cos(angles), np.sin(angles)], axis=1)
            shape = silhouette.like(disc.silhouette, disc.shape)
            shape[silhouette.at("radius")] = length / 2 * np.sqrt(slender)
            stretch = -np.log(slender) / 2 * np.array([np.cos(2 * middle), np.sin(2 * middle)])
            shape[silhouette.at("stretch")], shape[silhouette.at("turn")] = stretch, turn
            yield state_at(pixels, ARC, ARC.starts(curve)[0], silhouette, shape)


def _fans(observation: Observation) -> Iterable[tuple[float, Array, float, Array]]:
    """Fans around outermost points of a streak: ratio of near changes to far ones, end, length, angles.

    Lengths are in pixels of the picture, angles (2,) in radians from the x axis toward the y axis.
    """
    y, x = np.nonzero(observation.streak)
    if not len(x):
        return
    points = np.stack([x, y], axis=1).astype(float)
    change = np.linalg.norm(observation.C - observation.B, axis=-1)[y, x]
    directions = 2 * np.pi * np.arange(_DIRECTIONS) / _DIRECTIONS
    outward = np.stack([np.cos(directions), np.sin(directions)])
    for corner in np.unique(points[np.argmax(points @ outward, axis=0)], axis=0):
        away = points - corner
        distance = np.hypot(*away.T)
        length = float(np.quantile(distance, _WITHIN))
        if length == 0:  # a streak of one pixel
            continue
        far, near = distance > length / 2, distance < length / 4
        axis = np.arctan2(*away[far].mean(axis=0)[::-1])
        turned = (np.arctan2(away[far, 1], away[far, 0]) - axis + np.pi) % (2 * np.pi) - np.pi
        angles = axis + np.quantile(turned, (1 - _WITHIN, _WITHIN))
        ratio = float(change[near].mean() / change[far].mean())
        scale = observation.scale
        yield ratio, scale * corner + np.array(observation.origin), scale * length, angles


def changing(disc: State, best: State) -> Iterable[State]:
    """The best shape so far, and discs on its path and on a line, whose proportions may change.

    The rates start at 0: fits from several rates converge to the same ones.
    """
    yield best.of_kind(replace(as_silhouette(best.silhouette), changes=True))
    for family in dict.fromkeys((best.family, LINE)):
        yield disc.along(family).of_kind(replace(outlined(disc), changes=True))


def outlined(disc: State) -> Silhouette:
    """Outlines of the first order, with a rim as soft as that of a disc."""
    return replace(as_silhouette(disc.silhouette), order=_FIRST_ORDER)


def growing(disc: State) -> Iterable[State]:
    """Discs on the path and on simpler ones that grow towards either end.

    Growth replaces what a change of speed along the path may have approximated.
    """
    silhouette = replace(as_silhouette(disc.silhouette), changes=True)
    for family in dict.fromkeys((disc.family, LINE, PARABOLA)):
        start = disc.along(family).of_kind(silhouette)
        for growth in _GROWTHS:
            yield start.with_parameter("rates", growth)
