"""fit_sweep: image, plate and streak → Sweep.

Path, radius and color are found together, as those for which the least is left of the light across
the color (`misfit`), by Levenberg–Marquardt steps with weights that doubt what cannot be noise. It
goes from coarse to fine: every family of paths is tried on large pixels, the best few on small ones,
and the one with the best penalised likelihood is taken.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from blurmatte.color.model import ColorModel
from blurmatte.radiometry import LinearImage, with_noise
from blurmatte.streaks import Streak, require_streaks
from blurmatte.sweep.choice import best_of, score, trust_in
from blurmatte.sweep.data import Data, data_around
from blurmatte.sweep.descent import State, descend, main_colors, seen, state_at
from blurmatte.sweep.path import ARC, BOUNCE, CUBIC, FROM_REST, LINE, PARABOLA, PathFamily
from blurmatte.sweep.silhouette import DISC
from blurmatte.sweep.start import center_curve, half_width_of
from blurmatte.sweep.sweep import Sweep
from blurmatte.sweep.verdict import MAX_MISFIT, apart_from_plate, coherence, doubtful_share, misfit

Array = npt.NDArray[np.float64]

FAMILIES: tuple[PathFamily, ...] = (LINE, ARC, PARABOLA, CUBIC, FROM_REST, BOUNCE)

_COARSE_RADIUS = 4.0  # pixels: large enough to be round, small enough to be quick
_MARGIN = 0.4  # of the half width, what a mask may have missed
_LEAST, _MOST = 0.2, 1.7  # of the half width, what a radius can be: masks of small things are wide
_RADII = 0.4, 0.6, 0.8, 0.95  # of the half width, what descents start from
_POINTS = 33
_CLOSE = 20.0  # units of log likelihood that large pixels may have hidden
_FINALISTS = 4
_NOISE = 1.3  # misfit of what needs no better explanation
_CLEARLY = 1.5  # times less must be left to believe in more colors


def fit_sweep(
    image: LinearImage,
    plate: LinearImage,
    streak: Streak | None = None,
    families: Sequence[PathFamily] = FAMILIES,
) -> Sweep:
    """Find path, radius and color of a disc from the smear that it left.

    One paint is tried first; where it leaves more than noise, a plane of colors: two paints, one paint
    with highlights, or one in two lights.

    Parameters
    ----------
    image, plate : LinearImage
        With the object, and without; same size.
    streak : Streak, optional
        Where it moved. If not given, the strongest thing that moved.
    families : sequence of PathFamily
        Kinds of paths to choose from.

    Returns
    -------
    Sweep

    Raises
    ------
    MotionError
        If nothing moved.
    ValueError
        If the sizes differ.
    """
    image, plate = with_noise(image, plate)
    if streak is None:
        streak = require_streaks(image, plate)[0]
    search = _Search.of(streak, image, plate, families)
    line = search.best(1)
    assert line is not None
    left = misfit(search.data, line)
    plane = search.best(2) if left > _NOISE else None
    if plane is not None and misfit(search.data, plane) < min(left / _CLEARLY, MAX_MISFIT):
        return _sweep(search.data, plane, image.size)
    return _sweep(search.data, line, image.size)


@dataclass(frozen=True, eq=False)
class _Search:
    """Data, fine and coarse, and where descents begin."""

    data: Data
    coarse: Data
    curves: list[tuple[Array, float]]
    bounds: tuple[float, float]
    families: Sequence[PathFamily]

    @classmethod
    def of(
        cls, streak: Streak, image: LinearImage, plate: LinearImage, families: Sequence[PathFamily]
    ) -> "_Search":
        x0, y0, x1, y1 = streak.box
        mask = streak.mask[y0:y1, x0:x1]
        half_width = half_width_of(mask)
        data = data_around(streak, int(_MARGIN * half_width) + 4, image, plate)
        return cls(
            data,
            data.coarser(max(1, int(half_width / _COARSE_RADIUS))),
            [
                (center_curve(mask, radius) + np.array([x0, y0]), radius)
                for radius in (part * half_width for part in _RADII)
            ],
            (_LEAST * half_width, _MOST * half_width),
            families,
        )

    def best(self, rank: int) -> State | None:
        """Path, radius and color of this rank that leave the least, if any means anything."""
        tried = [s for curve, radius in self.curves for s in self._ends(curve, radius, rank)]
        if not tried:
            return None
        best = best_of(self.coarse, tried)
        curve, _ = best.family.at(best.path, np.linspace(0, 1, _POINTS))
        tried += self._ends(curve, best.shape[0], rank)
        finalists = _finalists(self.coarse, tried)
        finals = [descend(self.data, seen(self.data, state), self.bounds) for state in finalists]
        finals = [state for state in finals if apart_from_plate(self.data, state)]
        return best_of(self.data, finals) if finals else None

    def _ends(self, curve: Array, radius: float, rank: int) -> list[State]:
        """Of descents of all families that begin along a curve."""
        starts = _starts(self.coarse, self.families, curve, radius, rank)
        ends = (descend(self.coarse, start, self.bounds) for start in starts)
        return [end for end in ends if apart_from_plate(self.coarse, end)]


def _starts(
    data: Data, families: Iterable[PathFamily], curve: Array, radius: float, rank: int = 1
) -> Iterable[State]:
    """Where descents along a curve begin."""
    shape = DISC.start(radius)
    for family in families:
        for path in family.starts(curve):
            alpha = DISC.sweep(family, path, shape, data).alpha
            yield state_at(data, family, path, DISC, shape, main_colors(data, alpha, rank))


def _finalists(data: Data, tried: Sequence[State]) -> list[State]:
    """The best of each family that may turn out to be the best of all."""
    trust = trust_in(data, tried)
    families = {
        state.family: state for state in sorted(tried, key=lambda s: -score(data, s, trust))
    }
    best = min(score(data, s, trust) for s in families.values())
    close = [s for s in families.values() if score(data, s, trust) < best + _CLOSE]
    return sorted(close, key=lambda s: score(data, s, trust))[:_FINALISTS]


def _sweep(data: Data, state: State, size: tuple[int, int]) -> Sweep:
    trust = max(coherence(data, state), 1.0)
    H, _ = state.information(data)
    covariance = np.asarray(np.linalg.pinv(H, hermitian=True), float) * trust
    n = state.size - 2
    model = _model(state, covariance[n:, n:])
    stats = {
        "converged": state.converged,
        "misfit": misfit(data, state),
        "coherence": trust,
        "doubtful": doubtful_share(data, state),
    }
    return Sweep(
        state.family,
        state.path,
        state.silhouette,
        state.shape,
        model,
        covariance[:n, :n],
        size,
        stats,
    )


def _model(state: State, turns: Array) -> ColorModel:
    """The color model, with the covariance of the one direction that stands for it."""
    frame = state.frame
    moving = frame.across if frame.rank == 1 else frame.within
    basis = state.main[:, None] if frame.rank == 1 else frame.within
    return ColorModel(
        basis,
        moving @ turns @ moving.T,
        {"shape": float(np.degrees(np.sqrt(np.trace(turns) / 2)))},
    )
