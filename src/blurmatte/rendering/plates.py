"""Plates to move things in front of: linear light (H, W, 3), float64, never black.

Same size and seed, same bytes. Sizes are (width, height).
"""

import numpy as np
import numpy.typing as npt

from blurmatte.rendering.camera import Rng
from blurmatte.rendering.paint import check_color

Array = npt.NDArray[np.float64]

_GOLDEN = (np.sqrt(5) - 1) / 2  # turns by this part of a circle never come near each other


def plain_plate(size: tuple[int, int], color: npt.ArrayLike, rng: Rng) -> Array:
    """A wall of one hue: slow changes of brightness and a fine texture, nothing else.

    Parameters
    ----------
    size : (int, int)
        Width and height.
    color : (3,) float
        Linear light where the wall is brightest; it falls to 0.55 of that.
    rng : int or Generator

    Returns
    -------
    (H, W, 3) float64
        Every pixel a multiple of `color`.
    """
    paint, rng = check_color("color", color), np.random.default_rng(rng)
    slow = _smooth(size, _short(size) / 4, rng)
    fine = _smooth(size, 0.8, rng)
    brightness = 0.55 + 0.45 * _unit_range(slow + 0.12 * fine)
    return np.asarray(brightness[..., None] * paint)


def two_hue_plate(
    size: tuple[int, int], first: npt.ArrayLike, second: npt.ArrayLike, rng: Rng
) -> Array:
    """Patches of two colors with soft borders: every pixel lies on the segment between them.

    Parameters
    ----------
    size : (int, int)
        Width and height.
    first, second : (3,) float
        Linear light.
    rng : int or Generator

    Returns
    -------
    (H, W, 3) float64
    """
    a, b = check_color("first", first), check_color("second", second)
    patches = _smooth(size, _short(size) / 12, np.random.default_rng(rng))
    share = (0.5 + 0.5 * np.tanh(3 * patches))[..., None]
    return np.asarray((1 - share) * a + share * b)


def colorful_plate(size: tuple[int, int], rng: Rng, tile: float = 60) -> Array:
    """Tiles of all hues with hard edges, each softly shaded and grained.

    Parameters
    ----------
    size : (int, int)
        Width and height.
    rng : int or Generator
    tile : float
        Typical width of a tile, pixels.

    Returns
    -------
    (H, W, 3) float64
    """
    from scipy.spatial import KDTree

    if not tile > 0:
        raise ValueError(f"tile must be positive, got {tile}")
    _check_size(size)
    rng = np.random.default_rng(rng)
    width, height = size
    columns, rows = (int(np.ceil(side / tile)) + 2 for side in size)
    grid = np.stack(np.meshgrid(np.arange(columns), np.arange(rows)), axis=-1).reshape(-1, 2)
    centers = tile * (grid - 0.5 + rng.uniform(-0.38, 0.38, grid.shape))
    hue = (np.arange(len(grid)) * _GOLDEN + rng.uniform(0, 1)) % 1
    saturation, value = rng.uniform(0.45, 0.8, len(grid)), rng.uniform(0.1, 0.45, len(grid))
    paint = _from_hue(hue, saturation, value)
    fine = 3  # points across a pixel, to antialias the edges
    x, y = ((np.arange(side * fine) + 0.5) / fine - 0.5 for side in size)
    owner = KDTree(centers).query(np.stack(np.meshgrid(x, y), axis=-1))[1]
    light = paint[owner].reshape(height, fine, width, fine, 3).mean(axis=(1, 3))
    shade = 0.8 + 0.2 * _unit_range(_smooth(size, tile / 2, rng))
    grain = 1 + 0.015 * _smooth(size, 0.7, rng)
    return np.asarray(light * (shade * grain)[..., None])


def _from_hue(hue: Array, saturation: Array, value: Array) -> Array:
    """(n, 3) linear colors from hue (0…1, a circle), saturation and value, by the HSV formula."""
    k = (np.array([5, 3, 1]) + 6 * hue[:, None]) % 6
    dip = np.clip(np.minimum(k, 4 - k), 0, 1)
    return np.asarray(value[:, None] * (1 - saturation[:, None] * dip))


def _check_size(size: tuple[int, int]) -> None:
    if len(size) != 2 or min(size) < 1:
        raise ValueError(f"size must be (width, height), both 1 or more, got {size}")


def _short(size: tuple[int, int]) -> int:
    _check_size(size)
    return min(size)


def _smooth(size: tuple[int, int], scale: float, rng: np.random.Generator) -> Array:
    """(H, W) noise with mean 0 and spread 1 that varies over `scale` pixels."""
    from scipy.ndimage import gaussian_filter

    width, height = size
    noise = gaussian_filter(rng.standard_normal((height, width)), scale, mode="reflect")
    noise -= noise.mean()
    return np.asarray(noise / max(noise.std(), 1e-12))


def _unit_range(x: Array) -> Array:
    return np.asarray((x - x.min()) / max(np.ptp(x), 1e-12))
