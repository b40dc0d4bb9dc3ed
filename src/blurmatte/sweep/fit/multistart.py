"""Multistart: from the outline of a streak to the discs that explain it best, on paths of all families.

Fits go from coarse to fine: every family of paths is fitted on large pixels, from several curves
through the streak, and the best few go on to small pixels.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from blurmatte.radiometry import LinearImage
from blurmatte.streaks import Streak
from blurmatte.sweep.fit.centerline import center_curve, depth_of
from blurmatte.sweep.fit.levenberg_marquardt import ROUGH_TOLERANCE, minimize
from blurmatte.sweep.fit.parallel import thread_map
from blurmatte.sweep.fit.ranking import DECISIVE_LOG_BAYES_FACTOR, best_of, ranked
from blurmatte.sweep.fit.residuals import variance_inflation
from blurmatte.sweep.model.color_prior import ColorPrior
from blurmatte.sweep.model.observation import Observation, observation_around
from blurmatte.sweep.model.path import ARC, BOUNCE, CUBIC, FROM_REST, LINE, PARABOLA, PathFamily
from blurmatte.sweep.model.silhouette import DISC
from blurmatte.sweep.model.state import State, state_at

Array = npt.NDArray[np.float64]

FAMILIES: tuple[PathFamily, ...] = (LINE, ARC, PARABOLA, CUBIC, FROM_REST, BOUNCE)
_RADII = 1.0, 0.75, 1.2, 0.5  # of the half width, of discs that fits start from
QUICK_RADII = (0.8,)  # of the half width, for one of many frames
_MIN_RADIUS, _MAX_RADIUS = 0.25, 1.6  # of the half width
_COARSE_RADIUS, _FINE_RADIUS = 4.0, 16.0  # pixels of a disc on large and on small pixels
_MAX_PIXELS = 80_000  # of an observation; larger ones are averaged
_MARGIN = 2.5  # half widths around a streak
NODES_PER_RADIUS = 4.0  # of the color field, in a half width
_MASK_MARGIN = 0.3  # of the half width, that masks are widened by at most
_COARSE_STEPS, _FINE_STEPS = 25, 25
_COARSE_TOLERANCE = 0.3  # units of log likelihood
_FINALISTS = 2
_FIRST_SOFTNESS = 0.7  # pixels
_FREE_BRIGHTNESS = 10.0  # standard deviation, linear light: much more than any
_MAX_STD_RATIO = (
    3.0  # of the radius, from hue alone and with brightness, that are about as well known
)


@dataclass(frozen=True, eq=False)
class Multistart:
    """Observations, fine and coarse, and where fits start.

    Parameters
    ----------
    observation, coarse : Observation
    curves : sequence of ((n, 2) float, float)
        Curves through the streak, and the radius of a disc that may have moved along it.
    bounds : (float, float)
        Of the radius, pixels.
    middle : (2,) float
        Of the streak's box (x, y), pixels.
    """

    observation: Observation
    coarse: Observation
    curves: Sequence[tuple[Array, float]]
    bounds: tuple[float, float]
    middle: Array

    @classmethod
    def of(
        cls,
        streak: Streak,
        image: LinearImage,
        plate: LinearImage,
        color: ColorPrior,
        radii: Sequence[float] = _RADII,
    ) -> "Multistart":
        """For what left a streak, from discs of these parts of its half width."""
        x0, y0, x1, y1 = streak.box
        depth, wider = _depth_in(streak)
        half_width = float(depth.max()) - wider
        observation = observation_around(streak, int(_MARGIN * half_width) + 4, image, plate, color)
        observation = replace(observation, grain=half_width / NODES_PER_RADIUS)
        observation = observation.coarse_enough(half_width, _FINE_RADIUS)
        crowded = np.sqrt(observation.weight.size / _MAX_PIXELS)
        observation = observation.coarser(max(1, int(np.ceil(crowded))))
        observation = observation.raised(observation.correlated_noise())
        coarse = observation.coarse_enough(half_width, _COARSE_RADIUS)
        return cls(
            observation,
            coarse,
            [
                (center_curve(depth, radius + wider) + np.array([x0, y0]), radius)
                for radius in (part * half_width for part in radii)
            ],
            (_MIN_RADIUS * half_width, _MAX_RADIUS * half_width),
            np.array([x0 + x1 - 1, y0 + y1 - 1]) / 2,
        )

    def with_noise_inflated(self, by: float) -> "Multistart":
        """With so many times the variance of noise."""
        return replace(self, observation=self.observation.raised(by), coarse=self.coarse.raised(by))

    def best(self) -> tuple[list[State], list[State]]:
        """The best discs of one paint, and of colors that vary, each the best first.

        One paint leaves a wrong shape the least freedom, and goes first.
        """
        one_paint = self.of_one_paint
        fits = one_paint._from_all_curves()
        varied = [with_varied_colors(fit) for fit in fits]
        start = best_of(varied)
        varied += self._fits(start.curve, float(start.shape[0]), FAMILIES)
        return one_paint._best_refined(fits), self._best_refined(varied)

    @property
    def of_one_paint(self) -> "Multistart":
        """For an object of which only the brightness varies."""
        return replace(
            self, observation=self.observation.of_one_paint, coarse=self.coarse.of_one_paint
        )

    def quick(self) -> State:
        """The best of a few fits of parabolas to the first curve: for one of many frames."""
        curve, radius = self.curves[0]
        coarse = best_of(self._fits(curve, radius, (PARABOLA,)))
        return self.softened(self._refined(coarse))

    def near(self, family: PathFamily, curve: Array, radius: float) -> State:
        """The best fit that starts from a curve (33, 2) and a radius, or from a line there.

        The curve is moved over the streak: the next frame of a clip shows about the same elsewhere.
        """
        curve = curve + self.middle - (curve.min(axis=0) + curve.max(axis=0)) / 2
        fits = self._fits(curve, radius, tuple(dict.fromkeys((family, LINE))))
        return self.softened(best_of([self._refined(fit) for fit in fits]))

    def softened(self, state: State) -> State:
        """The same with a blurred rim, if that is likelier: lenses blur, and files blur color."""
        soft = replace(state.silhouette, soft=True)
        start = state.of_kind(soft)
        shape = start.shape.copy()
        shape[-1] = max(shape[-1], _FIRST_SOFTNESS * state.observation.scale)
        fitted = minimize(start.moved(start.path, shape), self.bounds, _FINE_STEPS)
        return best_of([state, fitted])

    def _from_all_curves(self) -> list[State]:
        """On large pixels: all families from the first curve, the best one and lines from others."""
        (curve, radius), *others = self.curves
        fits = self._fits(curve, radius, FAMILIES)
        for curve, radius in others:
            families = tuple(dict.fromkeys((best_of(fits).family, LINE)))
            fits += self._fits(curve, radius, families)
        best = best_of(fits)
        return fits + self._fits(best.curve, float(best.shape[0]), FAMILIES)

    def _best_refined(self, fits: Sequence[State]) -> list[State]:
        """The finalists on small pixels, the best first."""
        ends = thread_map(self._refined, self._finalists(fits))
        return [state for _, state in ranked(thread_map(self.softened, ends))]

    def _fits(self, curve: Array, radius: float, families: Sequence[PathFamily]) -> list[State]:
        """On large pixels, from a curve."""
        starts = [
            start_along(self.coarse, family, path, radius)
            for family in families
            for path in family.starts(curve)
        ]
        return [minimize(s, self.bounds, _COARSE_STEPS, _COARSE_TOLERANCE) for s in starts]

    def _finalists(self, fits: Sequence[State]) -> list[State]:
        """The best of each family, of those that may turn out to be the best of all."""
        best: dict[PathFamily, State] = {}
        for behind, state in ranked(fits):
            if behind < 4 * DECISIVE_LOG_BAYES_FACTOR:
                best.setdefault(state.family, state)
        return list(best.values())[:_FINALISTS]

    def _refined(self, state: State) -> State:
        """A fit on small pixels that starts there."""
        start = with_principal_axes(state.on(self.observation))
        return minimize(start, self.bounds, _FINE_STEPS, ROUGH_TOLERANCE)


def half_width_of(streak: Streak) -> float:
    """Half the width of a streak, pixels."""
    depth, wider = _depth_in(streak)
    return float(depth.max()) - wider


def _depth_in(streak: Streak) -> tuple[Array, float]:
    """Depth of the pixels in a streak's box, and by how much its mask is widened, pixels."""
    x0, y0, x1, y1 = streak.box
    depth = depth_of(streak.mask[y0:y1, x0:x1])
    return depth, min((streak.cell - 1) / 2, _MASK_MARGIN * float(depth.max()))


