"""Where something moved: regions of the image that differ from the plate by more than noise.

In this file d = C − B is the difference of image and plate, z the same in units of its standard
deviation, and T the sum of z² over the channels after smoothing, scaled so that it would be χ² with
three degrees of freedom if nothing had moved. Large pictures are looked at in cells of several
pixels, so that the search costs no more than for a picture of a million pixels.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np
import numpy.typing as npt

from blurmatte.checks import Bools, Box, Floats, check_kind, check_map, check_same_size
from blurmatte.errors import ColorModelError, MotionError, PlateError
from blurmatte.radiometry import (
    LinearImage,
    cell_means,
    check_same_colors,
    rounding_noise,
    with_noise,
)

_SURE, _POSSIBLE = 6.0**2, 3.5**2  # T: something moved here; part of it if it touches a sure place
_FAINTEST = 0.1  # of a streak's own strength: what is weaker beside it is its shadow or its halo
_SCALES = (1.0, 3.0)  # cells: smoothing that finds small sharp and faint broad streaks
_JOIN, _RIM = 2, 3  # cells: gaps that are bridged; rim added where the edge fades below all noise
_MAX_CELLS = 1e6
_STEPS = 4.0  # code values: to so many the blocks of JPEG and video are rounded
_MOST_ASKED = 4  # streaks of a picture that may be the object's
_NEXT_LEVEL = 2.0  # times the T that counts, until a streak falls apart
_GAP = 0.03  # of the T of a piece: 16 of 17 rags of people that went about left more in between
_LEAST_ASKED = 0.02  # of the strongest one's evidence: less is not
_MEDIAN_CHI2 = 0.79  # median over mean of the sum of three squares of noise

Told = TypeVar("Told")


@dataclass(frozen=True, eq=False)
class Streak:
    """A region of the image in which something moved.

    Parameters
    ----------
    mask : (H, W) bool
        True inside.
    box : (x0, y0, x1, y1)
        The smallest box around it, pixels; x1 and y1 are one past the last.
    evidence : float
        Sum of T over the region: how strongly the data say so.
    cell : int
        Width of the cells in which it was found, pixels: of large pictures it is wider than what moved
        by several of them. 1 if the region was given.

    Raises
    ------
    ValueError
        If the mask is empty.
    """

    mask: Bools
    box: Box = (0, 0, 0, 0)
    evidence: float = float("nan")
    cell: int = 1

    def __post_init__(self) -> None:
        shape = self.mask.shape[:2] if isinstance(self.mask, np.ndarray) else ()
        check_map("mask", self.mask, shape, kinds="b")
        rows, columns = (np.flatnonzero(np.any(self.mask, axis=axis)) for axis in (1, 0))
        if len(rows) == 0:
            raise ValueError("a streak needs at least one pixel; its mask is empty")
        box = (int(columns[0]), int(rows[0]), int(columns[-1]) + 1, int(rows[-1]) + 1)
        object.__setattr__(self, "box", box)

    def __repr__(self) -> str:
        x0, y0, x1, y1 = self.box
        area = int(np.count_nonzero(self.mask))
        return f"Streak({x1 - x0}x{y1 - y0} at {x0},{y0}, {area} pixels)"

    @classmethod
    def from_box(cls, box: Box, size: tuple[int, int]) -> "Streak":
        """All of a box (x0, y0, x1, y1) in a picture of `size` (width, height).

        Raises
        ------
        ValueError
            If the box is empty or leaves the picture.
        """
        x0, y0, x1, y1 = box
        width, height = size
        if not (0 <= x0 < x1 <= width and 0 <= y0 < y1 <= height):
            raise ValueError(
                f"region {x0},{y0},{x1},{y1} must lie in the picture of {width}x{height} pixels, "
                "with x0 < x1 and y0 < y1"
            )
        mask = np.zeros((height, width), bool)
        mask[y0:y1, x0:x1] = True
        return cls(mask)

    @property
    def is_whole(self) -> bool:
        """Whether all of it is in the picture, as far as can be seen."""
        (x0, y0, x1, y1), (height, width) = self.box, self.mask.shape
        return bool(min(x0, y0, width - x1, height - y1) > 0)

    def around(self, margin: int) -> Box:
        """The box with `margin` more pixels on each side, as far as the picture goes."""
        x0, y0, x1, y1 = self.box
        height, width = self.mask.shape
        return (
            max(0, x0 - margin),
            max(0, y0 - margin),
            min(width, x1 + margin),
            min(height, y1 + margin),
        )

    @property
    def rows_columns(self) -> tuple[slice, slice]:
        """The box as slices of an array."""
        x0, y0, x1, y1 = self.box
        return slice(y0, y1), slice(x0, x1)


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
    T = _evidence(image, plate, cell)
    moved = without_thin_parts(T > _POSSIBLE)  # edges of the plate
    labels, _ = ndimage.label(widened(moved, _JOIN), np.ones((3, 3)))
    streaks = []
    for number, place in enumerate(ndimage.find_objects(labels), start=1):
        near = np.where((labels[place] == number) & moved[place], T[place], 0)
        for part in _strong_parts(near) if near.max() > _SURE else ():
            mask = _to_pixels(part, place, cell, image.valid.shape)
            streaks.append(Streak(mask, evidence=float(T[place][part].sum()), cell=cell))
    return sorted(streaks, key=lambda streak: -streak.evidence)


def without_thin_parts(mask: Bools) -> Bools:
    """The 3 by 3 squares within a mask: SciPy's `binary_opening`, forty times as fast."""
    inside = np.pad(mask, 2)
    for join in (np.logical_and, np.logical_or):
        inside = join(join(inside[:-2], inside[1:-1]), inside[2:])
        inside = join(join(inside[:, :-2], inside[:, 1:-1]), inside[:, 2:])
    return np.asarray(inside)


