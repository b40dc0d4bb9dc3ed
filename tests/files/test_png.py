"""Chunks of PNGs: refused by name, and nothing on stderr."""

import struct
import zlib

import numpy as np
import pytest

from blurmatte.errors import FileError
from blurmatte.files.reading import read
from blurmatte.radiometry import SRGB


@pytest.mark.parametrize(
    ("chunks", "says"),
    [
        ({b"gAMA": bytes(300)}, "its gAMA chunk has 300 bytes instead of 4"),
        ({b"cHRM": bytes(4)}, "its cHRM chunk has 4 bytes instead of 32"),
        ({b"CgBI": b"P\0 \2"}, "Xcode"),
        ({b"ABCD": b""}, r"needs an extension \(ABCD\)"),
        ({b"a1cd": b""}, "a chunk's name"),
        ({b"zTXt": b"k\0\0" + zlib.compress(bytes(1 << 25))}, "inflate to more than 16 MiB"),
        ({b"iCCP": b"k\0\0" + zlib.compress(bytes(1 << 25))}, "inflate to more than 16 MiB"),
        ({b"iTXt": b"k\0\1\0\0\0" + zlib.compress(bytes(1 << 25))}, "inflate to more than 16 MiB"),
    ],
)
def test_chunks_are_refused_by_name(tmp_path, ramp, make_png, capfd, chunks, says):
    path = tmp_path / "a.png"
    path.write_bytes(make_png(ramp, chunks))
    with pytest.raises(FileError, match=says):
        read(path, SRGB)
    assert capfd.readouterr() == ("", "")


def test_second_header_is_damage(tmp_path, ramp, make_png, capfd):
    """door: libpng would read the picture and print a complaint."""
    path, png = tmp_path / "a.png", make_png(ramp)
    path.write_bytes(png[:33] + png[8:])
    with pytest.raises(FileError, match="second header"):
        read(path, SRGB)
    assert not capfd.readouterr().err


def with_pixels(png, stream):
    """The PNG with other deflated pixels."""
    start = png.index(b"IDAT")
    data = b"IDAT" + stream
    end = struct.pack(">I", len(stream)) + data + struct.pack(">I", zlib.crc32(data))
    return png[: start - 4] + end + png[-12:]


@pytest.mark.parametrize("bits", [np.uint8, np.uint16])
def test_pixels_that_cannot_be_inflated_are_damage(tmp_path, ramp, make_png, capfd, bits):
    path, png = tmp_path / "a.png", make_png(ramp.astype(bits))
    raw = zlib.decompress(png[png.index(b"IDAT") + 4 : -16])
    whole = zlib.compress(raw)
    for stream in (
        b"garbage!",
        zlib.compress(raw[:-1]),
        whole[:-4] + b"abcd",
        whole[: len(whole) // 2],
        zlib.compress(b"\x09" + raw[1:]),  # a filter that does not exist
    ):
        path.write_bytes(with_pixels(png, stream))
        with pytest.raises(FileError, match="the PNG is damaged or truncated"):
            read(path, SRGB)
    path.write_bytes(with_pixels(png, zlib.compress(raw + bytes(1 << 20))))
    assert read(path, SRGB).size == (32, 24)
    assert capfd.readouterr() == ("", "")


def test_interlaced_pixels_are_counted(tmp_path, ramp, capfd):
    from PIL import Image

    path = tmp_path / "a.png"
    for size in ((32, 24), (5, 1), (3, 7)):
        codes = ramp[: size[1], : size[0]]
        Image.fromarray(codes).save(path)
        png = path.read_bytes()
        assert read(path, SRGB).size == size
        rows = b"".join(  # Adam7
            b"".join(b"\0" + row.tobytes() for row in codes[y::dy, x::dx] if row.size)
            for x, y, dx, dy in (
                *((0, 0, 8, 8), (4, 0, 8, 8), (0, 4, 4, 8), (2, 0, 4, 4)),
                *((0, 2, 2, 4), (1, 0, 2, 2), (0, 1, 1, 2)),
            )
        )
        header = b"IHDR" + png[16:28] + b"\1"
        png = png[:12] + header + struct.pack(">I", zlib.crc32(header)) + png[33:]
        path.write_bytes(with_pixels(png, zlib.compress(rows)))
        np.testing.assert_allclose(read(path, SRGB).rgb, SRGB.decode(codes / 255), atol=1e-6)
