"""Other methods that estimate alpha, each a function of the pictures and its further inputs.

In this file `image` and `plate` are LinearImage of one size, C and B their light, and `truth` is the
true Layer: a method that takes it is tuned on it, which is impossible with a real picture. Every
method returns a Layer of the whole picture, alpha 0…1, except detectors, which return a mask. Libraries
are loaded by the function that needs them, so that the memory of a method contains no other.
"""

import warnings
from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt
from benchmarks.rendered import add_noise

from blurmatte.calibration import with_noise
from blurmatte.checks import Floats
from blurmatte.color import published_color_line
from blurmatte.layer import Layer
from blurmatte.matting import Pixelwise
from blurmatte.radiometry import LINEAR, SRGB, LinearImage, NoiseModel, Transfer
from blurmatte.rendering.processing import encode_codes
from blurmatte.streaks import require_streaks

Array = npt.NDArray[np.float64]
MattingMethod = Callable[..., Array]

STRONGEST = 99.5  # percentile of the difference in the streak at which a key has alpha 1
TRIMAP_RIM = 3  # pixels around the streak that are unknown in a trimap
OPAQUE = 0.99  # true alpha above which a trimap has foreground
RIDGE = 0.98  # of the largest alpha nearby: foreground where nothing is opaque
MARGIN = 24  # pixels of background around the streak, for matting
TRAINING_FRAMES = 50
_EQUAL = NoiseModel(read_std=1.0)


def nothing(image: LinearImage) -> Layer:
    """The empty layer, the baseline of every method."""
    return Layer(np.zeros(image.valid.shape), np.zeros(image.rgb.shape))


def difference_key(image: LinearImage, plate: LinearImage) -> Layer:
    """Alpha from Σ|C − B| over the channels, scaled so that its largest value in the streak is 1."""
    difference = _difference(image, plate)
    strongest = np.percentile(difference[require_streaks(image, plate)[0].mask], STRONGEST)
    return _with_light(np.clip(difference / strongest, 0, 1), image, plate)


def tuned_difference_key(image: LinearImage, plate: LinearImage, truth: Layer) -> Layer:
    """Alpha = gain · (Σ|C − B| − threshold), clipped; both such that Σ(α̂ − α)² is least."""
    difference = _difference(image, plate)
    plain = 1 / np.percentile(difference[truth.alpha > 0], STRONGEST)
    threshold, gain = _tuned(difference, truth.alpha, plain)
    return _with_light(np.clip(gain * (difference - threshold), 0, 1), image, plate)


def published(image: LinearImage, plate: LinearImage) -> Layer:
    """Color and alpha by the formulas of 2007, within the streak that blurmatte finds.

    Equation (5) has 6 equations for 5 unknowns and no weights. With two equal variances `Pixelwise`
    is its least-squares solution, and its premultiplied light lies on the color line.
    """
    mask = require_streaks(image, plate)[0].mask
    used = mask & image.valid & plate.valid
    model = published_color_line(image.rgb[used], plate.rgb[used])
    maps = Pixelwise()(image.rgb, plate.rgb, model, _EQUAL, _EQUAL)
    alpha = np.where(mask, np.clip(maps.alpha, 0, 1), 0)
    return Layer(alpha, np.where(alpha[..., None] > 0, np.maximum(maps.premultiplied, 0), 0))


def trimap_of(truth: Layer) -> Array:
    """0 away from the streak, 1 where the object is opaque or else on the ridge, 0.5 between.

    The ridge is where alpha is the largest within half the streak's width, the middle of the streak.
    """
    from scipy.ndimage import binary_dilation, distance_transform_edt, maximum_filter

    streak = truth.alpha > 0
    foreground = truth.alpha > OPAQUE
    if not foreground.any():
        reach = int(np.ceil(distance_transform_edt(streak).max()))
        nearby = maximum_filter(truth.alpha, size=2 * reach + 1)
        foreground = streak & (truth.alpha >= RIDGE * nearby)
    near = binary_dilation(streak, iterations=TRIMAP_RIM)
    return np.where(foreground, 1.0, np.where(near, 0.5, 0.0))


