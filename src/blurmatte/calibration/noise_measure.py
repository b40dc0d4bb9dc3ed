"""A camera's noise from frames of a still scene, an even region, or the difference to a plate.

In this file y is a variance, x the light at which it was measured and θ the coefficients of 1, x and
x² in it: read_std², gain and relative_std² (a photon transfer curve; J. R. Janesick, *Photon Transfer*,
SPIE 2007). Code values round light. Noise of variance σ², in squared steps of the code values, has in a
file the variance

    σ² + 1/12 − Σₖ exp(−4π²k²σ²) / (2π²k²),   k = 1, 2, …

if the same light is measured repeatedly: the sum is the part of the rounding error, of variance 1/12,
that is the same each time (B. Widrow and I. Kollár, *Quantization Noise*, Cambridge 2008).
"""

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
import scipy

from blurmatte.calibration.noise_pair import plate_share
from blurmatte.calibration.noise_samples import (
    AROUND_PX,
    Sample,
    noise_of_frames,
    noise_within,
    parts_by_light,
    require_pixels,
    rows_to_measure,
)
from blurmatte.checks import Array, Bools
from blurmatte.errors import NoiseError
from blurmatte.radiometry import LinearImage, NoiseModel, check_picture, rounding_noise
from blurmatte.radiometry.image import VARIANCE_FLOOR
from blurmatte.statistics import (
    UNIFORM_VARIANCE,
    chi_square_quantile,
    nonnegative_least_squares,
    robust_std,
    variance_inflation,
)

Levels = tuple[Array, ...]

_TINY = 1e-20  # light² or a fraction: guards a division

# Rejection of pixels where the scene changed.
_PIXELS_PER_LEVEL = 200  # pixels that determine a variance at one level of light
_QUIET_FRACTION = 0.25  # of the pixels at a level of light that must be still
# Of noise beyond four standard deviations, where pixels are rejected
_TAIL_PROBABILITY = 6e-5
_ITERATIONS = 8  # of rejection and estimation of the variance
_PATCH_PX = 7  # width of the patches in which changes are detected
# Quantile of the patches that measures their scatter, and its distance from the mean of a
# normal distribution, standard deviations
_LOW_QUANTILE = 0.1
_LOW_QUANTILE_STD = 1.28
# Standard deviations of a patch's mean beyond which the scene changed
_PATCH_THRESHOLD_STD = 5.0
_MAX_CHANGED_FRACTION = 0.5  # of the picture
# Ratio of the typical variance at a level of light to the fitted curve
_MAX_OVER_CURVE = 2.0
# Standard deviations from black or white within which noise is truncated
_END_MARGIN_STD = 3.0


