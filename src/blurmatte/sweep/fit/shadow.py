"""A disc and the shadow that it casts, fitted by block-coordinate descent.

A path that was fitted without the shadow may have bent around it, so that descent ends in a local
minimum. With the shadow in the plate, all families of paths are therefore fitted once more.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from blurmatte.checks import Array
from blurmatte.descent import descended
from blurmatte.statistics import DECISIVE_LOG_BAYES_FACTOR, relative_difference
from blurmatte.sweep.fit.levenberg_marquardt import ROUGH_TOLERANCE, minimize
from blurmatte.sweep.fit.multistart import Multistart, is_finalist, with_principal_axes
from blurmatte.sweep.fit.ranking import bic_penalty
from blurmatte.sweep.model.cast_shadow import CastShadow
from blurmatte.sweep.model.observation import Observation
from blurmatte.sweep.model.path import LINE
from blurmatte.sweep.model.state import State

# Lengths of the search for a shadow are in radii of the disc.
# Radius of a disc on large pixels, on which both disc and shadow are resolved
_COARSE_RADIUS_PX = 8.0
_CAST_RADIUS_PX = 5.0  # on which the shadow alone is fitted
# Of block-coordinate descent, on large and on small pixels
_COARSE_ROUNDS = 10
_FINE_ROUNDS = 4
_MAX_RESTARTS = 2  # with all families of paths, in the shadow found so far
_MAX_DISC_STEPS = 10  # of the disc in a round
_CONVERGED_DIFFERENCE = 2e-3  # relative change of alpha in a round
# From the disc's center to the shadow's, at the start of a fit
_FIRST_DISTANCES = (0.7, 1.4, 2.2)
_FIRST_DIRECTIONS = 8  # of each of these distances
_MAX_DISTANCE = 6.0
_MIN_SOFTNESS = 0.03
_FIRST_SOFTNESS = 0.3
_MAX_SOFTNESS = 1.0
_DIFFERENCE = 0.02  # of numerical derivatives
_MAX_CAST_STEPS = 8  # of the shadow in a round
# Standard deviations; the loss is, up to a factor, Student's t of the square as degrees of freedom
_CAUCHY_SCALE = 2.5


def fit_with_shadow(
    disc: State, search: Multistart, rival: State
) -> tuple[State, CastShadow] | None:
    """A disc with its own shadow, if that is possible and likelier than the disc alone.

    None also if it is so much less likely than a rival on large pixels that small ones cannot make it
    the likeliest.
    """
    plain, bounds = disc.observation, search.bounds
    coarse = plain.coarse_enough(disc.radius, _COARSE_RADIUS_PX)
    on_coarse = disc.on(coarse)
    straight, prior = on_coarse.along(LINE), plain.prior
    is_known = prior is not None and prior.path is not None  # else a shadow may have bent it
    starts: list[tuple[State, CastShadow | None]] = [(on_coarse, None)]
    if not is_known:
        starts += [] if straight is on_coarse else [(straight, None)]
        starts.append(_in_one_half(straight))
    best, cast = _alternated(*starts[0], bounds, _COARSE_ROUNDS)
    for start in starts[1:]:
        found = _alternated(*start, bounds, _COARSE_ROUNDS, best.cost)
        best, cast = min((best, cast), found, key=lambda fit: fit[0].cost)
    gain = (on_coarse.cost - best.cost) / best.variance_inflation
    if not cast.is_possible or gain < bic_penalty(coarse, CastShadow.size):
        return None
    other = rival.on(coarse)
    fewer = rival.parameters - disc.parameters - CastShadow.size
    behind = (best.cost - other.cost) / other.variance_inflation - bic_penalty(coarse, fewer)
    if not is_finalist(behind):
        return None
    best, cast = _alternated(best.on(plain), cast, bounds, _FINE_ROUNDS)
    for _ in range(0 if is_known else _MAX_RESTARTS):
        found = _restarted(best, cast, plain, search)
        if found[0].cost >= best.cost or not found[1].is_possible:
            break
        best, cast = found
    return (best, cast) if cast.is_possible and best.cost < disc.cost else None


def may_be_shaded(disc: State, outline: State) -> bool:
    """Whether a shadow of a disc could make it as likely as an outline that explains the streak.

    A score test: what a shadow gains where the disc is, and then one linearized step of the disc, whose
    predicted gain mostly exceeds its own, against the outline's gain and the price of the parameters.
    It holds only where the outline leaves no residuals: a shadow that the outline could not follow may
    have moved the disc too far for one step.
    """
    plain = disc.observation.coarse_enough(disc.radius, _COARSE_RADIUS_PX)
    alone, other = disc.on(plain), outline.on(plain)
    cast = fit_cast(plain, alone)
    shaded = with_principal_axes(alone.relit(in_shadow(plain, alone, cast)))
    H, g = shaded.information()
    gain = alone.cost - shaded.cost + float(g @ np.linalg.pinv(H, hermitian=True) @ g) / 2
    fewer = outline.size - disc.size - CastShadow.size
    needed = (alone.cost - other.cost) / other.variance_inflation - bic_penalty(plain, fewer)
    return gain / other.variance_inflation > needed - DECISIVE_LOG_BAYES_FACTOR


def _in_one_half(both: State) -> tuple[State, CastShadow]:
    """The likeliest disc and shadow of which a straight sweep of the middle between both was fitted."""
    radius, softness = both.radius, np.log(_FIRST_SOFTNESS)
    plain = both.observation.coarse_enough(radius, _CAST_RADIUS_PX)
    middle, found = both.on(plain), []
    for offset in _first_offsets():
        disc = middle.moved(both.path - radius / 2 * np.tile(offset, 2), both.shape)
        cast = _strengths(plain, disc)(np.array([*offset, softness]))[1]
        shaded = with_principal_axes(disc.relit(in_shadow(plain, disc, cast)))
        found.append((shaded, cast))
    best, cast = min(found, key=lambda one: one[0].cost)
    return best.on(both.observation), cast


def _restarted(
    disc: State, cast: CastShadow, plain: Observation, search: Multistart
) -> tuple[State, CastShadow]:
    """Disc and shadow from the best of all families of paths in the shadow found so far."""

    def shaded(observation: Observation) -> Observation:
        """With the plate in that shadow, for one paint."""
        observation = replace(observation, color=plain.color)
        return in_shadow(observation, disc.on(observation), cast)

    again = search.with_observations(shaded).again_from(disc)
    return _alternated(again.on(plain), cast, search.bounds, _FINE_ROUNDS)


def _alternated(
    disc: State,
    cast: CastShadow | None,
    bounds: tuple[float, float],
    rounds: int,
    rival: float = np.inf,
) -> tuple[State, CastShadow]:
    """Fit shadow and disc in turn until the cost falls no more; the disc's plate is in the shadow.

    Or until the last gain, repeated in all rounds that remain, would not reach the cost of a rival.
    """
    plain, found = disc.observation, (disc, cast)
    for turn in range(rounds):
        cast = fit_cast(plain, disc, cast)
        shaded = with_principal_axes(disc.relit(in_shadow(plain, disc, cast)))
        before, disc = disc, minimize(shaded, bounds, _MAX_DISC_STEPS, ROUGH_TOLERANCE)
        if turn > 0 and disc.cost >= before.cost:
            break
        found = disc, cast
        reachable = disc.cost - (rounds - 1 - turn) * (before.cost - disc.cost)
        changed = relative_difference(before.swept.alpha, disc.swept.alpha)
        if changed < _CONVERGED_DIFFERENCE or reachable > rival:
            break
    best, cast = found
    assert cast is not None
    return best, cast


def in_shadow(observation: Observation, state: State, cast: CastShadow) -> Observation:
    """An observation with the plate in the shadow that a disc casts."""
    S = cast.missing(state.family, state.path, state.radius, observation.pixels)
    return replace(observation, B=cast.on(observation.B, S, state.swept.alpha))


def fit_cast(observation: Observation, disc: State, start: CastShadow | None = None) -> CastShadow:
    """The shadow that minimizes the residuals of a disc; it need not be possible.

    The observation has the plate without a shadow.
    """
    radius = disc.radius
    solved = _strengths(observation.coarse_enough(radius, _CAST_RADIUS_PX), disc)
    first = None
    if start is not None:
        first = np.array([*np.divide(start.offset, radius), np.log(start.softness / radius)])
    return solved(_minimized(lambda x: solved(x)[0], first))[1]


def _strengths(
    observation: Observation, disc: State
) -> Callable[[Array], tuple[Array, CastShadow]]:
    """A function of offset and log softness, in radii: residuals and shadow of the best strength.

    Where the object was, residuals along its mean color are ignored, for shading causes them.
    """
    color = disc.mean_color
    radius, disc = disc.radius, disc.on(observation)
    alpha = disc.swept.alpha
    std = np.sqrt(observation.C_variance + observation.B_variance)
    over_noise = np.sqrt(observation.weight)[..., None] / std
    unit = color / max(float(np.linalg.norm(color)), 1e-9)
    across = np.where((alpha > 0)[..., None, None], np.eye(3) - np.outer(unit, unit), np.eye(3))
    known = across * over_noise[..., None]
    light = (1 - alpha)[..., None] * observation.B - observation.C
    missing = np.einsum("yxcd,yxd->yxc", known, light).reshape(-1, 3)
    # S is a factor of each pixel, so all but S of the normal equations is the same in all trials.
    by_strength = (known * observation.B[..., None, :]).reshape(-1, 3, 3)
    products = np.matmul(by_strength.swapaxes(1, 2), by_strength).reshape(-1, 9)
    pulls = np.matmul(missing[:, None, :], by_strength)[:, 0]

    def solved(x: Array) -> tuple[Array, CastShadow]:
        """Residuals with the best strength, and the shadow."""
        right, down = (x[:2] * radius).tolist()
        cast = CastShadow((right, down), float(np.exp(x[2])) * radius, (1.0, 1.0, 1.0))
        S = cast.missing(disc.family, disc.path, radius, observation.pixels).ravel()
        normal = ((S * S) @ products).reshape(3, 3) + 1e-9 * np.eye(3)
        t = np.clip(np.linalg.solve(normal, S @ pulls), 0, 1)
        explained = (by_strength.reshape(-1, 3) @ t).reshape(-1, 3)
        r, g, b = t.tolist()
        return (missing - S[:, None] * explained).ravel(), replace(cast, strength=(r, g, b))

    return solved


@dataclass(frozen=True, eq=False)
class _CastTrial:
    """Offset (x, y) and log softness (3,), in radii, with residuals and their Cauchy loss."""

    x: Array
    residuals: Array
    cost: float

    @classmethod
    def of(cls, residuals: Callable[[Array], Array], x: Array) -> "_CastTrial":
        """At a point, moved within the bounds."""
        far, softness = _MAX_DISTANCE, np.log([_MIN_SOFTNESS, _MAX_SOFTNESS])
        x = np.clip(x, (-far, -far, softness[0]), (far, far, softness[1]))
        r = residuals(x)
        return cls(x, r, float(np.log1p((r / _CAUCHY_SCALE) ** 2).sum()))


def _minimized(residuals: Callable[[Array], Array], start: Array | None) -> Array:
    """(3,) offset (x, y) and log softness, in radii, of the least residuals."""

    def information(trial: _CastTrial) -> tuple[Array, Array]:
        """Curvature and gradient of the loss, from differences of the residuals."""
        x, r, by = trial.x, trial.residuals, _DIFFERENCE
        J = np.stack([residuals(x + step) - r for step in by * np.eye(3)]) / by
        weighted = 2 * J / (_CAUCHY_SCALE**2 + r**2)
        return weighted @ J.T, weighted @ r

    def moved(trial: _CastTrial, step: Array) -> _CastTrial:
        """By at most a radius, which the profile of a shadow about follows."""
        return _CastTrial.of(residuals, trial.x + step / max(float(np.abs(step).max()), 1))

    if start is None:
        softness = np.log(_FIRST_SOFTNESS)
        trials = (_CastTrial.of(residuals, np.array([*at, softness])) for at in _first_offsets())
        first = min(trials, key=lambda trial: trial.cost)
    else:
        first = _CastTrial.of(residuals, start)
    # Rough: the next round refines both.
    return descended(first, information, moved, _MAX_CAST_STEPS, ROUGH_TOLERANCE)[0].x


def _first_offsets() -> list[tuple[float, float]]:
    """From the disc's center to the shadow's, in radii, at the start of a fit."""
    angles = np.linspace(0, 2 * np.pi, _FIRST_DIRECTIONS, endpoint=False)
    distances = _FIRST_DISTANCES
    return [(d * np.cos(a), d * np.sin(a)) for d in distances for a in angles]
