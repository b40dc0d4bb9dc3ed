"""fit_sweep: image, plate and streak → Sweep.

Path, radius and color are found together, as those for which the least is left of the light across
the color (`misfit`), by Levenberg–Marquardt steps with weights that doubt what cannot be noise. It
goes from coarse to fine: every family of paths is tried on large pixels, the best few on small ones,
and the one with the best penalised likelihood is taken.
"""

from collections.abc import Iterable, Sequence

import numpy as np
import numpy.typing as npt

from blurmatte.color.model import ColorModel
from blurmatte.radiometry import LinearImage, with_noise
from blurmatte.streaks import Streak, require_streaks
from blurmatte.sweep.choice import best_of, score, trust_in
from blurmatte.sweep.data import Data, data_within
from blurmatte.sweep.descent import State, descend, main_colors, seen, state_at
from blurmatte.sweep.path import ARC, BOUNCE, CUBIC, FROM_REST, LINE, PARABOLA, PathFamily
from blurmatte.sweep.silhouette import DISC
from blurmatte.sweep.start import center_curve, half_width_of
from blurmatte.sweep.sweep import Sweep
from blurmatte.sweep.verdict import coherence, doubtful_share

Array = npt.NDArray[np.float64]

FAMILIES: tuple[PathFamily, ...] = (LINE, ARC, PARABOLA, CUBIC, FROM_REST, BOUNCE)

_COARSE_RADIUS = 4.0  # pixels: large enough to be round, small enough to be quick
_MARGIN = 0.4  # of the half width, what a mask may have missed
_LEAST, _MOST = 0.2, 1.7  # of the half width, what a radius can be: masks of small things are wide
_RADII = 0.4, 0.6, 0.8, 0.95  # of the half width, what descents start from
_POINTS = 33
_CLOSE = 20.0  # units of log likelihood that large pixels may have hidden
_FINALISTS = 4


def fit_sweep(
    image: LinearImage,
    plate: LinearImage,
    streak: Streak | None = None,
    families: Sequence[PathFamily] = FAMILIES,
) -> Sweep:
    """Find path, radius and color of a disc from the smear that it left.

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
    mask = _cropped(streak)
    half_width = half_width_of(mask)
    data = data_within(streak.around(int(_MARGIN * half_width) + 4), image, plate)
    bounds = (_LEAST * half_width, _MOST * half_width)
    coarse = data.coarser(max(1, int(half_width / _COARSE_RADIUS)))
    tried = [
        descend(coarse, start, bounds)
        for part in _RADII
        for start in _starts(
            coarse,
            families,
            center_curve(mask, part * half_width) + streak.box[:2],
            part * half_width,
        )
    ]
    best = best_of(coarse, tried)
    curve, _ = best.family.at(best.path, np.linspace(0, 1, _POINTS))
    again = _starts(coarse, families, curve, best.shape[0])
    finalists = _finalists(coarse, [*tried, *(descend(coarse, start, bounds) for start in again)])
    finals = [descend(data, seen(data, state), bounds) for state in finalists]
    return _sweep(data, best_of(data, finals), image.size)


def _cropped(streak: Streak) -> npt.NDArray[np.bool_]:
    x0, y0, x1, y1 = streak.box
    return streak.mask[y0:y1, x0:x1]


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
    within, beside = coherence(data, state)
    H, _ = state.information(data)
    covariance = np.asarray(np.linalg.pinv(H, hermitian=True), float) * max(within, 1.0)
    n = state.size - 2
    model = _model(state, covariance[n:, n:])
    stats = {
        "converged": state.converged,
        "misfit": within / max(beside, 1.0),  # below 1, the noise was overstated
        "coherence": within,
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