@dataclass(frozen=True, eq=False)
class NoiseFit:
    """Measured noise: that of the sensor, the rounding of its file, and their correlation.

    Parameters
    ----------
    sensor : NoiseModel
        Without the rounding.
    rounding : NoiseModel
        Noise of the code values of the file.
    covariance : (3 channels, 3, 3) float
        Of the sensor's coefficients of 1, light and light² (`NoiseModel.coefficients`).
    light, variance, variance_std : three (K,) float, one for each channel
        The data: total variance at K levels of light, and its standard deviation.
    variance_inflation : (3 channels, 4) float
        Variance of sums over blocks of 2, 4, 8 and 16 pixels' width, over that of independent pixels.
    changed : float
        Fraction of the pixels rejected because the scene changed there.

    Examples
    --------
    >>> fit = bm.calibration.measure_noise_against(image, plate)
    >>> print(fit)
    NoiseFit(gain 1.32e-05 ± 4e-06, read_std 0 ± 0.0005)
    >>> print(fit.noise)
    NoiseModel(std 0.0019 at light 0.2)
    """

    sensor: NoiseModel
    rounding: NoiseModel
    covariance: Array
    light: Levels
    variance: Levels
    variance_std: Levels
    variance_inflation: Array
    changed: float = 0.0

    def __repr__(self) -> str:
        gain, gain_std = np.mean(self.sensor.gain), np.mean(self.gain_std)
        read, read_std = np.mean(self.sensor.read_std), np.mean(self.read_std_std)
        return f"NoiseFit(gain {gain:.3g} ± {gain_std:.1g}, read_std {read:.3g} ± {read_std:.1g})"

    @property
    def noise(self) -> NoiseModel:
        """Noise of sensor and rounding: that of a LinearImage from such a file."""
        return NoiseModel.from_coefficients(self.sensor.coefficients + self.rounding.coefficients)

    @property
    def gain_std(self) -> Array:
        """(3,) standard deviation of the sensor's gain."""
        return np.asarray(np.sqrt(self.covariance[:, 1, 1]))

    @property
    def read_std_std(self) -> Array:
        """(3,) standard deviation of the sensor's read_std."""
        return self._of_root(0)

    @property
    def relative_std_std(self) -> Array:
        """(3,) standard deviation of the sensor's relative_std."""
        return self._of_root(2)

    @property
    def scale(self) -> Array:
        """(3,) correlation length of the noise, pixels: 1 if pixels are independent.

        Sums over large areas have the variance of one independent number for each square of this width.
        """
        return np.asarray(np.sqrt(np.maximum(self.variance_inflation.max(axis=1), 1)))

    @property
    def separable(self) -> bool:
        """True if gain or read noise is known to 30 % in every channel, and not only their sum."""
        sensor = self.sensor
        gain_known = self.gain_std < 0.3 * np.asarray(sensor.gain)
        read_known = self.read_std_std < 0.3 * np.asarray(sensor.read_std)
        return bool(np.all(gain_known | read_known))

    def rounding_share(self, light: float) -> Array:
        """(3,) fraction of the variance at this light that is rounding."""
        x = np.full(3, float(light))
        return np.asarray(self.rounding.variance(x) / np.maximum(self.noise.variance(x), _TINY))

    def _of_root(self, term: int) -> Array:
        # Not by the slope of the root: it overestimates the error of a coefficient near zero.
        value = self.sensor.coefficients[:, term]
        std = np.sqrt(self.covariance[:, term, term])
        return np.asarray(np.sqrt(value + std) - np.sqrt(value))


def measure_noise(frames: Iterable[LinearImage], still: Bools | None = None) -> NoiseFit:
    """Measure a camera's noise from frames of a still scene, with equal settings.

    Successive frames are compared, so that slow changes of light have no effect; flicker is corrected.
    Pixels that are clipped in any frame or where something moved are rejected. No more than two frames
    are in memory at a time.

    Parameters
    ----------
    frames : iterable of LinearImage
        Two or more of the same size, with dark and bright parts.
    still : (H, W) bool, optional
        Where to measure; everywhere by default.

    Returns
    -------
    NoiseFit

    Raises
    ------
    TypeError, ValueError
        For fewer than two frames, different sizes, or a `still` that is not (H, W) bool.
    NoiseError
        If the camera or more than half of the scene moved, everything is clipped, exposures differ, or
        frames are copies.

    Examples
    --------
    >>> stills = [camera.photograph(wall, k) for k in range(4)]
    >>> print(bm.calibration.measure_noise(stills))
    NoiseFit(gain 1.17e-05 ± 2e-06, read_std 0 ± 0.0003)
    """
    return _fitted(noise_of_frames(frames, still))[0]


def measure_noise_against(
    picture: LinearImage, plate: LinearImage, still: Bools | None = None
) -> NoiseFit:
    """Measure a picture's noise from its difference to a plate, where nothing moved.

    Unlike a second frame the plate may have less noise than the picture, as an average has. The noise
    is divided between them by their fine structure, as in `fit_noise`.

    Parameters
    ----------
    picture, plate : LinearImage
        Of the same size, with dark and bright parts.
    still : (H, W) bool, optional
        Where to measure; everywhere by default.

    Returns
    -------
    NoiseFit
        Noise of the picture.

    Raises
    ------
    TypeError, ValueError, NoiseError
        As for `measure_noise`.

    Examples
    --------
    >>> print(bm.calibration.measure_noise_against(image, plate))
    NoiseFit(gain 1.32e-05 ± 4e-06, read_std 0 ± 0.0005)
    """
    check_picture("picture", picture)
    check_picture("plate", plate)
    sample = noise_of_frames([plate, picture], still)
    fit, typical, inliers = _fitted(sample)
    rows = rows_to_measure(picture)
    C, B = (np.asarray(p.rgb[rows], float) for p in (picture, plate))
    share, share_std = plate_share(C, B, 2 * typical + _TINY, inliers)
    part = 2 * (1 - share)
    coefficients = fit.sensor.coefficients
    of_share = 4 * share_std**2 * coefficients[:, :, None] * coefficients[:, None, :]
    return replace(
        fit,
        sensor=NoiseModel.from_coefficients(part * coefficients),
        rounding=rounding_noise(picture),
        covariance=part**2 * fit.covariance + of_share,
        variance=tuple(part * y for y in fit.variance),
        variance_std=tuple(part * y_std for y_std in fit.variance_std),
    )


