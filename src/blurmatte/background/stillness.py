"""Did the camera stand still? Shifts between frames, tile by tile.

The whole shift of a tile comes from the phase correlation (Kuglin & Hines 1975), the rest from one
step of Lucas & Kanade (1981). Tiles in which something else moved, or that show nothing, are outvoted.
"""

from collections.abc import Sequence

import numpy as np

from blurmatte.checks import Floats
from blurmatte.errors import PlateError
from blurmatte.statistics import MAD_TO_STD, cell_means

_TILES = 3  # a side
_LEAST_TILE, _TILE = 64, 256  # pixels of a side
_LEAST_OVERLAP = 16  # pixels
_LOOKED_AT = 5  # frames
_MOST_SHIFT = 0.5  # pixels: what averaging may blur edges by, and no more
_SURE = 0.1  # pixels: a tile of which the noise leaves more open does not vote
_GAIN = 0.8  # of the difference is left, at most, if it was a shift
_KEPT = 3 * MAD_TO_STD  # times the median deviation: three standard deviations


def check_still(light: Floats, gain: Floats, variance: float, names: Sequence[str]) -> None:
    """Refuse frames between which most of the picture is shifted.

    Parameters
    ----------
    light : (K, H, W, 3) float
    gain : (K, 3) float
        Which the light is divided by.
    variance : float
        Of the noise of one frame's mean over the channels, light².
    names : sequence of str
        What to call the frames.

    Raises
    ------
    PlateError
        With the frames and by how many pixels.
    """
    middle = len(light) // 2
    others = np.unique(np.linspace(0, len(light) - 1, _LOOKED_AT).astype(int))
    worst, at = 0.0, middle
    for k in others[others != middle]:
        a, b = ((light[i] / gain[i]).mean(axis=-1, dtype=np.float32) for i in (middle, k))
        if (moved := _moved(a, b, variance)) > worst:
            worst, at = moved, int(k)
    if worst > 0:
        raise PlateError(
            f"the camera moved: by {worst:.1f} pixels between {names[at]} and {names[middle]}; "
            "a plate needs a camera that stands still, give a part of the clip in which it does "
            "(--start, --stop), or stabilize it"
        )


def _moved(a: Floats, b: Floats, variance: float) -> float:
    """How far the camera moved between two pictures, pixels; 0 if it did not."""
    cell = -(-max(a.shape) // _TILE)
    whole = _shift(cell_means(a, cell), cell_means(b, cell), variance / cell**2)
    if whole is not None and max(map(abs, whole)) > 1:  # farther than a tile may be wide
        return float(cell * np.hypot(*whole))
    shifts = [_shift(a[tile], b[tile], variance) for tile in _tiles(a.shape)]
    lengths = [float(np.hypot(*shift)) for shift in shifts if shift is not None]
    moved = [length for length in lengths if length > _MOST_SHIFT]
    return float(np.median(moved)) if len(moved) >= max(2, len(lengths) / 2) else 0.0


def _tiles(shape: tuple[int, ...]) -> list[tuple[slice, slice]]:
    """3 x 3 of them over the whole picture; in small ones they overlap."""
    sides = []
    for length in shape:
        size = min(length, max(length // _TILES, _LEAST_TILE), _TILE)
        starts = np.linspace(0, length - size, _TILES)
        sides.append([slice(int(start), int(start) + size) for start in starts])
    return [(rows, columns) for rows in sides[0] for columns in sides[1]]


def _shift(a: Floats, b: Floats, variance: float) -> tuple[float, float] | None:
    """(x, y) of what b shows against a, pixels; None if the tile does not tell."""
    best, least, told = (0.0, 0.0), _GAIN * _difference(_smooth(a) - _smooth(b)), False
    for x, y in dict.fromkeys([_whole_shift(a, b), (0, 0)]):
        near = _overlap(a, b, x, y)
        if min(near[0].shape) < _LEAST_OVERLAP:
            continue
        dx, dy, left = _rest(*near, variance)
        told |= np.isfinite(left)
        if left < least:
            best, least = (x + dx, y + dy), left
    return best if told else None


def _difference(d: Floats) -> float:
    """How large differences are, of most pixels: those of something bright that moves count little."""
    return float(np.mean(np.sqrt(np.abs(d))))


def _smooth(tile: Floats) -> Floats:
    from scipy.ndimage import gaussian_filter

    return np.asarray(gaussian_filter(tile, 1))


def _whole_shift(a: Floats, b: Floats) -> tuple[int, int]:
    from scipy import fft

    window = np.outer(np.hanning(a.shape[0]), np.hanning(a.shape[1]))
    spectra = [fft.rfft2((tile - tile.mean()) * window) for tile in (a, b)]
    cross = np.conj(spectra[0]) * spectra[1]
    peaks = fft.irfft2(cross / (np.abs(cross) + 1e-12 * np.abs(cross).max() + 1e-30), a.shape)
    y, x = np.unravel_index(int(np.argmax(peaks)), a.shape)
    height, width = a.shape
    return int(x - width * (x > width // 2)), int(y - height * (y > height // 2))


def _overlap(a: Floats, b: Floats, x: int, y: int) -> tuple[Floats, Floats]:
    """The parts of both that show the same if b is a, shifted by whole pixels."""
    height, width = a.shape
    here = np.s_[max(0, -y) : height - max(0, y), max(0, -x) : width - max(0, x)]
    there = np.s_[max(0, y) : height - max(0, -y), max(0, x) : width - max(0, -x)]
    return a[here], b[there]


def _rest(a: Floats, b: Floats, variance: float) -> tuple[float, float, float]:
    """The rest of the shift, x and y, at most a pixel, and the difference it leaves.

    That is infinite if noise leaves the shift open.
    """
    a, b = _smooth(a), _smooth(b)
    middle: Floats = (a + b) / 2
    gy, gx = np.gradient(middle, axis=0), np.gradient(middle, axis=1)
    d, x, y, kept = b - a, 0.0, 0.0, np.ones(a.shape, bool)
    for _ in range(3):
        g = np.stack([gx[kept], gy[kept]])
        normal = np.einsum("in,jn->ij", g, g)  # small products; threads of BLAS would only wait
        # Smoothing by one pixel leaves 1/4π of white noise's variance, and spreads it over 4π pixels.
        if float(np.linalg.eigvalsh(normal).min()) * _SURE**2 < 2 * variance:
            return 0.0, 0.0, np.inf
        x, y = np.clip(-np.linalg.solve(normal, np.einsum("in,n->i", g, d[kept])), -1, 1)
        left = d + x * gx + y * gy
        kept = np.abs(left) <= max(_KEPT * float(np.median(np.abs(left))), np.sqrt(variance))
    return float(x), float(y), _difference(left)
