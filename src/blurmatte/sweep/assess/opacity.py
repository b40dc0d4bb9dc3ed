"""The opacity of an object, from the plate's texture that is seen through it.

An object of opacity f hides the part f χ of the light behind it. χ is the part of the exposure during
which it covers the pixel; one that was there for a part of the exposure only has this part as its
opacity. Where it adds the light χ k,

    C = (1 − f χ) B + χ k.

Shape and motion determine χ, and the light k, but before an even plate not f: k changes slowly, so
that the texture of the plate alone shows it. In each of several blocks of pixels, χ times a plane is
subtracted from C, u = (1 − χ) B and x = χ B. With the noise variance V of B, λ times the one that was
measured, and the power S of the texture,

    E[x C] = ρ (χ (1 − χ) + (1 − f) χ²) S,    E[x u] = χ (1 − χ) (S + λ V),    E[x²] = χ² (S + λ V).

ρ, at most 1, is the correlation of image and plate that their sampling and their files leave. λ and ρ
are measured around the object, where χ = 0. The scatter between blocks is the error. With known
colors (a line or plane), image and plate themselves are used along the axes across these colors, in
which the object has no light (equation (2) of the design).

A surface is solid (f = 1) or lets light through (f uniform from 0 to 1), and its light k is at most f
times that of the brightest paint. A source of light has any k. A flame hides nothing (f = 0), but what
glows, and what is lit more than the scene that the camera was exposed for, may as well be solid. Light
that would be negative excludes values of f. Before an even plate the posterior is the prior. Of
an object that moved, f is 1, or that of a source 0, unless the evidence against it is decisive. Of one
at rest, or that left the picture, or if any opacity is known to be possible (`OpacityPrior`), both
kinds of surface have even odds, and f is the mean of the posterior. The error is its root mean square
distance from that value.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np

from blurmatte.checks import Array, Bools, Ints64
from blurmatte.statistics import DECISIVE_LOG_BAYES_FACTOR
from blurmatte.streaks import dilated
from blurmatte.sweep.assess.occlusion import occluded
from blurmatte.sweep.fit.ranking import MAX_LIGHT, MIN_LIGHT
from blurmatte.sweep.model.observation import BACKGROUND_MARGIN_PX, Observation
from blurmatte.sweep.model.priors import OpacityPrior
from blurmatte.sweep.model.state import State

# Blocks, and the priors of noise and sampling.
_BLOCKS_PER_RADIUS = 2.0
_MIN_BLOCK_PX = 4
_MAX_BLOCK_PX = 8  # larger blocks are few, and the object's light changes within them
_MIN_FILLED = 0.4  # of a block: a plane has three of its pixels
_MIN_BLOCKS = 3  # of which the scatter is an error
_MAX_ODD_RATIO = 4.0  # residual of a block around the object, of the median
_NOISE_SCALE_STD = 0.5  # of λ about 1, before it is measured
_MISMATCH_STD = 0.05  # of 1/ρ about 1, before it is measured
# Of λ and 1/ρ in compressed pictures: files drop weak texture, so that inside is not as around
_COMPRESSED_STD = 0.2
# Of λ inside of that around: noise models are not exact, and light differs
_INSIDE_STD = 0.05
# Of the path of an object that counts as at rest, of its radius: a flash is short
_MAX_LENGTH = 0.5
_OUTSIDE_STEPS = 65  # between an end and twice the diameter from it
_MIN_SCATTER = 0.5  # of a plate, of the variance of its noise
_MIN_COVERED = 0.004  # of the exposure, of pixels that show the object
# Prior odds of what is rare, a source of light or an object that lets light through, against what is
# usual: decisive evidence makes them even
RARE_ODDS = float(np.exp(-DECISIVE_LOG_BAYES_FACTOR))


@dataclass(frozen=True)
class Opacity:
    """An opacity, 0…1, and its error; and both if it is known to let light through.

    even_std: the error if letting light through is as usual as being solid.
    solid_std: the error if 1 is taken for the value.
    """

    value: float
    std: float
    thin: float = 1.0
    thin_std: float = 0.0
    even_std: float = 0.0
    solid_std: float = 0.0


@dataclass(frozen=True, eq=False)
class _Moments:
    """Weighted sums over each of the n blocks, of the light C of the image, x and u of the plate."""

    xC: Array  # (n,)
    xx: Array  # (n,)
    xu: Array  # (n,)
    CC: Array  # (n,)
    noise: Array  # (n,) expectation of the noise in xx
    noise_u: Array  # (n,) and in xu
    x: Array  # (n,)
    # Sums over all of squared weights times x² V_C, x² V and V²: parts of the variance of xC and xx
    spread: Array


@dataclass(frozen=True, eq=False)
class _Scores:
    """Scores of the blocks, a − β d with β = 1 − f, whose mean is 0 at the opacity f."""

    a: Array  # (n,)
    d: Array  # (n,)
    # Variance of the sum of scores of white noise at slopes β, up to a factor, and that of a common
    # error
    white: Callable[[Array], Array]
    common: Callable[[Array], Array]

    @property
    def slope(self) -> Array:
        """(1,) β: the likeliest possible one."""
        return np.asarray(np.clip([self.a.sum() / max(float(self.d.sum()), 1e-12)], 0, 1), float)

    def variance(self, slope: Array) -> Array:
        """Of the sum of scores: the scatter between blocks, as noise changes it with the slope."""
        scores = self.a - self.slope * self.d
        n, white = len(scores), self.white(slope) / np.maximum(self.white(self.slope), 1e-300)
        return np.asarray(n / (n - 1) * float(scores @ scores) * white + self.common(slope))

    @property
    def peak(self) -> tuple[float, float]:
        """The likeliest opacity and its standard deviation."""
        std = np.sqrt(float(self.variance(self.slope)[0]))
        return 1 - float(self.slope[0]), std / max(float(self.d.sum()), 1e-12)

    def log_likelihood(self, f: Array) -> Array:
        """That the mean score is 0, by Student's t, of opacities (m,)."""
        total, freedom = self.a.sum() - (1 - f) * self.d.sum(), len(self.a) - 1
        t2 = total**2 / np.maximum(self.variance(1 - f), 1e-300)
        return np.asarray(-(freedom + 1) / 2 * np.log1p(t2 / freedom))


