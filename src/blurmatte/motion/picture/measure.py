"""Solution → Motion, from its sweep or else from moments of alpha; and its first and last silhouette.

A silhouette of area A that moves straight for a length L at constant speed has Σα = A. The variance
of alpha is V across the path and L²/12 + V along it, if the silhouette is about as long as it is wide;
V = r²/4 for a disc. The square pixels add 1/12 to both. No color is needed.

These sums are linear in alpha, or ratios of such sums. An error δα of a pixel at x changes the mean by
(x − mean) δα / Σα, and the covariance by ((x − mean)(x − mean)ᵀ − covariance) δα / Σα.

For a straight path v at constant speed α(x) = ∫ χ(x − v t) dt, t from 0 to 1. Its derivative along v is

    v·∇α = χ_first − χ_last,

because the integral telescopes. It is positive where the object was only at the beginning of the
exposure, and negative where it was only at the end. Where both silhouettes overlap it is 0. A single
picture does not determine which of the two was first.

The derivative multiplies noise by the length, so it is taken over a Gaussian neighborhood of standard
deviation s. Pixels of standard deviation σ whose errors are correlated over a length l (n = 4πl² of
them have a common error) give it the variance σ²(4πl² + 1) / (8π (s² + l²)²).
"""

from dataclasses import dataclass, replace

import numpy as np
import scipy

from blurmatte.checks import Array, Bools, Direction, check_kind
from blurmatte.errors import MotionError
from blurmatte.matting.solution import Solution, check_solution
from blurmatte.motion.picture.error_budget import propagated
from blurmatte.motion.picture.motion import MOMENTS, QUANTITIES, SWEEP, Motion
from blurmatte.radiometry import LinearImage
from blurmatte.statistics import UNIFORM_VARIANCE, UNKNOWN_FRACTION, chi_square_quantile
from blurmatte.sweep.model.path import FROM_REST, LINE
from blurmatte.sweep.model.shape import OUTLINE_POINTS
from blurmatte.sweep.sweep import Sweep
from blurmatte.trajectory import Trajectory

_INTERVALS = 128  # of the exposure
_END = 1e-3  # exposures: step of the differences that give the velocity at both ends
_DEPARTURE = 4  # index of the time of departure in the parameters of a path from rest
_N = len(QUANTITIES)
# Indices of what is no length, speed or change of speed
_PLACE_AND_SIZE = [
    QUANTITIES.index(one) for one in QUANTITIES if one not in ("length", "top_speed")
]
_OTHER = (
    "The streak may be of something else or of several objects, or the plate differs: the fit {}."
)
_CUT_BY_REGION = (
    "The shape reaches beyond the region, which may cut the object: the guessed plate then shows its "
    "rest; solve with a region that holds all of it."
)
_OPEN_BRIGHTNESS = (
    "It only adds light, and a change of its brightness looks like one of its speed: the errors of "
    "place and speed contain both, and its path may begin and end where it was too faint to be seen."
)


