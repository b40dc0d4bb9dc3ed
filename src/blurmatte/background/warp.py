"""Where the pixels of an image lie in its plate, and the plate read there.

A homography H (3, 3) takes a point of the image, in coordinates that are 0 in its center and ±1 at the
ends of its longer side, to the same coordinates of the plate. Eight numbers h say how far it is from
doing nothing:

    H = 1 + (h₀ h₁ h₂ | h₃ h₄ h₅ | h₆ h₇ 0)

h₂ and h₅ alone shift the picture.
"""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import numpy.typing as npt

from blurmatte.checks import Floats

Array = npt.NDArray[np.float64]

SHIFT = (2, 5)
ORDER = 3  # of the spline between pixels
_FEW = 100_000  # points that are read sooner than threads start
_REACH = 15  # pixels, beyond which a spline of this order knows nothing of a pixel


def homography(h: Array) -> Array:
    """(3, 3) of eight numbers."""
    return np.asarray(np.eye(3) + np.append(h, 0).reshape(3, 3))


def centered(size: tuple[int, int]) -> Array:
    """(3, 3) from pixels to coordinates that are 0 in the center and ±1 at the ends."""
    width, height = size
    half = max(width, height) / 2
    return np.array(
        [[1 / half, 0, (1 - width) / 2 / half], [0, 1 / half, (1 - height) / 2 / half], [0, 0, 1]]
    )


def places(h: Array, xy: Array, size: tuple[int, int]) -> tuple[Array, Array]:
    """Where points (n, 2) of the image lie in the plate, pixels; and (n, 2, 8) how h moves them."""
    to = centered(size)
    u = xy * to[0, 0] + to[:2, 2]
    H = homography(h)
    moved = u @ H[:, :2].T + H[:, 2]
    depth = moved[:, 2:]
    U = moved[:, :2] / depth
    one = np.concatenate([u, np.ones_like(depth)], axis=1) / depth
    slope = np.zeros((len(xy), 2, 8))
    slope[:, 0, :3] = slope[:, 1, 3:6] = one
    slope[:, :, 6:] = -U[:, :, None] * one[:, None, :2]
    return (U - to[:2, 2]) / to[0, 0], slope / to[0, 0]


def read_at(picture: Floats, xy: Array, order: int = ORDER) -> Array:
    """(n, channels) values of a picture (h, w, channels) at points (n, 2), by a spline."""
    from scipy.ndimage import map_coordinates

    def read(channel: int) -> Array:
        plane = np.ascontiguousarray(picture[..., channel], dtype=float)
        return np.asarray(map_coordinates(plane, xy.T[::-1], order=order, mode="nearest"))

    channels = range(picture.shape[-1])
    if len(xy) < _FEW:
        return np.stack([read(c) for c in channels], axis=-1)
    with ThreadPoolExecutor() as threads:  # SciPy lets go of the interpreter meanwhile
        return np.stack(list(threads.map(read, channels)), axis=-1)


def spline_of(picture: Floats) -> Array:
    """The coefficients of the spline through a picture (h, w, channels)."""
    from scipy.ndimage import spline_filter

    planes = [
        spline_filter(picture[..., c], ORDER, mode="nearest") for c in range(picture.shape[-1])
    ]
    return np.stack(planes, axis=-1)


def kept_variance(xy: Array) -> float:
    """Which part of the variance of white noise is left where it is read between pixels; the mean."""
    from scipy.ndimage import shift

    step = np.linspace(0, 1, 33)
    one = np.zeros(2 * _REACH + 1)
    one[_REACH] = 1
    energy = [float(np.sum(shift(one, s, order=ORDER) ** 2)) for s in step]
    along = np.interp(xy % 1, step, energy)
    return float(np.mean(along.prod(axis=1)))
