"""Synthetic and photographic plates, linear light (H, W, 3) float64, never black; and a fence.

The same size and seed give the same bytes. In this file sizes are (width, height), `rng` is a seed or
a generator, and colors are linear light (3,).
"""

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
import scipy

from blurmatte.checks import Array, Codes8
from blurmatte.errors import BlurmatteError
from blurmatte.layer import Layer
from blurmatte.radiometry import SRGB
from blurmatte.rendering.lighting import check_color
from blurmatte.rendering.processing import Rng

# Color photographs that come with scikit-image, without a download.
PHOTOS = ("astronaut", "chelsea", "coffee", "immunohistochemistry", "rocket", "stereo_motorcycle")


def plain_plate(size: tuple[int, int], color: npt.ArrayLike, rng: Rng) -> Array:
    """A wall of one hue with slow changes of brightness and a fine texture.

    Parameters
    ----------
    color : (3,) float
        Linear light at the brightest point; the darkest is 0.55 of it.
    """
    paint, rng = check_color("color", color), np.random.default_rng(rng)
    slow = _smooth(size, min(size) / 4, rng)
    fine = _smooth(size, 0.8, rng)
    brightness = 0.55 + 0.45 * _unit_range(slow + 0.12 * fine)
    return np.asarray(brightness[..., None] * paint)


def two_hue_plate(
    size: tuple[int, int], first: npt.ArrayLike, second: npt.ArrayLike, rng: Rng
) -> Array:
    """Patches of two colors with soft borders; every pixel is a mixture of the two."""
    a, b = check_color("first", first), check_color("second", second)
    patches = _smooth(size, min(size) / 12, np.random.default_rng(rng))
    share = (0.5 + 0.5 * np.tanh(3 * patches))[..., None]
    return np.asarray((1 - share) * a + share * b)


def colorful_plate(size: tuple[int, int], rng: Rng, tile: float = 60) -> Array:
    """Tiles of all hues with hard edges, soft shading and grain.

    Parameters
    ----------
    tile : float
        Typical width of a tile, pixels.
    """
    if not tile > 0:
        raise ValueError(f"tile must be positive, got {tile}")
    _check_size(size)
    rng = np.random.default_rng(rng)
    columns, rows = (int(np.ceil(side / tile)) + 2 for side in size)
    grid = np.stack(np.meshgrid(np.arange(columns), np.arange(rows)), axis=-1).reshape(-1, 2)
    centers = tile * (grid - 0.5 + rng.uniform(-0.38, 0.38, grid.shape))
    golden = (np.sqrt(5) - 1) / 2  # multiples of it are evenly distributed modulo 1
    hue = (np.arange(len(grid)) * golden + rng.uniform(0, 1)) % 1
    saturation, value = rng.uniform(0.45, 0.8, len(grid)), rng.uniform(0.1, 0.45, len(grid))
    paint = _from_hue(hue, saturation, value)
    tree = scipy.spatial.KDTree(centers)
    pixels = np.stack(np.meshgrid(*map(np.arange, size)), axis=-1)
    distances, owners = tree.query(pixels, k=2)
    light = paint[owners[..., 0]]
    # Antialiasing by 3 x 3 points of the pixels in which the nearest center may change.
    points = np.stack(np.meshgrid(*2 * [np.arange(-1, 2) / 3]), axis=-1).reshape(-1, 2)
    mixed = distances[..., 1] - distances[..., 0] <= 2 * np.linalg.norm(points[0])
    light[mixed] = paint[tree.query(pixels[mixed][:, None] + points)[1]].mean(axis=1)
    shade = 0.8 + 0.2 * _unit_range(_smooth(size, tile / 2, rng))
    grain = 1 + 0.015 * _smooth(size, 0.7, rng)
    return np.asarray(light * (shade * grain)[..., None])


