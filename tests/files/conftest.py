"""Small files, written here or by other programs, that blurmatte.files must read."""

import struct
import zlib
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import tifffile

from blurmatte.errors import FileError
from blurmatte.files.reading import read

D50 = (0.9642, 1.0, 0.8249)
ADOBE = ((0.60974, 0.31111, 0.01947), (0.20528, 0.62567, 0.06087), (0.14919, 0.06322, 0.74457))


def refusal(path, *arguments, reader=read, **options):
    """The one line with which a reader refuses a file, without its name."""
    with pytest.raises(FileError) as caught:
        reader(path, *arguments, **options)
    message = str(caught.value)
    assert message.startswith(f"{path}: ")
    assert "\n" not in message
    return message.removeprefix(f"{path}: ")


def png_chunk(kind: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))


def png_bytes(codes, chunks: dict[bytes, bytes] | None = None, size=None, color=None) -> bytes:
    """A PNG of (H, W, n) codes with extra chunks; `size` and `color` lie about what is in it."""
    height, width, count = codes.shape
    bits = codes.dtype.itemsize * 8
    kind = {1: 0, 2: 4, 3: 2, 4: 6}[count] if color is None else color
    header = struct.pack(">IIBBBBB", *(size or (width, height)), bits, kind, 0, 0, 0)
    rows = b"".join(b"\0" + row.astype(codes.dtype.newbyteorder(">")).tobytes() for row in codes)
    parts = {b"IHDR": header, **(chunks or {}), b"IDAT": zlib.compress(rows), b"IEND": b""}
    return b"\x89PNG\r\n\x1a\n" + b"".join(png_chunk(*item) for item in parts.items())


def s15(*values: float) -> bytes:
    return struct.pack(f">{len(values)}i", *(round(65536 * v) for v in values))


def curv(*values: int) -> bytes:
    return b"curv\0\0\0\0" + struct.pack(f">I{len(values)}H", len(values), *values)


def para(kind: int, *values: float) -> bytes:
    return b"para\0\0\0\0" + struct.pack(">HH", kind, 0) + s15(*values)


def profile_bytes(
    curves: dict[str, bytes] | bytes,
    primaries=ADOBE,
    space: bytes = b"RGB ",
    connection: bytes = b"XYZ ",
) -> bytes:
    """An ICC profile: a curve for all channels or one for each, and the primaries' XYZ (D50)."""
    names = "k" if space == b"GRAY" else "rgb"
    each = curves if isinstance(curves, dict) else dict.fromkeys(names, curves)
    tags = {f"{name}TRC".encode(): curve for name, curve in each.items()}
    if space == b"RGB ":
        for name, xyz in zip("rgb", primaries, strict=True):
            tags[f"{name}XYZ".encode()] = b"XYZ \0\0\0\0" + s15(*xyz)
    tags[b"wtpt"] = b"XYZ \0\0\0\0" + s15(*D50)
    table, body, at = b"", b"", 132 + 12 * len(tags)
    for name, data in tags.items():
        table += struct.pack(">4sII", name, at + len(body), len(data))
        body += data + b"\0" * (-len(data) % 4)
    size = at + len(body)
    header = struct.pack(">I4sI4s4s4s", size, b"\0" * 4, 0x02400000, b"mntr", space, connection)
    header += b"\0" * 12 + b"acsp" + b"\0" * 28 + s15(*D50)
    return header.ljust(128, b"\0") + struct.pack(">I", len(tags)) + table + body


# Columns are X, Y, Z: about what the sensors of many cameras see of them.
CAMERA_FROM_XYZ = ((0.70, -0.21, -0.05), (-0.45, 1.24, 0.23), (-0.09, 0.21, 0.62))


def ratios(*values: float) -> tuple[int, ...]:
    return tuple(part for value in values for part in (round(value * 10_000), 10_000))


