"""Fits compared: their residuals, their physical admissibility, and their ranking.

The Bayesian information criterion is that of Schwarz [1978]. Correlated residuals carry less
information: costs are divided by the variance inflation of the state of the least cost.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from weakref import WeakKeyDictionary

import numpy as np

from blurmatte.checks import Array, Bools, Ints64
from blurmatte.statistics import (
    CORRELATED_PX,
    DECISIVE_LOG_BAYES_FACTOR,
    MEDIAN_3,
    block_squares,
    chi_square_quantile,
    mean_of_blocks,
    trimmed_mean,
)
from blurmatte.sweep.model.cast_shadow import CastShadow
from blurmatte.sweep.model.observation import TRIMMED_OUTSIDE, Observation
from blurmatte.sweep.model.shape import FlatShape
from blurmatte.sweep.model.silhouette import OPAQUE
from blurmatte.sweep.model.state import State

# Reasons why a sweep is physically impossible
NEGATIVE_LIGHT = "needs negative light"
UNSEEN_END = "ends where nothing changed"

# Limits of a sweep that is physically possible.
MAX_LIGHT = 1.2  # mean light of a surface, where the sensor's white is 1
# Of a channel, of the brightest one; noise may make a dark channel negative
MIN_LIGHT = -0.1
_MIN_VISIBLE_FRACTION = 0.5  # of the total alpha, on valid pixels
_MAX_OUTSIDE_FRACTION = 0.01  # of the path, outside the mask
_PATH_POINTS = 129  # at even times, that are looked at
_ACROSS_POINTS = 9  # of each diameter across the path
# Turn of the path within the object's own width: half a circle, and rounding
_MAX_TURN_RAD = 3.5
# Median outside the streak, over that of noise, of codecs that repeat static parts
_MAX_REPEATED_CHI2 = 0.3 / MEDIAN_3
_MAX_NOISE_RATIO = 0.3  # standard deviation of noise over the rms change of a pixel
_TRIMMED_INSIDE = 0.1  # of the blocks of a sweep, dropped: tolerates occluders and holes
_CHROMA_PX = 16  # of the largest blocks whose mean chroma codecs quantize, for 4:2:0


def ranked(states: Sequence[State]) -> list[tuple[float, State]]:
    """Score above the best, units of log likelihood, and state; sorted, the best first.

    Inadmissible states are dropped if there are others. The time of a kink counts as two parameters,
    for noise favors one of many times [Yao 1988]. A source of light is a rare explanation: it must be
    decisively likelier.
    """
    admissible = [state for state in states if not rejection(state)] or list(states)
    likeliest = min(admissible, key=lambda state: state.cost)
    inflation = likeliest.variance_inflation
    scores = [
        (state.cost + state.silhouette.price(state.shape) - likeliest.cost) / inflation
        + bic_penalty(
            state.observation, state.parameters + (state.family.kink(state.path) is not None)
        )
        + DECISIVE_LOG_BAYES_FACTOR * is_source(state)
        for state in admissible
    ]
    order = sorted(range(len(scores)), key=scores.__getitem__)
    return [(scores[i] - scores[order[0]], admissible[i]) for i in order]


def is_source(state: State) -> bool:
    """Whether it has more light than a surface could reflect."""
    return float(state.mean_color.max()) > MAX_LIGHT and not state.observation.light_alone


def best_of(states: Sequence[State]) -> State:
    """The first of `ranked`."""
    return ranked(states)[0][1]


def bic_penalty(observation: Observation, parameters: int) -> float:
    """Penalty of a number of parameters, units of log likelihood."""
    return 0.5 * parameters * float(np.log(max(observation.weight.sum(), 2)))


def rejection(state: State) -> str:
    """Reason why the sweep is physically impossible, to follow "the fit"; empty if it is possible."""
    if state not in _REJECTIONS:
        _REJECTIONS[state] = _rejection(state)
    return _REJECTIONS[state]


# Of states that exist: each is compared several times
_REJECTIONS: WeakKeyDictionary[State, str] = WeakKeyDictionary()


def _rejection(state: State) -> str:
    light = state.mean_color
    if light.min() < MIN_LIGHT * light.max():
        return NEGATIVE_LIGHT
    if not inside_mask(state):
        return "leaves the streak"
    if ends_unseen(state):
        return UNSEEN_END
    if self_overlaps(state):
        return "doubles back within its own width"
    alpha = state.swept.alpha
    hidden = (alpha * (1 - state.observation.valid_fraction)).sum()
    if hidden >= (1 - _MIN_VISIBLE_FRACTION) * alpha.sum():
        return "lies mostly where the pictures are clipped or hidden"
    return ""


def inside_mask(state: State) -> bool:
    """True if the path stays near the streak where it is within the picture."""
    xy, _ = _visible_path(state)
    (y, x), beyond = _pixels_at(state, xy)
    outside = np.count_nonzero(beyond | ~state.observation.near[y, x])
    return bool(outside <= _MAX_OUTSIDE_FRACTION * _PATH_POINTS)


def ends_unseen(state: State) -> bool:
    """True if the object is decisively not where an end of its path lies, outside the streak.

    With its mean color it would be seen there. A fit of any colors may give that end the plate's color
    instead, and so make the path longer. A source of light may go out.
    """
    observation = state.observation
    xy, normals = _visible_path(state)
    # Across its path: stripes of the plate's color are not seen, but others of the object are.
    offsets = state.radius * np.linspace(-1, 1, _ACROSS_POINTS)
    across, beyond = _pixels_at(state, xy + offsets[:, None, None] * normals)
    seen = np.flatnonzero((observation.streak[tuple(across)] & ~beyond).any(axis=0))
    if observation.light_alone or not seen.size:
        return False
    (y, x), _ = _pixels_at(state, xy)
    ends = np.r_[: seen[0], seen[-1] + 1 : len(xy)]
    y, x = np.unique(np.stack([y, x])[:, ends], axis=1)
    shown = observation.valid[y, x] & ~observation.streak[y, x]
    return _log_odds_at(state, y[shown], x[shown]) < -DECISIVE_LOG_BAYES_FACTOR


def _log_odds_at(state: State, y: Ints64, x: Ints64) -> float:
    """Log Bayes factor of the mean color in the streak, against nothing, at rows and columns (n,)."""
    observation, alpha = state.observation, state.swept.alpha
    inside = observation.streak & observation.valid
    covered = alpha[inside][:, None]
    light = observation.C[inside] - (1 - covered) * observation.B[inside]
    color = (covered * light).sum(axis=0) / max(float((covered**2).sum()), 1e-12)
    variance = (observation.C_variance + observation.B_variance)[y, x]
    expected = alpha[y, x][:, None] * (color - observation.B[y, x])
    found = (observation.C - observation.B)[y, x]
    log_odds = float(((found - expected / 2) * expected / variance).sum())
    return log_odds / state.variance_inflation


def _visible_path(state: State) -> tuple[Array, Array]:
    """Points (n, 2) of the path within the picture, and unit normals of the path (n, 2) there."""
    xy, _ = state.family.at(state.path, np.linspace(0, 1, _PATH_POINTS))
    dx, dy = np.gradient(xy, axis=0).T
    normals = np.stack([-dy, dx], axis=1) / np.maximum(np.hypot(dx, dy), 1e-9)[:, None]
    visible = np.all((xy > -0.5) & (xy < np.array(state.observation.size) - 0.5), axis=1)
    return xy[visible], normals[visible]


def _pixels_at(state: State, xy: Array) -> tuple[Ints64, Bools]:
    """Rows and columns (2, ...) of points (..., 2), and whether they are beyond the pixels (...)."""
    at = (xy - state.observation.origin) / state.observation.scale
    h, w = state.observation.near.shape
    nearest = np.clip(np.rint(at), 0, (w - 1, h - 1)).astype(np.int64)
    # Blocks may cover less than the picture: one block beyond counts as within.
    return np.moveaxis(nearest[..., ::-1], -1, 0), np.any((at < -1) | (at > (w, h)), axis=-1)


def self_overlaps(state: State) -> bool:
    """True if the path reverses twice, or circles, within the object's own width.

    Also if it bounces and both pieces are shorter than the radius: a line gives the same picture.
    """
    steps = np.diff(state.curve, axis=0) @ np.array([1, 1j])
    turned = float(np.abs(np.angle(steps[1:] * steps[:-1].conj())).sum())
    kink = state.family.kink(state.path)
    if kink is not None:
        xy, _ = state.family.at(state.path, np.array([0, kink, 1]))
        if np.linalg.norm(np.diff(xy, axis=0), axis=1).max() < state.radius:
            return True
    return turned > _MAX_TURN_RAD and float(np.abs(steps).sum()) < 2 * state.radius * turned


@dataclass(frozen=True, eq=False)
class Candidate:
    """A fitted sweep."""

    state: State
    cast: CastShadow | None = None  # the shadow in which the state's plate lies
    # Pixels by which the file blurred colors, a standard deviation; 0 if it did not
    chroma_blur: float = 0.0
    opacity_std: float = 0.0  # standard deviation of the silhouette's opacity
    even_opacity_std: float = 0.0  # the same if letting light through is as usual as being solid
    # (p, p) float: of path and shape with a pattern that moves along, whose residuals and cost the
    # state has; None without
    covariance: Array | None = None
    # (p, p) float: of these by a blur of the rim that is not known; None if it is
    rim_covariance: Array | None = None
    # Nats by which the order of an outline limits its likelihood more than that of its rival
    unresolved: float = 0.0

    @property
    def silhouette(self) -> FlatShape:
        """Kind of the shape: candidates are flat."""
        assert isinstance(self.state.silhouette, FlatShape)
        return self.state.silhouette

    @property
    def parameters(self) -> int:
        """Number of parameters of path, shape, opacity and shadow."""
        seen_through = self.silhouette.opacity < 1
        return (
            self.state.parameters + seen_through + (CastShadow.size if self.cast is not None else 0)
        )


def hue_inflation(state: State) -> float:
    """As `State.variance_inflation`, the larger of both axes of hue, also over blocks of chroma."""
    inside, _ = state.places
    e = state.weighted_residuals[..., 1:]
    squares = (block_squares(e, inside, size) for size in (*CORRELATED_PX, _CHROMA_PX))
    return max(1.0, *(float(s.mean(axis=0).max()) for s in squares if len(s)), 1.0)


def residual_excess(state: State) -> float:
    """Correlation of residuals within the sweep over that of the noise outside; about 1 if it fits.

    Each is the variance of block sums over that of pixels: an error of the noise level cancels. Few
    blocks of one channel exceed 1 by chance: what they exceed in one of twenty cases counts as 1.
    """
    e, n = state.weighted_residuals, state.observation.channels
    inside, outside = state.places
    ratios = [
        _correlation(e, inside, _TRIMMED_INSIDE, size, n)
        / max(_correlation(e, outside, TRIMMED_OUTSIDE, size, n), 1.0)
        for size in CORRELATED_PX
    ]
    excess = float(np.exp(np.mean(np.log(np.maximum(ratios, 1e-6)))))
    if n > 1 or excess <= 1:
        return excess
    independent = max(np.count_nonzero(inside) / max(CORRELATED_PX) ** 2, 1.0)
    return max(1.0, excess / float(chi_square_quantile(0.95, independent) / independent))


def explained_fraction(state: State) -> float:
    """Fraction of the change in streak and sweep that the sweep explains, noise apart; 0 to 1."""
    observation, alpha = state.observation, state.swept.alpha
    use = (observation.streak | (alpha > 0)) & observation.valid
    variance = observation.C_variance + observation.B_variance
    noise = observation.channels * np.count_nonzero(use)
    change = float(((observation.C - observation.B) ** 2 / variance)[use].sum()) - noise
    left = float(state.chi2[use].sum()) - noise
    return float(np.clip(1 - left / change, 0, 1)) if change > 0 else 0.0


def outlier_fraction(state: State) -> float:
    """Fraction of the sweep's pixels whose χ² exceeds the 99.9 % quantile of noise."""
    inside = (state.swept.alpha > 0) & state.observation.valid
    limit = chi_square_quantile(0.999, state.observation.channels)
    return float(np.mean(state.chi2[inside] > limit)) if inside.any() else 1.0