def striped_plate(
    size: tuple[int, int], colors: Sequence[npt.ArrayLike], width: float, angle: float = 0.0
) -> Array:
    """Stripes with hard straight edges; each pixel is the exact average over its square.

    Parameters
    ----------
    colors : sequence of (3,) float
        Linear light of the stripes, repeated in this order. The first begins at the center.
    width : float
        Width of each stripe, pixels, 2 or more.
    angle : float
        Direction across the stripes, radians from +x towards +y; 0 gives upright stripes.
    """
    if len(colors) < 2:
        raise ValueError(f"colors must be 2 or more, got {len(colors)}")
    if not (np.isfinite(width) and width >= 2):  # then a pixel meets one edge at most
        raise ValueError(f"width must be 2 pixels or more, got {width}")
    if not np.isfinite(angle):
        raise ValueError(f"angle must be finite, got {angle}")
    paint = np.stack([check_color("colors", color) for color in colors])
    across = _across(size, angle)
    edge = np.rint(across / width).astype(int)
    beyond = _half_plane(across - edge * width, angle)[..., None]
    here, there = paint[(edge - 1) % len(paint)], paint[edge % len(paint)]
    return np.asarray((1 - beyond) * here + beyond * there)


def textured_plate(size: tuple[int, int], rng: Rng) -> Array:
    """A surface with structure in brightness and color at all scales.

    Its amplitude falls with frequency f as 1/f, as in photographs, and is blurred by a Gaussian of 0.7
    pixels, as by a lens. It is periodic: opposite borders match.
    """
    rng = np.random.default_rng(rng)
    brightness = _fractal(size, rng)[..., None]
    hue = np.stack([_fractal(size, rng) for _ in range(3)], axis=-1)
    hue -= hue.mean(axis=-1, keepdims=True)
    return np.asarray(0.03 + 0.72 / (1 + np.exp(1 - 0.8 * brightness - 0.9 * hue)))


def photo_plate(name: str, size: tuple[int, int]) -> Array:
    """The center of a photograph that comes with scikit-image.

    Its code values are dithered uniformly over their rounding interval, with a fixed seed; otherwise a
    camera of 8 bits would reproduce them without rounding errors. Parts may be saturated or nearly
    black.

    Parameters
    ----------
    name : str
        One of `PHOTOS`, a function of `skimage.data`.

    Raises
    ------
    BlurmatteError
        If scikit-image is missing.
    ValueError
        If the photograph is unknown or smaller than `size`.
    """
    if name not in PHOTOS:
        raise ValueError(f"name must be one of {', '.join(PHOTOS)}, got {name!r}")
    _check_size(size)
    codes = _load_photo(name)
    spare = codes.shape[1] - size[0], codes.shape[0] - size[1]
    if min(spare) < 0:
        raise ValueError(
            f"the photograph {name!r} is {codes.shape[1]}x{codes.shape[0]} pixels, "
            f"less than size {size[0]}x{size[1]}"
        )
    left, top = spare[0] // 2, spare[1] // 2
    codes = codes[top : top + size[1], left : left + size[0]]
    dithered = codes + np.random.default_rng(0).uniform(-0.5, 0.5, codes.shape)
    return np.asarray(SRGB.decode(np.abs(dithered) / 255))


def wire_fence(
    size: tuple[int, int],
    spacing: float,
    width: float,
    color: npt.ArrayLike,
    angle: float = 0.6,
) -> Layer:
    """A fence of two families of slanted wires, for use as an occluder.

    Alpha is 0 or 1: behind a partly covered pixel the true layer would not be defined.

    Parameters
    ----------
    spacing : float
        Distance between the center lines of adjacent wires, pixels.
    width : float
        Width of a wire, pixels: 1 or more, and less than `spacing`.
    color : (3,) float
        Linear light of the wire at normal incidence of the lamp.
    angle : float
        Inclination of the wires from upright, radians: one family to the left, one to the right.
    """
    paint = check_color("color", color)
    if not 1 <= width < spacing < np.inf:
        raise ValueError(
            f"width must be 1 pixel or more and less than spacing, got {width} and {spacing}"
        )
    if not 0 < abs(angle) < np.pi / 2:
        raise ValueError(f"angle must lie between 0 and pi/2, got {angle}")
    alpha, shade = np.zeros(size[::-1]), np.zeros(size[::-1])
    for lean in (angle, -angle):  # the second passes over the first
        across = _across(size, lean)
        from_middle = (across - spacing * np.rint(across / spacing)) / (width / 2)
        wire = np.abs(from_middle) <= 1
        alpha[wire], shade[wire] = 1, _round_shade(from_middle[wire])
    return Layer(alpha, shade[..., None] * paint)


