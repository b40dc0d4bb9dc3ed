"""The first and the last silhouette of a streak that no rigid outline explains.

For a straight path v at constant speed α(x) = ∫ χ(x − v t) dt, t from 0 to 1. Its derivative along v is

    v·∇α = χ_first − χ_last,

because the integral telescopes. It is positive where the object was only at the beginning of the
exposure, and negative where it was only at the end. Where both silhouettes overlap it is 0. A single
picture does not determine which of the two was first.

The derivative multiplies noise by the length, so it is taken over a Gaussian neighborhood of standard
deviation s. Pixels of standard deviation σ whose errors are correlated over a length l (n = 4πl² of
them have a common error) give it the variance σ²(4πl² + 1) / (8π (s² + l²)²).
"""

from dataclasses import dataclass

import numpy as np
import scipy

from blurmatte.checks import Array, check_kind
from blurmatte.errors import MotionError
from blurmatte.matting.solution import Solution, check_solution
from blurmatte.motion.picture.measure import variance_inflation
from blurmatte.motion.picture.motion import Motion

# Width of the Gaussian over which the derivative of alpha is taken.
_SCALES_PX = (1.0, 1.5, 2.2, 3.3, 5.0)  # tried in this order
_MAX_STD = 0.15  # median error of the change that separates 0 from 1 in most pixels
_MAX_SCALE = 0.35  # radii: a wider Gaussian blurs the silhouette itself


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