def widened(mask: Bools, by: int) -> Bools:
    """All within so many steps along rows and columns: SciPy's `binary_dilation`, ten times as fast."""
    for _ in range(by):
        before, mask = mask, mask.copy()
        mask[1:] |= before[:-1]
        mask[:-1] |= before[1:]
        mask[:, 1:] |= before[:, :-1]
        mask[:, :-1] |= before[:, 1:]
    return mask


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
    within = _cells(streak.mask[..., None].astype(np.float32), cell)[..., 0] > 0
    T = np.where(within, _evidence(image, plate, cell, _SCALES[:1]), 0)
    level = _POSSIBLE
    while level < T.max():
        labels, count = ndimage.label(without_thin_parts(level < T), np.ones((3, 3)))
        sums = ndimage.sum_labels(T, labels, np.arange(1, count + 1))
        numbers = 1 + np.flatnonzero(sums > _LEAST_ASKED * sums.sum())
        if len(numbers) > 1:
            near = _nearest(np.where(np.isin(labels, numbers), labels, 0))
            two = level == _POSSIBLE and len(numbers) == 2
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
    mask = _of_cells(part, streak.cell, streak.mask.shape)
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
        grown = widened(mask, _RIM)
        return np.asarray(
            occluder & binary_dilation(grown, iterations=across, mask=occluder | grown)
        )

    whole, rest = streaks[0], list(streaks[1:])
    for other in list(rest):
        between = behind(whole.mask) & behind(other.mask)
        if between.any():
            mask = whole.mask | other.mask | between
            evidence = whole.evidence + other.evidence
            whole = replace(whole, mask=mask, evidence=evidence)
            rest.remove(other)
    return [whole, *rest]


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
    strong = np.asarray(max(_POSSIBLE, _FAINTEST**2 * typical) < T)
    near = widened(strong, _JOIN)
    pieces, count = ndimage.label(near, np.ones((3, 3)))
    tops = ndimage.maximum(T, pieces, np.arange(1, count + 1))
    return [strong & (pieces == n) for n, top in enumerate(tops, start=1) if top > _SURE]


