"""Motion from a Sweep: everything follows from its parameters, and so do the errors."""

import numpy as np
import numpy.typing as npt

from blurmatte.motion.motion import QUANTITIES, Motion
from blurmatte.motion.propagation import propagated
from blurmatte.sweep import Sweep
from blurmatte.sweep.model.path import FROM_REST, LINE
from blurmatte.trajectory import Trajectory

Array = npt.NDArray[np.float64]

_STEPS = 128  # of the exposure
_RIM = 720  # points around the silhouette
_END = 1e-3  # of the exposure: over which the velocity at its ends is taken
_REST = 4  # which parameter of a path from rest is the time of its departure
_HALF = 0.5
_N = len(QUANTITIES)


def motion_of_sweep(sweep: Sweep, exposure_time: float | None) -> Motion:
    """All that path and silhouette say, through the covariance of their parameters."""
    n = len(sweep.path)

    def told(parameters: Array) -> Array:
        return _told(sweep, parameters[:n], parameters[n:])

    parameters = np.concatenate([sweep.path, sweep.shape])
    values, covariance = propagated(told, parameters, sweep.covariance, slice(2, 3))
    bends = sweep.family not in (LINE, FROM_REST)
    t = _times(sweep, sweep.path)
    xy = _centers(sweep, sweep.path, sweep.shape, t)
    resting = sweep.family is FROM_REST
    return Motion(
        trajectory=Trajectory(xy, t),
        values=values[:_N],
        covariance=covariance[:_N, :_N],
        speeds=values[_N + 2 :],
        speeds_std=np.sqrt(np.maximum(np.diag(covariance)[_N + 2 :], 0)),
        source="sweep",
        path=sweep.family.name,
        silhouette=sweep.silhouette.name,
        size=sweep.size,
        acceleration=values[_N : _N + 2] if bends else None,
        acceleration_covariance=covariance[_N : _N + 2, _N : _N + 2] if bends else None,
        resting=float(np.clip(sweep.path[_REST], 0, 1)) if resting else 0.0,
        resting_std=float(np.sqrt(sweep.covariance[_REST, _REST])) if resting else 0.0,
        at_border=_leaves(sweep, xy),
        doubts=tuple(_doubts(sweep)),
        exposure_time=exposure_time,
        sweep=sweep,
    )


def _told(sweep: Sweep, path: Array, shape: Array) -> Array:
    """`QUANTITIES`, then the acceleration (2,), then the speeds between moments."""
    t = _times(sweep, path)
    xy, lasting = _centers(sweep, path, shape, t), np.diff(t)
    steps = np.linalg.norm(np.diff(xy, axis=0), axis=1)
    center = lasting @ (xy[1:] + xy[:-1]) / 2
    chord = xy[-1] - xy[0]
    angle = float(np.arctan2(chord[1], chord[0]))
    across = sweep.silhouette.outline(shape, _RIM) @ np.array([-np.sin(angle), np.cos(angle)])
    first, last = (_velocity(sweep, path, shape, t) for t in (0, 1))
    speeds, area = steps / lasting, sweep.silhouette.area(shape)
    return np.array(
        [
            *center,
            angle,
            steps.sum(),
            np.ptp(across),
            np.sqrt(area / np.pi),
            area,
            speeds.max(),
            *(last - first),
            *speeds,
        ]
    )


def _times(sweep: Sweep, path: Array) -> Array:
    """(T,) moments, one of them when the velocity jumps if it does."""
    kink = sweep.family.kink(path)
    if not kink:  # also a departure at once
        return np.linspace(0, 1, _STEPS + 1)
    before, after = np.linspace(0, kink, _STEPS // 2 + 1), np.linspace(kink, 1, _STEPS // 2 + 1)
    return np.concatenate([before, after[1:]])


def _centers(sweep: Sweep, path: Array, shape: Array, t: Array) -> Array:
    """(T, 2) where the middle of the silhouette's area is; that of an outline is beside its origin."""
    xy = sweep.family.at(path, t)[0]
    if sweep.silhouette.order < 3:
        return xy
    x, y = sweep.silhouette.outline(shape, _RIM).T
    cross = x * np.roll(y, -1) - np.roll(x, -1) * y
    middle = [np.sum((v + np.roll(v, -1)) * cross) / (3 * cross.sum()) for v in (x, y)]
    return np.asarray(xy + sweep.silhouette.map_at(shape, t) @ np.array(middle))


def _velocity(sweep: Sweep, path: Array, shape: Array, t: int) -> Array:
    """(2,) at the first moment or the last, pixels per exposure."""
    inward = 1 - 2 * t
    a, b, c = _centers(sweep, path, shape, t + inward * _END * np.arange(3.0))
    return np.asarray(inward * (4 * b - 3 * a - c) / (2 * _END))


def _leaves(sweep: Sweep, xy: Array) -> bool:
    """Whether any of it lies beyond the picture."""
    reach = sweep.silhouette.reach(sweep.shape)
    beyond = (xy - reach < -_HALF) | (xy + reach > np.array(sweep.size) - _HALF)
    return bool(beyond.any())


def _doubts(sweep: Sweep) -> list[str]:
    if not sweep.rejection:
        return []
    return [
        f"The streak may be of something else, or of several things: the fit {sweep.rejection}."
    ]
