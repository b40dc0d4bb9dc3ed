"""regions_that_stand_out: where something is before a smooth scene, in one picture without a plate.

Cells of a picture are compared with the median of the cells around them, in windows of several widths:
it shows walls and floors with their edge, without what is smaller than half a window. Each connected
part that differs is a candidate; it stands out if the picture in it differs from the guess of the scene
there by more than scenes that agree with the surroundings do.
"""

import numpy as np
import scipy

from blurmatte.background.guess import (
    RIM_PX,
    PlateGuess,
    guess_plate,
    least_difference,
    noise_around,
)
from blurmatte.checks import Array, Bools, Box, Floats, box_of, enclosing, grown, rows_columns
from blurmatte.errors import PlateError
from blurmatte.radiometry import LinearImage, are_gray, check_picture
from blurmatte.statistics import robust_std, seen_means
from blurmatte.streaks.gate import overlap
from blurmatte.streaks.streak import cells_to_pixels

_CELLS = 64  # of the longer side of a picture
_REACHES = 4, 8, 16  # cells from the center of a window to its border
_MOST = 5  # candidates, the largest evidence first
_MAX_SHARE = 0.25  # of the picture that one candidate may cover: around it the scene is seen
_MAX_COMMON = 0.5  # cells of two candidates over those of either, or of one in the other
_MARGIN_PX = 8  # around a candidate, and one cell: its rim is fainter than the threshold
_MIN_RATIO = 9.0  # of squared differences, of the picture and of draws: three standard deviations
_MIN_CELLS = 2  # smaller parts are noise


def regions_that_stand_out(image: LinearImage) -> list[Box]:
    """Propose where an object may be, before a scene that is smooth around it.

    Parameters
    ----------
    image : LinearImage
        A picture of which there is no plate.

    Returns
    -------
    list of (x0, y0, x1, y1)
        Boxes for `guess_plate`, the one that stands out most first; empty if nothing does, as before
        a scene of many edges and patterns.

    Examples
    --------
    >>> y, x = np.mgrid[:120, :160]
    >>> light = np.where(np.hypot(x - 80, y - 60)[..., None] < 12, orange, [0.3, 0.35, 0.4])
    >>> bm.background.regions_that_stand_out(camera.photograph(light, 0))
    [(59, 40, 100, 80)]
    """
    check_picture("image", image)
    parts = _candidates(image)
    if image.noise is None and parts:
        image = image.with_noise(noise_around(image, np.logical_or.reduce(parts)))
    found: list[tuple[float, Box]] = []
    uncertain: list[Bools] = []
    for part in parts:
        box = box_of(part)
        if any(overlap(box, other) for _, other in found):
            continue
        # As wide as what a guess is made from at most, so that large pictures take no longer.
        near = grown(box, max(box[2] - box[0], box[3] - box[1]) + RIM_PX, image.size)
        shown = image.crop(near)
        try:
            guess = guess_plate(shown, part[rows_columns(near)])
        except PlateError:  # it is as large as the picture
            continue
        ratio = _ratio(shown, guess)
        if ratio <= _MIN_RATIO:
            uncertain.append(part)
            continue
        x0, y0, x1, y1 = grown(box_of(guess.hidden), RIM_PX, shown.size)
        box = near[0] + x0, near[1] + y0, near[0] + x1, near[1] + y1
        # Behind a large object any scene is likely, but not behind a part of it.
        wholes = [other for other in uncertain if (part & other).sum() > _MAX_COMMON * part.sum()]
        found.append((ratio, enclosing([box, *map(box_of, wholes)])))
    return [box for _, box in sorted(found, reverse=True)]


def _candidates(image: LinearImage) -> list[Bools]:
    """(H, W) where connected cells differ from those around them, the largest evidence first.

    What reaches from one side of the picture to the other is a part of the scene.
    """
    cell = max(2, -(-max(image.size) // _CELLS))
    light, count = seen_means(np.asarray(image.rgb, float), image.valid, cell)
    known = count > cell**2 / 2
    if not known.any():
        return []
    found, threshold = [], least_difference(image)
    light = light[..., :1] if are_gray(image, image) else light
    for reach in _REACHES:
        z2 = _differences(light, known, 2 * reach + 1)
        labels, parts = scipy.ndimage.label(z2 > threshold, np.ones((3, 3)))
        sums = scipy.ndimage.sum_labels(z2, labels, np.arange(1, parts + 1))
        found += [(sums[k], labels == k + 1) for k in np.argsort(sums)[::-1][:_MOST]]
    kept: list[Bools] = []
    for _, part in sorted(found, key=lambda one: -one[0]):
        if _is_possible(part) and not any(_are_one(part, other) for other in kept):
            kept.append(part)
    return [_in_pixels(part, cell, image.valid.shape) for part in kept[:_MOST]]


def _differences(light: Floats, known: Bools, width: int) -> Array:
    """(rows, columns) squared differences of cells from the median of a window, over their variance."""
    z2 = np.zeros(known.shape)
    for channel in np.moveaxis(light, -1, 0):
        rest = channel - scipy.ndimage.median_filter(channel, width, mode="nearest")
        z2 += (rest / max(robust_std(rest[known]), np.finfo(np.float32).eps)) ** 2
    return np.where(known, z2, 0)


def _is_possible(part: Bools) -> bool:
    """Whether cells may show an object: not single, not most of the picture, not across it."""
    if part.mean() > _MAX_SHARE:
        return False
    sides = [np.flatnonzero(part.any(axis=axis)) for axis in (0, 1)]
    across = any(np.ptp(at) == n - 1 for at, n in zip(sides, part.shape[::-1], strict=True))
    return not across and max(map(len, sides)) >= _MIN_CELLS


def _are_one(one: Bools, other: Bools) -> bool:
    return bool((one & other).sum() > _MAX_COMMON * (one | other).sum())


def _in_pixels(part: Bools, cell: int, shape: tuple[int, ...]) -> Bools:
    """(H, W) the pixels of cells, with a margin."""
    pixels = cells_to_pixels(part, cell, shape)
    return np.asarray(scipy.ndimage.distance_transform_edt(~pixels) <= _MARGIN_PX + cell)


def _ratio(image: LinearImage, guess: PlateGuess) -> float:
    """Squared difference of the picture from the guess, over that of the draws and noise."""
    hidden = guess.hidden & image.valid
    first, *draws = guess.plates
    own = float(((image.rgb - first.rgb)[hidden] ** 2).mean())
    noise = float(guess.image_noise.variance(first.rgb)[hidden].mean())
    by_chance = float(np.mean([((one.rgb - first.rgb)[hidden] ** 2).mean() for one in draws]))
    return own / (by_chance + noise)
