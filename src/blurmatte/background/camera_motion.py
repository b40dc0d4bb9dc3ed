"""Camera motion: shifts of tiles between frames.

Phase correlation (Kuglin & Hines 1975) finds the integer shift of a tile, three robust steps of Lucas &
Kanade (1981) the fraction. The median over the tiles that determine a shift tolerates moving objects.

The shift of a plate is part of its match (`alignment`), in one likelihood with the light.
`calibration.noise_samples` asks which share of noise a shift far below a pixel explains: one linear
step is enough.
"""

from collections.abc import Callable, Iterator, Sequence

import numpy as np
import scipy

from blurmatte.checks import Floats
from blurmatte.errors import PlateError
from blurmatte.radiometry import LinearImage, rounding_noise
from blurmatte.statistics import MAD_TO_STD, cell_means

# Frames and tiles that are compared, and the shift that is tolerated.
_FRAMES = 5
_TILES = 3  # per side
_MIN_TILES = 3  # that must agree with the shift of the whole; an object between tiles is in two
_MIN_TILE_PX = 64
_MAX_TILE_PX = 256
_MIN_OVERLAP_PX = 16  # of a shifted tile
MAX_SHIFT_PX = 0.5  # blur of a plate's edges that is acceptable
_MAX_SHIFT_STD_PX = 0.1  # of a tile that determines its shift
_PEAKS = 4  # of the correlation of two frames: what moves has one, too
_MIN_VARIANCE = 1e-7  # of a frame without code values, light²
_MAX_RESIDUAL_RATIO = 0.8  # of the differences with and without a shift


class CameraMotionError(PlateError):
    """Frames that do not show one scene from one place."""


def check_static_camera(
    gray_of: Callable[[int], Floats], variance: float, names: Sequence[str]
) -> None:
    """Raise CameraMotionError, naming frames and shift, if most of the picture moves between frames.

    gray_of: mean (H, W) of the channels of a frame, from its number on, at a common exposure.
    variance: of the noise of a frame, averaged over the channels, light².
    names: of the frames, for the error.
    """
    middle = len(names) // 2
    others = np.unique(np.linspace(0, len(names) - 1, _FRAMES).astype(int))
    worst, at = 0.0, middle
    a = gray_of(middle)
    for k in map(int, others[others != middle]):
        b = gray_of(k)
        if (moved := _moved(a, b, variance)) > worst:
            worst, at = moved, k
    if worst > 0:
        raise CameraMotionError(
            f"the camera moved: by {worst:.1f} pixels between {names[at]} and {names[middle]}; "
            "frames of a moving camera are registered if they are a list or those of read_frames"
        )


def looks_alike(plate: LinearImage, frames: Sequence[LinearImage]) -> bool:
    """Whether some frames of a clip look where a plate of their size does."""
    few = np.unique(np.linspace(0, len(frames) - 1, _FRAMES).astype(int))
    return not any(_moved(*in_gray(plate, frames[int(k)])) > 0 for k in few)


def in_gray(plate: LinearImage, frame: LinearImage) -> tuple[Floats, Floats, float]:
    """Means of the channels of a plate in the light of a frame, and of the frame; its variance."""
    a, b = (picture.rgb.mean(axis=-1) for picture in (plate, frame))
    gain = float(np.median(b)) / max(float(np.median(a)), 1e-6)
    return gain * a, b, _gray_variance(frame)


def _gray_variance(frame: LinearImage) -> float:
    """Variance by rounding of the mean of a frame's channels, light²: the least that it may have."""
    light = np.median(frame.rgb.reshape(-1, 3)[::7], axis=0)
    return max(float(rounding_noise(frame).variance(light).sum()) / 9, _MIN_VARIANCE)


def _moved(a: Floats, b: Floats, variance: float) -> float:
    """Shift between two pictures, pixels; 0 if it is tolerable."""
    whole, cell = shift_between(a, b, variance)
    too_far = whole is not None and max(map(abs, whole)) > cell  # for tiles
    if whole is not None and too_far and _is_seen_in_tiles(a, b, whole, variance):
        return float(np.hypot(*whole))
    shifts = [_shift(a[tile], b[tile], variance) for tile in _tiles(a.shape)]
    lengths = [float(np.hypot(*shift)) for shift in shifts if shift is not None]
    moved = [length for length in lengths if length > MAX_SHIFT_PX]
    return float(np.median(moved)) if len(moved) >= max(2, len(lengths) / 2) else 0.0


def _is_seen_in_tiles(a: Floats, b: Floats, whole: tuple[float, float], variance: float) -> bool:
    """Whether half of the tiles that determine a shift agree better with that of the whole.

    An object may determine the shift of the whole; it is in few tiles.
    """
    a, b = _smooth(a), _smooth(b)
    there, moved = _overlap(a, b, *map(round, whole))
    x, y = (max(0, -round(shift)) for shift in whole)
    still = b[y : y + there.shape[0], x : x + there.shape[1]]
    better = [
        _difference(moved[tile] - there[tile]) < _difference(still[tile] - there[tile])
        for tile in _tiles(there.shape)
        if np.isfinite(_subpixel_shift(there[tile], there[tile], variance)[2])
    ]
    return not better or sum(better) >= max(_MIN_TILES, len(better) / 2)