# When alpha counts as present, and when a motion from moments gets a doubt.
_MIN_SUM_STD = 3.0  # standard deviations: a smaller sum of alpha may be noise
_MAX_WIDTH = 1.5  # diameters of the disc of its area: a straight path is not wider
_MAX_UNKNOWN_FRACTION = 0.02  # of the streak's pixels
_PART_SMOOTHING_PX = 2.0  # standard deviation of the Gaussian before parts are labeled
_MIN_PART_ALPHA = 0.15  # of the largest smoothed alpha
_MIN_PART_FRACTION = 0.05  # of the sum of alpha: a smaller part is noise
_EVEN = 0.999  # probability of a smaller distance from the fitted place, of an even source
# Width of the Gaussian over which the derivative of alpha is taken.
_SCALES_PX = (1.0, 1.5, 2.2, 3.3, 5.0)  # tried in this order
_MAX_STD = 0.15  # median error of the change that separates 0 from 1 in most pixels
_MAX_SCALE = 0.35  # radii: a wider Gaussian blurs the silhouette itself


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

    Raises
    ------
    TypeError
        If it is something else.
    MotionError
        If there is no streak, or the sum of alpha is less than three times its error.

    Examples
    --------
    >>> motion = bm.measure_motion(solution)
    >>> print(motion)
    Motion(around (58.95, 37.02), 59.60 ± 0.21 px at -13.57 ± 0.08°, radius 10.01 ± 0.021 px, from
    its sweep)
    >>> print(f"{motion.length:.1f} ± {motion.length_std:.1f} pixels; true: {path.length:.1f}")
    59.6 ± 0.2 pixels; true: 59.7
    """
    check_solution("solution", solution)
    if not np.any(solution.streak & solution.known):
        raise MotionError(
            "no pixel of the streak has a known alpha, so that nothing can be measured; solve with "
            "another color, or before another background"
        )
    if solution.sweep is None:
        return motion_of_alpha(solution)
    known = solution.stats.exposure_time, solution.stats.readout
    motion = motion_of_sweep(solution.sweep, *known)
    if solution.stats.leaves_region:
        motion = replace(motion, doubts=(*motion.doubts, _CUT_BY_REGION))
    if solution.stats.only_adds_light:
        motion = _of_any_brightness(motion, solution)
    return motion.reversed if abs(motion.angle) > np.pi / 2 else motion


def motion_of_sweep(
    sweep: Sweep, exposure_time: float | None, readout: Direction = "down"
) -> Motion:
    """Motion of a fitted sweep; the covariance of its parameters gives the errors."""
    n = len(sweep.path)

    def quantities(parameters: Array) -> Array:
        """The measured quantities as a function of the parameters."""
        return _quantities_of_sweep(sweep, parameters[:n], parameters[n:])

    parameters = np.concatenate([sweep.path, sweep.shape])
    values, covariance = propagated(quantities, parameters, sweep.covariance, slice(2, 3))
    if _is_unresolved(sweep):
        motion = values.copy()
        motion[_PLACE_AND_SIZE] = 0
        covariance += np.outer(motion, motion)
    bends = sweep.family not in (LINE, FROM_REST)
    t = _times(sweep, sweep.path)
    xy = _centers(sweep, sweep.path, sweep.shape, t)
    resting = sweep.family is FROM_REST
    family = LINE if resting and not sweep.family.kink(sweep.path) else sweep.family
    return Motion(
        trajectory=Trajectory(xy, t),
        values=values[:_N],
        covariance=covariance[:_N, :_N],
        speeds=values[_N + 2 :],
        speeds_std=np.sqrt(np.maximum(np.diag(covariance)[_N + 2 :], 0)),
        source=SWEEP,
        path=family.name,
        silhouette=sweep.silhouette.name,
        size=sweep.size,
        acceleration=values[_N : _N + 2] if bends else None,
        acceleration_covariance=covariance[_N : _N + 2, _N : _N + 2] if bends else None,
        resting=float(np.clip(sweep.path[_DEPARTURE], 0, 1)) if resting else 0.0,
        resting_std=float(np.sqrt(sweep.covariance[_DEPARTURE, _DEPARTURE])) if resting else 0.0,
        at_border=_leaves_picture(sweep, t),
        doubts=(_OTHER.format(sweep.rejection),) if sweep.rejection else (),
        exposure_time=exposure_time,
        sweep=sweep,
        readout=readout,
    )


def _of_any_brightness(motion: Motion, solution: Solution) -> Motion:
    """A motion with the errors of a source whose brightness may change, if its light is not even.

    At constant brightness the mean place is that of its light, and at constant speed the middle of its
    path. They enter the errors where they are elsewhere than the fitted place.
    """
    light = np.sum(solution.premultiplied, axis=2, dtype=float)
    variance = np.sum(np.square(solution.premultiplied_std, dtype=float), axis=2)
    weights = _Weights.of(light, variance, solution.streak, solution.known)
    moments, errors = _moments(weights, "the added light sums to {}")
    xy = motion.trajectory.xy
    along = np.insert(np.cumsum(np.linalg.norm(np.diff(xy, axis=0), axis=1)), 0, 0)
    middle = [np.interp(along[-1] / 2, along, axis) for axis in xy.T]
    own, added = motion.covariance[:2, :2], np.zeros((2, 2))
    for place, error in ((moments[1:3], errors[1:3, 1:3]), (middle, 0.0)):
        off = place - motion.center
        if off @ np.linalg.solve(own + error, off) > chi_square_quantile(_EVEN, 2):
            added += np.outer(off, off)
    if not added.any():
        return motion
    covariance = motion.covariance.copy()
    covariance[:2, :2] += added
    covariance[-1, -1] += (motion.top_speed - motion.length) ** 2
    known, change = motion.acceleration_covariance, motion.acceleration
    if known is not None and change is not None:
        known = known + np.outer(change, change)
    return replace(
        motion,
        covariance=covariance,
        speeds_std=np.hypot(motion.speeds_std, motion.speeds - motion.length),
        acceleration_covariance=known,
        resting_std=float(np.hypot(motion.resting_std, motion.resting)),
        doubts=(*motion.doubts, _OPEN_BRIGHTNESS),
    )


def _is_unresolved(sweep: Sweep) -> bool:
    """Whether a path blurs less than the lens and the pixels do.

    Then a blur of another profile than that of the model looks like such a path, often one that turns
    back. Variances are compared, along both axes together. The blur of a file's chroma has a known
    profile, which fits are corrected for.
    """
    blur = sweep.silhouette.softness(sweep.shape)
    spread = sweep.family.curve(sweep.path).var(axis=0).sum()
    return bool(spread < 2 * (blur**2 + UNIFORM_VARIANCE))


def _quantities_of_sweep(sweep: Sweep, path: Array, shape: Array) -> Array:
    """`QUANTITIES`, then the acceleration (2,), then the speeds between moments."""
    t = _times(sweep, path)
    xy, durations = _centers(sweep, path, shape, t), np.diff(t)
    steps = np.linalg.norm(np.diff(xy, axis=0), axis=1)
    center = durations @ (xy[1:] + xy[:-1]) / 2
    chord = xy[-1] - xy[0]
    angle = float(np.arctan2(chord[1], chord[0]))
    normal = np.array([-np.sin(angle), np.cos(angle)])
    across = sweep.silhouette.outline(shape, OUTLINE_POINTS) @ normal
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
    """(T, 2) centroids of the silhouette."""
    xy, silhouette = sweep.family.at(path, t)[0], sweep.silhouette
    return np.asarray(xy + silhouette.map_at(shape, t) @ silhouette.center(shape))


def _velocity(sweep: Sweep, path: Array, shape: Array, t: int) -> Array:
    """(2,) at the first moment (t = 0) or the last (t = 1), pixels per exposure."""
    inward = 1 - 2 * t
    a, b, c = _centers(sweep, path, shape, t + inward * _END * np.arange(3.0))
    return np.asarray(inward * (4 * b - 3 * a - c) / (2 * _END))


def _leaves_picture(sweep: Sweep, t: Array) -> bool:
    """True if a part of the outline is beyond the picture at a moment; pixel 0 covers −0.5 to 0.5."""
    maps, centers = sweep.silhouette.map_at(sweep.shape, t), sweep.family.at(sweep.path, t)[0]
    outlines = sweep.outline @ maps.transpose(0, 2, 1) + centers[:, None]
    return bool(np.any((outlines < -0.5) | (outlines > np.array(sweep.size) - 0.5)))


def motion_of_alpha(solution: Solution) -> Motion:
    """Motion from sum, mean and covariance of alpha.

    Raises MotionError if the sum of alpha is less than three times its error.
    """
    use = solution.streak & solution.known
    alpha = np.asarray(solution.alpha, float)
    variance = variance_inflation(solution) * np.asarray(solution.alpha_std, float) ** 2
    scale = solution.stats.alpha_scale_std or 0.0
    weights = _Weights.of(alpha, variance, solution.streak, solution.known)
    moments = _moments(weights, "alpha sums to {} pixels", scale)
    motion = replace(
        _straight_motion(*moments, solution.size),
        at_border=_reaches_border(use, alpha[use], variance[use]),
        exposure_time=solution.stats.exposure_time,
        readout=solution.stats.readout,
    )
    return replace(motion, doubts=tuple(_doubts_of_moments(solution, use, motion)))


def motion_of_added_light(
    image: LinearImage, plate: LinearImage, streak: Bools, color: Array
) -> Motion:
    """Motion from sum, mean and covariance of the light that an object adds to the plate.

    For an object whose alpha nothing determines, such as a lamp before a dark sky. The added light
    α (k − B) is a multiple of alpha where light k and plate B are even. Where B is not, its differences
    from the mean enter the error, with an alpha of which nothing is known. The factor is open, so that
    the radius is that of a disc as wide as the streak is across. Clipped light is unknown.

    Parameters
    ----------
    image, plate : LinearImage
        Noise known.
    streak : (H, W) bool
    color : (3,) float
        Of the object's light, a unit vector.

    Raises
    ------
    MotionError
        If the sum of the light is less than three times its error.
    """
    known = image.valid & plate.valid
    use = streak & known
    added = (image.rgb.astype(float) - plate.rgb) @ color
    variance = (image.variance.astype(float) + plate.variance) @ color**2
    behind = plate.rgb @ color
    uneven = UNKNOWN_FRACTION * (behind - behind[use].mean()) if use.any() else behind
    weights = _Weights.of(added, variance, streak, known, uneven)
    moments, covariance = _moments(weights, "the added light sums to {}")
    values, covariance = propagated(_with_area_of_width, moments, covariance)
    return replace(
        _straight_motion(values, covariance, image.size),
        at_border=_reaches_border(use, added[use], variance[use]),
        exposure_time=image.meta.exposure_time,
        readout=image.meta.readout,
        doubts=(
            "Alpha is not determined, for the plate is dark or has the object's color: place, length "
            "and width are those of the added light, right if light and plate are even.",
        ),
    )


def _straight_motion(parameters: Array, covariance: Array, size: tuple[int, int]) -> Motion:
    """The straight motion of area, mean and variances."""
    values, covariance = propagated(_quantities_of_moments, parameters, covariance, slice(2, 3))
    center, angle, length = values[:2], values[2], values[3]
    half = length / 2 * np.array([np.cos(angle), np.sin(angle)])
    return Motion(
        trajectory=Trajectory.line(center - half, center + half),
        values=values,
        covariance=covariance,
        speeds=np.array([length]),
        speeds_std=np.sqrt(covariance[3:4, 3]),
        source=MOMENTS,
        path="line",
        silhouette="",
        size=size,
        at_border=False,
    )


def variance_inflation(solution: Solution) -> float:
    """Variance of the sum of alpha over the sum of the variances, at least 1."""
    use = solution.streak & solution.known
    independent = float(np.sum(np.asarray(solution.alpha_std[use], float) ** 2))
    correlated = solution.sum_std_without_factor**2
    return max(float(correlated / independent), 1.0) if independent > 0 else 1.0


@dataclass(frozen=True, eq=False)
class _Weights:
    """Weights of the n pixels of a streak.

    An unknown one is that of the nearest known pixel. In each quarter of the streak those err in
    common, by as much as the known ones are large.
    """

    at: Array  # (2, n) x and y
    weight: Array  # (n,)
    variance: Array  # (n,) of the known ones
    # (m, n): independent errors, each of which several pixels have in common, in proportion to these
    common: Array

    @classmethod
    def of(
        cls, weight: Array, variance: Array, streak: Bools, known: Bools, *common: Array
    ) -> "_Weights":
        """Of maps (H, W). `common`: errors that the known pixels of a quarter have in common."""
        y, x = np.nonzero(streak)
        seen = (known & streak)[y, x]
        if not seen.any():
            return cls(np.stack([x, y]), np.zeros(len(x)), np.zeros(len(x)), np.ones((1, len(x))))
        near = scipy.ndimage.distance_transform_edt(
            ~(known & streak), return_distances=False, return_indices=True
        )
        weight = weight[near[0], near[1]][y, x]
        # Pixels without the object do not change it.
        square = weight[seen] ** 2
        size = np.sqrt((square @ square) / max(square.sum(), 1e-30))
        errors = [np.where(seen, 0, size), *(np.where(seen, one[y, x], 0) for one in common)]
        quarter = 2 * (y > y.mean()) + (x > x.mean())
        quarters = np.arange(4)[:, None] == quarter
        return cls(
            np.stack([x, y]),
            weight,
            np.where(seen, variance[y, x], 0),
            np.concatenate([quarters * one for one in errors]),
        )


def _moments(weights: _Weights, sums_to: str, scale: float = 0.0) -> tuple[Array, Array]:
    """(6,) sum, mean x and y, variances xx, xy, yy of weights in pixels; their covariance.

    The weights share a factor of the relative standard deviation `scale`.
    """
    (x, y), weight = weights.at, weights.weight
    total = float(weight.sum())
    std = float(np.hypot(np.sqrt(weights.variance.sum()), total * scale))
    if not total > _MIN_SUM_STD * std:
        raise MotionError(
            f"{sums_to.format(f'{total:.1f} ± {std:.1f}')}, which is less than {_MIN_SUM_STD:g} times "
            "its error: no motion can be measured; choose the object with a region, or give its color, "
            "and solve again"
        )
    middle = weight @ x / total, weight @ y / total
    dx, dy = x - middle[0], y - middle[1]
    seconds = np.stack([dx * dx, dx * dy, dy * dy])
    moments = seconds @ weight / total
    by_weight = np.stack([np.ones(len(x)), dx / total, dy / total])
    by_weight = np.concatenate([by_weight, (seconds - moments[:, None]) / total])
    in_common = by_weight @ weights.common.T
    covariance = (by_weight * weights.variance) @ by_weight.T + in_common @ in_common.T
    covariance[0, 0] += (total * scale) ** 2
    pixel = UNIFORM_VARIANCE * np.array([1, 0, 1])
    return np.array([total, *middle, *(moments - pixel)]), covariance


def _with_area_of_width(moments: Array) -> Array:
    """The same moments with the area of a disc that has their variance across the path."""
    area = 4 * np.pi * _variances(moments)[1]
    return np.array([area, *moments[1:]])


def _variances(moments: Array) -> tuple[float, float]:
    """Difference of the variances along and across the path, and the one across, at least 0."""
    xx, xy, yy = moments[3:]
    difference = float(np.hypot(xx - yy, 2 * xy))  # of the two eigenvalues
    return difference, max((xx + yy - difference) / 2, 0.0)


def _quantities_of_moments(moments: Array) -> Array:
    """`QUANTITIES` of area, mean and variances."""
    area, x, y, xx, xy, yy = moments
    difference, across = _variances(moments)
    angle, length = 0.5 * np.arctan2(2 * xy, xx - yy), np.sqrt(12 * difference)
    radius = np.sqrt(max(area, 0.0) / np.pi)
    return np.array([x, y, angle, length, 4 * np.sqrt(across), radius, area, length])


def _reaches_border(use: Bools, weight: Array, variance: Array) -> bool:
    """True if the sum of weights (n,) along the border is above its error."""
    border = np.ones(use.shape, bool)
    border[1:-1, 1:-1] = False
    there = border[use]
    return bool(weight[there].sum() > _MIN_SUM_STD * np.sqrt(variance[there].sum()))


def _doubts_of_moments(solution: Solution, use: Bools, motion: Motion) -> list[str]:
    doubts = []
    parts = _part_count(solution, use)
    if parts > 1:
        doubts.append(
            f"Alpha has {parts} separate parts, and the moments are those of all of them; solve each "
            "with a region of its own."
        )
    if motion.width > _MAX_WIDTH * 2 * motion.radius:
        doubts.append(
            f"It is {motion.width:.0f} px wide, and a disc of its area {2 * motion.radius:.0f} px: the "
            "path bends, or it is not round, or there are several objects; length and direction are "
            "then not those of a straight path."
        )
    unknown = float(np.mean(~solution.known[solution.streak]))
    if unknown > _MAX_UNKNOWN_FRACTION:
        doubts.append(
            f"In {unknown:.0%} of the streak alpha is unknown: there it is that of the nearest pixels, "
            "with an error as large as alpha elsewhere."
        )
    return doubts


def _part_count(solution: Solution, use: Bools) -> int:
    """Number of separate parts of alpha."""
    alpha = np.where(use, np.asarray(solution.alpha, float), 0)
    near = scipy.ndimage.gaussian_filter(alpha, _PART_SMOOTHING_PX)
    labels, count = scipy.ndimage.label(near > _MIN_PART_ALPHA * near.max())
    sums = np.bincount(labels.ravel(), alpha.ravel(), count + 1)[1:]
    return int(np.count_nonzero(sums > _MIN_PART_FRACTION * alpha.sum()))


@dataclass(frozen=True, eq=False)
class EndSilhouettes:
    """Where the object was at the beginning or at the end of the exposure, but not at both.

    Parameters
    ----------
    change : (H, W) float
        First silhouette minus the last: 1 where it was only at the beginning, −1 where only at the
        end, 0 where it was at both moments or never. Raw, not clipped.
    change_std : (H, W) float
        Its standard deviation; infinite where alpha is not known.
    scale : float
        Standard deviation of the Gaussian over which alpha was averaged, pixels; it softens edges.

    Examples
    --------
    >>> ends = bm.motion.end_silhouettes(solution, motion)
    >>> ends.first.shape, ends.last.shape
    ((72, 128), (72, 128))
    """

    change: Array
    change_std: Array
    scale: float

    def __repr__(self) -> str:
        height, width = self.change.shape
        std = self.change_std[np.isfinite(self.change_std) & (self.change_std > 0)]
        typical = float(np.median(std)) if std.size else np.inf
        return f"EndSilhouettes({width}x{height}, ± {typical:.2g}, soft by {self.scale:g} px)"

    @property
    def first(self) -> Array:
        """(H, W) 0…1, the part of the first silhouette that the last does not overlap."""
        return np.clip(self.change, 0, 1)

    @property
    def last(self) -> Array:
        """(H, W) 0…1, the part of the last silhouette that the first does not overlap."""
        return np.clip(-self.change, 0, 1)


def end_silhouettes(solution: Solution, motion: Motion) -> EndSilhouettes:
    """Find the first and the last silhouette from the derivative of alpha along the motion.

    The object need not be rigid, but its path must be straight and its speed constant. Where the two
    silhouettes overlap, and which of them was first, cannot be known.

    Parameters
    ----------
    solution : Solution
    motion : Motion
        From `measure_motion(solution)`.

    Raises
    ------
    MotionError
        If it did not move by more than the error of its length.

    Examples
    --------
    >>> ends = bm.motion.end_silhouettes(solution, motion)
    >>> print(f"{ends.first.clip(0, 1).sum():.0f} pixels, π r² is {np.pi * 10**2:.0f}")
    318 pixels, π r² is 314
    """
    check_solution("solution", solution)
    check_kind("motion", motion, Motion, "use blurmatte.measure_motion(solution)")
    if not motion.moved:
        raise MotionError(
            f"a motion of {motion.length:.2g} ± {motion.length_std:.2g} px is not significant: the "
            "first and the last silhouette cannot be distinguished; use a longer exposure"
        )
    use = solution.streak & solution.known
    alpha = np.where(use, np.asarray(solution.alpha, float), 0)
    variance = np.where(use, np.asarray(solution.alpha_std, float) ** 2, 0)
    shift = motion.length * np.array([np.cos(motion.angle), np.sin(motion.angle)])
    max_scale = max(_MAX_SCALE * motion.radius, _SCALES_PX[0])
    for scale in [s for s in _SCALES_PX if s <= max_scale]:
        std = motion.length * _slope_std(variance, variance_inflation(solution), scale)
        if np.median(std[use]) <= _MAX_STD:
            break
    unknown = solution.streak & ~solution.known
    return EndSilhouettes(
        _derivative_along(alpha, shift, scale), np.where(unknown, np.inf, std), scale
    )


def _derivative_along(alpha: Array, shift: Array, scale: float) -> Array:
    """(H, W) derivative of alpha in the direction of a shift (2,), times its length."""
    dx, dy = (
        scipy.ndimage.gaussian_filter(alpha, scale, order=order) for order in ((0, 1), (1, 0))
    )
    return np.asarray(shift[0] * dx + shift[1] * dy)


def _slope_std(variance: Array, inflation: float, scale: float) -> Array:
    """(H, W) standard deviation of a derivative of alpha over a Gaussian neighborhood."""
    wider = scale**2 + (inflation - 1) / (4 * np.pi)
    mean = scipy.ndimage.gaussian_filter(variance, scale / np.sqrt(2))
    return np.asarray(np.sqrt(mean * inflation / (8 * np.pi)) / wider)