def may_be_there_in_part(state: State) -> bool:
    """Whether the path does not show for which part of the exposure the object was in the picture."""
    return is_at_rest(state) or has_left(state)


def has_left(state: State) -> bool:
    """Whether an end of the path may lie outside the picture, where no rim shows it.

    Before a plate of one hue, an object that moves on outside has less alpha and a color farther from
    the plate's: the same light. Only the likelihood shows it, which then does not change with the path.
    """
    radius, (start, *_, end) = state.silhouette.radius(state.shape), state.curve
    if any(_is_beyond(state, point, radius) for point in (start, end)):
        return True
    reachable = DECISIVE_LOG_BAYES_FACTOR * state.variance_inflation + state.cost
    for time, point in enumerate((start, end)):
        if not _is_beyond(state, point, -radius):
            continue
        path = _until_outside(state, time, radius)
        if path is not None and state.moved(path, state.shape).cost < reachable:
            return True
    return False


def _is_beyond(state: State, point: Array, distance: float) -> bool:
    """Whether a point (2,) is farther than that outside the observed pixels."""
    pixels = state.observation.pixels
    first = np.array(pixels.origin) - pixels.scale / 2
    last = first + pixels.scale * np.array(pixels.shape[::-1])
    return bool(np.maximum(first - point, point - last).max() >= distance)


def _until_outside(state: State, time: int, radius: float) -> Array | None:
    """Parameters of the path continued at one end, 0 or 1, until the object is outside.

    None if it is not after twice its diameter.
    """
    length = float(np.linalg.norm(np.diff(state.curve, axis=0), axis=1).sum())
    for more in np.linspace(0, 4 * radius / max(length, radius), _OUTSIDE_STEPS)[1:]:
        path = state.family.continued(state.path, more * (1 - time), more * time)
        if _is_beyond(state, state.family.curve(path)[-time], radius):
            return path
    return None


