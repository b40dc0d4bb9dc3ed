"""Discs with a pattern: in gray pictures, where hue shows no rim, and of several colors in clips.

Without hues alpha follows from brightness: a ball whose dark side is as bright as the plate looks
smaller and displaced. So does a ball whose gloss or second paint has the hue of the plate. In this file
the light of a disc is that of a random pattern f which moves along,

    P(x) = ∫ f((x − c(t)) / r) dt    while the disc of radius r around c(t) covers x,
    f = Σ_j f_j φ_j,

with polynomials φ_j, orthonormal on the disc, and with z, z u and z v, where (u, v, z) is the normal of
a sphere: the light of a matte sphere is nearly a polynomial of order two of its normal
[Ramamoorthi & Hanrahan 2001]. The coefficient of an order k has the prior standard deviation s qᵏ⁻¹,
of z as of order 1, of z u and z v as of order 2; the mean is free. s and q are estimated by expectation
maximization, and the coefficients are integrated out. Along each axis of color the pattern is another.

Without hues a pattern that fades or brightens towards the rim looks like a blurred rim, and a blurred
rim of another radius like paint with sharp edges, which polynomials round. So there the blur remains
that of the disc without a pattern, and the error contains how far the disc changes down to a sharp rim.
"""

from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import numpy as np

from blurmatte.checks import Array, Bools
from blurmatte.descent import descended
from blurmatte.statistics import CORRELATED_PX, mean_of_blocks
from blurmatte.streaks import dilated
from blurmatte.sweep.fit.levenberg_marquardt import ROUGH_TOLERANCE
from blurmatte.sweep.fit.ranking import Candidate
from blurmatte.sweep.model.silhouette import moments
from blurmatte.sweep.model.state import State
from blurmatte.sweep.model.student_t import VARIANCE, loss, student_weight

# Of the patterns that are fitted one after another, each from the one before, while they are likelier.
# Gloss and stripes have sharp edges: a pattern of too low an order moves the rim to imitate them.
_ORDERS = 2, 7, 12
_ORDERS_IN_COLOR = 2, 7  # where hues show the rim
_STARTS = (1.0, 1.25)  # radii that fits start from, of the disc without
_MAX_STEPS = 20
_SAME = 0.1  # standard deviations by which parameters of fits that meet differ at most
_MARGIN = 0.5  # around the streak, within which the disc may move, radii
_MAX_MOVE = 0.25  # in a step, radii
# Rounds of coefficients, weights and prior, at most, from a first prior and from that of a neighbor
_FIRST_ROUNDS = 24
_ROUNDS = 6
_MIN_CHANGE = 1e-3  # of standard deviations of the prior, relative, in a round that is not the last
_FIRST_SPREAD = 0.3  # s, of the plate's light
_MIN_SPREAD = 4e-3
_FREE_SPREAD = 1e3  # of the mean
_DECAYS = np.geomspace(0.1, 1, 24)  # q
_GRID = 401  # points across the disc, on which functions are made orthonormal


def has_pattern(state: State) -> bool:
    """Whether a fit is of a disc in gray pictures that may have a pattern."""
    return state.observation.channels == 1 and may_have_pattern(state)


def may_have_pattern(state: State) -> bool:
    """Whether a fit is of a solid disc of constant size, of which other frames know nothing."""
    shape, known = state.silhouette, state.observation
    if known.light_alone or known.prior is not None:
        return False
    plain = shape.is_disc and not shape.has("rates")
    return plain and shape.opacity == 1 and known.camera_stretch == (0.0, 0.0)


def fit_patterns(state: State, bounds: tuple[float, float]) -> list[Candidate]:
    """Discs with patterns, fitted from a disc without and from a larger one, the likeliest last.

    Their states have the residuals and the cost that the patterns leave. A side as bright as the plate
    is invisible, so that a disc without a pattern is rather too small. In gray pictures their errors
    contain the difference of the likeliest from one with a sharp rim.
    """
    fits: list[_PatternFit] = []
    for larger in _STARTS:
        parameters = np.concatenate([state.path, state.shape])
        parameters[len(state.path)] *= larger
        fits += _of_rising_order(state, bounds, parameters, fits)
    found = sorted(map(_candidate, fits), key=lambda one: -one.state.cost)
    best = min(fits, key=lambda one: one.cost)
    if not best.holds_blur:
        return found
    apart = best.parameters - best.with_sharp_rim.parameters
    by_rim = np.outer(apart, apart) / 3  # the blur is anywhere between: a uniform distribution
    return [replace(one, rim_covariance=by_rim) for one in found]


