"""Where a ball of known size flew in space, from one picture of its streak.

A sphere of radius R whose center is X is seen in the rays that are no farther than ρ from X, sin ρ =
R/|X|. A pinhole sees this cone as an ellipse. If X is θ off the axis, and q = cos²θ − sin²ρ, then its
center lies at sin θ cos θ / q on the plane z = 1, farther out than the center of the sphere, and its
half axes are sin ρ cos ρ / q away from the axis and sin ρ / √q across [Hartley & Zisserman, Multiple
View Geometry, 8.3: outlines of quadrics]. Given the ellipse, that is solved for X. What a moving ball
leaves, Boracchi, Caglioti and Giusti took apart first [Single-image 3D reconstruction of ball
velocity and spin from motion blur, VISAPP 2008].

All in units of R: the picture alone tells X/R, and R only its scale.
"""

from dataclasses import replace

import numpy as np
import numpy.typing as npt

from blurmatte.checks import check_kind
from blurmatte.errors import MotionError
from blurmatte.intrinsics import Intrinsics, check_intrinsics
from blurmatte.motion.ball_motion import BallMotion, ball_motion
from blurmatte.motion.seen_ball import SeenBall, at_nodes
from blurmatte.motion.sources import Source
from blurmatte.radiometry import LinearImage, check_picture, with_noise
from blurmatte.streaks import Streak
from blurmatte.sweep import Sweep, fit_sweep
from blurmatte.sweep.assess.diagnostics import diagnosed
from blurmatte.sweep.fit.candidate import Candidate
from blurmatte.sweep.fit.levenberg_marquardt import minimize
from blurmatte.sweep.fit.multistart import NODES_PER_RADIUS, with_principal_axes
from blurmatte.sweep.fit.ranking import best_of
from blurmatte.sweep.model.color_prior import ColorPrior
from blurmatte.sweep.model.observation import Observation, observation_around
from blurmatte.sweep.model.path import LINE, PARABOLA, Polynomial
from blurmatte.sweep.model.residuals import residual_excess, variance_inflation
from blurmatte.sweep.model.state import State, state_at
from blurmatte.sweep.model.student_t import VARIANCE
from blurmatte.sweep.sweep import MAX_RESIDUAL_EXCESS

Array = npt.NDArray[np.float64]

_MARGIN = 0.5  # of the radius, around the sweep: it may be wrong by that
_FINE_RADIUS = 40.0  # pixels: more of them tell nothing new
_ROUND = 20  # steps of a fixed point that gains four digits in each
_WORTH = 2.0  # units of log likelihood that a parameter must gain to be tried
_ROUNDS = 3
_BOUNDS = 0.5, 2.0  # of the sweep's radius


def measure_ball(
    sweep: Sweep,
    intrinsics: Intrinsics,
    radius: float,
    exposure_time: float | None = None,
    radius_std: float = 0.0,
    exposure_std: float = 0.0,
) -> BallMotion:
    """Where a ball was in space and how fast it went, from the disc on a path that it looks like.

    The disc has one radius, so this takes the ball to have kept its distance, and knows nothing of
    speed along the line of sight; `fit_ball` measures that from the pictures.

    Parameters
    ----------
    sweep : Sweep
        Of the ball; `fit_sweep`, or `Solution.sweep`.
    intrinsics : Intrinsics
        Of the camera.
    radius : float
        Of the ball, meters.
    exposure_time : float, optional
        Seconds; without it there is no speed, but all else.
    radius_std, exposure_std : float
        Standard deviations of the two.

    Returns
    -------
    BallMotion

    Raises
    ------
    TypeError, ValueError
        For something else, or a number out of its range.
    MotionError
        If the sweep explains no streak, or lies where the camera's model says nothing.
    """
    check_intrinsics("intrinsics", intrinsics)
    if not isinstance(sweep, Sweep):
        raise TypeError(f"sweep must be a Sweep, got {type(sweep).__name__}; use fit_sweep")
    intrinsics.check_size(sweep.size)
    _check_explained(sweep, "the sweep does not explain the streak")
    n = len(sweep.path)

    def nodes(parameters: Array, values: Array) -> Array:
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
    """Where a ball was in space and how fast it went, fitted to the pictures in three dimensions.

    Like `fit_sweep`, but the outline is that of a sphere that the camera sees on its way through
    space: an ellipse, growing as it comes nearer. It flies straight at constant speed, or with a
    constant acceleration if the streak says so clearly. The color is fitted along.

    Parameters
    ----------
    image, plate : LinearImage
        With the ball, and without; same size.
    intrinsics, radius, exposure_time, radius_std, exposure_std
        As `measure_ball` has them.
    sweep : Sweep, optional
        Where to begin, and of one color, two or any; found by `fit_sweep` if not given.

    Returns
    -------
    BallMotion

    Raises
    ------
    ColorModelError, ValueError
        As `fit_sweep`.
    MotionError
        If nothing moved, or no ball that flew like this explains the streak.
    """
    check_picture("image", image)
    check_intrinsics("intrinsics", intrinsics)
    check_kind("sweep", sweep, Sweep | None, "use blurmatte.fit_sweep(image, plate)")
    intrinsics.check_size(image.size)
    image, plate = with_noise(image, plate)
    if sweep is None:
        sweep = fit_sweep(image, plate)
    data, ball = _before(intrinsics, sweep, image, plate)
    best = _fitted(_start(data, ball, sweep, LINE), sweep)
    if residual_excess(best) > MAX_RESIDUAL_EXCESS or _would_bend(ball, best):
        bent = _fitted(_start(data, ball, sweep, PARABOLA), sweep)
        best = best_of([best, bent])
    n = len(best.path)
    H, _ = best.information()
    covariance = np.linalg.pinv(H, hermitian=True) * variance_inflation(best) * VARIANCE
    picture = Source(np.concatenate([best.path, best.shape]), np.asarray(covariance))
    found = diagnosed(Candidate(best), float(best.shape[0]), float(covariance[n, n] ** 0.5), 0.0)
    _check_explained(
        replace(sweep, diagnostics=found),
        "no ball that flew straight, or like thrown, explains the streak",
    )

    def nodes(parameters: Array, values: Array) -> Array:
        X, _ = at_nodes(intrinsics.with_values(values), parameters[:n], parameters[n:])
        assert isinstance(best.family, Polynomial)
        return np.asarray(best.family.weights(np.array([0, 0.5, 1])) @ X)

    return ball_motion(
        nodes,
        picture,
        intrinsics,
        (radius, radius_std),
        (exposure_time, exposure_std),
        best.family.name,
    )


