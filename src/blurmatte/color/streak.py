"""The color line from the streak: hue variation and feasibility; and the streak that has a color.

The published sum of squares (`published_color_line`) is biased to the plate's color by noise. Here
every direction of a line of colors has a likelihood from two kinds of evidence (`evidence.py`); the
estimate is the posterior mean and covariance. For a plate of one hue the color is not
determined, which raises ColorModelError.

Chroma subsampling mixes the colors of object and plate at rims, which biases a color estimated from
hues by a degree or two for thin objects. If the compression is known, a picture with the estimated
color is rendered and compressed in the same way. The error of the estimate from it, whose color is
known, estimates that of the image.

In the published sum C and B are the light of image and plate at n pixels of the streak, and m = C × B.

In the projection C and B are their linear light (H, W, 3), l (3,) is the unit direction of the object's
color, and p (H, W) the amount of light along l. C = p l + (1 − α) B is solved for p for
any α by the vector in the plane of l and B that is perpendicular to B:

    m = (l − (l·b) b) / (1 − (l·b)²),   b = B / |B|,   p = m·C.

Shadows, and objects of the plate's hue, have p = 0.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import scipy

from blurmatte.calibration import with_noise
from blurmatte.checks import Array, Bools, Floats, Floats32, check_same_size, rows_columns
from blurmatte.color.evidence import (
    SLACK,
    EvidenceKinds,
    StreakPixels,
    closed_form,
    misfit,
    posterior,
)
from blurmatte.color.model import ColorModel, unit
from blurmatte.errors import ColorModelError
from blurmatte.radiometry import SRGB, LinearImage, are_gray, check_same_colors
from blurmatte.radiometry.compression import MACROBLOCK
from blurmatte.radiometry.image import VARIANCE_FLOOR
from blurmatte.streaks import Streak, check_streak, require_streaks, shift_variance

_IF_ROUND = "; if it is round and of several colors, allow any (--rank 3, ColorModel.any())"

# Requirements on pixels, and limits of an accepted fit.
# Usable pixels of a streak, and those selected of a larger one
_MIN_PIXELS = 20
_MAX_PIXELS = 2500
_MAX_ANGLE_STD_DEG = 3.0  # standard deviation of the direction
# The same over the angle to the plate's hue: the relative error of alpha
_MAX_SCALE_STD = 0.2
# Residual over the change between plate and image; one paint leaves 0.05, two 0.13
_MAX_UNEXPLAINED = 0.1
_MAX_INFEASIBLE = 0.05  # fraction of pixels with infeasible alpha or light
# Quantization step of coarsely compressed chroma, codes; quality 95 has 10
_MIN_COARSE_STEP = 15.0
_MIN_COARSE_BLOCKS = 3  # coded units of such a file that a streak must cover
_RECOMPRESSIONS = 2  # images rendered for the error of compression
_RECOMPRESSION_MARGIN_PX = 24  # surroundings of the streak in these


def fit_color_from_hues(
    image: LinearImage,
    plate: LinearImage,
    streak: Streak | None = None,
    max_brightness: float = np.inf,
) -> ColorModel:
    """Estimate the object's line of colors from its streak (in place of [GC07 §3.1]).

    image, plate: the same size; unknown noise is measured.
    streak: where the object moved; by default the strongest of `find_streaks`.
    max_brightness: upper bound of the object's largest channel, linear light, 1 = sensor white. An
        object that would be clipped at rest is brighter than 1, so the default is no bound.

    Returns ColorModel: rank 1, with the covariance of its direction, and its error from each kind
    of evidence. Raises ColorModelError if the streak does not determine the color, or no single
    line fits it. Raises MotionError if no streak was given and nothing moved.
    """
    check_color_fit(image, plate, streak, max_brightness)
    image, plate = with_noise(image, plate)
    if streak is None:
        streak = require_streaks(image, plate)[0]
    pixels = _streak_pixels(image, plate, streak)
    both = EvidenceKinds(True, True, max_brightness)
    l, covariance = posterior(both, pixels)
    spread = {
        "hue variation": posterior(replace(both, feasibility=False), pixels),
        "feasibility": posterior(replace(both, hue=False), pixels),
    }
    if image.meta.sharing is not None:
        by_file = _compression_covariance(l, both, image, plate, streak)
        covariance, spread["compression"] = covariance + by_file, (l, by_file)
    evidence = {name: ColorModel(m[:, None], c).angle_std for name, (m, c) in spread.items()}
    model = ColorModel(l[:, None], covariance, evidence, image.meta.to_srgb)
    _check_determined(model, pixels)
    _check_fit(model, pixels)
    return model


def check_color_fit(
    image: LinearImage, plate: LinearImage, streak: Streak | None, max_brightness: float
) -> None:
    """Raise unless the arguments of a color fit are valid."""
    check_same_colors("the image", image, "the plate", plate)
    check_same_size("image", image.size, "plate", plate.size)
    check_not_gray(image, plate)
    check_streak("streak", streak)
    if not max_brightness > 0:
        raise ValueError(f"max_brightness must be positive, got {max_brightness}")


def check_not_gray(image: LinearImage, plate: LinearImage) -> None:
    """Raise ColorModelError if a file has one channel, or both pictures are gray."""
    if are_gray(image, plate):
        gray = [p for p in (image, plate) if p.meta.gray] or [image]
        raise ColorModelError(
            f"{gray[0].meta.source or 'a picture'} is gray: colors, and alpha from colors, need hues; "
            "give pictures in color. Single gray pictures can be solved by shape alone, without a color"
        )


def check_chroma_resolution(image: LinearImage, streak: Streak) -> None:
    """Raise ColorModelError if the image's file holds too little chroma of a small streak.

    Coarsely quantized and subsampled chroma has few coefficients for a rim; wrong shapes and colors
    then fit it as well as right ones.
    """
    file = image.meta.sharing
    if file is None or np.median(file.chroma) < _MIN_COARSE_STEP:
        return
    pixels, (w, h) = np.count_nonzero(streak.mask), file.mcu
    needed = _MIN_COARSE_BLOCKS
    if pixels < needed * w * h:
        raise ColorModelError(
            f"the streak covers {pixels} pixels, less than {needed} blocks of {w} by {h} in which this "
            "JPEG holds color, too few to determine a shape or a color; give the object's color "
            "(--color, model=), or take it larger, raw, as PNG, or as a JPEG of higher quality"
        )


def _streak_pixels(image: LinearImage, plate: LinearImage, streak: Streak) -> StreakPixels:
    """A regular selection of the streak's usable pixels, by blocks in which JPEG correlates noise."""
    box = streak.around(MACROBLOCK)
    image, plate = image.crop(box), plate.crop(box)
    inside = streak.mask[rows_columns(box)]
    usable = image.valid & plate.valid
    used = inside & usable
    # Noise truncated at black has a positive mean, which looks like color. By the image's noise for
    # both: a plate of many frames has little noise, but its frames were truncated.
    for picture in (image, plate):
        used &= (picture.rgb > 2 * np.sqrt(image.variance)).all(axis=-1)
    y, x = np.nonzero(used)
    if len(y) < _MIN_PIXELS:
        raise ColorModelError(
            f"only {len(y)} pixels of the streak are neither clipped nor before a black plate, "
            f"{_MIN_PIXELS} are needed; give the color (--color, model=), or change exposure"
        )
    step = max(1, -(-len(y) // _MAX_PIXELS))
    y, x = y[::step], x[::step]
    # Blocks on the grid of JPEG, which starts at the picture's corner.
    at = np.stack([y + box[1], x + box[0]], axis=1)
    blocks, block = np.unique(at // MACROBLOCK, axis=0, return_inverse=True)
    _, tile = np.unique(at // _tile(step), axis=0, return_inverse=True)
    order = np.lexsort((tile, block))
    y, x = y[order], x[order]
    C, B, vC, vB = (
        np.asarray(a[y, x], dtype=float)
        for a in (
            image.rgb, plate.rgb, image.variance,
            plate.variance + shift_variance(image, plate, usable & ~inside),
        )
    )  # fmt: skip
    least = 1e-12  # light², of float32
    apart = np.abs(blocks[:, None] - blocks[None]).sum(axis=-1)
    first, second = np.nonzero(np.triu(apart == 1))
    return StreakPixels(C, B, vC + least, vB + least, block[order], tile[order], (first, second))


def _compression_covariance(
    l: Array, evidence: EvidenceKinds, image: LinearImage, plate: LinearImage, streak: Streak
) -> Array:
    """(3, 3) covariance from compression of the image; see `recompressed`."""
    box = streak.around(_RECOMPRESSION_MARGIN_PX)
    image, plate = image.crop(box), plate.crop(box)
    streak = replace(streak, mask=streak.mask[rows_columns(box)])
    count = _RECOMPRESSIONS
    images, behind = recompressed(l, image, plate, streak, count)
    found = [posterior(evidence, _streak_pixels(again, behind, streak))[0] for again in images]
    off = np.array(found) - l
    return np.asarray(off.T @ off / count)


def _tile(step: int) -> int:
    """Width of a tile that divides a block and holds 8 or more of every `step`-th pixel."""
    return next((size for size in (4, 8) if size**2 >= 8 * step), MACROBLOCK)


def _check_determined(model: ColorModel, pixels: StreakPixels) -> None:
    """Raise ColorModelError if the direction is too uncertain."""
    B = pixels.B / np.linalg.norm(pixels.B, axis=1, keepdims=True)
    near = float(np.degrees(np.sqrt(np.mean(np.arccos(np.clip(B @ model.pole, -1, 1)) ** 2))))
    if model.angle_std <= min(_MAX_ANGLE_STD_DEG, _MAX_SCALE_STD * near):
        return
    spread = np.degrees(np.sqrt(np.mean(1 - np.clip(B @ unit(B.mean(axis=0)), -1, 1) ** 2)))
    said = ", ".join(f"{name} leaves {std:.1f}°" for name, std in model.evidence.items())
    why = f"{said}; the plate's hue is {near:.0f}° away and varies by {spread:.1f}° behind it"
    several = misfit(model.pole, pixels) > 9
    if several:
        why += "; the colors do not lie on one line: a highlight, a second color, or a shadow"
    possible = model.possible
    raise ColorModelError(
        f"the object's color is uncertain by {model.angle_std:.1f}°, from "
        f"{possible[1].hex[0]} to {possible[5].hex[0]} ({why}): give the "
        "color (--color, model=), pick pixels of the object where it is sharp or opaque, or bound "
        "its brightness" + _IF_ROUND * several
    )


def residual_of_second_hue(
    image: LinearImage, plate: LinearImage, streak: Streak, model: ColorModel
) -> float | None:
    """What a line of colors leaves of the change of light, if as much as of an object of two paints.

    None if it is less, or too few pixels show it. A part of the change, root mean square.
    """
    try:
        residual = _residual(model, _streak_pixels(*with_noise(image, plate), streak))
    except ColorModelError:
        return None
    return residual if residual > _MAX_UNEXPLAINED else None


def _residual(model: ColorModel, pixels: StreakPixels) -> float:
    """Residual over the change between plate and image, root mean square, without their noise."""
    a = closed_form(model.basis.T, pixels)
    unexplained = float(np.sum(a.r**2 - a.r_std**2))
    moved = float(np.sum((pixels.C - pixels.B) ** 2 - pixels.vC - pixels.vB))
    return float(np.sqrt(max(unexplained, 0) / moved)) if moved > 0 else 0.0


def _check_fit(model: ColorModel, pixels: StreakPixels) -> None:
    """Raise ColorModelError if a line does not fit the pixels, or many are infeasible."""
    a, residual = closed_form(model.basis.T, pixels), _residual(model, pixels)
    infeasible = np.maximum(-a.alpha, a.alpha - 1) > np.maximum(3 * a.alpha_std, 2 * SLACK)
    negative = 2 * SLACK * np.linalg.norm(pixels.B, axis=1)
    infeasible |= -a.k > np.maximum(3 * a.k_std, negative)
    if residual > _MAX_UNEXPLAINED or np.mean(infeasible) > _MAX_INFEASIBLE:
        raise ColorModelError(
            "no single color explains the streak: the best fit leaves a residual of "
            f"{residual:.0%} of the change, and {np.mean(infeasible):.0%} "
            "of the pixels with an impossible alpha or light; give the colors of the object (--color, "
            "model=; two with rank 2), or a region with one object and without its shadow"
            + _IF_ROUND
        )


def recompressed(
    l: Array, image: LinearImage, plate: LinearImage, streak: Streak, count: int
) -> tuple[list[LinearImage], LinearImage]:
    """Images of a line of colors, and the plate, compressed as the image was.

    The plate is compressed once more in the same way, so that it has the same relation to the rendered
    images as before to the image. The error of a color needs files with random noise, before there is a
    sweep; `sweep.fit.codec_loss` predicts the mean effect of a file on a sweep.

    l (3,): unit direction of the line.
    image, plate: the surroundings of the streak, with known noise.
    streak: where the object moved; elsewhere the plate is rendered.
    count: number of images, which differ in their noise. The draws are seeded.
    """
    compression, transfer = image.meta.sharing, image.meta.transfer or SRGB
    assert compression is not None
    light = _rendered(l, image, plate, streak)
    codes, noise = transfer.encode(light), np.sqrt(image.variance) / transfer.slope(light)
    normal = [np.random.default_rng(seed).normal(size=light.shape) for seed in range(count)]
    files = [compression.once(codes + noise * z) for z in normal]
    behind = transfer.encode(np.asarray(plate.rgb, float))
    files.append(compression.expected(behind, float(np.median(noise))))
    *images, behind = (transfer.decode(file).astype(image.rgb.dtype) for file in files)
    return [replace(image, rgb=rgb) for rgb in images], replace(plate, rgb=behind)


def _rendered(l: Array, image: LinearImage, plate: LinearImage, streak: Streak) -> Array:
    """(h, w, 3) light of an object of the line, with alpha and brightness estimated by pixel.

    Both are smoothed, so that the rendering has no noise.
    """
    sigma = 1.5  # pixels
    C, B = (np.asarray(picture.rgb, float) for picture in (image, plate))
    across = B - (B @ l)[..., None] * l
    length2 = np.einsum("yxc,yxc->yx", across, across)
    lost = length2 - np.einsum("yxc,yxc->yx", C, across)
    alpha = scipy.ndimage.gaussian_filter(lost, sigma) / np.maximum(
        scipy.ndimage.gaussian_filter(length2, sigma), 1e-12
    )
    alpha = np.clip(np.where(streak.mask, alpha, 0), 0, 1)
    k = scipy.ndimage.gaussian_filter((C - (1 - alpha)[..., None] * B) @ l, sigma)
    k = np.maximum(np.where(streak.mask, k, 0), 0)
    return np.asarray(k[..., None] * l + (1 - alpha)[..., None] * B)


def published_color_line(image_colors: Floats, plate_colors: Floats) -> ColorModel:
    """The line through black nearest to the lines C–B of all pixels ([GC07 §3.1]).

    Black, C and B span a plane that contains the object's color, so the line is perpendicular to every
    m = C × B: it is m₁ × m₂ for two pixels, and the eigenvector of Σ m mᵀ with the least eigenvalue
    for more. Exact without noise. Noise of the image adds σ²(|B|² I − B Bᵀ) to each m mᵀ, whose least
    eigenvector is the plate's color, and noise of the plate the same with the image's color.
    `fit_color` has no such bias.

    Parameters
    ----------
    image_colors, plate_colors : (n, 3) float
        Linear light of image and plate at n >= 2 pixels of the streak.

    Returns
    -------
    ColorModel
        Rank 1. The paper gives no error, so the covariance is zero.

    Raises
    ------
    ValueError
        For fewer than two pixels, or shapes that differ.

    Examples
    --------
    >>> inside = solution.streak
    >>> model = bm.color.published_color_line(image.rgb[inside], plate.rgb[inside])
    >>> model.hex
    ('#ffc047',)
    """
    C, B = (np.asarray(a, dtype=float).reshape(-1, 3) for a in (image_colors, plate_colors))
    if C.shape != B.shape or len(C) < 2:
        raise ValueError(
            f"two or more pixels of both pictures are needed, got {len(C)} of the image and "
            f"{len(B)} of the plate"
        )
    m = np.cross(C, B)
    line = np.linalg.eigh(m.T @ m)[1][:, :1]
    return ColorModel(line if line.sum() > 0 else -line)


def projection_vectors(plate: LinearImage, model: ColorModel) -> Floats32:
    """The vectors m (H, W, 3) that project an image on a color, p = m·C; the model has rank 1."""
    l, B = model.basis[:, 0].astype(np.float32), np.asarray(plate.rgb, np.float32)
    b = B / np.maximum(np.linalg.norm(B, axis=-1, keepdims=True), 1e-6)
    along = b @ l
    across2 = np.maximum(1 - along**2, 1e-4)  # the plate may have the object's color
    return np.asarray((l - along[..., None] * b) / across2[..., None], np.float32)


def projection_weights(image: LinearImage, plate: LinearImage, m: Floats32) -> Floats32:
    """Weights (H, W) of p: 1 / Var p, 0 where the plate is not valid. The noise is known."""
    noise = np.asarray(image.variance + plate.variance, np.float32)
    precision = 1 / np.maximum((m**2 * noise).sum(axis=-1), VARIANCE_FLOOR)
    return np.where(plate.valid, precision, np.float32(0))


def projected_energy(p: Floats32, weight: Floats32, mask: Bools) -> float:
    """Σ p² over a mask minus the expectation of noise, light².

    Σ p would prefer large faint areas, where the plate fits poorly; Σ p² / Var p areas of low noise.
    """
    weight = np.maximum(weight[mask], VARIANCE_FLOOR)
    return float(np.sum(p[mask] ** 2 - (weight > VARIANCE_FLOOR) / weight))


def streak_of_color(
    streaks: Sequence[Streak], image: LinearImage, plate: LinearImage, model: ColorModel
) -> Streak:
    """The streak with the largest energy along a model's color; the first for models of rank 2 or 3.

    An object of another color also has p ≠ 0, but p may be negative, and it has a component r = n·C,
    n ∝ l × B, which the model's color and the plate lack. Streaks in which that energy exceeds the
    energy of the color come last. Those that may be noise are chosen only if all may: where color and
    plate have nearly one hue, the energy of the color is small in every streak.
    """
    streaks = [streak for streak in streaks if streak.significant] or streaks
    if len(streaks) == 1 or model.rank > 1:
        return streaks[0]
    m = projection_vectors(plate, model)
    weight = projection_weights(image, plate, m)
    n = np.cross(model.basis[:, 0], plate.rgb)
    n /= np.maximum(np.linalg.norm(n, axis=-1, keepdims=True), 1e-6)
    p, r = (np.einsum("hwc,hwc->hw", a, image.rgb) for a in (m, n))
    of_color = np.abs(r) < 0.3 * p  # hues vary by less with shading and illuminants
    known = image.valid & (weight > 0)
    r_weight = 1 / np.maximum((n**2 * (image.variance + plate.variance)).sum(-1), VARIANCE_FLOOR)

    def rank(streak: Streak) -> tuple[bool, float]:
        """Whether light of the color predominates, and its energy."""
        use = streak.mask & known
        own = projected_energy(p, weight, use & of_color)
        other = projected_energy(r, r_weight, use) + projected_energy(p, weight, use & (p < 0))
        return own > other, own

    return max(streaks, key=rank)
