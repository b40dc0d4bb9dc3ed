"""Search: where a disc may have gone, from the streak's outline to the best path of all families.

Descents go from coarse to fine: every family of paths is tried on large pixels, from several curves
through the streak and then from the best path found, the best few on small ones.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from blurmatte.radiometry import LinearImage
from blurmatte.streaks import Streak
from blurmatte.sweep.choice import best_of, contested, ranked
from blurmatte.sweep.data import Data, data_around
from blurmatte.sweep.descent import ROUGHLY, State, descend, main_colors, seen, sharp, state_at
from blurmatte.sweep.frame import Frame
from blurmatte.sweep.known import KnownColor
from blurmatte.sweep.path import ARC, BOUNCE, CUBIC, FROM_REST, LINE, PARABOLA, PathFamily
from blurmatte.sweep.side_by_side import side_by_side
from blurmatte.sweep.silhouette import BLUR_OF_FILES, DISC
from blurmatte.sweep.start import center_curve, depth_of
from blurmatte.sweep.sweep import Sweep
from blurmatte.sweep.verdict import (
    HOPELESS,
    MAX_MISFIT,
    can_be,
    coherence_beside,
    doubtful_share,
    is_told_by_noise,
    left_beyond_noise,
    misfit,
)

Array = npt.NDArray[np.float64]

SMOOTH: tuple[PathFamily, ...] = (LINE, ARC, PARABOLA, CUBIC)
FAMILIES: tuple[PathFamily, ...] = (*SMOOTH, FROM_REST, BOUNCE)

_GRAINS = 5.0  # in the half width, over which any colors change little
_COARSE_RADIUS = 4.0  # pixels: large enough to be round, small enough to be quick
_FINE_RADIUS = 40.0  # pixels: more of them tell nothing new
# Cells, by which masks are wider if these are larger than pixels; and what is surely within, of the
# half width. Of cells of 1, 2 and 4 pixels a ball of 3 had masks of half widths of 10, 20 and 36.
_WIDER, _WITHIN = 7.0, 0.25
_MARGIN = 0.4  # of the half width, what a mask may have missed
_LEAST, _MOST = 0.2, 1.7  # of the half width, what a radius can be: masks of small things are wide
_RADII = 0.8, 0.6, 0.95, 0.4  # of the half width, what descents start from
QUICK = (0.8,)  # of them, where one must do
_QUICK_STEPS = 30  # what takes more mostly drifts towards something else that moved
_QUICK_GAIN = 1e-2  # of log likelihood: what is left then is less than 0.1 standard deviations
_CLOSE = 20.0  # units of log likelihood that large pixels may have hidden
_FINALISTS = 4
_ALIKE = 1.0  # units of log likelihood: about what descents on large pixels leave
_POINTS = 33  # of a curve to begin along
_SOFT = 0.7  # pixels: a rim is sharp if it suits less than this
_OF_CODECS = 4.0  # coherence of noise on large pixels: clips had 9 to 30, PNG about 0.5
_CONTRADICTED = 0.5  # of the pixels of a disc on large pixels


@dataclass(frozen=True, eq=False)
class Search:
    """Data, fine and coarse, and where descents begin.

    Parameters
    ----------
    data, coarse : Data
    curves : sequence of ((m, 2) float, float)
        Curves through the streak, and the radius of a disc that may have gone along.
    bounds : (float, float)
        Of the radius, pixels.
    middle : (2,) float
        Of the streak's box (x, y), pixels.
    families : tuple of PathFamily
        Of paths.
    """

    data: Data
    coarse: Data
    curves: Sequence[tuple[Array, float]]
    bounds: tuple[float, float]
    middle: Array
    families: tuple[PathFamily, ...] = FAMILIES

    @classmethod
    def of(
        cls,
        streak: Streak,
        image: LinearImage,
        plate: LinearImage,
        known: KnownColor | None,
        radii: Sequence[float] = _RADII,
        louder: float = 1.0,
    ) -> "Search":
        """The search for what left a streak, from discs of these parts of its half width.

        The pictures' noise has that many times the variance that was measured.
        """
        x0, y0, x1, y1 = streak.box
        depth = depth_of(streak.mask[y0:y1, x0:x1])
        wider = min(_WIDER * (streak.cell - 1), (1 - _WITHIN) * float(depth.max()))
        half_width = float(depth.max()) - wider
        data = data_around(streak, int(_MARGIN * half_width) + 4, image, plate, known)
        data = replace(data, grain=half_width / _GRAINS, louder=louder)
        data = data.coarse_enough(half_width, _FINE_RADIUS)
        if image.meta.sharing is not None and data.scale > 1:
            data = data.with_noise_measured()
        return cls(
            data,
            data.coarse_enough(half_width, _COARSE_RADIUS),
            [
                (center_curve(depth, radius + wider) + np.array([x0, y0]), radius)
                for radius in (part * half_width for part in radii)
            ],
            (_LEAST * half_width, _MOST * half_width),
            np.array([x0 + x1 - 1, y0 + y1 - 1]) / 2,
        )

    def raised(self, by: float) -> "Search":
        """With that many times the variance of noise."""
        return replace(self, data=self.data.raised(by), coarse=self.coarse.raised(by))

    @property
    def as_measured(self) -> "Search":
        """With the noise that was measured."""
        return self.raised(1 / self.data.louder)

    def best(self, rank: int) -> State:
        """Path, radius and color of this rank that leave the least."""
        finalists = _finalists(self.coarse, self._tried(rank))
        if left_beyond_noise(self.coarse, finalists[0]) > HOPELESS:
            finalists = finalists[:1]
        ends = side_by_side(self._roughly, finalists)
        likeliest = best_of(self.data, ends)
        first = self._finished(likeliest)
        soft = self.softened(first)
        others = [s for s in ends if s is not likeliest]
        if soft is not first:
            others = side_by_side(self.softened, others)
        return self._finished(contested(self.data, ranked(self.data, [soft, *others])))

    def quick(self, rank: int) -> State:
        """The best of a few descents, on throws from the first curve: for one of many frames.

        A throw is never too simple for a short way: a line where there is a faint bend would tell
        its center better than it is known. Nor is a soft rim; a sharp one is tried where that is not
        clearly soft. What most pixels contradict on large pixels is left as it is.
        """
        curve, radius = self.curves[0]
        coarse = best_of(self.coarse, self._ends(curve, radius, rank, (PARABOLA,)))
        start = self._soft(seen(self.data, coarse))
        if doubtful_share(self.data, start) > _CONTRADICTED:
            return start
        soft = descend(self.data, start, self.bounds, _QUICK_STEPS, _QUICK_GAIN)
        soft = self._defocused(soft)
        if soft.silhouette.softness(soft.shape) > _SOFT * self.data.scale:
            return soft
        return best_of(self.data, [soft, descend(self.data, sharp(self.data, soft), self.bounds)])

    def near(self, start: Sweep, rank: int) -> State:
        """What descents end at that begin with the path and size of another sweep, or a line there.

        It is laid over the streak: the next frame of a clip shows about the same path elsewhere.
        """
        xy = start.family.at(start.path, np.linspace(0, 1, _POINTS))[0]
        curve = xy + self.middle - (xy.min(axis=0) + xy.max(axis=0)) / 2
        families = dict.fromkeys((start.family, LINE))
        tried = self._ends(curve, start.radius, rank, tuple(families))
        ends = side_by_side(lambda s: descend(self.data, seen(self.data, s), self.bounds), tried)
        return self.softened(best_of(self.data, ends))

    def _tried(self, rank: int) -> list[State]:
        """Where descents on large pixels end.

        What explains the streak there is asked for nothing better: from the other radii only its own
        family may still end elsewhere, and contest it. Where all families end as before from another
        radius, they do from all.
        """
        (curve, radius), *others = self.curves
        tried = self._ends(curve, radius, rank)
        best = best_of(self.coarse, tried)
        for curve, radius in others:
            explained = self._is_found(best)
            ends = self._ends(curve, radius, rank, (best.family,) if explained else None)
            again = not explained and _end_alike(tried, ends)
            best = best_of(self.coarse, [best, *ends])
            tried += ends
            if again:
                break
        return tried + self._ends(best.curve, best.shape[0], rank)

    def _is_found(self, state: State) -> bool:
        """Whether a disc explains the streak on large pixels.

        What single ones say does not count in a clip: noise of a codec that hangs together is more
        there than it seems.
        """
        data = self.coarse
        if misfit(data, state) <= MAX_MISFIT:
            return True
        of_codec = self.data.compression is None and coherence_beside(data, state) > _OF_CODECS
        possible = of_codec and state.converged and can_be(data, state)
        return possible and left_beyond_noise(data, state) <= MAX_MISFIT

    def _roughly(self, state: State) -> State:
        """Where a descent on small pixels about ends."""
        return descend(self.data, seen(self.data, state), self.bounds, enough=ROUGHLY)

    def _finished(self, state: State) -> State:
        """Where a descent ends that goes on from there."""
        end = descend(self.data, state, self.bounds)
        return replace(end, contested=state.contested)

    def softened(self, state: State) -> State:
        """The same with a soft rim, if that explains the data clearly better.

        Lenses blur, and files blur color: most share it among pixels, and compression leaves out its
        fine structure.
        """
        start = self._soft(state)
        if start.cost >= state.cost:
            return state
        soft = descend(self.data, start, self.bounds)
        return self._defocused(best_of(self.data, [state, soft]))

    def softest(self, state: State) -> State:
        """The same with a rim as soft as lenses make it, if that explains the data better at all."""
        if state.silhouette.soft and not is_held(state):
            return state
        soft = descend(self.data, self._soft(state, defocused=True), self.bounds)
        return soft if soft.cost < state.cost else state

    def _defocused(self, state: State) -> State:
        """The same with a rim softer than files make it, if noise tells that, or nothing less explains.

        Otherwise it takes up what else is wrong: the dark side of a ball seems to fade in its shadow.
        """
        if not is_held(state):
            return state
        softer = self.softest(state)
        explained = left_beyond_noise(self.data, state) <= MAX_MISFIT
        if explained and not is_told_by_noise(self.data, softer):
            return state
        return best_of(self.data, [state, softer])

    def _soft(self, state: State, defocused: bool = False) -> State:
        """The same with a rim that is just soft, or as soft as it is, to begin with."""
        silhouette = replace(state.silhouette, soft=True, defocused=defocused)
        shape = silhouette.like(state.silhouette, state.shape)
        shape[-1] = max(shape[-1], _SOFT * self.data.scale)
        return state_at(self.data, state.family, state.path, silhouette, shape, state.frame)

    def _ends(
        self,
        curve: Array,
        radius: float,
        rank: int,
        families: tuple[PathFamily, ...] | None = None,
    ) -> list[State]:
        """Of descents that begin along a curve."""
        starts = _starts(self.coarse, curve, radius, rank, families or self.families)
        return [descend(self.coarse, start, self.bounds, enough=ROUGHLY) for start in starts]


def is_held(state: State) -> bool:
    """Whether a rim would be softer if it were not for files."""
    silhouette = state.silhouette
    return not silhouette.defocused and silhouette.softness(state.shape) >= BLUR_OF_FILES


def _starts(
    data: Data, curve: Array, radius: float, rank: int, families: tuple[PathFamily, ...]
) -> Iterable[State]:
    """Where descents along a curve begin."""
    shape = DISC.start(radius)
    for family in families:
        for path in family.starts(curve):
            if rank == 3:
                frame = Frame.of(np.eye(3))
            elif data.known is None:
                alpha = DISC.sweep(family, path, shape, data).alpha
                frame = main_colors(data, alpha, rank)
            else:
                frame = data.known.frame
            yield state_at(data, family, path, DISC, shape, frame)


def _end_alike(some: Sequence[State], others: Sequence[State]) -> bool:
    """Whether the best of each family is about as likely in both."""
    before, after = _least(some), _least(others)
    return all(abs(after[family] - before[family]) < _ALIKE for family in before)


def _least(ends: Sequence[State]) -> dict[PathFamily, float]:
    """The least cost of each family."""
    return {s.family: s.cost for s in sorted(ends, key=lambda s: s.cost, reverse=True)}


def _finalists(data: Data, tried: Sequence[State]) -> list[State]:
    """The best of each family that may turn out to be the best of all."""
    order = ranked(data, tried)
    best: dict[PathFamily, State] = {}
    for score, state in order:
        if score < order[0][0] + _CLOSE:
            best.setdefault(state.family, state)
    return list(best.values())[:_FINALISTS]
