"""Errors of estimates, where the truth is known: of alpha, colors, light, paths and sub-frames.

The estimate comes first and the truth second. The streak is where the true alpha is above 0. A bad
argument raises ValueError or TypeError: another size, numbers that are not finite, no streak. Nothing
is clipped or stretched. All light is linear, 1 = sensor white.

Alphas are (H, W) floats of the same size. Errors of the streak are measured where the true alpha is
above 0, so that the size of the picture has no effect. Errors outside are measured by `false_alpha`.
z is (estimate − truth) / std, which has mean 0 and spread 1 if std is correct.

A sub-frame is a sharp picture of the object in front of the plate at one time of the exposure. A
stack of them is (n, H, W, 3), in the order of time, floats coded as sRGB with black 0 and white 1,
as in the benchmark of Rozumnyi et al., "DeFMO", CVPR 2021. A single picture does not determine the
direction of time: the estimate is reversed if that decreases the sum of squared errors of the stack.
(The benchmark decides by its first sub-frame.) The benchmark scores the bounding box of the true
object: crop all arguments to it for comparable numbers.
"""

from dataclasses import dataclass
from statistics import NormalDist

import numpy as np
import numpy.typing as npt
import scipy

from blurmatte.checks import (
    Array,
    Bools,
    Floats,
    as_array,
    box_of,
    check_kind,
    check_light,
    check_map,
    check_same_size,
    rows_columns,
)
from blurmatte.layer import Layer, check_layer
from blurmatte.radiometry import SRGB, LinearImage, check_picture
from blurmatte.trajectory import Trajectory

_MAX_PSNR = 100.0  # dB, for a perfect stack of sub-frames, as in the benchmark
_WINDOW = 7  # pixels: width of the square for means and variances


def check_all_finite(name: str, value: Floats) -> None:
    """Raise if `value` holds NaN or infinite numbers, and say how many."""
    lost = int(np.sum(~np.isfinite(value)))
    if lost:
        raise ValueError(f"{name} must be finite, got {lost} NaN or infinite of {value.size}")


def checked_alphas(estimated: Floats, true: Floats) -> tuple[Floats, Floats, Bools]:
    """Both, finite float (H, W) of one size, and the streak, (H, W) bool; raises unless they are so."""
    pair = []
    for name, given in (("estimated", estimated), ("true", true)):
        alpha = check_map(name, given)
        if alpha.ndim != 2:
            raise ValueError(f"{name} must have the shape (height, width), got {alpha.shape}")
        check_all_finite(name, alpha)
        pair.append(alpha)
    check_same_size("estimated", pair[0].shape[1::-1], "true", pair[1].shape[1::-1])
    return pair[0], pair[1], streak_of(pair[1])


def check_finite_layer(name: str, value: Layer) -> None:
    """Raise unless `value` is a Layer of finite numbers."""
    check_layer(name, value)
    check_all_finite(f"the alpha of {name}", value.alpha)
    check_all_finite(f"the premultiplied light of {name}", value.premultiplied)


def streak_of(alpha: Floats) -> Bools:
    """(H, W) True where the true alpha is above 0; ValueError if that is nowhere."""
    streak: Bools = alpha > 0
    if not streak.any():
        raise ValueError(f"true must hold a streak, got alpha up to {np.max(alpha):g}")
    return streak


def alpha_rmse(estimated: Floats, true: Floats) -> float:
    """Root mean square error of alpha over the streak.

    Parameters
    ----------
    estimated, true : (H, W) float

    Returns
    -------
    float
        Alpha; 0 is perfect.

    Raises
    ------
    TypeError, ValueError
        If an argument is not (H, W) float, the sizes differ, a number is not finite, or the true
        alpha is above 0 nowhere.
    """
    error = _error(estimated, true)
    return float(np.sqrt(np.mean(error**2)))


def alpha_sad(estimated: Floats, true: Floats) -> float:
    """Sum of absolute differences of alpha over the streak.

    Parameters
    ----------
    estimated, true : (H, W) float

    Returns
    -------
    float
        Alpha summed over pixels; matting benchmarks print a thousandth of it. 0 is perfect.

    Raises
    ------
    TypeError, ValueError
        If an argument is not (H, W) float, the sizes differ, a number is not finite, or the true
        alpha is above 0 nowhere.
    """
    return float(np.sum(np.abs(_error(estimated, true))))


