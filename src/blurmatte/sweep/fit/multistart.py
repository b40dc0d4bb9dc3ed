"""Multistart: from the outline of a streak to the discs that explain it best, on paths of all families.

The search is coarse to fine: every family of paths is fitted on large pixels from several curves
through the streak, and the best few are refined on small pixels.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
import scipy

from blurmatte.checks import Array, Bools
from blurmatte.compiling import in_threads
from blurmatte.radiometry import LinearImage
from blurmatte.statistics import DECISIVE_LOG_BAYES_FACTOR
from blurmatte.streaks import Streak
from blurmatte.sweep.fit.levenberg_marquardt import ROUGH_TOLERANCE, minimize
from blurmatte.sweep.fit.ranking import best_of, bic_penalty, ranked, rejection
from blurmatte.sweep.model.color_field import ColorPrior
from blurmatte.sweep.model.observation import Observation, observation_around
from blurmatte.sweep.model.path import FAMILIES, LINE, PARABOLA, PathFamily
from blurmatte.sweep.model.priors import MotionPrior
from blurmatte.sweep.model.silhouette import DISC, OPAQUE, as_silhouette
from blurmatte.sweep.model.state import State, state_at

NODES_PER_RADIUS = 4.0  # of the color field, in a half width

# Settings of the search; lengths are in half widths of the streak unless they say pixels.
# Radii of the discs that fits start from, for one picture and for one of many frames
_RADII = (1.0, 0.75, 1.2, 0.5)
QUICK_RADII = (0.8,)
_MIN_COVERED = 0.5  # area that a disc covers on the first curve, of the largest on another one
_RADIUS_BOUNDS = (0.25, 1.6)
_MARGIN = 2.5  # around the streak
# Radius of a disc on large and on small pixels
_COARSE_RADIUS_PX = 4.0
_FINE_RADIUS_PX = 16.0
_MAX_PIXELS = 80_000  # of an observation; larger ones are averaged
MAX_STEPS = 25  # of one fit
_COARSE_TOLERANCE = 0.3  # on large pixels, units of log likelihood
_MAX_FINALISTS = 2  # families of paths that are refined
# Standard deviation of the rim's blur that fits of soft discs start from
_FIRST_BLUR_PX = 0.7


@dataclass(frozen=True, eq=False)
class Multistart:
    """Observations, fine and coarse, and where fits start."""

    observation: Observation
    coarse: Observation
    # Sequence of ((n, 2) float, float): curves through the streak, and the radius of a disc that
    # may have moved along each
    curves: Sequence[tuple[Array, float]]
    bounds: tuple[float, float]  # of the radius, pixels
    middle: Array  # (2,) float: of the streak's box (x, y), pixels

    @classmethod
    def of(
        cls,
        streak: Streak,
        image: LinearImage,
        plate: LinearImage,
        color: ColorPrior,
        radii: Sequence[float] = _RADII,
    ) -> "Multistart":
        """The search in a streak, from discs of these radii, fractions of its half width."""
        x0, y0, x1, y1 = streak.box
        depth, dilation = _depth_in(streak)
        half_width = float(depth.max()) - dilation
        margin = int(_MARGIN * half_width) + 4
        observation = observation_around(streak, margin, image, plate, color)
        observation = replace(observation, grain=half_width / NODES_PER_RADIUS)
        observation = observation.coarse_enough(half_width, _FINE_RADIUS_PX)
        excess = np.sqrt(observation.weight.size / _MAX_PIXELS)
        observation = observation.coarser(max(1, int(np.ceil(excess))))
        observation = observation.raised(observation.correlated_noise())
        low, high = _RADIUS_BOUNDS
        coarse = observation.coarse_enough(half_width, _COARSE_RADIUS_PX)
        curves = [
            (center_curve(depth, radius + dilation) + np.array([x0, y0]), radius)
            for radius in (fraction * half_width for fraction in radii)
        ]
        return cls(
            observation,
            coarse,
            _covering_first(curves),
            (low * half_width, high * half_width),
            np.array([x0 + x1 - 1, y0 + y1 - 1]) / 2,
        )

    def with_noise_inflated(self, by: float) -> "Multistart":
        """With the variance of noise multiplied by a factor."""
        return self.with_observations(lambda one: one.raised(by))

    def with_prior(self, prior: MotionPrior | None) -> "Multistart":
        """With a prior; its radius lies within the bounds."""
        if prior is None:
            return self
        low, high = self.bounds
        bounds = min(low, prior.radius / 2), max(high, 2 * prior.radius)
        known = partial(replace, prior=prior, camera_stretch=prior.camera_stretch)
        return replace(self.with_observations(known), bounds=bounds)

    @property
    def without_prior(self) -> "Multistart":
        """The same without what other frames say."""
        return self.with_observations(partial(replace, prior=None))

    def best(self) -> tuple[list[State], list[State]]:
        """The best discs of one paint, and of colors that vary; the best of each comes first.

        One paint is fitted first: it leaves a wrong shape the least freedom.
        """
        one_paint = self.of_one_paint
        fits = one_paint._from_all_curves()
        varied = [with_varied_colors(fit) for fit in fits]
        start = best_of(varied)
        varied += self._fits(start.curve, start.radius, FAMILIES)
        return one_paint._best_refined(fits), self._best_refined(varied)

    def best_of_one_paint(self) -> State:
        """The best disc of one paint."""
        one_paint = self.of_one_paint
        return one_paint._best_refined(one_paint._from_all_curves())[0]

    @property
    def of_one_paint(self) -> "Multistart":
        """For an object of which only the brightness varies."""
        return self.with_observations(lambda one: one.of_one_paint)

    def quick(self) -> State:
        """The best of a few fits of parabolas to the first curve: for one of many frames."""
        curve, radius = self.curves[0]
        coarse = best_of(self._fits(curve, radius, (PARABOLA,)))
        return self.softened(self._refined(coarse))

    def soft(self) -> State:
        """As `quick` and as likely, for pictures in which rims are seldom sharp.

        The sharp disc is fitted only if the blur of the rim does not make its own likelier for sure. In
        gray pictures a change of speed looks like a change of brightness: it must be worth its price. A
        short way looks like one there and back on large pixels.
        """
        curve, radius = self.curves[0]
        families = (LINE, PARABOLA) if self.observation.channels == 1 else (PARABOLA,)
        coarse = best_of(self._fits(curve, radius, families))
        starts = [coarse]
        if np.linalg.norm(np.diff(coarse.curve, axis=0), axis=1).sum() < 2 * coarse.radius:
            starts += self._fits(curve, radius, (LINE,))
        on_small = (with_principal_axes(one.on(self.observation)) for one in starts)
        soft = best_of([self._with_blur(one) for one in on_small])
        if _is_surely_blurred(soft):
            return soft
        return best_of([self._refined(soft.of_kind(as_silhouette(coarse.silhouette))), soft])

    def near(self, family: PathFamily, curve: Array, radius: float) -> State:
        """The best fit that starts from a curve (33, 2) and a radius, or from a line there.

        The curve is centered on the streak: the next frame shows about the same path elsewhere. If
        there is a prior of the path, the curve is its mean, and no other family is fitted.
        """
        prior = self.observation.prior
        if prior is not None and prior.path is not None:
            (fit,) = self._fits(curve, radius, (family,))
            return self.softened(self._refined(fit))
        curve = curve + self.middle - (curve.min(axis=0) + curve.max(axis=0)) / 2
        fits = self._fits(curve, radius, tuple(dict.fromkeys((family, LINE))))
        return self.softened(best_of([self._refined(fit) for fit in fits]))

    def again_from(self, state: State) -> State:
        """The best of the fits of all families that start from the curve of one, on small pixels."""
        fits = self._fits(state.curve, state.radius, FAMILIES)
        return self._best_refined(fits)[0]

    def with_observations(self, changed: Callable[[Observation], Observation]) -> "Multistart":
        """The same search with both observations changed."""
        fine, coarse = changed(self.observation), changed(self.coarse)
        return replace(self, observation=fine, coarse=coarse)

    def softened(self, state: State) -> State:
        """The same with a blurred rim, if that is likelier."""
        return best_of([state, self._with_blur(state)])

    def _with_blur(self, state: State) -> State:
        """The fit of a disc with a blurred rim that starts there."""
        start = state.of_kind(replace(as_silhouette(state.silhouette), soft=True))
        known = start.silhouette.softness(start.shape)
        blur = max(known, _FIRST_BLUR_PX * state.observation.scale)
        return minimize(start.with_parameter("blur", blur), self.bounds, MAX_STEPS)

    def _from_all_curves(self) -> list[State]:
        """Fits on large pixels: all families on the first curve, the best one and lines on others."""
        (curve, radius), *others = self.curves
        fits = self._fits(curve, radius, FAMILIES)
        for curve, radius in others:
            families = tuple(dict.fromkeys((best_of(fits).family, LINE)))
            fits += self._fits(curve, radius, families)
        best = best_of(fits)
        return fits + self._fits(best.curve, best.radius, FAMILIES)

    def _best_refined(self, fits: Sequence[State]) -> list[State]:
        """The finalists on small pixels, the best first."""
        ends = in_threads(self._refined, self._finalists(fits))
        return [state for _, state in ranked(in_threads(self.softened, ends))]

    def _fits(self, curve: Array, radius: float, families: Sequence[PathFamily]) -> list[State]:
        """Fits on large pixels that start from a curve."""
        starts = [
            start_along(self.coarse, family, path, radius)
            for family in families
            for path in family.starts(curve)
        ]
        return [minimize(start, self.bounds, MAX_STEPS, _COARSE_TOLERANCE) for start in starts]

    def _finalists(self, fits: Sequence[State]) -> list[State]:
        """The best of each family, of those that refinement may make the best of all."""
        best: dict[PathFamily, State] = {}
        for behind, state in ranked(fits):
            if is_finalist(behind):
                best.setdefault(state.family, state)
        return list(best.values())[:_MAX_FINALISTS]

    def _refined(self, state: State) -> State:
        """The fit on small pixels that starts there."""
        start = with_principal_axes(state.on(self.observation))
        return minimize(start, self.bounds, MAX_STEPS, ROUGH_TOLERANCE)


def is_finalist(behind: float) -> bool:
    """Whether small pixels may make the likeliest what is so many nats behind on large ones."""
    return behind < 4 * DECISIVE_LOG_BAYES_FACTOR


def _covering_first(curves: Sequence[tuple[Array, float]]) -> Sequence[tuple[Array, float]]:
    """Curves (n, 2) with their radii, first the first of which a disc covers about the most.

    Where a mask bulges, a disc as wide as that fits nowhere else.
    """
    areas = [
        radius * (2 * np.linalg.norm(np.diff(curve, axis=0), axis=1).sum() + np.pi * radius)
        for curve, radius in curves
    ]
    first = int(np.argmax(np.array(areas) >= _MIN_COVERED * max(areas)))
    return [curves[first], *curves[:first], *curves[first + 1 :]]


def half_width_of(streak: Streak) -> float:
    """Half the width of a streak, pixels."""
    depth, dilation = _depth_in(streak)
    return float(depth.max()) - dilation


def _depth_in(streak: Streak) -> tuple[Array, float]:
    """Depth of the pixels in a streak's box, and the dilation of its mask, pixels."""
    depth = depth_of(streak.mask[streak.rows_columns])
    return depth, min((streak.cell - 1) / 2, 0.3 * float(depth.max()))


