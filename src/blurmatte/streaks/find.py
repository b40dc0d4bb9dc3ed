"""Where something moved: regions of the image that differ from the plate by more than noise."""

import numpy as np

from blurmatte.calibration.noise_pair import with_noise
from blurmatte.checks import Bools, Floats, check_kind, check_same_size
from blurmatte.errors import MotionError, PlateError
from blurmatte.radiometry import LinearImage, check_same_colors
from blurmatte.streaks.evidence import POSSIBLE, SURE, evidence
from blurmatte.streaks.masks import of_cells, widened, without_thin_parts
from blurmatte.streaks.streak import RIM, Streak

_FAINTEST = 0.1  # of a streak's own strength: what is weaker beside it is its shadow or its halo
_JOIN = 2  # cells: gaps that are bridged
_MAX_CELLS = 1e6


def find_streaks(image: LinearImage, plate: LinearImage) -> list[Streak]:
    """Find the regions where something moved, the one with the largest evidence first.

    Parameters
    ----------
    image, plate : LinearImage
        The same size, at least 16x16 pixels; noise that is not known is measured.

    Returns
    -------
    list of Streak
        Empty if nothing moved.

    Raises
    ------
    ValueError
        If the sizes differ.
    PlateError
        If the pictures are too small or have no unclipped pixel in common.
    """
    from scipy import ndimage

    check_same_colors("the image", image, "the plate", plate)
    check_same_size("image", image.size, "plate", plate.size)
    if min(image.size) < 16:
        width, height = image.size
        raise PlateError(f"the picture is {width}x{height} pixels; 16x16 is the least to work with")
    if not (image.valid & plate.valid).any():
        raise PlateError("image and plate have no unclipped pixel in common; expose shorter")
    image, plate = with_noise(image, plate)
    cell = int(np.ceil(np.sqrt(image.valid.size / _MAX_CELLS)))
    T = evidence(image, plate, cell)
    moved = without_thin_parts(T > POSSIBLE)  # edges of the plate
    labels, _ = ndimage.label(widened(moved, _JOIN), np.ones((3, 3)))
    streaks = []
    for number, place in enumerate(ndimage.find_objects(labels), start=1):
        near = np.where((labels[place] == number) & moved[place], T[place], 0)
        for part in _strong_parts(near) if near.max() > SURE else ():
            mask = _to_pixels(part, place, cell, image.valid.shape)
            streaks.append(Streak(mask, evidence=float(T[place][part].sum()), cell=cell))
    return sorted(streaks, key=lambda streak: -streak.evidence)


def require_streaks(image: LinearImage, plate: LinearImage) -> list[Streak]:
    """`find_streaks` for those who cannot go on without one.

    Raises
    ------
    MotionError
        If nothing moved.
    """
    streaks = find_streaks(image, plate)
    if not streaks:
        raise MotionError(
            "nothing moved: image and plate agree within their noise; check that they are two "
            "pictures, or say where to look with a region (--region, streak=)"
        )
    return streaks


def find_streak_within(region: Streak, image: LinearImage, plate: LinearImage) -> Streak:
    """What moved in a region; all of the region if nothing is found that belongs there.

    Something belongs there if most of it lies in the region, or if it fills a tenth of it.

    Parameters
    ----------
    region : Streak
        Where to look, e.g. `Streak.from_box`.
    image, plate : LinearImage
        As for `find_streaks`.

    Returns
    -------
    Streak
        `region` itself if nothing is found that belongs there.

    Raises
    ------
    ValueError, PlateError
        As `find_streaks`.
    """
    check_kind("region", region, Streak, "use blurmatte.Streak.from_box(box, size)")
    inside, cell = np.zeros_like(region.mask), 1
    for found in find_streaks(image, plate):
        part = found.mask & region.mask
        count = np.count_nonzero(part)
        most = count > 0.5 * np.count_nonzero(found.mask)
        if most or count > 0.1 * np.count_nonzero(region.mask):
            inside, cell = inside | part, found.cell
    return Streak(inside, cell=cell) if inside.any() else region


def _strong_parts(T: Floats) -> list[Bools]:
    """The sure pieces, without the weak shadows and halos that touch them or lie between them."""
    from scipy import ndimage

    typical = float(np.quantile(T[T > 0], 0.9))
    strong = np.asarray(max(POSSIBLE, _FAINTEST**2 * typical) < T)
    near = widened(strong, _JOIN)
    pieces, count = ndimage.label(near, np.ones((3, 3)))
    tops = ndimage.maximum(T, pieces, np.arange(1, count + 1))
    return [strong & (pieces == n) for n, top in enumerate(tops, start=1) if top > SURE]


def _to_pixels(part: Bools, place: tuple[slice, ...], cell: int, shape: tuple[int, ...]) -> Bools:
    """A part of the cells with its gaps and holes filled and its faint rim, as a mask of pixels."""
    from scipy import ndimage

    joined = widened(np.pad(part, RIM), _JOIN)
    grown = widened(ndimage.binary_fill_holes(joined), RIM - _JOIN)
    cells = np.zeros([-(-side // cell) + 2 * RIM for side in shape], bool)
    cells[tuple(slice(s.start, s.stop + 2 * RIM) for s in place)] = grown
    return of_cells(cells[RIM:-RIM, RIM:-RIM], cell, shape)
