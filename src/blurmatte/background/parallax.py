"""Parallax: where a scene is not where one homography puts it, since the camera moved in space.

Tiles of a frame are compared with the same tiles of another frame that is warped to it. A tile that is
shifted, and agrees when it is shifted back, lies at another depth than the rest. What moves in the
scene is in one place in a few frames only; depth stays.
"""

from collections.abc import Iterable, Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np
import scipy

from blurmatte.background.camera_motion import MAX_SHIFT_PX, in_gray, tile_shifts
from blurmatte.background.registration import (
    CameraPath,
    ParallaxRegion,
    register_frames,
    seen_through,
)
from blurmatte.background.warp import composed, inverse
from blurmatte.checks import Array, Bools, Floats, enclosing
from blurmatte.radiometry import LinearImage

_TILES_ALONG = 16  # on the longer side
_MIN_TILE_PX = 32
_FRAMES = 6  # of a clip, that are compared
_FRACTION = 0.5  # of the pairs that determine the shift of a tile: more are most
_MIN_PAIRS = 2  # of a clip
_MIN_TILES = 2  # next to each other


def camera_path(frames: Sequence[LinearImage], plate: LinearImage | None = None) -> CameraPath:
    """As `register_frames`, with the parallax of the clip."""
    path = register_frames(frames, plate)
    return replace(path, parallax=tuple(parallax_of_clip(frames, path)))


def parallax_between(
    image: LinearImage, *plates: LinearImage, ignored: Bools | None = None
) -> list[ParallaxRegion]:
    """Where most plates that were matched to an image are shifted against it, the largest first.

    A plate that was made of several is not known where they differ, which hides their shift: give each.
    ignored (H, W): where the object is.
    """
    side, found = _side(image.size), list[tuple[Array, float]]()
    free = image.valid if ignored is None else image.valid & ~ignored
    for plate in plates:
        found += _displaced(image, replace(plate, valid=plate.valid & free), side)
    return _regions(found, image.size, side, 1)


def parallax_of_clip(frames: Sequence[LinearImage], path: CameraPath) -> list[ParallaxRegion]:
    """Where the registered frames of a clip disagree by a shift that stays in place, on the canvas."""
    known = path.registered
    some = [known[k] for k in np.unique(np.linspace(0, len(known) - 1, _FRAMES).astype(int))]
    side, found = _side(path.size), list[tuple[Array, float]]()
    for a, b in pairwise(some):
        h = composed(path.view(b).h, inverse(path.view(a).h))
        seen = seen_through(replace(path.view(b), h=h), frames[a])
        for at, length in _displaced(frames[b], seen, side):
            found.append((path.to_canvas(b, at[None])[0], length))
    return _regions(found, path.canvas.size, side, _MIN_PAIRS)


def _side(size: tuple[int, int]) -> int:
    return max(_MIN_TILE_PX, max(size) // _TILES_ALONG)


def _displaced(image: LinearImage, seen: LinearImage, side: int) -> Iterable[tuple[Array, float]]:
    """Centers (2,) of the tiles that determine a shift, and its length, pixels."""
    for tile, shift in tile_shifts(*in_gray(seen, image), side):
        if shift is not None and seen.valid[tile].all():
            rows, columns = tile
            middle = np.array([columns.start, rows.start]) + (side - 1) / 2
            yield middle, float(np.hypot(*shift))


def _regions(
    found: Sequence[tuple[Array, float]], size: tuple[int, int], side: int, least: int
) -> list[ParallaxRegion]:
    """Boxes around neighboring tiles that are shifted in most of the pairs that show them."""
    shape = -(-size[1] // side), -(-size[0] // side)
    lengths: dict[tuple[int, int], list[float]] = {}
    for (x, y), length in found:
        lengths.setdefault((int(y // side), int(x // side)), []).append(length)
    shifted, by = np.zeros(shape, bool), np.zeros(shape)
    for (row, column), each in lengths.items():
        if not (0 <= row < shape[0] and 0 <= column < shape[1]):
            continue
        far = [length for length in each if length > MAX_SHIFT_PX]
        if len(far) >= least and len(far) > _FRACTION * len(each):
            shifted[row, column], by[row, column] = True, np.median(far)
    return _joined(shifted, by, side, size)


def _joined(shifted: Bools, by: Floats, side: int, size: tuple[int, int]) -> list[ParallaxRegion]:
    labels, count = scipy.ndimage.label(shifted, np.ones((3, 3)))
    regions = []
    for number in range(1, count + 1):
        mine = labels == number
        if np.count_nonzero(mine) < _MIN_TILES:
            continue
        boxes = [
            (c * side, r * side, min(c * side + side, size[0]), min(r * side + side, size[1]))
            for r, c in np.argwhere(mine).tolist()
        ]
        regions.append(ParallaxRegion(enclosing(boxes), float(np.median(by[mine]))))
    return sorted(regions, key=lambda one: -(one.box[2] - one.box[0]) * (one.box[3] - one.box[1]))
