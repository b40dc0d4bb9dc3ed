"""Code values of files: rounding, luma and chroma, chroma subsampling, JPEG.

In this file `values` are R'G'B' code values 0…1, (H, W, 3); `codes` are the integers of a file.
"""

import io

import numpy as np
import numpy.typing as npt

from blurmatte.checks import Codes, Codes8, Floats
from blurmatte.radiometry import SRGB, YCBCR, Transfer

FULL_CHROMA = "4:4:4"
CHROMAS = {FULL_CHROMA: (), "4:2:2": (1,), "4:2:0": (1, 0)}  # axes along which pairs share chroma


def encode_codes(light: Floats, bits: int, transfer: Transfer = SRGB) -> Codes:
    """Encode linear `light` of any shape as rounded and clipped integer code values.

    The codes are those of `Camera.expose`: 10 and 12 bits fill the range of uint16.
    """
    check_bits(bits)
    return rounded(transfer.encode(light), bits)


def check_bits(bits: int) -> None:
    """Raise ValueError unless `bits` is a supported bit depth."""
    if bits not in (8, 10, 12, 16):
        raise ValueError(f"bits must be 8, 10, 12 or 16, got {bits}")


def check_8_bit_codes(codes: Codes) -> None:
    """Raise TypeError unless `codes` is (H, W, 3) uint8."""
    if codes.dtype != np.uint8 or codes.ndim != 3 or codes.shape[2] != 3:
        raise TypeError(f"codes must be (H, W, 3) uint8, got {codes.shape} {codes.dtype}")


def rounded(values: Floats, bits: int) -> Codes:
    """Round values 0…1 to the steps of `bits`, then scale to uint8 (8 bits) or uint16."""
    steps = 2**bits - 1
    codes: Floats = np.rint(steps * np.clip(values, 0, 1))
    if bits == 8:
        return codes.astype(np.uint8)
    codes = np.rint(codes * (65535 / steps))
    return codes.astype(np.uint16)


def subsample_chroma(values: Floats, chroma: str, steps: int) -> Floats:
    """Code values after chroma subsampling, as in uncompressed video.

    Cb and Cr are averaged over each pair or block, all three components are rounded to `steps` steps,
    and chroma is interpolated linearly between the block centers. The result may leave 0…1 slightly.
    """
    Y, Cb, Cr = np.moveaxis(values @ YCBCR.T, -1, 0)
    parts = _quantized(Y, steps), *(_subsampled(c, chroma, steps) for c in (Cb, Cr))
    return np.asarray(np.stack(parts, axis=-1) @ np.linalg.inv(YCBCR).T)


def _quantized(x: Floats, steps: int) -> Floats:
    return np.asarray(np.rint(steps * x) / steps)


def _subsampled(x: Floats, chroma: str, steps: int) -> Floats:
    """Average over blocks, round, and interpolate between the block centers."""
    shape = x.shape
    for axis in CHROMAS[chroma]:
        x = _halved(x, axis)
    x = _quantized(x, steps)
    for axis in CHROMAS[chroma]:
        x = _doubled(x, axis, shape[axis])
    return x


def _halved(x: Floats, axis: int) -> Floats:
    """Averages of pairs along `axis`; the last value of an odd count has no partner."""
    first, second = np.arange(0, x.shape[axis], 2), np.arange(1, x.shape[axis] + 1, 2)
    pairs = x.take(first, axis) + x.take(second, axis, mode="clip")
    return np.asarray(pairs / 2)


def _doubled(x: Floats, axis: int, count: int) -> Floats:
    """`count` values along `axis`, each a quarter of a step from its pair's center."""
    own = np.arange(count) // 2
    other = own + np.where(np.arange(count) % 2, 1, -1)
    return np.asarray(0.75 * x.take(own, axis) + 0.25 * x.take(other, axis, mode="clip"))


def to_jpeg(codes: npt.NDArray[np.unsignedinteger], quality: int, chroma: str) -> bytes:
    """Encode (H, W, 3) uint8 sRGB codes as a JPEG file that is tagged as sRGB."""
    from PIL import Image
    from PIL.ExifTags import IFD, Base

    exif = Image.Exif()
    exif.get_ifd(IFD.Exif)[Base.ColorSpace] = 1  # sRGB
    file = io.BytesIO()
    Image.fromarray(codes).save(file, "JPEG", quality=quality, subsampling=chroma, exif=exif)
    return file.getvalue()


def from_jpeg(file: bytes) -> Codes8:
    """Decode a JPEG file to (H, W, 3) codes."""
    from PIL import Image

    with Image.open(io.BytesIO(file)) as picture:
        return np.array(picture)
