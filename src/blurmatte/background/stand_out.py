"""regions_that_stand_out: where something is before a smooth scene, in one picture without a plate.

A robust polynomial over the picture shows cells that it does not explain. Each connected part is a
candidate; it stands out if the picture in it differs from the guess of the scene there by more than
scenes that agree with the surroundings do.
"""

import numpy as np
import scipy

from blurmatte.background.guess import RIM_PX, PlateGuess, guess_plate
from blurmatte.checks import Array, Bools, Box, box_of, grown, rows_columns
from blurmatte.errors import PlateError
from blurmatte.radiometry import LinearImage, check_picture
from blurmatte.statistics import MAD_TO_STD, QUANTILE_999_3, block_sums

_CELLS = 64  # of the longer side of a picture
_DEGREE = 4  # of the polynomial: light of lamps and windows on walls, skies and tables
_ROUNDS = 30  # of robust weights
_BISQUARE = 4.7  # residuals beyond so many standard deviations have no weight [Beaton, Tukey 1974]
_MOST = 5  # candidates, the largest evidence first
_MAX_SHARE = 0.25  # of the picture that one candidate may cover: around it the scene is seen
_MARGIN_PX = 8  # around a candidate
_MIN_RATIO = 9.0  # of squared differences, of the picture and of draws: three standard deviations
_FEW_CELLS = 2  # smaller parts are noise


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
    found = []
    for box in _candidates(image):
        region = np.zeros(image.valid.shape, bool)
        region[rows_columns(box)] = True
        try:
            guess = guess_plate(image, region)
        except PlateError:  # it is as large as the picture
            continue
        ratio = _ratio(image, guess)
        if ratio > _MIN_RATIO:
            found.append((ratio, grown(box_of(guess.hidden), RIM_PX, image.size)))
    return _apart([box for _, box in sorted(found, reverse=True)])


def _candidates(image: LinearImage) -> list[Box]:
    """Boxes around connected cells that a smooth field does not explain."""
    cell = max(2, -(-max(image.size) // _CELLS))
    count = block_sums(image.valid.astype(float), cell)
    known = count > cell**2 / 2
    if np.count_nonzero(known) < (_DEGREE + 1) * (_DEGREE + 2):
        return []
    light = block_sums(np.where(image.valid[..., None], np.asarray(image.rgb, float), 0), cell)
    z2 = np.where(known, _misfit(light / np.maximum(count, 1)[..., None], known), 0)
    labels, parts = scipy.ndimage.label(z2 > QUANTILE_999_3, np.ones((3, 3)))
    sums = scipy.ndimage.sum_labels(z2, labels, np.arange(1, parts + 1))
    places = scipy.ndimage.find_objects(labels)
    boxes = []
    for k in np.argsort(sums)[::-1]:
        rows, columns = places[k]
        sides = rows.stop - rows.start, columns.stop - columns.start
        if np.prod(sides) > _MAX_SHARE * labels.size or max(sides) < _FEW_CELLS:
            continue
        margin = _MARGIN_PX + cell * (1 + min(sides) // 2)  # alpha falls to zero over the width
        x0, y0, x1, y1 = (
            cell * edge for edge in (columns.start, rows.start, columns.stop, rows.stop)
        )
        boxes.append(grown((x0, y0, x1, y1), margin, image.size))
    return boxes[:_MOST]


def _misfit(light: Array, known: Bools) -> Array:
    """(rows, columns) squared residuals of a robust polynomial over their variance, of all channels.

    An object covers many cells that agree with each other: Tukey's bisquare gives them no weight at
    all, and Student's t a little.
    """
    y, x = (np.linspace(-1, 1, n) for n in known.shape)
    terms = np.polynomial.legendre.legvander2d(
        *np.meshgrid(x, y),
        [_DEGREE, _DEGREE],
    )
    degree = np.add.outer(np.arange(_DEGREE + 1), np.arange(_DEGREE + 1)).ravel()
    basis = terms[..., degree <= _DEGREE][known]
    values = light[known]
    z2 = np.zeros(len(values))
    weight = np.ones(len(values))
    for _ in range(_ROUNDS):
        root = np.sqrt(weight)[:, None]
        rest = values - basis @ np.linalg.lstsq(root * basis, root * values, rcond=None)[0]
        std = MAD_TO_STD * np.median(np.abs(rest), axis=0)
        z2 = ((rest / np.maximum(std, np.finfo(np.float32).eps)) ** 2).sum(axis=1)
        weight = np.maximum(1 - z2 / (rest.shape[1] * _BISQUARE**2), 0) ** 2
    result = np.zeros(known.shape)
    result[known] = z2
    return result


def _ratio(image: LinearImage, guess: PlateGuess) -> float:
    """Squared difference of the picture from the guess, over that of the draws and noise."""
    hidden = guess.hidden & image.valid
    first, *draws = guess.plates
    own = float(((image.rgb - first.rgb)[hidden] ** 2).mean())
    noise = float(guess.image_noise.variance(first.rgb)[hidden].mean())
    by_chance = float(np.mean([((one.rgb - first.rgb)[hidden] ** 2).mean() for one in draws]))
    return own / (by_chance + noise)


def _apart(boxes: list[Box]) -> list[Box]:
    """Boxes that do not overlap one before them."""
    kept: list[Box] = []
    for x0, y0, x1, y1 in boxes:
        if all(x1 <= a0 or a1 <= x0 or y1 <= b0 or b1 <= y0 for a0, b0, a1, b1 in kept):
            kept.append((x0, y0, x1, y1))
    return kept