def alpha_sum_bias(estimated: Floats, true: Floats) -> float:
    """(Σα̂ − Σα) / Σα over the streak: the relative excess of alpha, negative if some is missing.

    Parameters
    ----------
    estimated, true : (H, W) float

    Returns
    -------
    float
        A fraction; 0 is perfect.

    Raises
    ------
    TypeError, ValueError
        If an argument is not (H, W) float, the sizes differ, a number is not finite, or the true
        alpha is above 0 nowhere.
    """
    estimated, true, streak = checked_alphas(estimated, true)
    error = estimated[streak].astype(float) - true[streak]
    return float(np.sum(error) / np.sum(true[streak], dtype=float))


def alpha_gradient_error(estimated: Floats, true: Floats) -> float:
    """Sum over the streak of (|∇α̂| − |∇α|)²: edges that are too soft, too sharp or misplaced.

    The gradient error of Rhemann et al., "A perceptually motivated online benchmark for image
    matting", CVPR 2009. ∇ is the first derivative of a Gaussian of σ = 1.4 pixels, cut off at 4
    pixels, each of the two kernels (9, 9) scaled to a sum of squares of 1; border values are repeated
    outside the picture. Common code first stretches each alpha to 0…1. That would hide errors in the
    strength of a faint streak and is omitted; if both alphas fill 0…1, the numbers are the same.

    Parameters
    ----------
    estimated, true : (H, W) float

    Returns
    -------
    float
        Summed over pixels; matting benchmarks print a thousandth of it. 0 is perfect.

    Raises
    ------
    TypeError, ValueError
        If an argument is not (H, W) float, the sizes differ, a number is not finite, or the true
        alpha is above 0 nowhere.
    """
    estimated, true, streak = checked_alphas(estimated, true)
    error = _gradient_magnitude(estimated) - _gradient_magnitude(true)
    return float(np.sum(error[streak] ** 2))


def false_alpha(estimated: Floats, true: Floats, margin: float = 0) -> float:
    """Root mean square of the estimated alpha where the object never was.

    Parameters
    ----------
    estimated, true : (H, W) float
    margin : float
        Pixels no further than this from the streak are left out, >= 0.

    Returns
    -------
    float
        Alpha; 0 is perfect.

    Raises
    ------
    TypeError, ValueError
        If an alpha is not (H, W) float, the sizes differ, a number is not finite, the true alpha is
        above 0 nowhere, nothing lies outside, or the margin is negative.
    """
    estimated, true, streak = checked_alphas(estimated, true)
    if not margin >= 0:
        raise ValueError(f"margin must be 0 or more pixels, got {margin}")
    outside = scipy.ndimage.distance_transform_edt(~streak) > margin
    if not outside.any():
        raise ValueError(f"no pixel is further than {margin:g} pixels from the streak of true")
    return float(np.sqrt(np.mean(estimated[outside].astype(float) ** 2)))


def _error(estimated: Floats, true: Floats) -> Array:
    """(n,) error of alpha at the pixels of the streak."""
    estimated, true, streak = checked_alphas(estimated, true)
    return np.asarray(estimated[streak].astype(float) - true[streak])


def _gradient_magnitude(alpha: Floats) -> Array:
    x = np.arange(-4, 5)  # pixels
    gauss = np.exp(-(x**2) / (2 * 1.4**2))
    across, along = (kernel / np.linalg.norm(kernel) for kernel in (gauss, x * gauss))
    smooth = [
        scipy.ndimage.correlate1d(alpha.astype(float), across, axis, mode="nearest")
        for axis in (0, 1)
    ]
    dx, dy = (scipy.ndimage.correlate1d(smooth[i], along, 1 - i, mode="nearest") for i in (0, 1))
    return np.asarray(np.hypot(dx, dy))


