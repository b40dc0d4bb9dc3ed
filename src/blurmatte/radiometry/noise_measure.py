"""Measuring a camera's noise: from frames of a still scene, from an even region, against a plate."""

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from blurmatte.checks import Bools
from blurmatte.errors import NoiseError
from blurmatte.radiometry.blocks import coherence
from blurmatte.radiometry.image import LinearImage, check_picture
from blurmatte.radiometry.noise import NoiseModel, plate_share, rounding_noise
from blurmatte.radiometry.noise_fit import NoiseFit, fit_sensor, without_rounding
from blurmatte.radiometry.noise_samples import (
    Array,
    Sample,
    noise_of_frames,
    noise_within,
    parts_by_light,
    require_pixels,
    rows_to_measure,
)

_EACH = 200  # pixels at least, to tell a variance at some level of light
_QUIET = 0.25  # of the pixels: that few need to be still to begin with
_ROUNDS = 8  # of leaving out what is far beyond the noise of the rest
_RARE = 6e-5  # of noise, what is beyond four standard deviations
_PATCH = 7  # pixels: what changes does so in more than one
_LOWEST, _LOWEST_SIGMAS = 0.1, 1.28  # part of the patches, and how far below the mean it is
_CLEARLY = 5.0  # standard deviations of a patch's mean
_MOST_CHANGED = 0.5  # of the pixels
_ODD = 2.0  # times the curve: so much is typical of no level of light
_NEAR_END = 3.0  # standard deviations: so near to black or white, noise is cut off
_NO_NOISE = 1e-14  # light squared, what rounding of 32-bit floats makes
_NOTHING = 1e-20  # light squared, or a share: lest zero is divided by
_AROUND = 5  # pixels over which the light is averaged that noise depends on


def measure_noise(frames: Iterable[LinearImage], still: Bools | None = None) -> NoiseFit:
    """Measure a camera's noise from frames of a still scene, taken alike.

    Each frame is compared with the one before, so that light which slowly changes does no harm; nor
    does light that flickers. Pixels that are clipped in any frame are left out, and those where
    something moved. No more than two frames are in memory at a time.

    Parameters
    ----------
    frames : iterable of LinearImage
        Two or more of the same size, with dark and bright parts.
    still : (H, W) bool, optional
        Where to look; everywhere if not given.

    Returns
    -------
    NoiseFit

    Raises
    ------
    TypeError, ValueError
        For fewer than two frames, different sizes, or a `still` that is not (H, W) bool.
    NoiseError
        If the frames do not tell: the camera moved or more than half of what it saw, all is clipped,
        exposures differ, or frames are copies.
    """
    return _fitted(noise_of_frames(frames, still))[0]


