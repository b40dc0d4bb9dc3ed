"""The noise of image and plate, measured from their difference.

In this file C is the image's light, B the plate's, and d = C − B.
"""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import scipy

from blurmatte.checks import Bools, Floats, check_map, check_same_size
from blurmatte.radiometry import (
    LinearImage,
    NoiseModel,
    are_gray,
    check_picture,
    counted_once,
    rounding_noise,
)
from blurmatte.radiometry.image import VARIANCE_FLOOR
from blurmatte.radiometry.noise_model import fit_coefficients
from blurmatte.statistics import MAD_TO_STD, robust_std


def fit_noise(
    image: LinearImage, plate: LinearImage, still: Bools | None = None
) -> tuple[NoiseModel, NoiseModel]:
    """Measure the noise of image and plate from their difference where nothing moved.

    The variance of the difference at several levels of light is fitted by a `NoiseModel`. Its division
    between the pictures follows from their fine structure: both contain that of the scene, so the
    covariance of the difference with the image's is the image's noise variance.

    Parameters
    ----------
    image, plate : LinearImage
        The same size.
    still : (H, W) bool, optional
        Where nothing moved. By default outliers of the difference are rejected, and places where the
        differences of neighbors have a common sign; up to about a third of the picture may change.

    Returns
    -------
    tuple of NoiseModel
        Noise of the image and of the plate.

    Raises
    ------
    TypeError, ValueError
        If the sizes differ, or `still` is not (H, W) bool.

    Examples
    --------
    >>> of_image, of_plate = bm.calibration.fit_noise(image, plate)
    >>> print(of_image)
    NoiseModel(std 0.002 at light 0.2)
    """
    check_picture("image", image)
    check_picture("plate", plate)
    check_same_size("image", image.size, "plate", plate.size)
    rows = slice(None, None, max(1, round(image.valid.size / 5e5)))  # half a million pixels
    C, B = (picture.rgb[rows].astype(float) for picture in (image, plate))
    usable = image.valid[rows] & plate.valid[rows]
    least = [rounding_noise(picture).coefficients for picture in (image, plate)]
    if still is not None:
        still = check_map("still", still, image.valid.shape, kinds="b")
        usable &= still[rows]
    else:
        few = slice(None, None, 4)
        first, _ = _fit_total(B[few], (C - B)[few], usable[few], least[0] + least[1])
        usable &= _quiet(C - B, first.variance(B) + VARIANCE_FLOOR, usable)
    model, kept = _fit_total(B, C - B, usable, least[0] + least[1])
    share, _ = plate_share(C, B, model.variance(B) + VARIANCE_FLOOR, kept)
    total = model.coefficients
    return (
        NoiseModel.from_coefficients(np.maximum((1 - share) * total, least[0])),
        NoiseModel.from_coefficients(np.maximum(share * total, least[1])),
    )


def _quiet(d: Floats, s2: Floats, usable: Bools) -> Bools:
    """(H, W) where the mean of d over 7 x 7 pixels is no outlier among such means."""
    if not usable.any():
        return usable
    z = np.where(usable[..., None], d, 0) / np.sqrt(s2)
    mean = np.abs(scipy.ndimage.uniform_filter(z, size=(7, 7, 1)))
    medians = np.median(np.ascontiguousarray(mean[usable].T), axis=1)  # of contiguous rows: faster
    usual = np.maximum(MAD_TO_STD * medians, 1 / 7)  # 1/7 is that of white noise
    return np.asarray((mean <= 4 * usual).all(axis=-1))


def _fit_total(
    light: Floats, difference: Floats, usable: Bools, least: Floats
) -> tuple[NoiseModel, Bools]:
    """Noise of the difference, and (H, W, 3) which of its values are inliers."""
    total, kept = np.empty((3, 3)), np.zeros(light.shape, bool)
    for c in range(3):
        x, d = light[..., c], difference[..., c]
        cut_off = (x == 0) | (x + d == 0)  # noise is truncated at black
        lowest = 2.0 if np.mean(cut_off) > 0.01 else 0.0
        total[c], kept[..., c] = _fit_channel(x, d, usable & ~cut_off, least[c], lowest)
    return NoiseModel.from_coefficients(total), kept


