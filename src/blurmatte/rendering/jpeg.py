"""What a file does to neighboring pixels: JPEG, and the shared color of video.

In this file `values` are code values 0…1, (H, W, 3), R'G'B'.
"""

import io
from typing import Any

import numpy as np
import numpy.typing as npt

from blurmatte.checks import Floats
from blurmatte.radiometry import Compression
from blurmatte.rendering.ycbcr import from_ycbcr, to_ycbcr

FULL_CHROMA = "4:4:4"
CHROMAS = {FULL_CHROMA: (), "4:2:2": (1,), "4:2:0": (1, 0)}  # axes along which pairs share chroma

_EXIF_POINTER, _COLOR_SPACE, _IS_SRGB = 0x8769, 0xA001, 1


def to_jpeg(codes: npt.NDArray[np.unsignedinteger[Any]], quality: int, chroma: str) -> bytes:
    """The JPEG file of (H, W, 3) uint8 sRGB codes, which says that they are sRGB."""
    from PIL import Image

    exif = Image.Exif()
    exif.get_ifd(_EXIF_POINTER)[_COLOR_SPACE] = _IS_SRGB
    file = io.BytesIO()
    Image.fromarray(codes).save(file, "JPEG", quality=quality, subsampling=chroma, exif=exif)
    return file.getvalue()


def from_jpeg(file: bytes) -> npt.NDArray[np.uint8]:
    """(H, W, 3) codes of a JPEG file."""
    from PIL import Image

    with Image.open(io.BytesIO(file)) as picture:
        return np.array(picture)


def compression_of(file: bytes) -> Compression:
    """What a JPEG file of `to_jpeg` did."""
    from PIL import Image

    with Image.open(io.BytesIO(file)) as picture:
        tables, layers = picture.quantization, picture.layer  # type: ignore[attr-defined]
    (_, across, down, luma), (*_, chroma) = layers[0], layers[1]
    steps = [np.reshape(tables[name], (8, 8)).tolist() for name in (luma, chroma)]
    of_luma, of_chroma = (tuple(map(tuple, table)) for table in steps)
    return Compression(of_luma, of_chroma, (across, down))


def coarsen_chroma(values: Floats, chroma: str, steps: int) -> Floats:
    """What is left of `values` when pairs of pixels share their chroma, as in video.

    Cb and Cr are averaged over each pair or block, all three are rounded to `steps` steps, and
    chroma is interpolated linearly between the centers of the blocks. May leave 0…1 a little.
    """
    Y, Cb, Cr = to_ycbcr(values)
    return from_ycbcr(_stepped(Y, steps), _shared(Cb, chroma, steps), _shared(Cr, chroma, steps))


def _stepped(x: Floats, steps: int) -> Floats:
    return np.asarray(np.rint(steps * x) / steps)


def _shared(x: Floats, chroma: str, steps: int) -> Floats:
    """Averaged over blocks, rounded, and interpolated between the centers of the blocks."""
    shape = x.shape
    for axis in CHROMAS[chroma]:
        x = _halved(x, axis)
    x = _stepped(x, steps)
    for axis in CHROMAS[chroma]:
        x = _doubled(x, axis, shape[axis])
    return x


def _halved(x: Floats, axis: int) -> Floats:
    """Averages of pairs along `axis`; an odd last one stays alone."""
    first, second = np.arange(0, x.shape[axis], 2), np.arange(1, x.shape[axis] + 1, 2)
    pairs = x.take(first, axis) + x.take(second, axis, mode="clip")
    return np.asarray(pairs / 2)


def _doubled(x: Floats, axis: int, count: int) -> Floats:
    """`count` values along `axis`, each a quarter of a step from its pair's center."""
    own = np.arange(count) // 2
    other = own + np.where(np.arange(count) % 2, 1, -1)
    return np.asarray(0.75 * x.take(own, axis) + 0.25 * x.take(other, axis, mode="clip"))