def shift_between(a: Floats, b: Floats, variance: float) -> tuple[tuple[float, float] | None, int]:
    """(x, y) shift of the whole of b against a, pixels, None if they do not determine it; its cell.

    The pictures are compared as means over cells of so many pixels.
    """
    cell = -(-max(a.shape) // _MAX_TILE_PX)
    shift = _shift(cell_means(a, cell), cell_means(b, cell), variance / cell**2)
    return None if shift is None else (cell * shift[0], cell * shift[1]), cell


def likely_shifts(a: Floats, b: Floats) -> list[tuple[float, float]]:
    """(x, y) shifts of the whole of b against a, pixels, that may be the camera's."""
    cell = -(-max(a.shape) // _MAX_TILE_PX)
    peaks = _integer_shifts(cell_means(a, cell), cell_means(b, cell), _PEAKS)
    return list(dict.fromkeys([*((cell * x, cell * y) for x, y in peaks), (0.0, 0.0)]))


def tile_shifts(
    a: Floats, b: Floats, variance: float, side: int
) -> Iterator[tuple[tuple[slice, slice], tuple[float, float] | None]]:
    """Rows and columns of square tiles, and the shift of b against a there; None if undetermined."""
    for y in range(0, a.shape[0] - side + 1, side):
        for x in range(0, a.shape[1] - side + 1, side):
            tile = np.s_[y : y + side, x : x + side]
            yield tile, _shift(a[tile], b[tile], variance)


def _tiles(shape: tuple[int, ...]) -> list[tuple[slice, slice]]:
    """Tiles over the whole picture; in small pictures they overlap."""
    sides = []
    for length in shape:
        size = max(length // _TILES, _MIN_TILE_PX)
        size = min(length, size, _MAX_TILE_PX)
        starts = np.linspace(0, length - size, _TILES)
        sides.append([slice(int(start), int(start) + size) for start in starts])
    return [(rows, columns) for rows in sides[0] for columns in sides[1]]


def _shift(a: Floats, b: Floats, variance: float) -> tuple[float, float] | None:
    """(x, y) shift of b against a, pixels; None if the tile does not determine it."""
    best, determined = (0.0, 0.0), False
    least = _MAX_RESIDUAL_RATIO * _difference(_smooth(a) - _smooth(b))
    for x, y in dict.fromkeys([*_integer_shifts(a, b, 1), (0, 0)]):
        overlap = _overlap(a, b, x, y)
        if min(overlap[0].shape) < _MIN_OVERLAP_PX:
            continue
        dx, dy, residual = _subpixel_shift(*overlap, variance)
        determined |= np.isfinite(residual)
        if residual < least:
            best, least = (x + dx, y + dy), residual
    return best if determined else None


def _difference(d: Floats) -> float:
    """Mean square root of |d|: a bright moving object has little weight."""
    return float(np.mean(np.sqrt(np.abs(d))))


def _smooth(tile: Floats) -> Floats:
    return np.asarray(scipy.ndimage.gaussian_filter(tile, 1))


def _integer_shifts(a: Floats, b: Floats, count: int) -> Iterator[tuple[int, int]]:
    """The shifts of the highest peaks, which are not next to one another."""
    window = np.outer(np.hanning(a.shape[0]), np.hanning(a.shape[1]))
    spectra = [scipy.fft.rfft2((tile - tile.mean()) * window) for tile in (a, b)]
    cross = np.conj(spectra[0]) * spectra[1]
    peaks = scipy.fft.irfft2(cross / (np.abs(cross) + 1e-12 * np.abs(cross).max() + 1e-30), a.shape)
    height, width = a.shape
    for _ in range(count):
        y, x = map(int, np.unravel_index(int(np.argmax(peaks)), a.shape))
        yield x - width * (x > width // 2), y - height * (y > height // 2)
        near = np.arange(-1, 2)
        peaks[np.ix_((y + near) % height, (x + near) % width)] = -np.inf


def _overlap(a: Floats, b: Floats, x: int, y: int) -> tuple[Floats, Floats]:
    """The parts of both that overlap if b is a, shifted by (x, y) pixels."""
    height, width = a.shape
    here = np.s_[max(0, -y) : height - max(0, y), max(0, -x) : width - max(0, x)]
    there = np.s_[max(0, y) : height - max(0, -y), max(0, x) : width - max(0, -x)]
    return a[here], b[there]


def _subpixel_shift(a: Floats, b: Floats, variance: float) -> tuple[float, float, float]:
    """(x, y) shift, at most a pixel each, and the residual difference.

    The residual is infinite if noise leaves the shift undetermined.
    """
    a, b = _smooth(a), _smooth(b)
    middle: Floats = (a + b) / 2
    gy, gx = np.gradient(middle, axis=0), np.gradient(middle, axis=1)
    d, x, y, inliers = b - a, 0.0, 0.0, np.ones(a.shape, bool)
    for _ in range(3):
        g = np.stack([gx[inliers], gy[inliers]])
        normal = np.einsum("in,jn->ij", g, g)  # BLAS's threads would only wait for such products
        # Smoothing by one pixel leaves 1/4π of white noise's variance and correlates 4π pixels.
        least = float(np.linalg.eigvalsh(normal).min())
        if least * _MAX_SHIFT_STD_PX**2 < 2 * variance:
            return 0.0, 0.0, np.inf
        x, y = np.clip(-np.linalg.solve(normal, np.einsum("in,n->i", g, d[inliers])), -1, 1)
        residual = d + x * gx + y * gy
        limit = 3 * MAD_TO_STD * float(np.median(np.abs(residual)))
        inliers = np.abs(residual) <= max(limit, np.sqrt(variance))
    return float(x), float(y), _difference(residual)