def start_along(observation: Observation, family: PathFamily, path: Array, radius: float) -> State:
    """A disc on a path, with color axes along the light that its alpha implies."""
    disc = replace(DISC, camera_stretch=observation.camera_stretch)
    state = state_at(observation, family, path, disc, disc.start(radius))
    return with_principal_axes(state)


def thin_with_moments(state: State) -> list[State]:
    """Discs that let light through, along a line, of which alpha has the moments of a fit's alpha.

    A disc of radius r has the variance r²/4 along each axis; an even motion of length l adds l²/12
    along its own. The sum of alpha is o π r² with the opacity o. None if that is a solid disc.
    """
    alpha, pixels = state.swept.alpha, state.observation.pixels
    at = pixels.origin + pixels.scale * np.argwhere(alpha > 0)[:, ::-1]
    weight = alpha[alpha > 0]
    middle = np.average(at, axis=0, weights=weight)
    (across, along), axes = np.linalg.eigh(np.cov(at.T, ddof=0, aweights=weight))
    opacity = float(weight.sum()) * pixels.scale**2 / (4 * np.pi * across)
    if opacity >= OPAQUE:
        return []
    half = np.sqrt(3 * (along - across)) * axes[:, 1]
    disc = replace(DISC, camera_stretch=state.observation.camera_stretch, opacity=opacity)
    shape, line = disc.start(2 * np.sqrt(across)), _evenly(np.stack([middle - half, middle + half]))
    starts = ((family, family.starts(line)[0]) for family in (LINE, PARABOLA))
    return [
        with_principal_axes(state_at(state.observation, family, path, disc, shape))
        for family, path in starts
    ]


