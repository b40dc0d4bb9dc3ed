"""Freer: what is less known of a sweep whose shape need not be round, or the same all the way.

In this file H (n, n) is the curvature and g (n,) the gradient of the cost by all parameters, in their
order and units in a `State` but for those of the freedom, which it has not: bulges, or changes of
logarithms, without a unit. One step, −H⁻¹ g, leads to what would be with them.
"""

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from blurmatte.sweep.data import Data
from blurmatte.sweep.descent import State
from blurmatte.sweep.outline_start import bulgy, shaped
from blurmatte.sweep.silhouette import Swept
from blurmatte.sweep.student import VARIANCE
from blurmatte.sweep.verdict import overstated

Array = npt.NDArray[np.float64]

_USUAL = 0.5  # standard deviation of how much shapes change: logarithms, half or twice is rare


@dataclass(frozen=True, eq=False)
class Freer:
    """What one step from a state, with parameters of its shape that it has not, leads to.

    Parameters
    ----------
    less_known : (size, size) float
        What is to be added to the inverse of `State.information`.
    step : (size,) float
        By what the state's own parameters would be others.
    freedom : (k,) float
        What those would be that it has not.
    gain : float
        By how much likelier that would be, units of log likelihood as far as that is evidence.
    """

    less_known: Array
    step: Array
    freedom: Array
    gain: float


def if_not_round(data: Data, disc: State) -> Freer:
    """What would be of a disc if it might have bulges.

    Parameters
    ----------
    data : Data
    disc : State
        Of one paint or a plane, where a descent ended.
    """
    silhouette, first = bulgy(disc), len(disc.path) + 1
    H, g = shaped(data, disc, silhouette).information(data)
    return _freer(H, g, np.s_[first : first + 2 * silhouette.bulges - 2], overstated(data, disc))


def if_it_changes(data: Data, state: State) -> Freer:
    """What would be of a shape if it might become larger or longer while it goes.

    Before a plate of one color what becomes longer leaves nearly the same as what goes further.

    Parameters
    ----------
    data : Data
    state : State
        Of one paint or a plane, where a descent ended.
    """
    by_shape = state.swept.by_parameters
    by_change = state.silhouette.by_change(state.family, state.path, state.shape, data)
    swept = Swept(state.swept.alpha, np.concatenate([by_shape, by_change], axis=2))
    H, g = replace(state, swept=swept).information(data)
    change = np.s_[by_shape.shape[2] : swept.by_parameters.shape[2]]
    # Where residuals hang together they are so much less evidence against what is usual.
    trust = overstated(data, state)
    H[change, change] += trust * VARIANCE / _USUAL**2 * np.eye(by_change.shape[2])
    return _freer(H, g, change, trust)


def _freer(H: Array, g: Array, freedom: slice, trust: float) -> Freer:
    """From H and g, which overstate evidence by trust; `freedom` says where in them it stands."""
    own = np.delete(np.arange(len(H)), freedom)
    both, alone = (np.linalg.pinv(K, hermitian=True) for K in (H, H[np.ix_(own, own)]))
    step = -(both @ g)
    gain = -0.5 * float(g @ step) - 0.5 * float(g[own] @ alone @ g[own])
    less_known = both[np.ix_(own, own)] - alone
    return Freer(less_known, step[own], step[freedom], gain / trust)
