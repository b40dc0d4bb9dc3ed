"""From errors of what was measured to errors of what follows from it, and which of them matter.

To first order: the covariance of f(x) is J Σ Jᵀ, J by central differences.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

_STEP = 1e-3  # standard deviations: far less than where a function bends


@dataclass(frozen=True, eq=False)
class Source:
    """Numbers that an answer rests on.

    Parameters
    ----------
    values : (n,) float
    covariance : (n, n) float
    """

    values: Array
    covariance: Array

    @classmethod
    def number(cls, value: float, std: float) -> "Source":
        """One number with its standard deviation."""
        return cls(np.array([value], float), np.array([[std**2]], float))


def covariances(
    f: Callable[..., Array], sources: Mapping[str, Source]
) -> tuple[Array, dict[str, Array]]:
    """What f makes of the sources' values, and the covariance that each of them alone gives it.

    Parameters
    ----------
    f : callable
        Of as many arrays as there are sources, in their order; gives an array (m,).
    sources : mapping of str to Source
        Independent of each other.

    Returns
    -------
    value : (m,) float
    parts : dict of str to (m, m) float
    """
    values = [source.values for source in sources.values()]
    value = np.asarray(f(*values), dtype=float)
    parts = {}
    for i, (name, source) in enumerate(sources.items()):
        # Along the axes of the covariance: each step is as small as its own error asks for.
        variances, axes = np.linalg.eigh(source.covariance)
        total = np.zeros((len(value), len(value)))
        for variance, axis in zip(variances, axes.T, strict=True):
            if variance <= 0:
                continue
            d = _STEP * np.sqrt(variance) * axis
            up, down = (f(*values[:i], v, *values[i + 1 :]) for v in (values[i] + d, values[i] - d))
            slope = (np.asarray(up) - np.asarray(down)) / (2 * _STEP)
            total += np.outer(slope, slope)
        parts[name] = total
    return value, parts


def shares(direction: Array, parts: Mapping[str, Array]) -> dict[str, float]:
    """Which share of the variance along a direction (m,) comes from each part, the largest first."""
    variances = {name: float(direction @ part @ direction) for name, part in parts.items()}
    total = sum(variances.values())
    order = sorted(variances.items(), key=lambda pair: -pair[1])
    return {name: variance / total for name, variance in order if total > 0 and variance > 0}