def measure_noise_against(
    picture: LinearImage, plate: LinearImage, still: Bools | None = None
) -> NoiseFit:
    """Measure a picture's noise from its difference to a plate, where nothing moved.

    Unlike a second frame the plate may have less noise than the picture, as an average has. How much
    of the difference is whose shows in the fine structure, as for `fit_noise`.

    Parameters
    ----------
    picture, plate : LinearImage
        Of the same size, with dark and bright parts.
    still : (H, W) bool, optional
        Where to look; everywhere if not given.

    Returns
    -------
    NoiseFit
        Of the picture.

    Raises
    ------
    TypeError, ValueError, NoiseError
        As for `measure_noise`.
    """
    check_picture("picture", picture)
    check_picture("plate", plate)
    sample = noise_of_frames([plate, picture], still)
    fit, typical, believed = _fitted(sample)
    rows = rows_to_measure(picture)
    C, B = (np.asarray(p.rgb[rows], float) for p in (picture, plate))
    share, share_std = plate_share(C, B, 2 * typical + _NOTHING, believed)
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

    Light is taken to be a parabola over 32 pixels; what goes beyond that is taken for noise. Edges and
    specks are left out, if most of the region has none. Texture all over it is not: then this is an
    upper bound, and so it is for pixels that are unequal, which frames do not show. Noise of a
    `scale` of many pixels comes out too small, by 6 (scale / 32)² of itself.

    Parameters
    ----------
    picture : LinearImage
    region : (H, W) bool
        Where light changes slowly. Gain and read noise are told apart only if some of it is dark and
        some bright; else their errors are as large as they are.

    Returns
    -------
    NoiseFit

    Raises
    ------
    TypeError, ValueError
        If `region` is not (H, W) bool, or empty.
    NoiseError
        If the region is too small, clipped, or has no noise.
    """
    check_picture("picture", picture)
    return _fitted(noise_within(picture, region))[0]


def _fitted(sample: Sample) -> tuple[NoiseFit, Array, Bools]:
    """The fit, (H, W, 3) about what variance the pixels have, and which of them were believed."""
    light = _light(sample)
    typical, believed, changed = _believed(sample, light)
    everywhere = np.asarray(believed.all(axis=-1))
    together = coherence(sample.v / (typical + _NOTHING) - 1, everywhere).max(axis=-1)
    channels = [
        _channel(light, sample, believed, c, max(float(together[c]), 1.0)) for c in range(3)
    ]
    theta, covariance, x, y, y_std = (list(parts) for parts in zip(*channels, strict=True))
    fit = NoiseFit(
        NoiseModel.from_coefficients(np.array(theta)),
        sample.rounding,
        np.array(covariance),
        tuple(x),
        tuple(y),
        tuple(y_std),
        coherence(sample.e / np.sqrt(typical + _NOTHING), everywhere),
        changed,
    )
    return fit, typical, believed


def _believed(sample: Sample, light: Array) -> tuple[Array, Bools, float]:
    """(H, W, 3) typical variances, which pixels to believe, and which share had changed."""
    typical = np.stack([_typical(light[..., c], sample, c) for c in range(3)], axis=-1)
    if not all((typical[..., c] > _NO_NOISE)[sample.use[..., c]].any() for c in range(3)):
        raise NoiseError(
            "there is no noise: the pictures are copies of one, or of even areas without any noise; "
            "give pictures as the camera took them"
        )
    _, believed = _unchanged(sample, typical)
    require_pixels(believed)
    # Where most pixels of some light changed, other light tells what is typical of that.
    curve = NoiseModel.from_coefficients(
        np.array([_channel(light, sample, believed, c)[0] for c in range(3)])
    )
    typical = np.minimum(typical, _ODD * (curve.variance(light) + sample.step**2 / 12))
    changed, believed = _unchanged(sample, typical)
    believed &= _clear_of_ends(sample, light, typical)
    require_pixels(believed)
    return typical, believed, changed


def _light(sample: Sample) -> Array:
    """(H, W, 3) light, less of its own noise: by that, pixels would be sorted into wrong levels.

    Light comes the nearer to the mean of its neighborhood the less it differs there by more than
    noise (J.-S. Lee, *Digital image enhancement and noise filtering by use of local statistics*, IEEE
    Trans. PAMI 2, 1980).
    """
    from scipy.ndimage import uniform_filter

    size = (_AROUND, _AROUND, 1)
    weight = np.maximum(uniform_filter(sample.use.astype(float), size), _NOTHING)

    def mean(x: Array) -> Array:
        return np.asarray(uniform_filter(np.where(sample.use, x, 0), size) / weight)

    around = mean(sample.light)
    differs = np.maximum(mean(sample.light**2) - around**2, _NOTHING)
    own = np.clip(1 - mean(sample.v) / sample.frames / differs, 0, 1)
    return np.asarray(around + own * (sample.light - around))


def _typical(light: Array, sample: Sample, c: int) -> Array:
    """(H, W) variance that pixels of like light mostly have, in spite of those that changed."""
    from scipy.stats import chi2

    use = sample.use[..., c]
    x, v, step2 = light[use], sample.v[..., c][use], sample.step[..., c][use] ** 2
    low = chi2.ppf(_QUIET, sample.freedom) / sample.freedom
    far = chi2.isf(_RARE, sample.freedom) / sample.freedom
    at, levels = [], []
    for piece in parts_by_light(x, _EACH):
        w, step = v[piece], float(np.mean(step2[piece]))
        s2 = max(float(np.quantile(w, _QUIET)) / low, step / 12)
        for _ in range(_ROUNDS):
            # Rounding may make a whole step of nothing.
            near = w[w <= far * s2 + step]
            s2 = float(np.mean(near)) if len(near) else s2
        at.append(float(np.median(x[piece])))
        levels.append(s2)
    return np.asarray(np.interp(light, at, levels))


def _unchanged(sample: Sample, typical: Array) -> tuple[float, Bools]:
    """Share of pixels where more than noise changed, and (H, W, 3) the others but for outliers."""
    from scipy.ndimage import uniform_filter
    from scipy.stats import chi2

    far = chi2.isf(_RARE, sample.freedom) / sample.freedom
    limit = far * typical + sample.step**2
    use = np.asarray(sample.use.all(axis=-1))
    size = (_PATCH, _PATCH)
    ratio = (np.minimum(sample.v, limit) / (typical + _NOTHING)).mean(axis=-1)
    part = uniform_filter(use.astype(float), size)
    patch = uniform_filter(np.where(use, ratio, 0), size) / np.maximum(part, _NOTHING)
    below = 1 - float(np.quantile(patch[use], _LOWEST)) if use.any() else 0.0
    white = float(np.sqrt(2 / (3 * sample.freedom * _PATCH**2)))
    changed = patch > 1 + _CLEARLY * max(below / _LOWEST_SIGMAS, white)
    share = float(np.mean(changed[use])) if use.any() else 0.0
    if share > _MOST_CHANGED:
        raise NoiseError(
            f"{share:.0%} of the picture changed by more than noise; the scene and the camera must "
            "stay still, or say where they do"
        )
    return share, sample.use & ~changed[..., None] & (sample.v <= limit)


def _clear_of_ends(sample: Sample, light: Array, typical: Array) -> Bools:
    """(H, W, 3) where the noise of a file's light ends neither at black nor at white."""
    reach = _NEAR_END * np.sqrt(typical)
    return np.asarray((sample.step == 0) | ((light > reach) & (light < 1 - reach)))


def _channel(
    light: Array, sample: Sample, believed: Bools, c: int, together: float = 1.0
) -> tuple[Array, Array, Array, Array, Array]:
    """Of one channel: coefficients, their covariance, and the levels they are fitted to."""
    some = believed[..., c]
    x, v, step2 = (a[..., c][some] for a in (light, sample.v, sample.step**2))
    pieces = parts_by_light(x, _EACH)
    at, whole, steps = (np.array([np.mean(a[p]) for p in pieces]) for a in (x, v, step2))
    scatter = np.mean([np.std(v[p]) for p in pieces] / (whole + _NOTHING))
    spread = scatter * np.sqrt(together / np.array([len(p) for p in pieces]))
    y = without_rounding(whole, steps, sample.repeated)
    theta, covariance, y_std = fit_sensor(at, y, spread, steps / 12)
    return theta, covariance, at, y + steps / 12, y_std
