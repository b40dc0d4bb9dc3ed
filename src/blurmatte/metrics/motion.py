"""Errors of an estimated path, and of sub-frames of the exposure.

A sub-frame is a sharp picture of the object in front of the plate at one time of the exposure. A
stack of them is (n, H, W, 3), in the order of time, floats coded as sRGB with black 0 and white 1,
as in the benchmark of Rozumnyi et al., "DeFMO", CVPR 2021. A single picture does not determine the
direction of time: the estimate is reversed if that decreases the sum of squared errors of the stack.
(The benchmark decides by its first sub-frame.) The benchmark scores the bounding box of the true
object: crop all arguments to it for comparable numbers. Nothing is clipped.
"""

import numpy as np
import scipy

from blurmatte.checks import Array, Floats, check_kind, check_light, check_map
from blurmatte.metrics.alpha import check_all_finite
from blurmatte.trajectory import Trajectory

_MAX_PSNR = 100.0  # dB, for a perfect stack, as in the benchmark
_WINDOW = 7  # pixels: width of the square for means and variances


def trajectory_iou(
    estimated: Trajectory | None, true: Trajectory, radius: float, samples: int = 100
) -> float:
    """Trajectory intersection over union (TIoU) of fast moving objects.

    At each of `samples` times, equally spaced from the first moment of the exposure to the last, a
    disc of the true radius is placed at the true and one at the estimated position, and the area of
    their intersection is divided by that of their union. The score is the mean over time (Kotera et
    al., "Intra-frame object tracking by deblatting", ICCV workshops 2019), for the better of the two
    directions of time, as a single picture does not determine it (the benchmark of Rozumnyi et al.,
    "DeFMO", CVPR 2021). For two paths of n points at equally spaced times, and `samples` = n, it is
    the benchmark's number.

    Parameters
    ----------
    estimated : Trajectory or None
        None for a method without a result: a miss, which scores 0.
    true : Trajectory
    radius : float
        True radius of the object, pixels, > 0.
    samples : int
        Number of times, 2 or more.

    Returns
    -------
    float
        0…1; 1 is perfect.

    Raises
    ------
    TypeError, ValueError
        If a path is not a Trajectory, or a number out of its range.
    """
    hint = "use blurmatte.Trajectory.line(start, end)"
    check_kind("estimated", estimated, Trajectory | None, hint)
    check_kind("true", true, Trajectory, hint)
    if not (np.isfinite(radius) and radius > 0):
        raise ValueError(f"radius must be finite and above 0 pixels, got {radius}")
    if samples < 2:
        raise ValueError(f"samples must be 2 or more, got {samples}")
    if estimated is None:
        return 0.0
    t = np.linspace(0, 1, samples)
    there = true.at(t)
    forth, back = (_disc_iou(estimated.at(times) - there, radius) for times in (t, t[::-1]))
    return float(max(forth.mean(), back.mean()))


def _disc_iou(shift: Array, radius: float) -> Array:
    """(n,) intersection over union of two discs of one radius, `shift` (n, 2) apart.

    The common chord has the central angle θ, cos(θ/2) = d / 2r, and cuts a segment of the area
    (θ − sin θ) r²/2 from each disc; the two segments are the intersection.
    """
    half = np.arccos(np.minimum(np.linalg.norm(shift, axis=1) / (2 * radius), 1))
    shared = 2 * half - np.sin(2 * half)  # in units of r²
    return np.asarray(shared / (2 * np.pi - shared))


def subframe_psnr(estimated: Floats | None, true: Floats, plate: Floats) -> float:
    """Peak signal-to-noise ratio of a stack of sub-frames: one mean square error over all of it.

    Parameters
    ----------
    estimated : (n, H, W, 3) float or None
        None for a method without a result: a miss, scored as n copies of the plate.
    true : (n, H, W, 3) float
    plate : (H, W, 3) float
        The scene without the object; used only for None.

    Returns
    -------
    float
        Decibel, for a peak of 1; at most 100.

    Raises
    ------
    TypeError, ValueError
        If an argument is not such an array, sizes or numbers of sub-frames differ, a number is not
        finite, or `true` or `plate` leaves 0…1.
    """
    shown, true = _shown(estimated, true, plate)
    error = float(np.mean((shown - true) ** 2))
    return min(-10 * float(np.log10(error)), _MAX_PSNR) if error > 0 else _MAX_PSNR