def noise_inflation(state: State) -> float:
    """Variance of the noise within a sweep over the one that was measured, 1 or more.

    Codecs of clips repeat static parts, whose noise is then less than that of moving parts. 1 if the
    noise outside the streak is not repeated, and if the residuals are too large compared with the
    change to be noise.
    """
    observation, alpha = state.observation, state.swept.alpha
    _, outside = state.places
    inside = (alpha > 0) & (alpha < OPAQUE) & observation.valid
    if not (inside.any() and outside.any()):
        return 1.0
    median = float(chi_square_quantile(0.5, observation.channels))
    if np.median(state.chi2[outside]) >= _MAX_REPEATED_CHI2 * median:
        return 1.0
    inflation = float(np.median(state.chi2[inside])) / median
    variance = (observation.C_variance + observation.B_variance)[inside]
    change = float(np.mean((observation.C - observation.B)[inside] ** 2))
    explains = inflation * float(np.mean(variance)) < _MAX_NOISE_RATIO**2 * change
    return inflation if inflation > 1 and explains else 1.0


def colors_are_correlated(state: State) -> bool:
    """True if the noise of color is correlated between pixels, which chroma subsampling causes.

    Blur by a lens does not correlate noise, and slow variation of light has no influence.
    """
    observation = state.observation
    _, outside = state.places
    variance = observation.C_variance + observation.B_variance
    e = (observation.C - observation.B) / np.sqrt(variance)
    color = e - e.mean(axis=-1, keepdims=True)
    near, far = (_squared_differences(color, outside, apart) for apart in (1, 2))
    return bool(near < _MAX_INDEPENDENT_RATIO * far)


# Of squared differences of neighbors over those of pixels two apart: 1 for independent noise, 0.8 where
# pairs of pixels share their color; chance makes it 1 ± 0.02 of 3000 pixels.
_MAX_INDEPENDENT_RATIO = 0.9


def _squared_differences(values: Array, use: Bools, apart: int) -> float:
    """Sum of squared differences of pixels so far apart, 1 or 2, of three in a row or column."""
    total = 0.0
    for x, known in ((values, use), (values.swapaxes(0, 1), use.T)):
        all_three = known[2:] & known[1:-1] & known[:-2]
        total += float(np.sum((x[apart:][: len(all_three)] - x[:-2])[all_three] ** 2))
    return total


def _correlation(e: Array, use: Bools, trimmed: float, size: int, channels: int) -> float:
    """Mean square of block sums over that of pixels; 1 if there are no pixels."""
    if not use.any():
        return 1.0
    pixels = trimmed_mean((e**2).sum(axis=-1)[use] / channels, trimmed)
    return mean_of_blocks(e, use, size, channels, trimmed) / pixels if pixels > 0 else 1.0