def positions_of_discs(intrinsics: Intrinsics, centers: Array, radius: float) -> Array:
    """(k, 3) where balls are that look like discs of a radius around `centers` (k, 2) pixels; in radii.

    The disc stands for the ellipse of the same center and area. With m the distance of that center
    from the axis and b, a its half axes, all on the plane z = 1,

        a² = b² (1 + m²/(1 + b²)),    q = (1 + b²)/(m² + (1 + b²)²),    sin²ρ = b² q,

    and cos²θ = q (1 + b²).
    """
    m = intrinsics.undistort(centers)
    m2 = (m**2).sum(axis=-1)
    # A radian takes `magnification` pixels; on the plane z = 1 it is (1 + m²)^(3/4) long.
    square = (radius / intrinsics.magnification(centers)) ** 2 * (1 + m2) ** 1.5  # a b
    b2 = square
    for _ in range(_ROUND):
        b2 = square / np.sqrt(1 + m2 / (1 + b2))
    q = (1 + b2) / (m2 + (1 + b2) ** 2)
    distance = (b2 * q) ** -0.5
    cosine = np.sqrt(np.minimum(q * (1 + b2), 1))
    # The center of the ball is seen nearer to the axis than that of its picture.
    tangent = np.sqrt(1 - cosine**2) / cosine
    factor = np.where(m2 > 0, tangent / np.sqrt(np.maximum(m2, 1e-300)), 1)
    ray = np.concatenate([m * factor[..., None], np.ones_like(m[..., :1])], axis=-1)
    return np.asarray(ray * (distance * cosine)[..., None])


def _check_explained(sweep: Sweep, what: str) -> None:
    """MotionError if the sweep is rejected."""
    if sweep.rejection:
        raise MotionError(f"{what}: the fit {sweep.rejection}; give a ball alone in its streak")


def _fitted(state: State, sweep: Sweep) -> State:
    """Where a fit ends, though it takes more steps than others, for the start may be far off."""
    for _ in range(_ROUNDS):
        state = minimize(state, (_BOUNDS[0] * sweep.radius, _BOUNDS[1] * sweep.radius))
        if state.converged:
            break
    return state


def _before(
    intrinsics: Intrinsics, sweep: Sweep, image: LinearImage, plate: LinearImage
) -> tuple[Observation, SeenBall]:
    """The pixels around a sweep, and the ball that the camera may see in them."""
    x0, y0, x1, y1 = sweep.box
    seen = np.zeros((sweep.size[1], sweep.size[0]), dtype=bool)
    seen[y0:y1, x0:x1] = sweep.within(sweep.box)[0] > 0
    streak = Streak(seen)
    color = ColorPrior(np.eye(3), varied=sweep.model.rank)
    data = observation_around(streak, int(_MARGIN * sweep.radius) + 4, image, plate, color)
    data = replace(data, grain=sweep.radius / NODES_PER_RADIUS)
    data = data.coarse_enough(sweep.radius, _FINE_RADIUS)
    ball = SeenBall.before(intrinsics, data)
    known = np.isfinite(ball.slopes.sum(axis=(-1, -2)))
    if not np.all(known[data.streak]):
        raise MotionError(
            "the streak leaves the part of the picture in which the camera's distortion can be undone; "
            "give intrinsics that were calibrated up to there"
        )
    return replace(data, weight=np.where(known, data.weight, 0)), ball


def _start(data: Observation, ball: SeenBall, sweep: Sweep, family: Polynomial) -> State:
    """The ball that looks like the sweep, at constant distance from the camera."""
    centers = family.starts(sweep.trajectory.at(np.linspace(0, 1, 33)))[0].reshape(-1, 2)
    X = positions_of_discs(ball.intrinsics, centers, sweep.radius)
    pixels = ball.intrinsics.project(X)
    radii = ball.intrinsics.magnification(pixels) / np.linalg.norm(X, axis=1)
    shape = np.array([np.exp(np.log(radii).mean()), *np.zeros(family.degree)])
    return with_principal_axes(state_at(data, family, pixels.ravel(), ball, shape))


def _would_bend(ball: SeenBall, line: State) -> bool:
    """Whether acceleration could explain clearly more: Rao's score test of its three parameters."""
    X, _ = at_nodes(ball.intrinsics, line.path, line.shape)
    middle = X.mean(axis=0, keepdims=True)
    pixel = ball.intrinsics.project(middle)
    radius = ball.intrinsics.magnification(pixel) / np.linalg.norm(middle)
    path = np.concatenate([line.path[:2], pixel[0], line.path[2:]])
    shape = np.array([*line.shape, np.log(radius[0] / line.shape[0])])
    bent = state_at(line.observation, PARABOLA, path, ball, shape)
    H, g = bent.information()
    gain = float(g @ np.linalg.pinv(H, hermitian=True) @ g) / 2
    return gain / variance_inflation(line) > _WORTH * (bent.size - line.size)