def matting(solver: MattingMethod, image: LinearImage, trimap: Array) -> Layer:
    """Alpha by a PyMatting solver, color by its estimate_foreground_ml: as documented.

    Its input is the picture around the streak, sRGB-coded as in its documentation.

    Raises
    ------
    ValueError
        If the solver does not converge.
    """
    return _matted(solver, image, trimap, SRGB, 1.0)


def best_matting(solver: MattingMethod, image: LinearImage, trimap: Array, truth: Layer) -> Layer:
    """The same times the true largest alpha, of the sRGB-coded or of the linear picture: the better.

    A trimap must contain foreground, and a faint streak has none: alpha is too large by a factor that
    only the truth gives.
    """
    peak = float(truth.alpha.max())
    both = [_matted(solver, image, trimap, curve, peak) for curve in (SRGB, LINEAR)]
    return min(both, key=lambda layer: float(np.sum((layer.alpha - truth.alpha) ** 2)))


def background_subtractor(
    subtractor: Any, image: LinearImage, plate: LinearImage, rng: int
) -> Array:
    """Where an OpenCV background subtractor, trained on noisy copies of the plate, detects change.

    The copies have the noise of the image, as blurmatte measures it, and 8 bits. 1 inside, 0 outside.
    """
    generator = np.random.default_rng(rng)
    noise = with_noise(image, plate)[0].noise
    assert isinstance(noise, NoiseModel)
    for _ in range(TRAINING_FRAMES):
        subtractor.apply(encode_codes(add_noise(plate.rgb, noise, generator), 8))
    seen = subtractor.apply(encode_codes(image.rgb, 8), learningRate=0)
    return np.asarray(seen > 0, float)


def _difference(image: LinearImage, plate: LinearImage) -> Array:
    return np.asarray(np.abs(image.rgb.astype(float) - plate.rgb).sum(axis=-1))


def _with_light(alpha: Array, image: LinearImage, plate: LinearImage) -> Layer:
    """The light that alpha leaves to the object: C − (1 − α) B, where it is not negative."""
    through = 1 - alpha[..., None]
    light = np.maximum(image.rgb - through * plate.rgb, 0)
    return Layer(alpha, np.where(alpha[..., None] > 0, light, 0))


def _tuned(difference: Array, alpha: Floats, plain: float) -> tuple[float, float]:
    """Threshold and gain of the least squared error; never worse than no threshold and `plain`."""
    from scipy.optimize import minimize

    def error(at: Array) -> float:
        return float(np.sum((np.clip(np.exp(at[1]) * (difference - at[0]), 0, 1) - alpha) ** 2))

    thresholds = np.percentile(difference[alpha > 0], [0, 10, 25, 50])
    starts = [np.array([t, np.log(plain * g)]) for t in (0, *thresholds) for g in (1, 0.5, 0.25)]
    best = minimize(error, min(starts, key=error), method="Nelder-Mead").x
    return float(best[0]), float(np.exp(best[1]))


def _matted(
    solver: MattingMethod, image: LinearImage, trimap: Array, curve: Transfer, peak: float
) -> Layer:
    """Alpha times `peak` and its light; the solver sees light coded by `curve`."""
    from pymatting import estimate_foreground_ml

    place = _around(trimap > 0)
    seen = np.clip(curve.encode(np.clip(image.rgb[place].astype(float), 0, 1)), 0, 1)
    with warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("ignore")
        alpha = peak * np.asarray(solver(seen, trimap[place]), float)
        color = np.asarray(estimate_foreground_ml(seen, alpha), float)
    if not np.isfinite(alpha).all():
        raise ValueError("alpha is not finite")
    layer = nothing(image)
    layer.alpha[place] = alpha
    layer.premultiplied[place] = alpha[..., None] * curve.decode(color)
    return layer


def _around(near: npt.NDArray[np.bool_]) -> tuple[slice, slice]:
    """Rows and columns of the box around a mask, with a margin."""
    lines = (np.flatnonzero(near.any(axis=axis)) for axis in (1, 0))
    rows, columns = (slice(max(0, int(n[0]) - MARGIN), int(n[-1]) + 1 + MARGIN) for n in lines)
    return rows, columns