def _to_pixels(part: Bools, place: tuple[slice, ...], cell: int, shape: tuple[int, ...]) -> Bools:
    """A part of the cells with its gaps and holes filled and its faint rim, as a mask of pixels."""
    from scipy import ndimage

    joined = widened(np.pad(part, _RIM), _JOIN)
    grown = widened(ndimage.binary_fill_holes(joined), _RIM - _JOIN)
    cells = np.zeros([-(-side // cell) + 2 * _RIM for side in shape], bool)
    cells[tuple(slice(s.start, s.stop + 2 * _RIM) for s in place)] = grown
    return _of_cells(cells[_RIM:-_RIM, _RIM:-_RIM], cell, shape)


def _of_cells(cells: Bools, cell: int, shape: tuple[int, ...]) -> Bools:
    """The pixels of cells, the last of which reach beyond the picture."""
    return np.asarray(cells.repeat(cell, axis=0).repeat(cell, axis=1)[: shape[0], : shape[1]])


def _evidence(
    image: LinearImage, plate: LinearImage, cell: int, scales: Sequence[float] = _SCALES
) -> Floats:
    """(h, w) T of every cell: the largest over the scales of smoothing.

    A sum of z weighted by w has the variance Σw²; with Gaussian weights that is a Gaussian sum too,
    of 1/√2 the scale. Dividing by it leaves noise at the border as it is elsewhere.
    """
    z, weight, rounding = _normalized_difference(image, plate, cell)
    T = np.zeros(weight.shape, np.float32)
    for scale in scales:
        white = _smoothed(weight, scale / np.sqrt(2)) / (4 * np.pi * scale**2)
        std = np.sqrt(np.maximum(white, 1e-6))
        steps = _STEPS**2 * (4 * np.pi * scale**2)
        T_here = np.zeros_like(T)
        for c in range(3):
            smooth = _smoothed(z[..., c], scale) / std
            smooth -= np.median(smooth)
            T_here += smooth**2 / _spread2(smooth, steps * rounding[..., c])
        T = np.maximum(T, T_here)
    return T


def _smoothed(values: Floats, scale: float) -> Floats:
    from scipy.ndimage import gaussian_filter

    return np.asarray(gaussian_filter(values, scale, mode="constant"))


def _spread2(smooth: Floats, steps: Floats) -> Floats:
    """(h, w) variance of a smoothed z of one channel where nothing moved.

    White noise leaves 1. What there is beyond that is correlated noise of JPEG and video, light
    that drifts, soft shadows: long-tailed, so it counts twelve times. The quantile believes what
    two thirds of the picture say. A tenth is believed too, but no further than a few code values,
    `steps`: where neighbors have like light, a codec may round all of them up or down.
    """
    told = np.quantile(np.abs(smooth), (0.65, 0.9)) / (0.9346, 1.6449)  # of normal numbers 1
    most, some = 12 * np.maximum(told**2 - 1, 0)
    return np.asarray(1 + np.maximum(most, np.minimum(some, steps)), dtype=smooth.dtype)


def _normalized_difference(
    image: LinearImage, plate: LinearImage, cell: int
) -> tuple[Floats, Floats, Floats]:
    """(h, w, 3) difference of the cells' means over its standard deviation, (h, w) 1 where it is
    known and 0 elsewhere, (h, w, 3) the part of that variance which rounding alone has.

    Where the plate has edges, a shift by a fraction of a pixel makes a difference too. How large
    the shifts are is read off the edges themselves.
    """
    used = image.valid & plate.valid
    d = _cells(np.where(used[..., None], image.rgb - plate.rgb, 0), cell)
    B = _cells(plate.rgb, cell)
    known = _cells(used[..., None].astype(np.float32), cell)[..., 0] > 0.5
    variance = _mean_variance(image, B, cell) + _mean_variance(plate, B, cell)
    edge = _edge_energy(B)
    variance = variance + 9 * _shift2(d, variance, edge) * edge + 1e-14
    z = np.where(known[..., None], d / np.sqrt(variance), 0)
    rounding = (rounding_noise(image).variance(B) + rounding_noise(plate).variance(B)) / variance
    return tuple(np.asarray(a, dtype=np.float32) for a in (z, known, rounding))  # type: ignore[return-value]


def shift_variance(image: LinearImage, plate: LinearImage, still: Bools) -> Floats:
    """(H, W, 3) variance that a plate shifted by a fraction of a pixel has at its own edges, light².

    How far it is shifted is read off the edges where `still`, (H, W) bool: nothing moved there.
    """
    d = np.asarray(image.rgb - plate.rgb, float)
    edge = _edge_energy(np.asarray(plate.rgb, float))
    return np.asarray(
        _shift2(d[still], (image.variance + plate.variance)[still], edge[still]) * edge
    )


def _shift2(d: Floats, variance: Floats, edge: Floats) -> float:
    """Mean squared shift, pixels², from what d² has beyond its variance at the strongest edges."""
    energy = edge.sum(axis=-1)
    if energy.size == 0:
        return 0.0
    strong = energy >= np.quantile(energy, 0.9)
    of_noise = _MEDIAN_CHI2 * np.median(variance.sum(axis=-1)[strong])
    excess = np.median((d**2).sum(axis=-1)[strong]) - of_noise
    return max(float(excess / (np.median(energy[strong]) + 1e-14)), 0.0)


def _edge_energy(B: Floats) -> Floats:
    """(h, w, 3) squared gradient, the largest of the neighbors: light² per cell²."""
    from scipy import ndimage

    energy = np.gradient(B, axis=0) ** 2 + np.gradient(B, axis=1) ** 2
    return np.asarray(ndimage.maximum_filter(energy, size=(3, 3, 1)))


def _cells(values: npt.NDArray[np.floating], cell: int) -> Floats:
    """Means over cells of cell × cell pixels; the last ones reach to the border."""
    if cell == 1:
        return values
    height, width = (n // cell * cell for n in values.shape[:2])
    pad = [(0, -n % cell) for n in values.shape[:2]] + [(0, 0)]
    padded = np.pad(values, pad, mode="edge") if (height, width) != values.shape[:2] else values
    return cell_means(padded, cell)


def _mean_variance(picture: LinearImage, B: Floats, cell: int) -> Floats:
    from blurmatte.radiometry import NoiseModel

    if isinstance(picture.noise, NoiseModel):
        return np.asarray(picture.noise.variance(B) / cell**2)
    return np.asarray(_cells(picture.variance, cell) / cell**2)


def check_streak(name: str, value: object) -> None:
    """Raise TypeError unless it is a Streak, or None."""
    check_kind(name, value, Streak | None, "use blurmatte.Streak(mask), or from_box")
