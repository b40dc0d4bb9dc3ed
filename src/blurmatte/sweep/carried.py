"""What a disc carries along, at an offset from its center and soft: its shadow, or its highlight.

Both are told alike: by where they are and how soft, in radii of the disc, as (3,) x: the offset (x, y)
and the logarithm of the softness, a standard deviation.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from blurmatte.sweep.data import Data
from blurmatte.sweep.descent import State
from blurmatte.sweep.path import PathFamily

Array = npt.NDArray[np.float64]

RADIUS = 6.0  # pixels of a disc, enough to tell what it carries
DIFFERENCE = 0.02  # of a radius, for derivatives
_MOMENTS, _STEP = (33, 257), 1.0  # least and most; pixels from one to the next
_DIRECTIONS = 8  # where it is looked for first
_DOUBT = 2.5  # standard deviations, from where on something else is seen
_TRIES = 20


def placed(
    left: Callable[[Array], Array],
    start: Array | None,
    distances: tuple[float, ...],
    farthest: float,
    softness: tuple[float, float, float],
    slopes: Callable[[Array], Array] | Literal["2-point"] = "2-point",
) -> Array:
    """(3,) x that leaves least.

    Parameters
    ----------
    left : function
        Of x: (n,) what it leaves, in standard deviations.
    start : (3,) float, optional
        To begin with; if not given, the best of some at these distances.
    distances : tuple of float
        From the center, radii.
    farthest : float
        Most of an offset along x or y, radii.
    softness : (float, float, float)
        Least, at first, and most, radii.
    slopes : function, optional
        Of x: (n, 3) derivatives of what it leaves.
    """
    from scipy.optimize import least_squares

    def doubted(x: Array) -> float:
        return float(np.sum(np.log1p((left(x) / _DOUBT) ** 2)))

    least, first, most = np.log(softness)
    if start is None:
        turns = np.linspace(0, 2 * np.pi, _DIRECTIONS, endpoint=False)
        start = min(
            (np.array([d * np.cos(a), d * np.sin(a), first]) for d in distances for a in turns),
            key=doubted,
        )
    bounds = (-farthest, -farthest, least), (farthest, farthest, most)
    end = least_squares(
        left, np.clip(start, *bounds), slopes, bounds,
        loss="cauchy", f_scale=_DOUBT, max_nfev=_TRIES,
    )  # fmt: skip
    return np.asarray(end.x)


def place_of(carried: Any, radius: float) -> Array | None:
    """(3,) x of what a disc of a radius, pixels, carries; None of nothing."""
    if carried is None:
        return None
    return np.array([*carried.offset / radius, np.log(carried.softness / radius)])


def centers_of(family: PathFamily, path: Array, data: Data) -> Array:
    """(T, 2) where something that goes along a path was at even times, in the pixels of data."""
    way = np.linalg.norm(np.diff(family.at(path, np.linspace(0, 1, 33))[0], axis=0), axis=1)
    count = int(np.clip(way.sum() / (_STEP * data.scale), *_MOMENTS))
    moments = (np.arange(count) + 0.5) / count
    return np.asarray((family.at(path, moments)[0] - np.array(data.origin)) / data.scale)


def slopes_of(data: Data, state: State, carried: Any) -> Array:
    """(h, w, 3) derivatives of what a disc carries by its offset and the log of its softness."""
    step = DIFFERENCE * float(state.shape[0])
    x, y, soft = np.array([step, 0]), np.array([0, step]), np.exp(DIFFERENCE)
    ways = [
        (
            replace(carried, offset=carried.offset + d),
            replace(carried, offset=carried.offset - d),
            step,
        )
        for d in (x, y)
    ]
    softer = replace(carried, softness=carried.softness * soft)
    harder = replace(carried, softness=carried.softness / soft)
    ways.append((softer, harder, DIFFERENCE))
    return np.stack(
        [(a.of(data, state) - b.of(data, state)) / (2 * h) for a, b, h in ways], axis=-1
    )
