"""Position and speed of a ball of known size in three dimensions, from one picture of its streak.

`perspective_ball` has the geometry of one position. Boracchi, Caglioti and Giusti first measured a
moving ball this way [Single-image 3D reconstruction of ball velocity and spin from motion blur, VISAPP
2008].
"""

from dataclasses import replace

import numpy as np

from blurmatte.background.guess import with_noise_of_guess
from blurmatte.checks import Array, check_kind, rows_columns
from blurmatte.errors import MotionError
from blurmatte.intrinsics import Intrinsics, check_intrinsics
from blurmatte.motion.picture.error_budget import Source
from blurmatte.motion.space.ball_motion import BallMotion, ball_motion
from blurmatte.motion.space.perspective_ball import PerspectiveBall, at_nodes, positions_of_discs
from blurmatte.radiometry import LinearImage, check_picture
from blurmatte.streaks import Streak
from blurmatte.sweep.assess.diagnostics import diagnosed
from blurmatte.sweep.fit.levenberg_marquardt import minimize
from blurmatte.sweep.fit.multistart import NODES_PER_RADIUS, with_principal_axes
from blurmatte.sweep.fit.ranking import Candidate, best_of, residual_excess
from blurmatte.sweep.fit_sweep import fit_sweep
from blurmatte.sweep.model.color_field import ColorPrior
from blurmatte.sweep.model.observation import Observation, observation_around
from blurmatte.sweep.model.path import LINE, PARABOLA, Polynomial
from blurmatte.sweep.model.state import State, state_at
from blurmatte.sweep.model.student_t import VARIANCE
from blurmatte.sweep.sweep import MAX_RESIDUAL_EXCESS, Sweep

# The fit of a ball, which starts at a sweep.
_MARGIN = 0.5  # radii around the sweep, by which it may be wrong
_MAX_RADIUS_PX = 40.0  # on finer pixels the fit gains no information
_RADIUS_BOUNDS = (0.5, 2.0)  # of the sweep's radius
_MAX_ROUNDS = 3  # of the usual number of steps: the start may be far off
_MIN_GAIN = 2.0  # expected log likelihood for each parameter of the acceleration


def measure_ball(
    sweep: Sweep,
    intrinsics: Intrinsics,
    radius: float,
    exposure_time: float | None = None,
    radius_std: float = 0.0,
    exposure_std: float = 0.0,
) -> BallMotion:
    """Position and speed of a ball in three dimensions, from the disc that was fitted to its streak.

    The disc has a constant radius, so the distance of the ball is assumed constant, and its speed
    along the line of sight is not measured; `fit_ball` measures it from the pictures.

    Parameters
    ----------
    sweep : Sweep
        Of the ball; from `fit_sweep`, or `Solution.sweep`.
    intrinsics : Intrinsics
        Of the camera.
    radius : float
        Of the ball, meters.
    exposure_time : float, optional
        Seconds; without it there is no speed.
    radius_std, exposure_std : float
        Standard deviations of the two.

    Raises
    ------
    TypeError, ValueError
        For something else, or a number out of its range.
    MotionError
        If the sweep does not explain the streak, or lies where the distortion has no inverse.

    Examples
    --------
    >>> lens = bm.Intrinsics.from_focal_length(28, image.size, sensor_width=36)
    >>> ball = bm.motion.measure_ball(sweep, lens, radius=0.02, radius_std=0.0005)
    >>> print(f"{ball.length:.3f} ± {ball.length_std:.3f} m; mostly from the {ball.dominant}")
    0.122 ± 0.003 m; mostly from the radius
    """
    check_intrinsics("intrinsics", intrinsics)
    check_kind("sweep", sweep, Sweep, "use blurmatte.sweep.fit_sweep(image, plate)")
    intrinsics.check_size(sweep.size)
    _check_accepted(sweep, "the sweep does not explain the streak")
    n = len(sweep.path)

    def nodes(parameters: Array, values: Array) -> Array:
        """Positions at begin, middle and end for a radius of 1."""
        centers, _ = sweep.family.at(parameters[:n], np.array([0, 0.5, 1]))
        size = sweep.silhouette.radius(parameters[n:])
        return positions_of_discs(intrinsics.with_values(values), centers, size)

    picture = Source(np.concatenate([sweep.path, sweep.shape]), sweep.covariance)
    return ball_motion(
        nodes, picture, intrinsics, (radius, radius_std), (exposure_time, exposure_std), "disc"
    )


def fit_ball(
    image: LinearImage,
    plate: LinearImage,
    intrinsics: Intrinsics,
    radius: float,
    exposure_time: float | None = None,
    radius_std: float = 0.0,
    exposure_std: float = 0.0,
    sweep: Sweep | None = None,
) -> BallMotion:
    """Position and speed of a ball in three dimensions, fitted to the pictures.

    Like `fit_sweep`, but the silhouette is the perspective image of a sphere that moves through space:
    an ellipse that grows as it approaches. Its path is straight at constant speed, or has a constant
    acceleration if a score test finds it significant. The color is fitted too.

    Parameters
    ----------
    image, plate : LinearImage
        With the ball, and without; same size.
    intrinsics, radius, exposure_time, radius_std, exposure_std
        As in `measure_ball`.
    sweep : Sweep, optional
        The start, with the rank of the color; found by `fit_sweep` if not given.

    Raises
    ------
    ColorModelError, ValueError
        As `fit_sweep`.
    MotionError
        If nothing moved, or no such ball explains the streak.

    Examples
    --------
    >>> lens = bm.Intrinsics.from_focal_length(28, image.size, sensor_width=36)
    >>> ball = bm.motion.fit_ball(image, plate, lens, radius=0.02, exposure_time=1 / 60)
    >>> print(f"{ball.speed:.2f} ± {ball.speed_std:.2f} m/s")
    7.12 ± 0.01 m/s
    """
    check_picture("image", image)
    check_intrinsics("intrinsics", intrinsics)
    check_kind("sweep", sweep, Sweep | None, "use blurmatte.sweep.fit_sweep(image, plate)")
    intrinsics.check_size(image.size)
    image, plate = with_noise_of_guess(image, plate)
    if sweep is None:
        sweep = fit_sweep(image, plate)
    best = _best_fit(intrinsics, sweep, image, plate)
    picture, family, n = _accepted(best, sweep), best.family, len(best.path)

    def nodes(parameters: Array, values: Array) -> Array:
        """Positions at begin, middle and end for a radius of 1."""
        X, _ = at_nodes(intrinsics.with_values(values), parameters[:n], parameters[n:])
        assert isinstance(family, Polynomial)
        return np.asarray(family.weights(np.array([0, 0.5, 1])) @ X)

    sizes, times = (radius, radius_std), (exposure_time, exposure_std)
    return ball_motion(nodes, picture, intrinsics, sizes, times, family.name)