def is_at_rest(state: State) -> bool:
    """Whether its path is too short to show how long it was there."""
    steps = np.linalg.norm(np.diff(state.curve, axis=0), axis=1)
    radius = state.silhouette.radius(state.shape)
    return bool(steps.sum() < _MAX_LENGTH * radius)


def fit_opacity(state: State) -> Opacity:
    """The opacity of an object whose shape and path are those of a fit."""
    observation = state.observation
    chi = state.swept.alpha / state.silhouette.opacity
    inside = (chi > _MIN_COVERED) & observation.valid & (observation.weight > 0)
    # The texture of an occluder is in both pictures, as if it were seen through the object.
    inside = inside & ~_occluded(observation, chi, inside)
    around = (observation.weight == observation.weight.max()) & observation.valid
    around &= ~dilated((chi > 0) | observation.streak, BACKGROUND_MARGIN_PX)
    radius = state.silhouette.radius(state.shape) / observation.scale
    smallest, largest = _MIN_BLOCK_PX, _MAX_BLOCK_PX
    size = int(np.clip(radius / _BLOCKS_PER_RADIUS, smallest, largest))
    of_texture = _of_texture(observation, chi, inside, around, size)
    scores = [] if of_texture is None else [of_texture]
    if observation.color.rank < 3 and inside.any():
        scores.append(_across(observation, chi, inside, size))
    known = [one for one in scores if len(one.a) >= _MIN_BLOCKS]
    is_open = observation.opacity is OpacityPrior.ANY or may_be_there_in_part(state)
    return _posterior(known, partial(_possible, observation, chi, inside), is_open)


def _occluded(observation: Observation, chi: Array, inside: Bools) -> Bools:
    """(h, w) True where a static object hides the moving one, and within a block's width of there.

    At the rim of the shape chi (h, w), 0 to 1, is too small to show what hides it: hence the margin.
    """
    if not inside.any():
        return inside
    C, B, V_C, V_B = observation.light
    light, _ = _mean_lights((C, B), chi, inside)
    return dilated(occluded(chi, light, C, B, V_C + V_B, inside), _MIN_BLOCK_PX)


def _of_texture(
    observation: Observation, chi: Array, inside: Bools, around: Bools, size: int
) -> _Scores | None:
    """Scores of the texture along the axes of the object's colors; None if the plate has none.

    A guessed plate is a mean: it varies less than its errors do, which are the texture that it lacks.
    """
    axes = slice(0, observation.color.rank)
    behind = _moments(observation, np.ones_like(chi), around, size, axes, 1.0)
    (scale, mismatch), covariance = _measured_around(behind)
    covariance[0, 0] += _INSIDE_STD**2
    if observation.compression is not None:
        covariance += np.eye(2) * _COMPRESSED_STD**2
    slope = 0.5
    for _ in range(2):  # weights depend on the slope
        own = _moments(observation, chi, inside, size, axes, slope)
        shown = (own.xu - scale * own.noise_u) / (1 + mismatch)
        d = (own.xx - scale * own.noise) / (1 + mismatch)
        slope = float(np.clip((own.xC - shown).sum() / max(d.sum(), 1e-12), 0, 1))
    if own.xx.sum() < _MIN_SCATTER * scale * own.noise.sum():
        return None
    # Derivatives of the sum of scores by λ and 1/ρ: a constant, and a part in proportion to the slope
    by_u = np.array([own.noise_u.sum(), shown.sum()]) / (1 + mismatch)
    by_x = np.array([own.noise.sum(), d.sum()]) / (1 + mismatch)
    of_image, of_plate, twice = own.spread

    def common(slope: Array) -> Array:
        """By λ and 1/ρ."""
        by = by_u + slope[:, None] * by_x
        return np.asarray(np.einsum("mi,ij,mj->m", by, covariance, by))

    return _Scores(
        own.xC - shown,
        d,
        lambda slope: of_image + slope**2 * (scale * of_plate + scale**2 * twice),
        common,
    )