def measure_noise_within(picture: LinearImage, region: Bools) -> NoiseFit:
    """Measure a camera's noise from an even region of one picture.

    The residuals from a parabola over 32 by 32 pixels are taken for noise. Edges and specks are
    rejected if they cover a minor part of the region. With texture everywhere the result is an upper
    bound; it also contains the fixed pattern of unequal pixels, which differences of frames do not.
    Noise of a large `scale` is underestimated, by a fraction of 6 (scale / 32)².

    Parameters
    ----------
    picture : LinearImage
    region : (H, W) bool
        Where light changes slowly. Gain and read noise can be separated only if it holds dark and
        bright parts; otherwise their errors are as large as themselves.

    Returns
    -------
    NoiseFit

    Raises
    ------
    TypeError, ValueError
        If `region` is not (H, W) bool, or empty.
    NoiseError
        If the region is too small, clipped, or has no noise.

    Examples
    --------
    >>> even = camera.photograph(np.full((72, 128, 3), 0.3), 0)
    >>> fit = bm.calibration.measure_noise_within(even, even.valid)
    >>> print(fit.noise)
    NoiseModel(std 0.0021 at light 0.2)
    """
    check_picture("picture", picture)
    return _fitted(noise_within(picture, region))[0]


def _fitted(sample: Sample) -> tuple[NoiseFit, Array, Bools]:
    """The fit, (H, W, 3) typical variances of the pixels, and which of them are inliers."""
    light = _light(sample)
    typical, inliers, changed = _inliers(sample, light)
    everywhere = np.asarray(inliers.all(axis=-1))
    inflation = variance_inflation(sample.v / (typical + _TINY) - 1, everywhere).max(axis=-1)
    channels = [
        _channel(light, sample, inliers, c, max(float(inflation[c]), 1.0)) for c in range(3)
    ]
    theta, covariance, x, y, y_std = (list(parts) for parts in zip(*channels, strict=True))
    fit = NoiseFit(
        NoiseModel.from_coefficients(np.array(theta)),
        sample.rounding,
        np.array(covariance),
        tuple(x),
        tuple(y),
        tuple(y_std),
        variance_inflation(sample.e / np.sqrt(typical + _TINY), everywhere),
        changed,
    )
    return fit, typical, inliers


def _inliers(sample: Sample, light: Array) -> tuple[Array, Bools, float]:
    """(H, W, 3) typical variances and inliers, and the fraction of changed pixels."""
    typical = np.stack([_typical(light[..., c], sample, c) for c in range(3)], axis=-1)
    noisy = sample.use & (typical > VARIANCE_FLOOR)
    if not noisy.any(axis=(0, 1)).all():
        raise NoiseError(
            "there is no noise: the pictures are copies of one, or of even areas without any noise; "
            "give pictures as the camera took them"
        )
    _, inliers = _unchanged(sample, typical)
    require_pixels(inliers)
    # If most pixels at a level of light changed, the curve through other levels bounds its variance.
    curve = NoiseModel.from_coefficients(
        np.array([_channel(light, sample, inliers, c)[0] for c in range(3)])
    )
    expected = curve.variance(light) + UNIFORM_VARIANCE * sample.step**2
    typical = np.minimum(typical, _MAX_OVER_CURVE * expected)
    changed, inliers = _unchanged(sample, typical)
    # In files of code values noise is truncated near black and white.
    reach = _END_MARGIN_STD * np.sqrt(typical)
    inliers &= (sample.step == 0) | ((light > reach) & (light < 1 - reach))
    require_pixels(inliers)
    return typical, inliers, changed