def _accepted(best: State, sweep: Sweep) -> Source:
    """The parameters of a fit from a sweep, and their covariance; MotionError if it is rejected."""
    covariance = best.variance_inflation * VARIANCE * best.inverse_curvature()
    radius_std = float(covariance[len(best.path), len(best.path)] ** 0.5)
    found = diagnosed(Candidate(best), best.radius, radius_std, 0.0)
    what = "no ball on a straight line or with constant acceleration explains the streak"
    _check_accepted(replace(sweep, diagnostics=found), what)
    return Source(np.concatenate([best.path, best.shape]), covariance)


def _check_accepted(sweep: Sweep, what: str) -> None:
    """Raise MotionError if the sweep is rejected."""
    if sweep.rejection:
        raise MotionError(f"{what}: the fit {sweep.rejection}; give a ball alone in its streak")


def _best_fit(
    intrinsics: Intrinsics, sweep: Sweep, image: LinearImage, plate: LinearImage
) -> State:
    """The fit with a line, or with a parabola if that is needed and better."""
    data, ball = _observation(intrinsics, sweep, image, plate)
    best = _fitted(_start(data, ball, sweep, LINE), sweep)
    if residual_excess(best) > MAX_RESIDUAL_EXCESS or _accelerates(ball, best):
        bent = _fitted(_start(data, ball, sweep, PARABOLA), sweep)
        best = best_of([best, bent])
    return best


def _fitted(state: State, sweep: Sweep) -> State:
    """The minimum near a start."""
    low, high = _RADIUS_BOUNDS
    for _ in range(_MAX_ROUNDS):
        state = minimize(state, (low * sweep.radius, high * sweep.radius))
        if state.converged:
            break
    return state


def _observation(
    intrinsics: Intrinsics, sweep: Sweep, image: LinearImage, plate: LinearImage
) -> tuple[Observation, PerspectiveBall]:
    """The pixels around a sweep, and the image of a ball in them."""
    seen = np.zeros((sweep.size[1], sweep.size[0]), dtype=bool)
    seen[rows_columns(sweep.box)] = sweep.within(sweep.box)[0] > 0
    streak = Streak(seen)
    color = ColorPrior(np.eye(3), varied=sweep.model.rank)
    margin = int(_MARGIN * sweep.radius) + 4
    data = observation_around(streak, margin, image, plate, color)
    data = replace(data, grain=sweep.radius / NODES_PER_RADIUS)
    data = data.coarse_enough(sweep.radius, _MAX_RADIUS_PX)
    ball = PerspectiveBall.in_observation(intrinsics, data)
    known = np.isfinite(ball.slopes.sum(axis=(-1, -2)))
    if not np.all(known[data.streak]):
        raise MotionError(
            "the streak leaves the part of the picture in which the camera's distortion can be undone; "
            "give intrinsics that were calibrated up to there"
        )
    return replace(data, weight=np.where(known, data.weight, 0)), ball


def _start(data: Observation, ball: PerspectiveBall, sweep: Sweep, family: Polynomial) -> State:
    """The ball that looks like the sweep, at constant distance from the camera."""
    centers = family.starts(sweep.trajectory.at(np.linspace(0, 1, 33)))[0].reshape(-1, 2)
    X = positions_of_discs(ball.intrinsics, centers, sweep.radius)
    pixels = ball.intrinsics.project(X)
    radii = ball.intrinsics.magnification(pixels) / np.linalg.norm(X, axis=1)
    ball = replace(ball, degree=family.degree)
    shape = np.array([np.exp(np.log(radii).mean()), *np.zeros(family.degree)])
    return with_principal_axes(state_at(data, family, pixels.ravel(), ball, shape))


def _accelerates(ball: PerspectiveBall, line: State) -> bool:
    """True if a parabola may fit better: Rao's score test of the three added parameters."""
    X, _ = at_nodes(ball.intrinsics, line.path, line.shape)
    middle = X.mean(axis=0, keepdims=True)
    pixel = ball.intrinsics.project(middle)
    radius = ball.intrinsics.magnification(pixel) / np.linalg.norm(middle)
    path = np.concatenate([line.path[:2], pixel[0], line.path[2:]])
    shape = np.array([*line.shape, np.log(radius[0] / line.shape[0])])
    bent = state_at(line.observation, PARABOLA, path, replace(ball, degree=2), shape)
    H, g = bent.information()
    gain = float(g @ np.linalg.pinv(H, hermitian=True) @ g) / 2
    return gain / line.variance_inflation > _MIN_GAIN * (bent.size - line.size)