def subframe_ssim(estimated: Floats | None, true: Floats, plate: Floats) -> float:
    """Structural similarity of a stack of sub-frames: the mean over them.

    That of Wang et al., "Image quality assessment: from error visibility to structural similarity",
    IEEE Trans. Image Processing 2004, with the conventions of Python libraries: a uniform window of 7
    by 7 pixels, sample covariances, channels separately, windows inside the picture only. The data
    range is that of the true stack, so that an estimate does not set its own scale. (The benchmark's
    code takes the range of the estimate.)

    Parameters
    ----------
    estimated : (n, H, W, 3) float or None
        None for a method without a result: a miss, scored as n copies of the plate.
    true : (n, H, W, 3) float
        At least 7 by 7 pixels, not all of one value.
    plate : (H, W, 3) float
        The scene without the object; used only for None.

    Returns
    -------
    float
        At most 1, which is perfect.

    Raises
    ------
    TypeError, ValueError
        If an argument is not such an array, sizes or numbers of sub-frames differ, a number is not
        finite, or `true` or `plate` leaves 0…1; if `true` is too small or all of one value.
    """
    shown, true = _shown(estimated, true, plate)
    if min(true.shape[1:3]) < _WINDOW:
        raise ValueError(f"true must be {_WINDOW} by {_WINDOW} pixels or more, got {true.shape}")
    span = float(np.ptp(true.astype(float)))
    if span == 0:
        raise ValueError(f"true must show something, all its values are {true.flat[0]:g}")
    return float(np.mean([_ssim(a, b, span) for a, b in zip(shown, true, strict=True)]))


def _shown(estimated: Floats | None, true: Floats, plate: Floats) -> tuple[Array, Floats]:
    """(n, H, W, 3) the estimated stack in the direction that fits better, and the true one.

    Of None the plate is shown.
    """
    true = _check_stack("true", true)
    _check_range("true", true)
    plate = check_map("plate", check_light("plate", plate), true.shape[1:])
    check_all_finite("plate", plate)
    _check_range("plate", plate)
    if estimated is None:
        return np.broadcast_to(plate.astype(float), true.shape), true
    estimated = _check_stack("estimated", estimated)
    stack = check_map("estimated", estimated, true.shape).astype(float)
    forth, back = (np.sum((order - true) ** 2) for order in (stack, stack[::-1]))
    return stack if forth <= back else stack[::-1], true


def _check_stack(name: str, value: Floats) -> Floats:
    stack: Floats = check_map(name, value)
    if stack.ndim != 4 or stack.shape[3] != 3 or stack.size == 0:
        raise ValueError(f"{name} must have the shape (n, height, width, 3), got {stack.shape}")
    check_all_finite(name, stack)
    return stack


def _check_range(name: str, value: Floats) -> None:
    low, high = float(np.min(value)), float(np.max(value))
    if low < -1e-6 or high > 1 + 1e-6:  # of float32
        raise ValueError(f"{name} must be coded as sRGB from 0 to 1, got {low:g} to {high:g}")


def _ssim(a: Array, b: Floats, span: float) -> float:
    """Mean over windows and channels of two (H, W, 3) pictures whose data range is `span`.

    With means μ, variances v and the covariance c of the pictures in a window,

        SSIM = (2 μ_a μ_b + k₁) (2 c + k₂) / ((μ_a² + μ_b² + k₁) (v_a + v_b + k₂))
    """

    def mean(x: Floats) -> Array:
        """Mean over each window."""
        rim = _WINDOW // 2
        filtered = scipy.ndimage.uniform_filter(x, size=(_WINDOW, _WINDOW, 1))
        return np.asarray(filtered[rim:-rim, rim:-rim])

    b = b.astype(float)  # float32 is too coarse for differences of squares
    sample = _WINDOW**2 / (_WINDOW**2 - 1)
    k1, k2 = (0.01 * span) ** 2, (0.03 * span) ** 2
    mu_a, mu_b = mean(a), mean(b)
    cov = sample * (mean(a * b) - mu_a * mu_b)
    var = sample * (mean(a * a) - mu_a**2 + mean(b * b) - mu_b**2)
    likeness = (2 * mu_a * mu_b + k1) * (2 * cov + k2)
    return float(np.mean(likeness / ((mu_a**2 + mu_b**2 + k1) * (var + k2))))