def _light(sample: Sample) -> Array:
    """(H, W, 3) denoised light: by its noise, pixels would be grouped into wrong levels.

    By the adaptive filter of J.-S. Lee, *Digital image enhancement and noise filtering by use of local
    statistics*, IEEE Trans. PAMI 2, 1980.
    """
    size = (AROUND_PX, AROUND_PX, 1)
    weight = np.maximum(scipy.ndimage.uniform_filter(sample.use.astype(float), size), _TINY)

    def mean(x: Array) -> Array:
        """Local mean over the pixels in use."""
        return np.asarray(scipy.ndimage.uniform_filter(np.where(sample.use, x, 0), size) / weight)

    around = mean(sample.light)
    differs = np.maximum(mean(sample.light**2) - around**2, _TINY)
    own = np.clip(1 - mean(sample.v) / sample.frames / differs, 0, 1)
    return np.asarray(around + own * (sample.light - around))


def _typical(light: Array, sample: Sample, c: int) -> Array:
    """(H, W) robust variance of pixels of similar light."""
    use = sample.use[..., c]
    x, v, step2 = light[use], sample.v[..., c][use], sample.step[..., c][use] ** 2
    low = float(chi_square_quantile(_QUIET_FRACTION, sample.freedom)) / sample.freedom
    far = _rejection_ratio(sample)
    at, levels = [], []
    for piece in parts_by_light(x, _PIXELS_PER_LEVEL):
        w, step = v[piece], float(np.mean(step2[piece]))
        s2 = max(float(np.quantile(w, _QUIET_FRACTION)) / low, UNIFORM_VARIANCE * step)
        for _ in range(_ITERATIONS):
            # Rounding may turn no noise into a whole step.
            near = w[w <= far * s2 + step]
            s2 = float(np.mean(near)) if len(near) else s2
        at.append(float(np.median(x[piece])))
        levels.append(s2)
    return np.asarray(np.interp(light, at, levels))


def _rejection_ratio(sample: Sample) -> float:
    """Upper quantile of v / σ²."""
    tail = chi_square_quantile(1 - _TAIL_PROBABILITY, sample.freedom)
    return float(tail) / sample.freedom


def _unchanged(sample: Sample, typical: Array) -> tuple[float, Bools]:
    """Fraction of changed pixels, and (H, W, 3) those unchanged and within the noise."""
    limit = _rejection_ratio(sample) * typical + sample.step**2
    use = np.asarray(sample.use.all(axis=-1))
    size = (_PATCH_PX, _PATCH_PX)
    ratio = (np.minimum(sample.v, limit) / (typical + _TINY)).mean(axis=-1)
    part = scipy.ndimage.uniform_filter(use.astype(float), size)
    patch = scipy.ndimage.uniform_filter(np.where(use, ratio, 0), size) / np.maximum(part, _TINY)
    below = 1 - float(np.quantile(patch[use], _LOW_QUANTILE)) if use.any() else 0.0
    white = float(np.sqrt(2 / (3 * sample.freedom * _PATCH_PX**2)))
    scatter = max(below / _LOW_QUANTILE_STD, white)
    changed = patch > 1 + _PATCH_THRESHOLD_STD * scatter
    share = float(np.mean(changed[use])) if use.any() else 0.0
    if share > _MAX_CHANGED_FRACTION:
        raise NoiseError(
            f"{share:.0%} of the picture changed by more than noise; the scene and the camera must "
            "stay still; or select where they do"
        )
    return share, sample.use & ~changed[..., None] & (sample.v <= limit)


