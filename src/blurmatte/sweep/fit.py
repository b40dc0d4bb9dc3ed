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
from blurmatte.sweep.data import Data, data_within
from blurmatte.sweep.descent import State, descend, main_color, state_at
from blurmatte.sweep.path import ARC, BOUNCE, CUBIC, FROM_REST, LINE, PARABOLA, PathFamily
from blurmatte.sweep.silhouette import DISC
from blurmatte.sweep.start import center_curve
from blurmatte.sweep.sweep import Sweep
from blurmatte.sweep.verdict import coherence, doubtful_share

Array = npt.NDArray[np.float64]

FAMILIES: tuple[PathFamily, ...] = (LINE, ARC, PARABOLA, FROM_REST, BOUNCE, CUBIC)

_COARSE_RADIUS = 4.0  # pixels: large enough to be round, small enough to be quick
_FINALISTS = 2
_MARGIN = 0.4  # of the half width, what a mask may have missed
_LEAST, _MOST = 0.5, 1.7  # of the half width, what a radius can be


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
    curve, half_width = center_curve(streak.mask)
    data = data_within(streak.around(int(_MARGIN * half_width) + 4), image, plate)
    bounds = (_LEAST * half_width, _MOST * half_width)
    coarse = data.coarser(max(1, int(half_width / _COARSE_RADIUS)))
    tried = [
        descend(coarse, start, bounds)
        for family in families
        for start in _starts(coarse, family, curve, half_width)
    ]
    finalists = sorted(tried, key=lambda s: _score(coarse, s))[:_FINALISTS]
    finals = [
        descend(data, state_at(data, s.family, s.path, s.silhouette, s.shape, s.line), bounds)
        for s in finalists
    ]
    best = min(finals, key=lambda s: _score(data, s))
    return _sweep(data, best, image.size, {s.family.name: _score(coarse, s) for s in tried})


def _starts(data: Data, family: PathFamily, curve: Array, radius: float) -> Iterable[State]:
    """Where descents of a family begin."""
    directions = (curve, curve[::-1]) if family is FROM_REST else (curve,)
    for way in directions:
        path, shape = family.start(way), DISC.start(radius)
        alpha = DISC.sweep(family, path, shape, data).alpha
        yield state_at(data, family, path, DISC, shape, main_color(data, alpha))


def _score(data: Data, state: State) -> float:
    """Minus the log likelihood, and what every parameter costs [Schwarz 1978]."""
    return state.cost + 0.5 * state.size * float(np.log(max(data.weight.sum(), 2)))


def _sweep(data: Data, state: State, size: tuple[int, int], tried: dict[str, float]) -> Sweep:
    within, beside = coherence(data, state)
    H, _ = state.information(data)
    covariance = np.asarray(np.linalg.pinv(H, hermitian=True), float) * max(within, 1.0)
    n = state.size - 2
    turns = covariance[n:, n:]
    model = ColorModel(
        state.line[:, None],
        state.across @ turns @ state.across.T,
        {"shape": float(np.degrees(np.sqrt(np.trace(turns) / 2)))},
    )
    stats = {
        "converged": state.converged,
        "misfit": within / max(beside, 1.0),  # below 1, the noise was overstated
        "coherence": within,
        "doubtful": doubtful_share(data, state),
        "tried": tried,
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
