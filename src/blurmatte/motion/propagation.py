"""Errors of what follows from parameters: the covariance through numerical derivatives."""

from collections.abc import Callable

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

_STEP = 1e-3  # of a standard deviation: small beside what bends, large beside rounding


def propagated(
    function: Callable[[Array], Array],
    parameters: Array,
    covariance: Array,
    angles: slice = slice(0),
) -> tuple[Array, Array]:
    """Values (n,) of a function of parameters (m,), and their covariance (n, n).

    Parameters
    ----------
    function : callable
        From (m,) to (n,).
    parameters, covariance : (m,), (m, m) float
    angles : slice
        Which of the values are angles, whose differences are taken around the circle.
    """
    values = function(parameters)
    steps = _STEP * np.sqrt(np.maximum(np.diag(covariance), 0)) + 1e-9
    J = np.empty((len(values), len(parameters)))
    for i, step in enumerate(steps):
        shift = np.zeros(len(parameters))
        shift[i] = step
        change = function(parameters + shift) - function(parameters - shift)
        change[angles] = np.angle(np.exp(1j * change[angles]))
        J[:, i] = change / (2 * step)
    return values, J @ covariance @ J.T