def _of_rising_order(
    state: State, bounds: tuple[float, float], parameters: Array, known: "list[_PatternFit]"
) -> "list[_PatternFit]":
    """Fits from some parameters, each from the one before, until a higher order is not likelier.

    From where they meet one of the known fits they are the known ones.
    """
    fits: list[_PatternFit] = []
    for order in _ORDERS if state.observation.channels == 1 else _ORDERS_IN_COLOR:
        start = _PatternFit.of(state, bounds, parameters, order)
        if len(fits) > 1 and start.cost >= fits[-1].cost:
            break
        fit = start.fitted
        met = [k for k, one in enumerate(known) if fit.is_near(one)]
        if met:
            return fits + known[met[0] :]
        fits.append(fit)
        parameters = fit.parameters
    return fits


def _candidate(fit: "_PatternFit") -> Candidate:
    """The disc of a fit, with the residuals and the cost that its pattern leaves."""
    known, n = fit.state.observation, len(fit.state.path)
    disc = fit.state.moved(fit.parameters[:n], fit.parameters[n:])
    e = fit.in_picture(disc.e)
    cost = float(np.sum(known.weight * loss((e**2).sum(axis=0), known.channels)))
    cost += sum(one.prior_cost for one in fit.patterns)
    explained = replace(disc, e=e, cost=cost, converged=fit.converged)
    return Candidate(explained, covariance=fit.covariance)


def fit_pattern(state: State, bounds: tuple[float, float]) -> Candidate:
    """The disc with the most varied of the patterns, from one without.

    Its error contains the mean square difference of the simpler hypotheses from it: a pattern may also
    imitate the rim of another disc.
    """
    fits = fit_patterns(state, bounds)
    best = fits[-1]
    found = [np.concatenate([one.path, one.shape]) for one in (state, *(c.state for c in fits))]
    apart = np.array(found) - found[-1]
    assert best.covariance is not None
    return replace(best, covariance=best.covariance + apart.T @ apart / len(found))


def _powers(order: int) -> list[tuple[int, int]]:
    """Exponents of u and v in the order of `pattern_kernel`."""
    return [(n - m, m) for n in range(order + 1) for m in range(n + 1)]


@lru_cache
def _functions(order: int) -> tuple[Array, Array]:
    """Matrix (k, k) from the functions of `pattern_kernel` to φ, and the exponents (k,) of q.

    The first of φ is 1, whose exponent does not matter.
    """
    along = np.linspace(-1, 1, _GRID)
    u, v = (x.ravel() for x in np.meshgrid(along, along))
    inside = u**2 + v**2 < 1
    u, v = u[inside], v[inside]
    powers, z = _powers(order), np.sqrt(1 - u**2 - v**2)
    count = len(powers)
    _, R = np.linalg.qr(np.stack([u**i * v**j for i, j in powers], axis=1) / np.sqrt(len(u)))
    of_z = np.stack([z, z * u, z * v], axis=1)
    T = np.zeros((count + 3, count + 3))
    T[:count, :count] = np.linalg.inv(R) * np.sign(R[0, 0])
    T[count:, count:] = np.diag(1 / of_z.std(axis=0))
    T[0, count] = -z.mean() / z.std()
    return T, np.array([*(max(i + j - 1, 0) for i, j in powers), 0, 1, 1], float)


@dataclass(frozen=True, eq=False)
class _Pattern:
    """The most probable pattern of a disc along an axis of color."""

    prior_std: Array  # (k,) of the coefficients
    coefficients: Array  # (k,)
    weights: Array  # (n,) of the pixels, over their variance
    e: Array  # (n,) residuals of unit variance
    # Negative log prior density of the coefficients, and the log volume of their posterior
    prior_cost: float
    loss: float  # of the residuals