def _channel(
    light: Array, sample: Sample, inliers: Bools, c: int, inflation: float = 1.0
) -> tuple[Array, Array, Array, Array, Array]:
    """Coefficients of one channel, their covariance, and light, variance, std of the levels."""
    some = inliers[..., c]
    x, v, step2 = (a[..., c][some] for a in (light, sample.v, sample.step**2))
    pieces = parts_by_light(x, _PIXELS_PER_LEVEL)
    at, whole, steps = (np.array([np.mean(a[p]) for p in pieces]) for a in (x, v, step2))
    scatter = np.mean([np.std(v[p]) for p in pieces] / (whole + _TINY))
    spread = scatter * np.sqrt(inflation / np.array([len(p) for p in pieces]))
    y = without_rounding(whole, steps, sample.repeated)
    theta, covariance, y_std = fit_sensor(at, y, spread, UNIFORM_VARIANCE * steps)
    return theta, covariance, at, y + UNIFORM_VARIANCE * steps, y_std


def fit_sensor(x: Array, y: Array, spread: Array, rounding: Array) -> tuple[Array, Array, Array]:
    """The sensor's coefficients, by robust non-negative least squares.

    x, y (K,): levels of light, and variances without rounding.
    spread (K,): standard deviation of y, as a fraction of the total variance, y plus rounding.
    rounding (K,): variance of the rounding there.

    Returns the coefficients (3,), their covariance (3, 3), and the standard deviation (K,) of y.
    No coefficient is negative; that of light² is 0 unless it exceeds twice its standard deviation.
    The covariance is that of the scatter of the levels, at least of `spread`. The prior standard
    deviation of a coefficient is the value that would explain all of the variance.
    """
    A = np.stack([x**0, x, x**2], axis=1)
    theta, weight, y_std = _weighted(A, y, spread, rounding)
    most = np.min((y + y_std)[:, None] / np.maximum(A, _TINY), axis=0, initial=np.inf, where=A > 0)
    unit = np.maximum(most, _TINY)
    information = (A * unit).T @ ((A * unit) * weight[:, None]) + np.eye(3)
    covariance = np.linalg.inv(information) * np.outer(unit, unit)
    if theta[2] < 2 * np.sqrt(covariance[2, 2]):
        theta, _, y_std = _weighted(A[:, :2], y, spread, rounding)
        theta = np.append(theta, 0.0)
    return theta, covariance, y_std


def _weighted(A: Array, y: Array, spread: Array, rounding: Array) -> tuple[Array, Array, Array]:
    """θ, weights of the levels and standard deviations of y; outliers are weighted down.

    The weights are Cauchy's with the scale of the scatter, for the likelihood of a level where
    something moved is not known.
    """
    theta, trust = np.zeros(A.shape[1]), np.ones(len(y))
    y_std = spread * np.maximum(y + rounding, _TINY)
    for _ in range(8):
        root = np.sqrt(trust) / y_std
        theta = nonnegative_least_squares(A * root[:, None], y * root)
        y_std = spread * np.maximum(A @ theta + rounding, _TINY)
        z = np.abs(y - A @ theta) / y_std
        trust = 1 / (1 + (z / (3 * max(robust_std(z), 1.0))) ** 2)
    scatter = float(np.sum(trust * z**2)) / max(len(y) - A.shape[1], 1)
    return theta, trust / y_std**2 / max(scatter, 1.0), y_std


def without_rounding(y: Array, step2: Array, repeated: bool) -> Array:
    """Variances before the rounding to code values.

    y (K,): variances of values that are rounded to code values, light².
    step2 (K,): squared steps of the code values, light²; 0 for none.
    repeated: true for repeated measurements of the same light; else the rounding error is
        independent.
    """
    steps = np.maximum(step2, _TINY)
    if not repeated:
        return np.maximum(y - UNIFORM_VARIANCE * step2, 0)
    sigma2 = np.geomspace(0.02, 3.0, 400) ** 2  # beyond, the sum is negligible
    k = np.arange(1, 60)[:, None]
    same = np.sum(np.exp(-4 * np.pi**2 * k**2 * sigma2) / (2 * np.pi**2 * k**2), axis=0)
    seen = sigma2 + UNIFORM_VARIANCE - same
    inverse = np.interp(y / steps, seen, sigma2, left=0) * steps
    return np.where(y > seen[-1] * steps, y - UNIFORM_VARIANCE * step2, inverse)