def _fit_channel(
    light: Floats, difference: Floats, usable: Bools, least: Floats, lowest: float
) -> tuple[Floats, Bools]:
    """Coefficients of the variance of one channel's difference, and (H, W) its inliers.

    Light below `lowest` times its standard deviation is not used if there is any other.
    """
    x, d = light[usable], difference[usable]
    kept = np.zeros(usable.shape, bool)
    if len(x) == 0:
        return least, kept
    order = np.argsort(x)
    x, d = x[order], d[order]
    edges = x[(np.linspace(0, 1, 25)[1:-1] * (len(x) - 1)).astype(int)]
    cuts = np.unique([0, *np.searchsorted(x, edges, side="right"), len(x)])
    inside = np.zeros(len(x), bool)
    level, variance, count = [], [], []
    for start, stop in pairwise(cuts):
        at = max(float(np.median(x[start:stop])), 0.0)
        inliers, scatter = _clipped_scatter(d[start:stop], float(np.polyval(least[::-1], at)))
        inside[order[start:stop][inliers]] = True
        level.append(at)
        variance.append(scatter + VARIANCE_FLOOR)
        count.append(inliers.sum())
    kept[usable] = inside
    # Relative errors: √(2 / count) of a sample variance, about a tenth of the model.
    weight = (2 / np.maximum(count, 1) + 0.1**2) ** -0.5
    x, variances = np.array(level), np.array(variance)
    clear = x >= lowest * np.sqrt(variances)
    some = clear if clear.any() else ~clear
    return fit_coefficients(x[some], variances[some], weight[some]), kept


def _clipped_scatter(d: Floats, least: float) -> tuple[Bools, float]:
    """Inliers of `d` within four sigma, and their second moment about zero, by iteration."""
    sizes = np.sort(np.abs(d))
    sums = np.cumsum(sizes**2)
    s2, limit = max(robust_std(d) ** 2, least), np.inf
    for _ in range(4):
        limit = 4 * float(np.sqrt(s2))
        count = int(np.searchsorted(sizes, limit, side="right"))
        s2 = max(float(sums[count - 1]) / count if count else s2, least)
    return np.asarray(np.abs(d) <= limit), s2


def plate_share(C: Floats, B: Floats, s2: Floats, kept: Bools) -> tuple[float, float]:
    """The plate's share of the variance of C − B, and the standard deviation of that share.

    From E[(C − B) · fine structure of C] = σ_C². The scene's fine structure is noise in this estimate:
    pixels are weighted down by that of the next row, whose noise is independent, and the estimate is
    combined with a prior of 0.5 ± 0.3.

    C, B (H, W, 3): light.
    s2 (H, W, 3): variance of C − B, light².
    kept (H, W, 3): inliers.
    """
    of_C, of_B = _fine_structure(C), _fine_structure(B)
    scene = np.roll((of_C + of_B) / 2, 1, axis=0)
    weight = np.where(kept[:, 1:-1], 1 / (s2[:, 1:-1] + scene**2), 0)
    d = (C - B)[:, 1:-1] * weight
    of_image, of_plate = d * of_C, -d * of_B
    both, prior = float(np.sum(of_image + of_plate)), 0.3**2
    if not both > 0.1 * float(np.sum(s2[:, 1:-1] * weight)):
        return 0.5, prior**0.5  # no noise, or too smooth to separate it from the scene
    share = float(np.sum(of_plate)) / both
    variance = float(np.sum(((1 - share) * of_plate - share * of_image) ** 2)) / both**2
    mean = (share * prior + 0.5 * variance) / (prior + variance)
    return float(np.clip(mean, 0, 1)), (prior * variance / (prior + variance)) ** 0.5


def _fine_structure(x: Floats) -> Floats:
    """(H, W - 2, ...) half the negative second difference along rows."""
    fine: Floats = x[:, :-2] + x[:, 2:]
    fine *= -0.5
    fine += x[:, 1:-1]
    return fine


def with_noise(image: LinearImage, plate: LinearImage) -> tuple[LinearImage, LinearImage]:
    """Image and plate with known noise; unknown noise is measured by `fit_noise`.

    Where nothing moves, frames of a clip repeat errors of the codec. Where something does, a frame has
    its own, which no difference shows: they are in its noise as well, at the light of the plate, since
    the errors of its own light would be in its weights.

    The noise of gray pictures counts once (`Meta.one_channel`).
    """
    check_picture("image", image)
    check_picture("plate", plate)
    if image.noise is None or plate.noise is None:
        of_image, of_plate = fit_noise(image, plate)
        if image.noise is None:
            image = with_coding_errors(image, plate.with_noise(of_image))
        plate = plate if plate.noise is not None else plate.with_noise(of_plate)
    if are_gray(image, plate):
        return counted_once(image), counted_once(plate)
    return image, plate


def with_coding_errors(image: LinearImage, plate: LinearImage) -> LinearImage:
    """The image with the noise that its plate is given and, of a clip, with errors of moving blocks."""
    coding = image.meta.coding
    error = None if coding is None else coding.variance(plate.rgb)
    return replace(image, noise=plate.noise if error is None else plate.variance + error)