@dataclass(frozen=True, eq=False)
class _PatternFit:
    """Path and shape of a disc with a pattern."""

    state: State  # of the disc without
    bounds: tuple[float, float]  # of the radius
    use: Bools  # (h, w) pixels
    light: Array  # (4, c, n) image, plate and their variances in these, along axes of color
    order: int
    parameters: Array
    swept: Array  # (n, k) integrals of the functions; the first is alpha
    patterns: tuple[_Pattern, ...]  # along each axis
    converged: bool = False

    @classmethod
    def of(
        cls, state: State, bounds: tuple[float, float], parameters: Array, order: int
    ) -> "_PatternFit":
        """The pattern of an order on a path, near a fit."""
        known = state.observation
        margin = int(np.ceil(_MARGIN * state.radius / known.scale))
        use = dilated(state.swept.alpha > 0, margin) & (known.weight > 0)
        light = np.stack([values[use].T[: known.channels] for values in known.light])
        S = _swept(state, use, order, parameters)
        spread = _FIRST_SPREAD * max(abs(float(light[1, 0].mean())), _MIN_SPREAD)
        prior_std = np.full(S.shape[1], spread)
        seen, axes = known.weight[use], range(known.channels)
        patterns = tuple(
            _likeliest(seen, light[:, k], S, order, prior_std, _FIRST_ROUNDS) for k in axes
        )
        return cls(state, bounds, use, light, order, parameters, S, patterns)

    @property
    def cost(self) -> float:
        """Negative log marginal likelihood."""
        return sum(one.loss + one.prior_cost for one in self.patterns)

    @property
    def holds_blur(self) -> bool:
        """Whether fits keep the blur of the rim: no hue shows how large it is."""
        return self.state.silhouette.has("blur") and len(self.patterns) == 1

    @property
    def _free(self) -> Bools:
        """(p,) which parameters are fitted."""
        free = np.ones(len(self.parameters), bool)
        if self.holds_blur:
            free[len(self.state.path) :][self.state.silhouette.at("blur")] = False
        return free

    @property
    def fitted(self) -> "_PatternFit":
        """The likeliest fit of this order near this one."""
        of, moved = _PatternFit.information, _PatternFit.moved
        fit, converged = descended(self, of, moved, _MAX_STEPS, ROUGH_TOLERANCE)
        return replace(fit, converged=converged)

    @property
    def with_sharp_rim(self) -> "_PatternFit":
        """The likeliest fit of this order with the least blur."""
        known, n = self.state.silhouette, len(self.state.path)
        parameters = self.parameters.copy()
        parameters[n:][known.at("blur")] = 0.0
        parameters[n:] = known.possible(parameters[n:], self.bounds)
        return _PatternFit.of(self.state, self.bounds, parameters, self.order).fitted

    def moved(self, step: Array) -> "_PatternFit":
        """The fit after a step, shortened to where the model is about linear."""
        state, n = self.state, len(self.state.path)
        most = _MAX_MOVE * state.radius
        parameters = self.parameters.copy()
        parameters[self._free] += step / max(np.abs(step).max() / most, 1)
        parameters[n:] = state.silhouette.possible(parameters[n:], self.bounds)
        S = _swept(state, self.use, self.order, parameters)
        seen = state.observation.weight[self.use]
        patterns = tuple(
            _likeliest(seen, self.light[:, k], S, self.order, one.prior_std, _ROUNDS)
            for k, one in enumerate(self.patterns)
        )
        return replace(self, parameters=parameters, swept=S, patterns=patterns)

    def is_near(self, other: "_PatternFit") -> bool:
        """Whether another fit has the same order, and parameters that hardly differ."""
        apart = np.abs(self.parameters - other.parameters)
        near = np.all(apart <= _SAME * np.sqrt(np.diag(self.covariance)))
        return self.order == other.order and bool(near)

    def information(self) -> tuple[Array, Array]:
        """Curvature (p, p) and gradient (p,) of the cost by what is free.

        The patterns are integrated out.
        """
        free = self._free
        count = np.count_nonzero(free)
        H, g = np.zeros((count, count)), np.zeros(count)
        for k, pattern in enumerate(self.patterns):
            root = np.sqrt(pattern.weights)
            C, B, _, _ = self.light[:, k]
            light = (1 - self.swept[:, 0]) * B + self.swept @ pattern.coefficients
            e = root * (C - light)
            J = root[:, None] * np.compress(free, self._by_parameters(k), axis=1)
            S = root[:, None] * self.swept
            cross, prior = S.T @ J, np.diag(pattern.prior_std**-2)
            explained = np.linalg.solve(S.T @ S + prior, cross)
            of_prior = S.T @ e - pattern.coefficients / pattern.prior_std**2
            H += J.T @ J - cross.T @ explained
            g += explained.T @ of_prior - J.T @ e
        return H, g

    @cached_property
    def covariance(self) -> Array:
        """(p, p) of the parameters; correlated residuals carry less information."""
        channels = len(self.patterns)
        e = np.zeros((*self.use.shape, channels))
        for k, one in enumerate(self.patterns):
            e[self.use, k] = one.e * np.sqrt(student_weight(one.e**2, 1))
        blocks = (mean_of_blocks(e, self.use, size, channels) for size in CORRELATED_PX)
        inflation = max(1.0, *blocks) * VARIANCE
        H, _ = self.information()
        covariance, free = np.zeros(2 * self.parameters.shape), self._free
        covariance[np.ix_(free, free)] = inflation * np.linalg.pinv(H, hermitian=True)
        return covariance

    def in_picture(self, e: Array) -> Array:
        """Residuals (3, h, w) with those that the pattern leaves."""
        e = e.copy()
        for k, one in enumerate(self.patterns):
            e[k][self.use] = one.e
        return e

    def _by_parameters(self, k: int) -> Array:
        """(n, p) derivatives of light along an axis by the parameters, for the likeliest plate."""
        from blurmatte.sweep.model import pattern_kernel  # SciPy is slow to import

        values = _functions(self.order)[0] @ self.patterns[k].coefficients
        by_powers = np.zeros((self.order + 1, self.order + 1))
        for (i, j), value in zip(_powers(self.order), values, strict=False):
            by_powers[i, j] = value
        plate = np.zeros(self.use.shape)
        plate[self.use] = self._plate(k)
        xy, by_path, *disc = _disc(self.state, self.parameters)
        J = np.zeros((*self.use.shape, len(self.state.path) + 2))
        pattern_kernel.derivatives(xy, by_path, *disc, by_powers, values[-3:], plate, J)
        scale = self.state.observation.scale
        return np.asarray(J[self.use][:, : len(self.parameters)] / scale)

    def _plate(self, k: int) -> Array:
        """(n,) light of the plate along an axis that image and plate make likeliest."""
        _, B, V_C, V_B = self.light[:, k]
        through = 1 - self.swept[:, 0]
        V = V_C + through**2 * V_B
        return np.asarray(B + through * V_B / np.sqrt(V) * self.patterns[k].e)