@dataclass(frozen=True)
class Calibration:
    """Statistics of z = (estimate − truth) / std.

    Parameters
    ----------
    count : int
        Number of values.
    mean : float
        Of z; 0 if there is no bias.
    spread : float
        Root mean square of z about its mean; 1 if std is correct, more if it is too small.
    robust_spread : float
        Median of |z| over that of a normal distribution: `spread` for an unbiased estimate, insensitive
        to a few outliers.
    within_1, within_2, within_3 : float
        Fraction of |z| below 1, 2 and 3; 0.683, 0.954 and 0.997 for normal errors of the given std.
    """

    count: int
    mean: float
    spread: float
    robust_spread: float
    within_1: float
    within_2: float
    within_3: float


def calibration(
    estimate: npt.ArrayLike, std: npt.ArrayLike, truth: npt.ArrayLike, where: Bools | None = None
) -> Calibration:
    """Compare the errors of estimates with their reported standard deviations.

    Values with an infinite, zero or NaN std are ignored; `count` is the number of the others.

    Parameters
    ----------
    estimate, std, truth : (...) float
        Estimates, their reported standard deviations and the true values; one shape.
    where : bool, optional
        Values to use: the same shape, or its first axes (a pixel, for all three channels).

    Returns
    -------
    Calibration

    Raises
    ------
    TypeError, ValueError
        If the shapes differ, a std is negative, an estimate with a usable std or its truth is not
        finite, or nothing remains.
    """
    x, s, t = (
        np.asarray(as_array(name, value), dtype=float)
        for name, value in (("estimate", estimate), ("std", std), ("truth", truth))
    )
    for name, value in (("std", s), ("truth", t)):
        if value.shape != x.shape:
            raise ValueError(
                f"{name} must have the shape of estimate, {x.shape}, got {value.shape}"
            )
    if where is not None:
        where = check_map("where", where, x.shape[: np.ndim(where)], kinds="b")
        x, s, t = x[where], s[where], t[where]
    if np.any(s < 0):
        raise ValueError(f"std must not be negative, got {int(np.sum(s < 0))} that are")
    usable = np.isfinite(s) & (s > 0)
    if not usable.any():
        raise ValueError(f"std must be finite and above 0 somewhere, got none in {s.size} values")
    check_all_finite("estimate", x[usable])
    check_all_finite("truth", t[usable])
    return _summary((x[usable] - t[usable]) / s[usable])


def _summary(z: Array) -> Calibration:
    size = np.abs(z)
    within = (float(np.mean(size < limit)) for limit in (1, 2, 3))
    robust = float(np.median(size)) / NormalDist().inv_cdf(0.75)  # the median of |z|
    return Calibration(z.size, float(z.mean()), float(z.std()), robust, *within)


@dataclass(frozen=True)
class ColorDistance:
    """Distance of true colors from the estimated line or plane.

    Parameters
    ----------
    units : float
        Largest distance of a true color, linear light in units of 0…255.
    degrees : float
        Largest angle between a mixture of the true colors and the estimated ones, 0…90.
    """

    units: float
    degrees: float


def color_distance(estimated: npt.ArrayLike, true: npt.ArrayLike) -> ColorDistance:
    """Distance of true colors from a color, a line or a plane of colors, brightness matched.

    Let Q be an orthonormal basis of the estimated colors. QQᵀo is the nearest of them to a true color
    o; brightness is not compared, as a line or plane holds all shades. `units` is 255 · |o − QQᵀo|,
    which is proportional to the brightness of o. `degrees` is the angle between o and the line or
    plane. For several true colors it is the largest over all their mixtures, also those with negative
    light: between two planes it is the larger of their two principal angles, and between a plane and a
    line 90 degrees.

    Parameters
    ----------
    estimated : (3,) or (3, rank) float
        A straight color, or columns that span the estimated colors, as in `ColorModel.basis`; rank
        1 or 2. They need not be orthonormal.
    true : (3,) or (n, 3) float
        One or more colors of the object, linear light.

    Returns
    -------
    ColorDistance
        Zeros are perfect.

    Raises
    ------
    ValueError
        For other shapes, numbers that are not finite, black, and two columns of one hue.
    """
    Q = _estimated_span(np.asarray(as_array("estimated", estimated), dtype=float))
    o = _true_colors(np.asarray(as_array("true", true), dtype=float))
    off = o - o @ Q @ Q.T
    units = 255 * float(np.linalg.norm(off, axis=1).max())
    T = _span(o)
    sine = float(np.linalg.norm(T - Q @ Q.T @ T, ord=2))  # of the largest angle to a vector of T
    return ColorDistance(units, float(np.degrees(np.arcsin(min(sine, 1.0)))))


