"""Small files made by hand or by other programs, for what blurmatte.files must read."""

import struct
import zlib
from collections.abc import Callable

import numpy as np
import pytest

D50 = (0.9642, 1.0, 0.8249)
ADOBE = ((0.60974, 0.31111, 0.01947), (0.20528, 0.62567, 0.06087), (0.14919, 0.06322, 0.74457))


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


@pytest.fixture
def ramp():
    """(24, 32, 3) uint8 codes: every hue, nothing saturated."""
    y, x = np.mgrid[0:24, 0:32]
    return np.stack([8 * x, 10 * y, 255 - 4 * (x + y) - 6], axis=-1).astype(np.uint8)


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