def start_along(observation: Observation, family: PathFamily, path: Array, radius: float) -> State:
    """A disc on a path, with the axes of color of the light that its alpha leaves."""
    state = state_at(observation, family, path, DISC, DISC.start(radius))
    return with_principal_axes(state)


def fitted_to_hue(state: State, bounds: tuple[float, float]) -> State:
    """The same fitted to hue alone, for one paint, if that determines the radius about as well.

    Shade falls off towards the rim faster than a smooth field can, which biases the radius and, where
    one side is darker, the center. Hue does not depend on it.
    """
    if state.observation.color.varied > 1:
        return state
    start = with_principal_axes(state)
    start = start.relit(start.observation.raised(variance_inflation(start)))
    observation = start.observation
    error = np.broadcast_to(_FREE_BRIGHTNESS * observation.color.axes[:, 0], observation.C.shape)
    known = 0.0 if observation.chroma_error is None else observation.chroma_error
    fitted = minimize(start.relit(replace(observation, chroma_error=known + error)), bounds)
    alike = _radius_std(fitted) < _MAX_STD_RATIO * _radius_std(start)
    return fitted if fitted.converged and alike else state


def _radius_std(state: State) -> float:
    """Standard deviation of the radius from the curvature of the cost, pixels."""
    n = len(state.path)
    covariance = np.linalg.pinv(state.information()[0], hermitian=True)
    return float(np.sqrt(covariance[n, n]))


def with_principal_axes(state: State) -> State:
    """The same with axes along the colors of the light that its alpha leaves."""
    return state.relit(state.observation.along_colors(state.swept.alpha))


def with_varied_colors(state: State) -> State:
    """The same with colors that may vary along all axes, unless they are known."""
    color = state.observation.color
    varied = replace(color, varied=color.rank)
    return state.relit(replace(state.observation, color=varied))
