"""Several streaks, or several things in one: which of them is asked, and what belongs together."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TypeVar

import numpy as np
import numpy.typing as npt

from blurmatte.checks import Bools, Floats
from blurmatte.errors import ColorModelError, MotionError
from blurmatte.radiometry import LinearImage
from blurmatte.streaks.evidence import POSSIBLE, SCALES, evidence, in_cells
from blurmatte.streaks.masks import of_cells, widened, without_thin_parts
from blurmatte.streaks.streak import RIM, Streak

_MOST_ASKED = 4  # streaks of a picture that may be the object's
_NEXT_LEVEL = 2.0  # times the T that counts, until a streak falls apart
_GAP = 0.03  # of the T of a piece: 16 of 17 rags of people that went about left more in between
_LEAST_ASKED = 0.02  # of the strongest one's evidence: less is not

Told = TypeVar("Told")


def strongest_told(streaks: Sequence[Streak], tell: Callable[[Streak], Told]) -> Told:
    """What the strongest streak tells that tells anything, those that are whole before the others.

    An arm that swings a ball on a string moves more than the ball, and tells nothing; arms come from
    beyond the border.

    Parameters
    ----------
    streaks : sequence of Streak
        The strongest first, one or more.
    tell : function
        What a streak tells; raises ColorModelError or MotionError if that is nothing.

    Raises
    ------
    ColorModelError, MotionError
        What the strongest said, if none tells anything.
    """
    refusal: ColorModelError | MotionError | None = None
    least = _LEAST_ASKED * streaks[0].evidence
    asked = [streaks[0], *(s for s in streaks[1:_MOST_ASKED] if s.evidence > least)]
    for streak in sorted(asked, key=lambda streak: not streak.is_whole):
        try:
            return tell(streak)
        except (ColorModelError, MotionError) as error:
            refusal = error if refusal is None or streak is streaks[0] else refusal
    assert refusal is not None
    raise refusal


def pieces_apart(streak: Streak, image: LinearImage, plate: LinearImage) -> list[Streak]:
    """Pieces of a streak around which hardly anything moved: another thing may have moved beside.

    Parameters
    ----------
    streak : Streak
        One of `find_streaks`, which are joined over gaps, for of faint ones parts may not be seen.
    image, plate : LinearImage
        As for `find_streaks`, noise known.

    Returns
    -------
    list of Streak
        The strongest first; a pixel in between belongs to the nearest piece. None if the streak holds
        together; nor is any that is hardly stronger than what is around it, as of what falls to rags,
        unless there are but two with nothing in between.
    """
    from scipy import ndimage

    cell = streak.cell
    within = in_cells(streak.mask[..., None].astype(np.float32), cell)[..., 0] > 0
    T = np.where(within, evidence(image, plate, cell, SCALES[:1]), 0)
    level = POSSIBLE
    while level < T.max():
        labels, count = ndimage.label(without_thin_parts(level < T), np.ones((3, 3)))
        sums = ndimage.sum_labels(T, labels, np.arange(1, count + 1))
        numbers = 1 + np.flatnonzero(sums > _LEAST_ASKED * sums.sum())
        if len(numbers) > 1:
            near = _nearest(np.where(np.isin(labels, numbers), labels, 0))
            two = level == POSSIBLE and len(numbers) == 2
            apart = [n for n in numbers if two or level < _GAP * np.quantile(T[labels == n], 0.9)]
            pieces = [_piece(streak, near == n, T) for n in apart]
            return sorted(pieces, key=lambda piece: -piece.evidence)
        level *= _NEXT_LEVEL
    return []


def _nearest(labels: npt.NDArray[np.int32]) -> npt.NDArray[np.int32]:
    """The label, other than 0, that is nearest."""
    from scipy.ndimage import distance_transform_edt

    at = distance_transform_edt(labels == 0, return_distances=False, return_indices=True)
    return np.asarray(labels[tuple(at)])


def _piece(streak: Streak, part: Bools, T: Floats) -> Streak:
    """What of a streak is in a part of the cells."""
    mask = of_cells(part, streak.cell, streak.mask.shape)
    return Streak(mask & streak.mask, evidence=float(T[part].sum()), cell=streak.cell)


def joined_behind(streaks: Sequence[Streak], occluder: Bools) -> list[Streak]:
    """The streaks, the first one with the others, and the part between them, that it goes on in
    behind an occluder.

    Parameters
    ----------
    streaks : sequence of Streak
        The strongest first, one or more.
    occluder : (H, W) bool
        Where something still is in front.
    """
    from scipy.ndimage import binary_dilation, distance_transform_edt

    if not occluder.any():
        return list(streaks)
    across = int(2 * distance_transform_edt(np.pad(occluder, 1)).max())

    def behind(mask: Bools) -> Bools:
        grown = widened(mask, RIM)
        return np.asarray(
            occluder & binary_dilation(grown, iterations=across, mask=occluder | grown)
        )

    whole, rest = streaks[0], list(streaks[1:])
    for other in list(rest):
        between = behind(whole.mask) & behind(other.mask)
        if between.any():
            mask = whole.mask | other.mask | between
            whole = replace(whole, mask=mask, evidence=whole.evidence + other.evidence)
            rest.remove(other)
    return [whole, *rest]
