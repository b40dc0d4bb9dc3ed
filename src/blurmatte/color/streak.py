"""The color line from the streak itself: hue variation and feasibility.

The published sum of squares (`published_color_line`) finds the plate's own color in noisy pictures.
Here every direction that a line of colors can have is judged by two kinds of evidence
(`evidence.py`), the answer is the mean of what they leave possible (`posterior.py`), its covariance
the spread. Before a plate of one hue there is no answer, and `ColorModelError` says so.
"""

from dataclasses import replace

import numpy as np
import numpy.typing as npt

from blurmatte.checks import check_same_size
from blurmatte.color.evidence import SLACK, Evidence, Pixels, closed_form, misfit
from blurmatte.color.model import ColorModel
from blurmatte.color.posterior import posterior, unit
from blurmatte.color.through_file import drawn
from blurmatte.errors import ColorModelError
from blurmatte.radiometry import LinearImage, check_same_colors, with_noise
from blurmatte.streaks import Streak, check_streak, require_streaks, shift_variance

Array = npt.NDArray[np.float64]

_MAX_ANGLE_STD = 3.0  # degrees: an answer less certain than this is none
_MAX_SCALE_STD = 0.2  # of the angle to the plate's hue: alpha is uncertain by about this fraction
_MAX_UNEXPLAINED = 0.1  # of the change between plate and image: one paint left 0.05, two 0.13
_MAX_IMPOSSIBLE = 0.05  # of the pixels: more cannot be noise
_MAX_PIXELS = 2500  # a regular selection of so many speaks for the streak
_IF_ROUND = "; if it is round and of several colors, allow any (--rank 3, ColorModel.any())"
_COARSE = 15.0  # codes of a step: of quality 95, 10, errors that are claimed cover what is lost
_FEW = 3  # blocks of shared chroma: of smaller streaks, at quality 90, 38 of 48 answers were wrong
_DRAWS, _AROUND = 2, 24  # pictures out of the same file; pixels around the streak
_BLOCK = 16  # pixels: noise of neighbors this near may be the same noise (JPEG, its halved color)


def fit_color_from_hues(
    image: LinearImage,
    plate: LinearImage,
    streak: Streak | None = None,
    max_brightness: float = np.inf,
) -> ColorModel:
    """Find the object's line of colors from its streak alone (in place of [GC07 §3.1]).

    Parameters
    ----------
    image, plate : LinearImage
        The same size; noise that is not known is measured.
    streak : Streak, optional
        Where the object moved; the strongest of `find_streaks` if not given.
    max_brightness : float
        The brightest that the object's largest channel can be, linear light, 1 = sensor white. An
        object that would be clipped if it stood still is brighter than 1, so the default is no bound.

    Returns
    -------
    ColorModel
        Rank 1, with the covariance of its direction and what each kind of evidence says.

    Raises
    ------
    ColorModelError
        If the streak leaves a whole family of colors possible, or no single line explains it. The
        message says what would help.
    MotionError
        If no streak was given and nothing moved.
    """
    check_color_fit(image, plate, streak, max_brightness)
    image, plate = with_noise(image, plate)
    if streak is None:
        streak = require_streaks(image, plate)[0]
    pixels = _streak_pixels(image, plate, streak)
    kinds = {
        name: Evidence(hue, feasibility, max_brightness)
        for name, hue, feasibility in (
            ("together", True, True), ("hue variation", True, False), ("feasibility", False, True)
        )
    }  # fmt: skip
    spread = {name: posterior(evidence, pixels) for name, evidence in kinds.items()}
    l, covariance = spread.pop("together")
    if image.meta.sharing is not None:
        by_file = _by_file(l, kinds["together"], image, plate, streak)
        covariance, spread["compression"] = covariance + by_file, (l, by_file)
    evidence = {name: ColorModel(m[:, None], c).angle_std for name, (m, c) in spread.items()}
    model = ColorModel(l[:, None], covariance, evidence, image.meta.to_srgb)
    _refuse_the_open(model, pixels)
    _refuse_the_unfit(model, pixels)
    return model


def check_color_fit(
    image: LinearImage, plate: LinearImage, streak: Streak | None, max_brightness: float
) -> None:
    """Raise what fits of a color raise for what is no such argument."""
    check_same_colors("the image", image, "the plate", plate)
    check_same_size("image", image.size, "plate", plate.size)
    refuse_gray(image, plate)
    check_streak("streak", streak)
    if not max_brightness > 0:
        raise ValueError(f"max_brightness must be positive, got {max_brightness}")


def refuse_gray(image: LinearImage, plate: LinearImage) -> None:
    """Raise ColorModelError if either picture has one channel: alpha is told from color."""
    for picture in (image, plate):
        if picture.meta.gray:
            raise ColorModelError(
                f"{picture.meta.source or 'a picture'} is gray: alpha is told from color, so image "
                "and plate must both have it"
            )


