"""burst_plate: the plate of one shot from other shots of the same scene, as from the hand."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import scipy

from blurmatte.background.fit_match import Matching, fit_match, match_at_rest
from blurmatte.background.guess import (
    RIM_PX,
    PlateGuess,
    channels_share_noise,
    faint_rim,
    guess_plate,
    least_difference,
    noise_around,
)
from blurmatte.background.match import Match
from blurmatte.background.plate import plate_of_shots
from blurmatte.background.robust_mean_kernel import UNSEEN
from blurmatte.background.warp import Warp, warped_mask
from blurmatte.checks import Array, Bools
from blurmatte.errors import PlateError
from blurmatte.radiometry import LinearImage

# Fraction of the pixels on which shots differ where no two agree: noise alone yields one in 900
_MIN_HOLES = 0.01
# Error of a guess over the noise of a shot, and over what the object changes: of a rougher one, pixels
# are better not known. With the light k of the object, an error e of the plate's light B makes one of
# (1 - alpha) e / (k - B) in alpha; over a streak 1 - alpha is about one half, so that the error of
# alpha remains within the .05 of a plausible answer.
_MAX_GUESS_ERROR = 2.0
_MAX_ERROR_OF_CHANGE = 0.1


def burst_plate(
    image: LinearImage, plates: Sequence[LinearImage], matching: Matching | None = None
) -> tuple[LinearImage, list[Match]]:
    """The scene behind the object in an image, from other shots, each with the object elsewhere.

    Each shot is matched to the image alone. If one shows that the camera was at rest, the same is
    supposed of the others, unless structure outside of the object is displaced in them. The plate of
    a pixel is the light that most of all shots agree on, the image included; it is the mean of those
    shots that show it, without the image.
    Where streaks overlap, most shots may agree on the object: there the plate is compared with a guess
    from the surroundings (`guess_plate`), which replaces what contradicts it. A guess that is too rough
    to be contradicted by the object's light replaces all there.

    Parameters
    ----------
    image : LinearImage
    plates : sequence of LinearImage
        Two or more, of the size of the image.
    matching : Matching, optional
        As in `fit_match`.

    Returns
    -------
    plate : LinearImage
        In pixels and light of the image, its noise known. Not `valid` where no two shots agree, as
        where the object is in front of one place in all of them, unless the surroundings show what is
        there: then it is a `PlateGuess`.
    matches : list of Match
        Of each.

    Raises
    ------
    ValueError
        If the sizes differ, or there is but one plate.
    PlateError
        If a shot shows another place or too different a light.
    """
    if len(plates) < 2:
        raise ValueError(f"plates must be two or more, got {len(plates)}; use match_plate for one")
    matches = [fit_match(image, plate, matching) for plate in plates]
    if matching is None and not all(match.moves for match in matches):
        pairs = zip(matches, plates, strict=True)
        matches = [
            match_at_rest(image, plate) or match if match.moves else match for match, plate in pairs
        ]
    pairs = zip(matches, plates, strict=True)
    shots = [_shown(match, plate) for match, plate in pairs]
    plate, differ = plate_of_shots(image, shots)
    return _checked(image, plate, differ), matches


def _checked(image: LinearImage, plate: LinearImage, differ: Bools) -> LinearImage:
    """The plate with a guess where streaks overlap: of what contradicts it, and of what is not known.

    differ: (H, W) bool, where a shot differs from the plate.
    """
    region = _overlapping(differ, differ & ~plate.valid)
    if not region.any():
        return plate
    try:
        guess = guess_plate(plate, region)
        noise = noise_around(image, region)
        light = guess.rgb[guess.hidden]
        change = np.quantile(((image.rgb[guess.hidden] - light) ** 2).mean(axis=-1), 0.95)
        limits = (
            _MAX_GUESS_ERROR**2 * noise.variance(light).mean(),
            _MAX_ERROR_OF_CHANGE**2 * change,
        )
        if guess.error**2 > max(limits):
            return plate
        unlikely = _contradicting(plate, guess) | _undecided(image, plate, guess, differ & region)
        guess = guess_plate(plate, region & unlikely)
    except PlateError:  # too little is seen around it
        return plate
    # The streak lies partly before pixels that other shots show: their noise is independent.
    return replace(guess, image_noise=noise, errors=None)


def _contradicting(plate: LinearImage, guess: PlateGuess) -> Bools:
    """(H, W) where a plate is not known or is unlikely before a guess, and the faint rims around."""
    excess = over_noise((plate.rgb - guess.rgb) ** 2, plate, guess)
    off = _mostly((excess > 1) & guess.hidden & plate.valid)
    if not off.any():
        return ~plate.valid
    away = scipy.ndimage.distance_transform_edt(~(off | ~plate.valid))
    return np.asarray(away <= faint_rim(excess[off], off))


def _undecided(image: LinearImage, plate: LinearImage, guess: PlateGuess, moved: Bools) -> Bools:
    """(H, W) where light that differs as much as the object's does would not contradict a guess.

    moved (H, W): where a shot differs from the plate.
    """
    seen = moved & plate.valid & image.valid
    if not seen.any():
        return ~plate.valid
    contrast = np.quantile((image.rgb - plate.rgb)[seen] ** 2, 0.95, axis=0)
    return over_noise(contrast, plate, guess) < 1


def over_noise(squared: Array, plate: LinearImage, guess: PlateGuess) -> Array:
    """(H, W) squared differences of light (3,) or (H, W, 3) over the least that is no noise."""
    z2 = squared / (guess.variance + plate.variance)
    total = z2.mean(axis=-1) if channels_share_noise(plate) else z2.sum(axis=-1)
    return np.asarray(total / least_difference(plate))


def _mostly(mask: Bools) -> Bools:
    """(H, W) where most of the pixels around are True: noise alone yields single ones."""
    return np.asarray(scipy.ndimage.uniform_filter(mask.astype(float), 3) > 0.5)


def _overlapping(differ: Bools, holes: Bools) -> Bools:
    """(H, W) the hull of streaks that overlap, as holes show where no two shots agree.

    Between the ends of the streaks all shots may agree on the object.
    """
    moved, around = _mostly(differ), 2 * RIM_PX + 1
    parts, count = scipy.ndimage.label(scipy.ndimage.maximum_filter(moved, around))
    index = np.arange(count + 1)
    area, unknown = (scipy.ndimage.sum_labels(mask, parts, index) for mask in (moved, holes))
    overlap = np.asarray(moved & (unknown > _MIN_HOLES * area)[parts])
    if not overlap.any():
        return overlap
    return np.asarray(scipy.ndimage.maximum_filter(_hull(overlap), around))


def _hull(mask: Bools) -> Bools:
    """(H, W) the convex hull of the True pixels."""
    corners = np.concatenate([np.argwhere(mask) + at for at in ((0, 0), (0, 1), (1, 0), (1, 1))])
    hull = scipy.spatial.ConvexHull(corners)
    y, x = np.indices(mask.shape) + 0.5
    sides = [a * y + b * x + c <= 0 for a, b, c in hull.equations]
    return np.asarray(np.logical_and.reduce(sides))


def _shown(match: Match, plate: LinearImage) -> LinearImage:
    """A plate as the image sees it; the light of what it does not show is UNSEEN."""
    matched = match.apply(plate)
    rgb = np.array(matched.rgb, np.float32)
    if match.moves:
        rgb[~warped_mask(np.ones(plate.valid.shape, bool), Warp(match.h, match.size))] = UNSEEN
    return LinearImage(rgb, valid=matched.valid, meta=plate.meta)