def fitted_to_hue(state: State, bounds: tuple[float, float]) -> State:
    """The same fitted to hue alone, for one paint, if that determines the radius to within three times.

    Shading changes faster near the rim than a smooth field, which biases the radius and, where one
    side is darker, the center. Hue does not depend on shading.
    """
    if state.observation.color.varied > 1:
        return state
    start = with_principal_axes(state)
    start = start.relit(start.observation.raised(start.variance_inflation))
    observation = start.observation
    # A standard deviation of 10, linear light, along the mean color: brightness has no influence.
    error = np.broadcast_to(10 * observation.color.axes[:, 0], observation.C.shape)
    known = 0.0 if observation.chroma_error is None else observation.chroma_error
    fitted = minimize(start.relit(replace(observation, chroma_error=known + error)), bounds)
    alike = _radius_std(fitted) < 3 * _radius_std(start)
    return fitted if fitted.converged and alike else state


def _is_surely_blurred(state: State) -> bool:
    """Whether a sharp rim would cost more than twice what it saves in parameters.

    The cost is about quadratic in the variance b² of the blur, for it is even in b: a Wald statistic.
    """
    blur = state.silhouette.softness(state.shape)
    variance = state.variance_inflation * max(state.inverse_curvature_of("blur").item(), 1e-12)
    cost = blur**2 / (8 * variance)
    return not rejection(state) and cost > 2 * bic_penalty(state.observation, 1)


