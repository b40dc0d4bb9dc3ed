"""The opacity of an object on a short path, from the plate's texture that is seen through it.

An object that was there for the fraction f of the exposure, or that hides the fraction f of the light
behind it, has the alpha f χ. χ is the part of that time during which it covers the pixel. The light
α k determines the product f k alone, so that neither shape nor motion determines f. On a path
shorter than the object there are pixels that it covers all that time. Where χ = 1,

    C = f k + (1 − f) B,

and k changes slowly: the contrast of the plate's texture in the image is 1 − f times its contrast in
the plate. In each of several blocks of pixels a plane is subtracted from image and plate, which leaves
y and x. With the noise variance V of x, λ times the one that was measured,

    E[x y] = (1 − f) ρ S,    E[x²] = S + λ V.

S is the power of the texture. ρ, at most 1, is the correlation of image and plate that their sampling
and their files leave. λ and ρ are measured around the object, where f = 0. The scatter between
blocks is the error. With known colors (a line or plane), image and plate themselves are used along the
axes across these colors, in which the object has no light (equation (2) of the design).

The prior is a uniform density of f, and a probability for f = 1: the same for an object at rest, and
1 / (1 + `MOVED_ODDS`) for one that moved. Colors that are physically impossible exclude values of f. A
plate without texture leaves the prior as it is. Of one that moved, f is 1 unless the evidence against
this is decisive, and its error is the root mean square of 1 − f.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from blurmatte.checks import Array, Bools
from blurmatte.statistics import DECISIVE_LOG_BAYES_FACTOR
from blurmatte.streaks import dilated
from blurmatte.sweep.fit.ranking import MAX_LIGHT, MIN_LIGHT
from blurmatte.sweep.model.observation import BlockStatistics, Observation
from blurmatte.sweep.model.silhouette import OPAQUE
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
# Of the path of an object that counts as at rest, of its radius: a flash is short
_MAX_LENGTH = 0.5
# Prior odds that an object that moved was there for a part of the exposure only: decisive evidence
# makes them even
MOVED_ODDS = float(np.exp(-DECISIVE_LOG_BAYES_FACTOR))


@dataclass(frozen=True)
class Opacity:
    """Mean and standard deviation of an opacity, 0…1."""

    value: float
    std: float


@dataclass(frozen=True, eq=False)
class _Moments:
    """Weighted sums over each of the n blocks, of the light x of the plate and y of the image."""

    xy: Array  # (n,)
    xx: Array  # (n,)
    yy: Array  # (n,)
    noise: Array  # (n,) expectation of the noise in xx
    x: Array  # (n,)
    # Sums over all of squared weights times x² V_C, x² V and V²: parts of the variance of xy and xx
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


def is_at_rest(state: State) -> bool:
    """Whether its path is too short to show how long it was there."""
    steps = np.linalg.norm(np.diff(state.curve, axis=0), axis=1)
    radius = state.silhouette.radius(state.shape)
    return bool(steps.sum() < _MAX_LENGTH * radius)


def fit_opacity(state: State) -> Opacity:
    """The opacity of an object whose shape and path are those of a fit.

    1 ± 0 if it covers no pixel all the time that it is there.
    """
    observation, at_rest = state.observation, is_at_rest(state)
    inside = state.swept.alpha >= OPAQUE * state.silhouette.opacity
    if not (at_rest or inside.any()):
        return Opacity(1.0, 0.0)
    inside &= observation.valid & (observation.weight > 0)
    around = (observation.weight == observation.weight.max()) & observation.valid
    around &= ~dilated((state.swept.alpha > 0) | observation.streak, BlockStatistics.margin_px)
    radius = state.silhouette.radius(state.shape) / observation.scale
    smallest, largest = _MIN_BLOCK_PX, _MAX_BLOCK_PX
    size = int(np.clip(radius / _BLOCKS_PER_RADIUS, smallest, largest))
    scores = [_of_texture(observation, inside, around, size)]
    if observation.color.rank < 3 and inside.any():
        scores.append(_across(observation, inside, size))
    known = [one for one in scores if len(one.a) >= _MIN_BLOCKS]
    return _posterior(known, observation, inside, 1.0 if at_rest else MOVED_ODDS)


def _of_texture(observation: Observation, inside: Bools, around: Bools, size: int) -> _Scores:
    """Scores of the texture along the axes of the object's colors."""
    axes = slice(0, observation.color.rank)
    behind = _moments(observation, around, size, axes, 1.0)
    (scale, mismatch), covariance = _measured_around(behind)
    if observation.compression is not None:
        covariance += np.eye(2) * _COMPRESSED_STD**2
    slope = 0.5
    for _ in range(2):  # weights depend on the slope
        own = _moments(observation, inside, size, axes, slope)
        d = (own.xx - scale * own.noise) / (1 + mismatch)
        slope = float(np.clip(own.xy.sum() / max(d.sum(), 1e-12), 0, 1))
    by = np.array([own.noise.sum(), d.sum()]) / (1 + mismatch)
    error, (of_image, of_plate, twice) = float(by @ covariance @ by), own.spread
    return _Scores(
        own.xy,
        d,
        lambda slope: of_image + slope**2 * (scale * of_plate + scale**2 * twice),
        lambda slope: slope**2 * error,
    )