def refuse_coarse(image: LinearImage, streak: Streak) -> None:
    """Raise ColorModelError if the image's file holds too little color of a streak so small.

    Where pixels share chroma, what is left of a rim is what suits a few coefficients; wrong shapes
    and colors then leave no more than right ones.
    """
    file = image.meta.sharing
    if file is None or np.median(file.chroma) < _COARSE:
        return
    pixels, (w, h) = np.count_nonzero(streak.mask), file.mcu
    if pixels < _FEW * w * h:
        raise ColorModelError(
            f"the streak covers {pixels} pixels, less than {_FEW} blocks of {w} by {h} in which this "
            "JPEG holds color, too few to tell a shape or a color; give the object's color (--color, "
            "model=), or take it larger, raw, as PNG, or as a JPEG of higher quality"
        )


def _streak_pixels(image: LinearImage, plate: LinearImage, streak: Streak) -> Pixels:
    """A regular selection of the streak's usable pixels, ordered by block."""
    box = streak.around(_BLOCK)
    image, plate = image.crop(box), plate.crop(box)
    inside = streak.mask[box[1] : box[3], box[0] : box[2]]
    usable = image.valid & plate.valid
    used = inside & usable
    # Noise that was cut off at black has another mean, which looks like color. The image's noise,
    # for a plate of many frames has little left, but was cut off before.
    for picture in (image, plate):
        used &= (picture.rgb > 2 * np.sqrt(image.variance)).all(axis=-1)
    y, x = np.nonzero(used)
    if len(y) < 20:
        raise ColorModelError(
            f"only {len(y)} pixels of the streak are neither clipped nor before a black plate, 20 are "
            "the least; give the color (--color, model=), or expose otherwise"
        )
    step = max(1, -(-len(y) // _MAX_PIXELS))
    y, x = y[::step], x[::step]
    # Blocks on the grid that JPEG has too, which starts at the picture's corner.
    at = np.stack([y + box[1], x + box[0]], axis=1)
    blocks, block = np.unique(at // _BLOCK, axis=0, return_inverse=True)
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
    least = 1e-12  # float32 light is no better known
    apart = np.abs(blocks[:, None] - blocks[None]).sum(axis=-1)
    first, second = np.nonzero(np.triu(apart == 1))
    return Pixels(C, B, vC + least, vB + least, block[order], tile[order], (first, second))


def _by_file(
    l: Array, evidence: Evidence, image: LinearImage, plate: LinearImage, streak: Streak
) -> Array:
    """(3, 3) covariance by what the image's file did to colors."""
    box = streak.around(_AROUND)
    image, plate = image.crop(box), plate.crop(box)
    streak = replace(streak, mask=streak.mask[box[1] : box[3], box[0] : box[2]])
    images, behind = drawn(l, image, plate, streak, _DRAWS)
    found = [posterior(evidence, _streak_pixels(again, behind, streak))[0] for again in images]
    off = np.array(found) - l
    return np.asarray(off.T @ off / _DRAWS)


def _tile(step: int) -> int:
    """Side of a tile, which divides a block: with every so many pixels used, it holds 8 or more."""
    return next((size for size in (4, 8) if size**2 >= 8 * step), _BLOCK)


def _refuse_the_open(model: ColorModel, pixels: Pixels) -> None:
    B = pixels.B / np.linalg.norm(pixels.B, axis=1, keepdims=True)
    near = float(np.degrees(np.sqrt(np.mean(np.arccos(np.clip(B @ model.pole, -1, 1)) ** 2))))
    if model.angle_std <= min(_MAX_ANGLE_STD, _MAX_SCALE_STD * near):
        return
    spread = np.degrees(np.sqrt(np.mean(1 - np.clip(B @ unit(B.mean(axis=0)), -1, 1) ** 2)))
    said = ", ".join(f"{name} leaves {std:.1f}°" for name, std in model.evidence.items())
    why = f"{said}; the plate's hue is {near:.0f}° away and varies by {spread:.1f}° behind it"
    several = misfit(model.pole, pixels) > 9
    if several:
        why += "; the colors do not lie on one line: a highlight, a second color, or a shadow"
    possible = model.possible
    raise ColorModelError(
        f"the streak leaves the object's color open by {model.angle_std:.1f}°, anything from "
        f"{possible[1].hex[0]} to {possible[5].hex[0]} ({why}): give the "
        "color (--color, model=), pick pixels of the object where it is sharp or opaque, or bound "
        "its brightness" + _IF_ROUND * several
    )


def _refuse_the_unfit(model: ColorModel, pixels: Pixels) -> None:
    a = closed_form(model.basis.T, pixels)
    unexplained = float(np.sum(a.r**2 - a.r_std**2))
    moved = float(np.sum((pixels.C - pixels.B) ** 2 - pixels.vC - pixels.vB))
    impossible = np.maximum(-a.alpha, a.alpha - 1) > np.maximum(3 * a.alpha_std, 2 * SLACK)
    negative = 2 * SLACK * np.linalg.norm(pixels.B, axis=1)
    impossible |= -a.k > np.maximum(3 * a.k_std, negative)
    if unexplained > _MAX_UNEXPLAINED**2 * moved or np.mean(impossible) > _MAX_IMPOSSIBLE:
        raise ColorModelError(
            "no single line of colors explains the streak: the best leaves "
            f"{np.sqrt(max(unexplained / moved, 0)):.0%} of the change, and {np.mean(impossible):.0%} "
            "of the pixels with an alpha below 0 or above 1, or with negative light; give the colors "
            "of the object (--color, model=; two with rank 2), or choose a region with one object and "
            "without its shadow" + _IF_ROUND
        )