def _measured_around(behind: _Moments) -> tuple[Array, Array]:
    """λ and 1/ρ − 1 (2,) around the object, and their covariance: x (x − C) = λ V + (1/ρ − 1) x C.

    Weighted by the power of each block; the priors keep them near 1 and 0.
    """
    prior = np.array([1.0, 0.0])
    std = np.array([_NOISE_SCALE_STD, _MISMATCH_STD])
    if len(behind.xC) < _MIN_BLOCKS:
        return prior, np.diag(std**2)
    odd = np.abs(behind.xx - 2 * behind.xC + behind.CC)
    usual = odd <= _MAX_ODD_RATIO * np.median(odd)
    weight = usual / np.maximum(behind.xx + behind.noise, 1e-12)
    A = weight[:, None] * np.stack([behind.noise, behind.xC], axis=1)
    b = weight * (behind.xx - behind.xC) - A @ prior
    variance = max(float(np.mean(b**2)), 1e-12)
    covariance = np.linalg.inv(A.T @ A / variance + np.diag(std**-2))
    found = prior + covariance @ A.T @ b / variance
    return np.maximum(found, 0), covariance


def _across(observation: Observation, chi: Array, inside: Bools, size: int) -> _Scores:
    """Scores of the light across known colors, which the object has in proportion to their error."""
    axes, slope = slice(observation.color.rank, 3), 0.5
    for _ in range(2):
        own = _moments(observation, chi, inside, size, axes, slope, whole=True)
        slope = float(np.clip((own.xC - own.xu).sum() / max(own.xx.sum(), 1e-12), 0, 1))
    light, behind = _mean_lights(observation.light[:2], chi, inside)
    error = observation.color.angle_std * float(own.x.sum())

    def common(slope: Array) -> Array:
        """By the angle between the object's light and the known colors."""
        return np.asarray(((error * (light - slope[:, None] * behind)) ** 2).sum(axis=1))

    return _Scores(own.xC - own.xu, own.xx, np.ones_like, common)


def _moments(
    observation: Observation,
    chi: Array,
    use: Bools,
    size: int,
    axes: slice,
    slope: float,
    whole: bool = False,
) -> _Moments:
    """Moments over blocks of `size` pixels of those in use.

    χ times a plane is subtracted in each block, unless the light is used as a whole. Pixels are
    weighted by their noise at a slope 1 − f, not by their residuals: these share the noise of x.
    """
    rows, columns = np.nonzero(use)
    _, block, count = np.unique(
        rows // size * use.shape[1] + columns // size, return_inverse=True, return_counts=True
    )
    full = (count >= _MIN_FILLED * size**2)[block]
    rows, columns, block = rows[full], columns[full], np.unique(block[full], return_inverse=True)[1]
    C, B, V_C, V_B = (light[rows, columns][:, axes] for light in observation.light)
    part = chi[rows, columns]
    free, covered = np.ones(len(block)), part[:, None]
    x, u = covered * B, (1 - covered) * B
    if not whole and len(block):
        at = np.stack([part, part * (rows % size), part * (columns % size)], axis=1)
        (C, x, u), free = _without_planes((C, x, u), at, block)
    w = 1 / (V_C + (1 - (1 - slope) * covered) ** 2 * V_B)

    def sums(values: Array) -> Array:
        """Over the pixels of each block and the axes."""
        return np.asarray(np.bincount(block, (w * values).sum(axis=1)), float)

    V = free[:, None] * V_B
    noise, noise_u = covered**2 * V, covered * (1 - covered) * V
    spread = [float(np.sum(w**2 * v)) for v in (x**2 * V_C, x**2 * noise, noise**2)]
    products = x * C, x * x, x * u, C * C, noise, noise_u, x
    xC, xx, xu, CC, noise, noise_u, x = map(sums, products)
    return _Moments(xC, xx, xu, CC, noise, noise_u, x, np.array(spread))


