"""measure_motion: Solution → Motion, from its sweep if there is one, else from the moments of alpha."""

import numpy as np
import numpy.typing as npt

from blurmatte.errors import MotionError
from blurmatte.matting.solution import Solution
from blurmatte.motion.picture.error_budget import propagated
from blurmatte.motion.picture.moments import motion_of_alpha
from blurmatte.motion.picture.motion import QUANTITIES, Motion
from blurmatte.sweep.model.path import FROM_REST, LINE
from blurmatte.sweep.sweep import Sweep
from blurmatte.trajectory import Trajectory

Array = npt.NDArray[np.float64]

_INTERVALS = 128  # of the exposure
_OUTLINE_POINTS = 720
_END = 1e-3  # exposures: step of the differences that give the velocity at both ends
_DEPARTURE = 4  # index of the time of departure in the parameters of a path from rest
_N = len(QUANTITIES)


def measure_motion(solution: Solution) -> Motion:
    """Measure the motion of an object during the exposure: position, path length, direction, size.

    The motion comes from the fitted sweep (`Solution.sweep`) if there is one: path, speed over time
    and size, with the errors that noise and the uncertain color cause together. Otherwise it comes
    from the moments of alpha: their sum is the area of the silhouette for any motion, their mean is
    the mean position. For a straight path of length L at constant speed the variance along the path
    is L²/12 larger than across it, if the silhouette is about as long as it is wide.

    A single picture does not determine the direction of time; the motion is given as going to the
    right.

    Parameters
    ----------
    solution : Solution
        From `solve` or `read_solution`.

    Returns
    -------
    Motion

    Raises
    ------
    TypeError
        If it is something else.
    MotionError
        If there is no streak, or the sum of alpha is not above its error.
    """
    if not isinstance(solution, Solution):
        raise TypeError(
            f"solution must be a Solution, got {type(solution).__name__}; use "
            "blurmatte.solve(image, plate) or blurmatte.read_solution(file)"
        )
    if not np.any(solution.streak & solution.known):
        raise MotionError(
            "no pixel of the streak has a known alpha, so that nothing can be measured; solve with "
            "another color, or before another background"
        )
    if solution.sweep is None:
        return motion_of_alpha(solution)
    motion = motion_of_sweep(solution.sweep, solution.stats.get("exposure_time"))
    return motion.reversed if abs(motion.angle) > np.pi / 2 else motion


def motion_of_sweep(sweep: Sweep, exposure_time: float | None) -> Motion:
    """Motion of a fitted sweep; the covariance of its parameters gives the errors."""
    n = len(sweep.path)

    def quantities(parameters: Array) -> Array:
        return _quantities(sweep, parameters[:n], parameters[n:])

    parameters = np.concatenate([sweep.path, sweep.shape])
    values, covariance = propagated(quantities, parameters, sweep.covariance, slice(2, 3))
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
        resting=float(np.clip(sweep.path[_DEPARTURE], 0, 1)) if resting else 0.0,
        resting_std=float(np.sqrt(sweep.covariance[_DEPARTURE, _DEPARTURE])) if resting else 0.0,
        at_border=_leaves_picture(sweep, xy),
        doubts=_doubts(sweep),
        exposure_time=exposure_time,
        sweep=sweep,
    )


def _quantities(sweep: Sweep, path: Array, shape: Array) -> Array:
    """`QUANTITIES`, then the acceleration (2,), then the speeds between moments."""
    t = _times(sweep, path)
    xy, durations = _centers(sweep, path, shape, t), np.diff(t)
    steps = np.linalg.norm(np.diff(xy, axis=0), axis=1)
    center = durations @ (xy[1:] + xy[:-1]) / 2
    chord = xy[-1] - xy[0]
    angle = float(np.arctan2(chord[1], chord[0]))
    normal = np.array([-np.sin(angle), np.cos(angle)])
    across = sweep.silhouette.outline(shape, _OUTLINE_POINTS) @ normal
    first, last = (_velocity(sweep, path, shape, t) for t in (0, 1))
    speeds, area = steps / durations, sweep.silhouette.area(shape)
    size = [np.ptp(across), np.sqrt(area / np.pi), area]
    return np.array([*center, angle, steps.sum(), *size, speeds.max(), *(last - first), *speeds])


def _times(sweep: Sweep, path: Array) -> Array:
    """(T,) moments; one of them is the moment when the velocity jumps, if it does."""
    kink = sweep.family.kink(path)
    if not kink:  # also a departure at time 0
        return np.linspace(0, 1, _INTERVALS + 1)
    half = _INTERVALS // 2 + 1
    return np.concatenate([np.linspace(0, kink, half), np.linspace(kink, 1, half)[1:]])


def _centers(sweep: Sweep, path: Array, shape: Array, t: Array) -> Array:
    """(T, 2) centroids of the silhouette; that of an outline of order 3 or more is off its origin."""
    xy = sweep.family.at(path, t)[0]
    if sweep.silhouette.order < 3:
        return xy
    x, y = sweep.silhouette.outline(shape, _OUTLINE_POINTS).T
    cross = x * np.roll(y, -1) - np.roll(x, -1) * y
    middle = [np.sum((v + np.roll(v, -1)) * cross) / (3 * cross.sum()) for v in (x, y)]
    return np.asarray(xy + sweep.silhouette.map_at(shape, t) @ np.array(middle))


def _velocity(sweep: Sweep, path: Array, shape: Array, t: int) -> Array:
    """(2,) at the first moment (t = 0) or the last (t = 1), pixels per exposure."""
    inward = 1 - 2 * t
    a, b, c = _centers(sweep, path, shape, t + inward * _END * np.arange(3.0))
    return np.asarray(inward * (4 * b - 3 * a - c) / (2 * _END))


def _leaves_picture(sweep: Sweep, xy: Array) -> bool:
    """True if a part of the object lies beyond the picture; pixel 0 covers −0.5 to 0.5."""
    reach = sweep.silhouette.reach(sweep.shape)
    beyond = (xy - reach < -0.5) | (xy + reach > np.array(sweep.size) - 0.5)
    return bool(beyond.any())


def _doubts(sweep: Sweep) -> tuple[str, ...]:
    if not sweep.rejection:
        return ()
    return (
        f"The streak may be of something else, or of several objects: the fit {sweep.rejection}.",
    )
