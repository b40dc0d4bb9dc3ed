"""Search for streaks: connected regions of the image that differ from the plate by more than noise.

A streak loses its contrast where the plate has the object's color, and is then found in parts. Parts on
one curve, of one width, with weak evidence between them are joined. Such parts are (n, 2) arrays of the
x and y of their cells, and a curve is v = a + b u + c u² along the principal axis u of two parts.

The picture is divided into tiles, which show how likely a streak is due to noise. The largest T of a
tile where nothing moved has an extreme-value distribution; that of compression has a heavy tail, so
that log T is taken as Gumbel (T as Fréchet). Its two parameters follow from two quantiles of the tiles,
and the expected number of tiles of the picture above a T from these.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import scipy

from blurmatte.calibration.noise_pair import with_noise
from blurmatte.checks import Array, Bools, Floats, box_of, check_kind, check_same_size, rows_columns
from blurmatte.errors import MotionError, PlateError
from blurmatte.radiometry import LinearImage, check_same_colors, whitened
from blurmatte.streaks.evidence import SMOOTHING, evidence, light_change, without_outliers
from blurmatte.streaks.streak import Streak, cells_to_pixels, dilated, grown_part, opened

# Thresholds of T, and the shape of the masks. Lengths are in cells.
_MAX_CELLS = 1e6  # of a picture
_SURE = 6.0**2  # T: something moved
_POSSIBLE = 3.5**2  # T: part of a streak if connected to a sure place
_MIN_RELATIVE_CONTRAST = 0.1  # of a streak's own; below it is a shadow or halo
_CLOSING = 2  # gaps up to twice this are closed
_RIM = 3  # of a streak, fainter than the noise
_MIN_EVIDENCE_RATIO = 0.01  # of a streak over the strongest: others are of noise, codec or halo
_MIN_ELONGATION = 2.0  # length over width from which a part has a direction
_MAX_WIDTH_RATIO = 2.0  # of two parts of one streak
_PARABOLA = 3  # parameters: of fewer cells it is not determined
_TILE_CELLS = 8, 32  # at least: T is correlated over fewer; at most
_TILES_PER_SIDE = 16  # between these limits
_QUANTILES = 0.5, 0.95  # of the tiles' largest T; above it is what did move
_STILL_QUANTILE = 0.95  # of T where nothing moved: the corridor's median exceeds it


def find_streaks(image: LinearImage, plate: LinearImage) -> list[Streak]:
    """Find the regions where something moved, the one with the largest evidence first.

    Parameters
    ----------
    image, plate : LinearImage
        The same size, at least 16x16 pixels; unknown noise is estimated.

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

    Examples
    --------
    >>> streaks = bm.find_streaks(image, plate)
    >>> len(streaks), streaks[0].box
    (1, (20, 15, 101, 57))
    """
    check_same_colors("the image", image, "the plate", plate)
    check_same_size("image", image.size, "plate", plate.size)
    if min(image.size) < 16:
        width, height = image.size
        raise PlateError(f"the picture is {width}x{height} pixels; it must be 16x16 or more")
    if not (image.valid & plate.valid).any():
        raise _nothing_usable(image, plate)
    image, plate = with_noise(image, plate)
    image = without_outliers(image, plate)
    cell = int(np.ceil(np.sqrt(image.valid.size / _MAX_CELLS)))
    T = evidence(*whitened(image, plate, of_sums=True), cell)
    moved = opened(_POSSIBLE < T)  # thin: a shifted edge of the plate
    labels, _ = scipy.ndimage.label(dilated(moved, _CLOSING), np.ones((3, 3)))
    parts = []
    for number, place in enumerate(scipy.ndimage.find_objects(labels), start=1):
        near = np.where((labels[place] == number) & moved[place], T[place], 0)
        for part in _strong_parts(near) if near.max() > _SURE else ():
            cells = np.zeros(T.shape, bool)
            cells[place] = part
            parts.append(cells)
    parts = join_in_line(parts, T)
    expected = expected_false(T, parts) if len(parts) > 1 else [0.0] * len(parts)
    streaks = [
        Streak(
            _to_pixels(part, cell, image.valid.shape),
            evidence=float(T[part].sum()),
            cell=cell,
            expected_false=false,
        )
        for part, false in zip(parts, expected, strict=True)
    ]
    return sorted(streaks, key=lambda streak: -streak.evidence)


def _nothing_usable(image: LinearImage, plate: LinearImage) -> PlateError:
    """The error for pictures without a valid pixel in common: transparent, or clipped."""
    for name, picture in (("the image", image), ("the plate", plate)):
        if not picture.valid.any() and not picture.clipped.any(axis=-1).all():
            return PlateError(
                f"{name} has no opaque pixel: its alpha is below 1 everywhere; export it without alpha"
            )
    return PlateError("image and plate have no unclipped pixel in common; expose shorter")


def require_streaks(image: LinearImage, plate: LinearImage) -> list[Streak]:
    """`find_streaks`, with a MotionError if nothing moved, or if changes of light hide it."""
    streaks = find_streaks(image, plate)
    if not streaks:
        change = light_change(image, plate)
        if change > 0:
            raise MotionError(
                f"no streak: image and plate differ by {change:.0%} of their light all over the "
                "picture, more than noise and than the match can describe; lamps that flicker leave "
                "bands: take both in steady light, or with exposure times that are multiples of 1/100 "
                "s (1/120 s in America)"
            )
        raise MotionError(
            "nothing moved: image and plate agree within their noise; check that they are two "
            "pictures, or give a region (--region, streak=)"
        )
    return streaks


def find_streak_within(region: Streak, image: LinearImage, plate: LinearImage) -> Streak:
    """The streak in a region: the parts there of the streaks that belong to it.

    A streak belongs to the region if more than half of it lies there, or if it fills a tenth of it;
    unless its evidence is less than a hundredth of the largest there.

    Parameters
    ----------
    region : Streak
        Such as `Streak.from_box`.
    image, plate : LinearImage
        As for `find_streaks`.

    Returns
    -------
    Streak
        `region` itself if no streak belongs to it.

    Raises
    ------
    ValueError, PlateError
        As `find_streaks`.

    Examples
    --------
    >>> region = bm.streaks.Streak.from_box((10, 10, 110, 66), image.size)
    >>> bm.streaks.find_streak_within(region, image, plate).box
    (20, 15, 101, 57)
    """
    check_kind("region", region, Streak, "use blurmatte.streaks.Streak.from_box(box, size)")
    belonging = []
    for found in find_streaks(image, plate):
        count = np.count_nonzero(found.mask & region.mask)
        most = count > 0.5 * np.count_nonzero(found.mask)
        if most or count > 0.1 * np.count_nonzero(region.mask):
            belonging.append(found)
    if not belonging:
        return region
    parts = [one.mask for one in without_faint(belonging)]
    return Streak(np.any(parts, axis=0) & region.mask, cell=belonging[-1].cell)


def without_faint(streaks: Sequence[Streak]) -> list[Streak]:
    """Streaks, the strongest first, without those of less than a hundredth of its evidence."""
    return [one for one in streaks if one.evidence >= _MIN_EVIDENCE_RATIO * streaks[0].evidence]


def _strong_parts(T: Floats) -> list[Bools]:
    """Masks of the sure parts, without connected weak shadows and halos."""
    typical = float(np.quantile(T[T > 0], 0.9))
    weakest = _MIN_RELATIVE_CONTRAST**2 * typical
    strong = np.asarray(max(_POSSIBLE, weakest) < T)
    near = dilated(strong, _CLOSING)
    pieces, count = scipy.ndimage.label(near, np.ones((3, 3)))
    tops = scipy.ndimage.maximum(T, pieces, np.arange(1, count + 1))
    return [strong & (pieces == n) for n, top in enumerate(tops, start=1) if top > _SURE]


def _to_pixels(part: Bools, cell: int, shape: tuple[int, ...]) -> Bools:
    """(H, W) mask of pixels of a part of the cells: closed, filled, and with its faint rim."""
    place = rows_columns(box_of(part))
    cells = grown_part(part[place], place, part.shape, _CLOSING, _RIM)
    return cells_to_pixels(cells, cell, shape)


def expected_false(T: Floats, parts: Sequence[Bools]) -> list[float]:
    """For each part of the cells, the number of equally strong ones that are due to noise.

    T (h, w): the test statistic, see `evidence`. parts: masks (h, w), at least one. Noise does not fill
    a tile: a larger part counts as 0, and its tiles are left out, as are those of the strongest part.
    """
    tile = int(np.clip(np.sqrt(T.size) / _TILES_PER_SIDE, *_TILE_CELLS))
    tops = _largest(T, tile)
    strongest = max(float(T[part].sum()) for part in parts)
    large = [
        np.count_nonzero(part) > tile**2 or float(T[part].sum()) == strongest for part in parts
    ]
    moved = np.zeros(tops.shape, bool)
    for part in (part for part, is_large in zip(parts, large, strict=True) if is_large):
        moved |= _largest(part, tile)
    still = np.log(np.maximum(tops[~moved], 1e-3))
    if still.size < 2:
        return [0.0] * len(parts)
    low, high = np.quantile(still, _QUANTILES)
    reduced = [-np.log(-np.log(q)) for q in _QUANTILES]
    spread = max(float(high - low) / (reduced[1] - reduced[0]), 1e-3)
    middle = float(low) - spread * reduced[0]
    excess = [(np.log(float(T[part].max())) - middle) / spread for part in parts]
    expected = [float(tops.size * -np.expm1(-np.exp(-one))) for one in excess]
    return [0.0 if is_large else e for is_large, e in zip(large, expected, strict=True)]


def _largest(values: Floats | Bools, tile: int) -> Floats:
    """The largest value of each tile; those at the right and lower border may be smaller."""
    rows = np.maximum.reduceat(values, np.arange(0, values.shape[0], tile), axis=0)
    return np.asarray(np.maximum.reduceat(rows, np.arange(0, values.shape[1], tile), axis=1))


def merge_across_occluder(streaks: Sequence[Streak], occluder: Bools) -> list[Streak]:
    """Merge the first streak with those that continue it on the other side of an occluder.

    streaks: at least one, the strongest first.
    occluder (H, W): static objects in front of the moving one.

    The first of the result is the merged one; its mask includes the hidden part between.
    """
    if not occluder.any():
        return list(streaks)
    across = int(2 * scipy.ndimage.distance_transform_edt(np.pad(occluder, 1)).max())

    def behind(mask: Bools) -> Bools:
        """The part of the occluder within its width of a mask."""
        grown = dilated(mask, _RIM)
        return np.asarray(
            occluder
            & scipy.ndimage.binary_dilation(grown, iterations=across, mask=occluder | grown)
        )

    whole, rest = streaks[0], list(streaks[1:])
    for other in list(rest):
        between = behind(whole.mask) & behind(other.mask)
        if between.any():
            mask = whole.mask | other.mask | between
            whole = replace(whole, mask=mask, evidence=whole.evidence + other.evidence)
            rest.remove(other)
    return [whole, *rest]


def _corridor_between(one: Array, other: Array, shape: tuple[int, ...]) -> Bools | None:
    """(h, w) the cells between two parts that follow each other on one parabola; None for others."""
    both = np.concatenate([one, other])
    origin, frame = both.mean(axis=0), _axes(both)
    parts = ((p - origin) @ frame.T for p in (one, other))
    first, second = sorted(parts, key=lambda part: float(part[:, 0].mean()))
    end, begin = first[:, 0].max(), second[:, 0].min()
    if end >= begin or not (_is_elongated(first) and _is_elongated(second)):
        return None
    spreads = [_spread(part) for part in (first, second)]
    if max(spreads) > _MAX_WIDTH_RATIO * min(spreads):
        return None
    u, v = np.concatenate([first, second]).T
    bend = np.polyfit(u, v, 2)
    for part, spread in zip((first, second), spreads, strict=True):
        offset = float(np.mean((part[:, 1] - np.polyval(bend, part[:, 0])) ** 2)) - spread**2
        if offset > spread**2:
            return None
    y, x = np.indices(shape, sparse=True)
    (ux, uy), (vx, vy) = frame
    x, y = x - origin[0], y - origin[1]
    u, v = ux * x + uy * y, vx * x + vy * y
    half_width = float(np.sqrt(3) * np.mean(spreads))
    return np.asarray((u > end) & (u < begin) & (np.abs(v - np.polyval(bend, u)) <= half_width))


def _axes(part: Array) -> Array:
    """(2, 2) unit vectors along and across a part."""
    return np.asarray(np.linalg.eigh(np.cov((part - part.mean(axis=0)).T))[1].T[::-1])


def _spread(part: Array) -> float:
    """Standard deviation across a part, about its own parabola; at least that of one cell."""
    u, v = part.T
    u = u - u.mean()
    return max(float(np.std(v - np.polyval(np.polyfit(u, v, 2), u))), 12**-0.5)


def _is_elongated(part: Array) -> bool:
    """Whether a part, along its first axis, is longer than wide: only then it has a direction."""
    # A strip of constant density has the width √12 times its spread.
    along, least = float(np.ptp(part[:, 0])), _MIN_ELONGATION * np.sqrt(12)
    return bool(along >= least * 12**-0.5 and along >= least * _spread(part))


def join_in_line(parts: Sequence[Bools], T: Floats) -> list[Bools]:
    """Join the parts of one streak, with the corridors between them.

    parts: (h, w) masks of cells; T (h, w): the evidence of every cell.

    Two parts are joined if they are elongated, lie on one parabola, are about equally wide, and the
    median evidence between them exceeds that of nearly all cells in which nothing moved.
    """
    moved = np.logical_or.reduce(parts) if parts else np.zeros(T.shape, bool)
    halo = int(3 * max(SMOOTHING))  # of a part in the smoothed evidence

    def is_streak(corridor: Bools) -> bool:
        """Whether its median T exceeds that of most cells where nothing moved."""
        still = T[~dilated(moved | corridor, halo)]
        most = np.quantile(still, _STILL_QUANTILE) if still.size else np.inf
        return bool(np.median(T[corridor]) > most)

    return _joined(list(parts), is_streak)


def _joined(parts: list[Bools], is_streak: Callable[[Bools], bool]) -> list[Bools]:
    """The parts after all possible joins, each the first that is found."""
    waiting, short = list[Bools](), list[Bools]()
    for part in parts:
        (waiting if _has_direction(_cells(part)) else short).append(part)
    done: list[tuple[Bools, Array]] = []
    while waiting:
        part = waiting.pop(0)
        cells = _cells(part)
        for k, (other, places) in enumerate(done):
            corridor = _corridor_between(places, cells, part.shape)
            if corridor is not None and corridor.any() and is_streak(corridor):
                del done[k]
                waiting.insert(0, other | part | corridor)
                break
        else:
            done.append((part, cells))
    return [*(part for part, _ in done), *short]


def _has_direction(cells: Array) -> bool:
    """Whether a part is elongated along its own axis, and so may be along that of two parts."""
    return len(cells) > _PARABOLA and _is_elongated((cells - cells.mean(axis=0)) @ _axes(cells).T)


def _cells(part: Bools, most: int = 4000) -> Array:
    """(n, 2) x and y of at most about so many cells of a part."""
    y, x = np.nonzero(part)
    step = max(1, len(x) // most)
    return np.stack([x[::step], y[::step]], axis=-1).astype(float)