def _radius_std(state: State) -> float:
    """Standard deviation of the radius from the curvature of the cost, pixels."""
    return float(np.sqrt(state.inverse_curvature_of("radius").item()))


def with_principal_axes(state: State) -> State:
    """The same with color axes along the light that its alpha implies."""
    return state.relit(state.observation.along_colors(state.swept.alpha))


def with_varied_colors(state: State) -> State:
    """The same with colors that may vary along all axes, unless they are known."""
    color = state.observation.color
    varied = replace(color, varied=color.rank)
    return state.relit(replace(state.observation, color=varied))


def depth_of(mask: Bools) -> Array:
    """(h + 2, w + 2) distance of each pixel of a streak and its holes from the outside, pixels.

    Padded by one pixel; the largest is the radius of the largest disc that fits.
    """
    return np.asarray(
        scipy.ndimage.distance_transform_edt(np.pad(scipy.ndimage.binary_fill_holes(mask), 1))
    )


def center_curve(depth: Array, radius: float) -> Array:
    """Equally spaced points (m, 2) of a path of a disc of this radius within the streak.

    A disc lies within the streak if its center lies in the streak's core, the pixels as deep as its
    radius. The curve joins the means of the pixels at equal geodesic distance from one end of the core;
    a core without length gives a short line.
    """
    parts, _ = scipy.ndimage.label(depth >= min(radius, float(depth.max())))
    core = parts == np.argmax(np.bincount(parts[parts > 0]))
    along = _distance_from_an_end(core)
    steps = np.arange(0, np.nanmax(along) + 1, max(radius / 4, 1))
    which = np.digitize(along[core], steps)
    y, x = np.nonzero(core)
    count = np.bincount(which)
    points = np.stack([np.bincount(which, v)[count > 0] / count[count > 0] for v in (x, y)], axis=1)
    length = float(np.sum(np.linalg.norm(np.diff(points, axis=0), axis=1)))
    if length < radius / 2:
        points = _along_main_axis(depth > 0, radius / 2)
    return _evenly(points - 1)


def _distance_from_an_end(mask: Bools) -> Array:
    """(h, w) geodesic distance within the mask from one of its ends, pixels."""
    index = np.full(mask.shape, -1)
    index[mask] = np.arange(np.count_nonzero(mask))
    edges = [(0, 1, 1.0), (1, 0, 1.0), (1, 1, np.sqrt(2)), (1, -1, np.sqrt(2))]
    rows, columns, lengths = [], [], []
    for dy, dx, length in edges:
        a = index[: mask.shape[0] - dy, max(0, -dx) : mask.shape[1] - max(0, dx)]
        b = index[dy:, max(0, dx) : mask.shape[1] - max(0, -dx)]
        both = (a >= 0) & (b >= 0)
        rows.append(a[both])
        columns.append(b[both])
        lengths.append(np.full(np.count_nonzero(both), length))
    n = np.count_nonzero(mask)
    graph = scipy.sparse.coo_array(
        (np.concatenate(lengths), (np.concatenate(rows), np.concatenate(columns))), (n, n)
    )
    graph = graph.tocsr()
    first = scipy.sparse.csgraph.dijkstra(graph, directed=False, indices=0)
    end = int(np.argmax(np.where(np.isfinite(first), first, -1)))
    distance = scipy.sparse.csgraph.dijkstra(graph, directed=False, indices=end)
    along = np.full(mask.shape, np.nan)
    along[mask] = np.where(np.isfinite(distance), distance, 0)
    return along


def _along_main_axis(mask: Bools, length: float) -> Array:
    """Both ends (2, 2) of a line through the middle of a region."""
    y, x = np.nonzero(mask)
    points = np.stack([x, y], axis=1).astype(float)
    middle = points.mean(axis=0)
    spread = np.cov(points.T) if len(points) > 1 else np.eye(2)
    axis = np.linalg.eigh(spread)[1][:, 1]
    return np.stack([middle - length / 2 * axis, middle + length / 2 * axis])


def _evenly(points: Array) -> Array:
    """Equally spaced points of a polyline."""
    s = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    at = np.linspace(0, s[-1], 33)
    return np.stack([np.interp(at, s, points[:, i]) for i in (0, 1)], axis=1)