def _load_photo(name: str) -> Codes8:
    try:
        from skimage import data
    except ImportError as error:
        raise BlurmatteError('photographs need: pip install "blurmatte[photos]"') from error
    pictures = getattr(data, name)()
    return np.asarray(pictures[0] if isinstance(pictures, tuple) else pictures)  # left, right, ...


def _across(size: tuple[int, int], angle: float) -> Array:
    """(H, W) coordinate of each pixel along a direction, from the center of the picture."""
    _check_size(size)
    x, y = (np.arange(side) - (side - 1) / 2 for side in size)
    return np.asarray(np.cos(angle) * x + np.sin(angle) * y[:, None])


def _half_plane(distance: Array, angle: float) -> Array:
    """Fraction of a pixel's square beyond a straight edge, for a center `distance` beyond it.

    It is the convolution of a ramp of length max(|cos|, |sin|) with a box of length min(|cos|, |sin|)
    of the edge's direction: the difference of the ramp's integral at both ends of the box.
    """
    short, long = sorted((abs(np.cos(angle)), abs(np.sin(angle))))
    middle, reach = 0.5 + distance / long, short / long / 2
    if reach < 1e-6:  # avoids cancellation; the box is negligible
        return np.asarray(np.clip(middle, 0, 1))
    return np.asarray((_ramp_area(middle + reach) - _ramp_area(middle - reach)) / (2 * reach))


def _ramp_area(x: Array) -> Array:
    return np.asarray(np.clip(x, 0, 1) ** 2 / 2 + np.maximum(x - 1, 0))


def _fractal(size: tuple[int, int], rng: np.random.Generator) -> Array:
    """(H, W) noise of mean 0 and std 1 with a 1/f amplitude, blurred by 0.7 pixels as by a lens."""
    _check_size(size)
    width, height = size
    f = np.hypot(np.fft.rfftfreq(width), np.fft.fftfreq(height)[:, None])
    lens = np.exp(-2 * (np.pi * 0.7 * f) ** 2)
    f[0, 0] = np.inf
    waves = np.fft.rfft2(rng.standard_normal((height, width))) * lens / f
    noise = np.fft.irfft2(waves, (height, width))
    return np.asarray(noise / max(noise.std(), 1e-12))


def _round_shade(from_middle: Array) -> Array:
    """Light of a round wire, ambient + Lambert, at positions −1…1 across it."""
    facing = -0.6 * from_middle + 0.8 * np.sqrt(1 - from_middle**2)
    ambient = 0.3
    return np.asarray(ambient + (1 - ambient) * np.maximum(facing, 0))


def _from_hue(hue: Array, saturation: Array, value: Array) -> Array:
    """(n, 3) linear colors from hue, saturation and value (n,), all 0…1, by the HSV formula."""
    k = (np.array([5, 3, 1]) + 6 * hue[:, None]) % 6
    dip = np.clip(np.minimum(k, 4 - k), 0, 1)
    return np.asarray(value[:, None] * (1 - saturation[:, None] * dip))


def _check_size(size: tuple[int, int]) -> None:
    if len(size) != 2 or min(size) < 1:  # type: ignore[redundant-expr]
        raise ValueError(f"size must be (width, height), both 1 or more, got {size}")


def _smooth(size: tuple[int, int], scale: float, rng: np.random.Generator) -> Array:
    """(H, W) noise of mean 0 and std 1, smoothed by a Gaussian of `scale` pixels."""
    _check_size(size)
    noise = scipy.ndimage.gaussian_filter(rng.standard_normal(size[::-1]), scale, mode="reflect")
    noise -= noise.mean()
    return np.asarray(noise / max(noise.std(), 1e-12))


def _unit_range(x: Array) -> Array:
    return np.asarray((x - x.min()) / max(np.ptp(x), 1e-12))