def dng_tags(white, black, orientation=1, noise=(), camera="Example C1", neutral=(0.5, 1.0, 0.8)):
    """Tags of a DNG as tifffile takes them: number, type, count, value, whether in the first page."""
    B, H, I, SRATIONAL, RATIONAL, D = "B", "H", "I", 10, 5, "d"
    tags = [
        (50706, B, 4, b"\1\4\0\0"),  # DNGVersion
        (50708, "s", 0, camera),  # UniqueCameraModel
        (274, H, 1, orientation),
        (50713, H, 2, (2, 2)),  # BlackLevelRepeatDim
        (50714, RATIONAL, 4, ratios(*black)),  # BlackLevel
        (50717, I, 1, (white,)),  # WhiteLevel
        (50721, SRATIONAL, 9, ratios(*np.ravel(CAMERA_FROM_XYZ))),  # ColorMatrix1
        (50728, RATIONAL, 3, ratios(*neutral)),  # AsShotNeutral
        (50778, H, 1, 21),  # CalibrationIlluminant1: D65
        (33434, RATIONAL, 1, ratios(0.025)),  # ExposureTime
    ]
    if len(noise):
        tags.append((51041, D, len(noise), tuple(noise)))  # NoiseProfile
    return [(*tag, True) for tag in tags]


def write_dng(path, codes, pattern=((0, 1), (1, 2)), white=16383, black=(512,) * 4, **facts):
    """A DNG of (H, W) uint16 codes behind a pattern of 0 red, 1 green, 2 blue; of (H, W, 3) without."""
    tags = dng_tags(white, black, **facts)
    if codes.ndim == 2:
        pattern = np.asarray(pattern)
        tags.append((33421, "H", 2, pattern.shape, True))  # CFARepeatPatternDim
        tags.append((33422, "B", pattern.size, bytes(pattern.ravel().tolist()), True))  # CFAPattern
    kind = 34892 if codes.ndim == 3 else "cfa"
    planar = "contig" if codes.ndim == 3 else None  # else newer versions take rows for pages
    tifffile.imwrite(
        path, codes, photometric=kind, planarconfig=planar, extratags=tags, metadata=None
    )
    return path


def write_monochrome_dng(path, codes, white=16383, black=512):
    """A DNG of (H, W) uint16 codes of a sensor without colors: linear RAW of one sample."""
    of_colors = {50713, 50714, 50721, 50728, 50778}  # black levels, matrix, neutral, illuminant
    tags = [tag for tag in dng_tags(white, (black,) * 4) if tag[0] not in of_colors]
    tags.append((50714, 5, 1, ratios(black), True))  # BlackLevel
    tifffile.imwrite(path, codes, photometric="minisblack", extratags=tags, metadata=None)
    with tifffile.TiffFile(path, mode="r+b") as file:  # tifffile writes no LinearRaw of one sample
        file.pages[0].tags[262].overwrite(34892)
    return path


def mosaic_codes(light, pattern=((0, 1), (1, 2)), white=16383, black=512):
    """The codes of (H, W, 3) light behind a pattern; floats, neither rounded nor clipped."""
    y, x = np.indices(light.shape[:2])
    pattern = np.asarray(pattern)
    seen = pattern[y % pattern.shape[0], x % pattern.shape[1]]
    return black + (white - black) * np.take_along_axis(light, seen[..., None], axis=2)[..., 0]


@pytest.fixture
def ramp():
    """(24, 32, 3) uint8 codes: every hue, nothing saturated."""
    y, x = np.mgrid[0:24, 0:32]
    return np.stack([8 * x, 10 * y, 255 - 4 * (x + y) - 6], axis=-1).astype(np.uint8)


@pytest.fixture(scope="session")
def make_dng() -> Callable[..., Path]:
    return write_dng


@pytest.fixture(scope="session")
def make_monochrome_dng() -> Callable[..., Path]:
    return write_monochrome_dng


@pytest.fixture(scope="session")
def make_mosaic() -> Callable[..., np.ndarray]:
    return mosaic_codes


@pytest.fixture
def make_png() -> Callable[..., bytes]:
    return png_bytes


@pytest.fixture
def make_profile() -> Callable[..., bytes]:
    return profile_bytes


@pytest.fixture
def curve():
    """Builders of the two kinds of ICC curve tags."""
    return {"curv": curv, "para": para}