def _measured_around(behind: _Moments) -> tuple[Array, Array]:
    """λ and 1/ρ − 1 (2,) where the slope is 1, and their covariance: x (x − y) = λ V + (1/ρ − 1) x y.

    Weighted by the power of each block; the priors keep them near 1 and 0.
    """
    prior = np.array([1.0, 0.0])
    std = np.array([_NOISE_SCALE_STD, _MISMATCH_STD])
    if len(behind.xy) < _MIN_BLOCKS:
        return prior, np.diag(std**2)
    odd = np.abs(behind.xx - 2 * behind.xy + behind.yy)
    usual = odd <= _MAX_ODD_RATIO * np.median(odd)
    weight = usual / np.maximum(behind.xx + behind.noise, 1e-12)
    A = weight[:, None] * np.stack([behind.noise, behind.xy], axis=1)
    b = weight * (behind.xx - behind.xy) - A @ prior
    variance = max(float(np.mean(b**2)), 1e-12)
    covariance = np.linalg.inv(A.T @ A / variance + np.diag(std**-2))
    found = prior + covariance @ A.T @ b / variance
    return np.maximum(found, 0), covariance


def _across(observation: Observation, inside: Bools, size: int) -> _Scores:
    """Scores of the light across known colors, which the object has in proportion to their error."""
    axes, slope = slice(observation.color.rank, 3), 0.5
    for _ in range(2):
        own = _moments(observation, inside, size, axes, slope, whole=True)
        slope = float(np.clip(own.xy.sum() / max(own.xx.sum(), 1e-12), 0, 1))
    C, B = (light[inside].mean(axis=0) for light in observation.light[:2])
    error = observation.color.angle_std * float(own.x.sum())

    def common(slope: Array) -> Array:
        """By the angle between the object's light and the known colors."""
        light = C - slope[:, None] * B
        return np.asarray((error * light).sum(axis=1) ** 2)

    return _Scores(own.xy, own.xx, np.ones_like, common)


def _moments(
    observation: Observation,
    use: Bools,
    size: int,
    axes: slice,
    slope: float,
    whole: bool = False,
) -> _Moments:
    """Moments over blocks of `size` pixels of those in use.

    A plane is subtracted in each block, unless the light is used as a whole. Pixels are weighted by
    their noise at a slope of y by x, not by their residuals: these share the noise of x.
    """
    rows, columns = np.nonzero(use)
    _, block, count = np.unique(
        rows // size * use.shape[1] + columns // size, return_inverse=True, return_counts=True
    )
    full = (count >= _MIN_FILLED * size**2)[block]
    rows, columns, block = rows[full], columns[full], np.unique(block[full], return_inverse=True)[1]
    C, B, V_C, V_B = (light[rows, columns][:, axes] for light in observation.light)
    free = np.ones(len(block))
    if not whole and len(block):
        at = np.stack([np.ones(len(block)), rows % size, columns % size], axis=1).astype(float)
        (C, B), free = _without_planes((C, B), at, block)
    w = 1 / (V_C + slope**2 * V_B)

    def sums(values: Array) -> Array:
        """Over the pixels of each block and the axes."""
        return np.asarray(np.bincount(block, (w * values).sum(axis=1)), float)

    noise = free[:, None] * V_B
    spread = [float(np.sum(w**2 * v)) for v in (B**2 * V_C, B**2 * noise, noise**2)]
    return _Moments(sums(C * B), sums(B * B), sums(C * C), sums(noise), sums(B), np.array(spread))


def _without_planes(
    values: tuple[Array, Array], at: Array, block: npt.NDArray[np.int64]
) -> tuple[tuple[Array, Array], Array]:
    """Values (n, axes) less the plane of each block; the part (n,) of white noise that remains.

    at (n, 3): 1, and coordinates in the block.
    """
    count = int(block.max()) + 1
    M = np.zeros((count, 3, 3))
    np.add.at(M, block, at[:, :, None] * at[:, None, :])
    inverse = np.linalg.pinv(M, hermitian=True)[block]
    left = []
    for light in values:
        right = np.zeros((count, 3, light.shape[1]))
        np.add.at(right, block, at[:, :, None] * light[:, None, :])
        plane = np.einsum("nij,nja->nia", inverse, right[block])
        left.append(light - np.einsum("ni,nia->na", at, plane))
    free = 1 - np.einsum("ni,nij,nj->n", at, inverse, at)
    return (left[0], left[1]), free


def _posterior(
    scores: list[_Scores], observation: Observation, inside: Bools, odds: float
) -> Opacity:
    """Mean and standard deviation under the prior of the module; odds: of f < 1 against f = 1."""
    values = [np.linspace(0.001, 1, 400)]
    for one in scores:
        peak, std = one.peak
        values.append(np.clip(peak + std * np.linspace(-8, 8, 161), 0.001, 1))
    f = np.unique(np.concatenate(values))
    log = np.sum([one.log_likelihood(f) for one in scores], axis=0) + np.zeros(len(f))
    possible = _possible(f, observation, inside)
    log = np.where(possible | (not possible.any()), log, -np.inf)
    density = np.exp(log - log.max())
    mass = np.append(odds * density * np.gradient(f), density[-1])
    mass /= mass.sum()
    f = np.append(f, 1.0)
    mean = float(mass @ f)
    if odds < 1 and mass[-1] > 0.5:
        mean = 1.0
    return Opacity(mean, float(np.sqrt(mass @ (f - mean) ** 2)))


def _possible(f: Array, observation: Observation, inside: Bools) -> Bools:
    """(n,) whether the mean color that belongs to an opacity is physically possible."""
    if not inside.any():
        return np.ones(len(f), bool)
    C, B = (light[inside].mean(axis=0) for light in (observation.C, observation.B))
    light = (C - (1 - f)[:, None] * B) / f[:, None]
    brightest = light.max(axis=1)
    lit = light.min(axis=1) >= MIN_LIGHT * brightest
    return np.asarray(lit & (brightest > 0) & (brightest <= MAX_LIGHT))