def _without_planes(
    values: tuple[Array, ...], at: Array, block: Ints64
) -> tuple[tuple[Array, ...], Array]:
    """Values (n, axes) less the best sum of `at` (n, 3) in each block; the part of noise that remains.

    at: χ times 1, and times coordinates in the block.
    """
    count = int(block.max()) + 1
    products = (at[:, i] * at[:, j] for i in range(3) for j in range(3))
    M = np.stack([np.bincount(block, one, count) for one in products], axis=1)
    inverse = np.linalg.pinv(M.reshape(count, 3, 3), hermitian=True)
    left = []
    for light in values:
        right = [[np.bincount(block, at[:, i] * one, count) for one in light.T] for i in range(3)]
        plane = np.einsum("bij,jab->bia", inverse, np.array(right))[block]
        left.append(light - np.einsum("ni,nia->na", at, plane))
    free = 1 - np.einsum("ni,nij,nj->n", at, inverse[block], at)
    return tuple(left), free


def _possible(observation: Observation, chi: Array, inside: Bools, f: Array) -> tuple[Bools, Bools]:
    """(n,) whether light of a surface, and of a source, is possible at opacities f (n,).

    All is possible if no pixel shows the object.
    """
    if not inside.any():
        return np.ones(len(f), bool), np.ones(len(f), bool)
    lights = _mean_lights((observation.C, observation.B), chi, inside)
    solid, behind = map(observation.rgb, lights)
    light = (solid - behind) + f[:, None] * behind
    brightest = light.max(axis=1)
    lit = (light.min(axis=1) >= MIN_LIGHT * brightest) & (brightest > 0)
    return np.asarray(lit & (brightest <= MAX_LIGHT * f)), np.asarray(lit)


def _mean_lights(pictures: tuple[Array, Array], chi: Array, inside: Bools) -> tuple[Array, Array]:
    """(3,) light of an object of f = 1, and of the plate, weighted by χ²."""
    part = chi[inside][:, None]
    C, B = (picture[inside] for picture in pictures)
    total = float((part**2).sum())
    behind = (part**2 * B).sum(axis=0) / total
    return np.asarray((part * (C - (1 - part) * B)).sum(axis=0) / total), np.asarray(behind)


def _posterior(
    scores: list[_Scores], possible: Callable[[Array], tuple[Bools, Bools]], is_open: bool
) -> Opacity:
    """Opacity and its error, if other values than 1 are rare or, as open, have even odds.

    possible: `_possible` of opacities.
    """
    values = [np.linspace(0, 1, 401)]
    for one in scores:
        peak, std = one.peak
        values.append(np.clip(peak + std * np.linspace(-8, 8, 161), 0, 1))
    f = np.unique(np.concatenate(values))
    log = np.sum([one.log_likelihood(f) for one in scores], axis=0) + np.zeros(len(f))
    surface, source = possible(f)
    if not source.any():
        surface, source = np.ones((2, len(f)), bool)
    likelihood = np.exp(log - log[source].max())
    prior = np.where(surface, 1, RARE_ODDS * source)
    solid, dark = likelihood[-1] * surface[-1], likelihood[0] * RARE_ODDS * source[0]
    thin = likelihood * np.gradient(f) * prior
    at, even = np.array([0.0, *f, 1.0]), np.array([dark, *thin, solid])
    mass = even.copy()
    mass[1:-1] *= 1.0 if is_open else RARE_ODDS
    value = float(mass @ at / mass.sum())
    if not is_open and mass[-1] > mass.sum() / 2:
        value = 1.0
    elif mass[0] > mass.sum() / 2:
        value = 0.0
    mean = float(thin @ f / thin.sum())
    # A source that hides all has even odds.
    mass[-1] = even[-1] = likelihood[-1] * prior[-1]
    std, even_std = (_rms_from(value, at, one) for one in (mass, even))
    return Opacity(value, std, mean, _rms_from(mean, f, thin), even_std, _rms_from(1.0, at, mass))


def _rms_from(value: float, at: Array, mass: Array) -> float:
    """Root mean square distance from a value of masses (n,) at places (n,)."""
    return float(np.sqrt(mass @ (at - value) ** 2 / mass.sum()))