def _swept(state: State, use: Bools, order: int, parameters: Array) -> Array:
    """(n, k) integrals of the functions φ over the exposure, in some pixels."""
    from blurmatte.sweep.model import pattern_kernel  # SciPy is slow to import

    T = _functions(order)[0]
    S = np.zeros((*use.shape, len(T)))
    xy, _, *disc = _disc(state, parameters)
    pattern_kernel.swept(xy, *disc, order, S)
    return np.asarray(S[use] @ T)


def _disc(state: State, parameters: Array) -> tuple[Array, Array, Array, float, float]:
    """Centers, their derivatives by the path, weights, radius and blur as `pattern_kernel` takes them.

    Lengths are in large pixels, but of the parameters in those of the picture.
    """
    pixels, n = state.observation.pixels, len(state.path)
    path, shape = parameters[:n], parameters[n:]
    soft = state.silhouette.softness(shape) / pixels.scale
    t, weights = moments(state.family, path, pixels.scale, soft=soft)
    xy, by_path = state.family.at(path, t)
    xy = (xy - pixels.origin) / pixels.scale
    radius = state.silhouette.value("radius", shape)
    return xy, by_path, weights, radius / pixels.scale, soft


def _likeliest(
    seen: Array, light: Array, S: Array, order: int, prior_std: Array, rounds: int
) -> _Pattern:
    """The pattern of the largest posterior density, and its prior, by expectation maximization.

    seen (n,): weights of the pixels.
    """
    C, B, V_C, V_B = light
    V = V_C + (1 - S[:, 0]) ** 2 * V_B
    P, least = C - (1 - S[:, 0]) * B, _MIN_SPREAD * max(float(B.mean()), _MIN_SPREAD)
    prior_std = np.array([_FREE_SPREAD, *prior_std[1:]])
    weights = seen / V
    for _ in range(rounds):
        weighted = weights[:, None] * S
        H = S.T @ weighted + np.diag(prior_std**-2)
        covariance = np.linalg.inv(H)
        f = covariance @ (P @ weighted)
        e = (P - S @ f) / np.sqrt(V)
        weights = seen * student_weight(e**2, 1) / V
        used, prior_std = prior_std, _prior_of(f**2 + np.diag(covariance), order, least)
        if np.abs(prior_std / used - 1).max() < _MIN_CHANGE:
            break
    varied = slice(1, None)  # the mean is free
    prior_cost = float(np.sum((f / used)[varied] ** 2)) / 2 + float(np.log(used[varied]).sum())
    prior_cost += float(np.linalg.slogdet(H)[1]) / 2
    return _Pattern(used, f, weights, e, prior_cost, float(seen @ loss(e**2, 1)))


def _prior_of(squares: Array, order: int, least: float) -> Array:
    """(k,) standard deviations s qᵏ⁻¹ that are likeliest for expected squares of coefficients (k,)."""
    exponents = _functions(order)[1][1:]
    factors = _DECAYS[:, None] ** exponents
    s2 = np.mean(squares[1:] / factors**2, axis=1)
    best = np.argmin(2 * np.log(factors).sum(axis=1) + len(exponents) * np.log(s2))
    spread = max(float(np.sqrt(s2[best])), least)
    return np.array([_FREE_SPREAD, *(spread * factors[best])])