def premultiplied_rmse(estimated: Floats, true: Layer) -> float:
    """Root mean square error of premultiplied light, over the pixels of the streak and channels.

    Parameters
    ----------
    estimated : (H, W, 3) float
        Linear light, alpha times the object's color.
    true : Layer

    Returns
    -------
    float
        Light; 0 is perfect.

    Raises
    ------
    TypeError, ValueError
        If `estimated` is not (H, W, 3) float, the sizes differ, a number is not finite, or `true`
        holds no streak.
    """
    estimated = check_light("estimated", estimated)
    check_all_finite("estimated", estimated)
    check_finite_layer("true", true)
    check_same_size("estimated", estimated.shape[1::-1], "true", true.size)
    streak = streak_of(true.alpha)
    error = estimated[streak].astype(float) - true.premultiplied[streak]
    return float(np.sqrt(np.mean(error**2)))


def recomposite_psnr(estimated: Layer, true: Layer, background: LinearImage) -> float:
    """Peak signal-to-noise ratio of the estimated layer over another picture.

    Both layers are put over the background, clipped to 0…1, coded as sRGB (white is 1; not rounded),
    and compared within the bounding box of the streak. Outside, both show the background, which would
    raise the ratio by the size of the picture; errors there are measured by `false_alpha`.

    Parameters
    ----------
    estimated, true : Layer
    background : LinearImage
        Not the plate: over the plate the errors of alpha and of light cancel.

    Returns
    -------
    float
        Decibel; infinite if both look the same.

    Raises
    ------
    TypeError, ValueError
        If the sizes differ, a number is not finite, or `true` holds no streak.
    """
    for name, layer in (("estimated", estimated), ("true", true)):
        check_finite_layer(name, layer)
    check_picture("background", background)
    check_same_size("estimated", estimated.size, "true", true.size)
    box = rows_columns(box_of(streak_of(true.alpha)))
    seen, wanted = (_coded(layer.over(background).rgb[box]) for layer in (estimated, true))
    error = float(np.mean((seen - wanted) ** 2))
    return -10 * float(np.log10(error)) if error > 0 else np.inf


def _span(colors: Array) -> Array:
    """(3, rank) orthonormal columns that span the rows of (n, 3)."""
    return np.asarray(scipy.linalg.orth(colors.T, rcond=1e-6))  # of float32


def _estimated_span(estimated: Array) -> Array:
    """(3, rank) orthonormal columns that span the estimated colors."""
    columns = estimated.reshape(3, 1) if estimated.shape == (3,) else estimated
    if columns.ndim != 2 or columns.shape not in ((3, 1), (3, 2)):
        raise ValueError(
            f"estimated must have the shape (3,), (3, 1) or (3, 2), got {estimated.shape}"
        )
    check_all_finite("estimated", columns)
    Q = _span(columns.T)
    if Q.shape[1] < columns.shape[1]:
        raise ValueError(
            f"estimated must hold {columns.shape[1]} independent colors, got {Q.shape[1]}"
        )
    return Q


def _true_colors(true: Array) -> Array:
    """(n, 3) the colors as rows."""
    colors = true[None] if true.ndim == 1 else true
    if colors.ndim != 2 or colors.shape[1] != 3 or len(colors) == 0:
        raise ValueError(f"true must have the shape (3,) or (n, 3), got {true.shape}")
    check_all_finite("true", colors)
    black = int(np.sum(~colors.any(axis=1)))
    if black:
        raise ValueError(f"true must hold colors that are not black, got {black} black ones")
    return colors


def _coded(light: Floats) -> Array:
    return np.asarray(SRGB.encode(np.clip(light.astype(float), 0, 1)))


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
