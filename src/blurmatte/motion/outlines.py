"""The first and the last silhouette, where no rigid outline explains the streak.

Of a straight way v at constant speed α(x) = ∫ χ(x − v t) dt, t from 0 to 1. Along v its derivative is

    v·∇α = χ_first − χ_last,

because the integral telescopes. Where it is positive the object was when the exposure began and not
when it ended; where it is negative, the other way round. Where both silhouettes overlap it is 0, and
nothing is known. Which of the two was first nobody can tell.

Noise is multiplied by the length, so that the derivative is taken over a neighborhood: of a Gaussian
of deviation s. Of pixels that err alike over a deviation l (4πl² of them as one) and alone by σ, its
variance is σ²(4πl² + 1) / (8π (s² + l²)²).
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from blurmatte.checks import check_kind
from blurmatte.errors import MotionError
from blurmatte.matting import Solution
from blurmatte.matting.solution import check_solution
from blurmatte.motion.moments import alike
from blurmatte.motion.motion import Motion

Array = npt.NDArray[np.float64]

_SCALES = 1.0, 1.5, 2.2, 3.3, 5.0  # pixels, the neighborhoods that are tried
_ENOUGH = 0.15  # a standard deviation that tells 0 from 1 in most pixels
_COARSEST = 0.35  # of the radius: what a neighborhood may blur


@dataclass(frozen=True, eq=False)
class EndSilhouettes:
    """Where the object was when the exposure began and ended, but not both.

    Parameters
    ----------
    change : (H, W) float
        First silhouette less the last: 1 where it was only at first, −1 where only at last, 0 where
        it was at both moments or never. Raw, not clipped.
    change_std : (H, W) float
        Its standard deviation; infinite where alpha is not known.
    scale : float
        Deviation of the Gaussian over which alpha was averaged, pixels: edges are as soft as that.
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
    """Find the first and the last silhouette from how alpha changes along the motion.

    It needs no rigid shape, but a straight way at constant speed. Where the two overlap, and
    which of them was first, cannot be known.

    Parameters
    ----------
    solution : Solution
    motion : Motion
        What `measure_motion` gave for it.

    Returns
    -------
    EndSilhouettes

    Raises
    ------
    MotionError
        If it did not move by more than the error of its length.
    """
    check_solution("solution", solution)
    check_kind("motion", motion, Motion, "use blurmatte.measure_motion(solution)")
    if not motion.moved:
        raise MotionError(
            f"it moved {motion.length:.2g} ± {motion.length_std:.2g} px, so that the first and the "
            "last silhouette are one; there is no direction to look along"
        )
    use = solution.streak & solution.known
    alpha = np.where(use, np.asarray(solution.alpha, float), 0)
    variance = np.where(use, np.asarray(solution.alpha_std, float) ** 2, 0)
    way = motion.length * np.array([np.cos(motion.angle), np.sin(motion.angle)])
    most = max(_COARSEST * motion.radius, _SCALES[0])
    for scale in [s for s in _SCALES if s <= most]:
        std = motion.length * _slope_std(variance, alike(solution), scale)
        if np.median(std[use]) <= _ENOUGH:
            break
    unknown = solution.streak & ~solution.known
    return EndSilhouettes(_along(alpha, way, scale), np.where(unknown, np.inf, std), scale)


def _along(alpha: Array, way: Array, scale: float) -> Array:
    """(H, W) derivative of alpha in the direction of a way, times its length."""
    from scipy.ndimage import gaussian_filter

    dx, dy = (gaussian_filter(alpha, scale, order=order) for order in ((0, 1), (1, 0)))
    return np.asarray(way[0] * dx + way[1] * dy)


def _slope_std(variance: Array, together: float, scale: float) -> Array:
    """(H, W) standard deviation of a derivative of alpha over a Gaussian neighborhood."""
    from scipy.ndimage import gaussian_filter

    wider = scale**2 + (together - 1) / (4 * np.pi)
    mean = gaussian_filter(variance, scale / np.sqrt(2))
    return np.asarray(np.sqrt(mean * together / (8 * np.pi)) / wider)
