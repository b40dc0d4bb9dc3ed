"""What a PNG file says about itself and OpenImageIO does not pass on.

A PNG is a signature and chunks: length, type, data, CRC. Chunks that do not add up are refused
here, before libpng sees them, for it prints its complaints to stderr.
"""

import struct
import zlib
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

from blurmatte.errors import FileError

SIGNATURE = b"\x89PNG\r\n\x1a\n"
_PALETTE = 3  # PNG color type


@dataclass(frozen=True)
class PngFacts:
    """The header of a PNG, and how it says its code values encode light.

    Parameters
    ----------
    size : (int, int)
        Width and height.
    bits : int
        Per channel.
    palette : bool
        The pixels are numbers of colors in a table.
    srgb : bool
        There is an sRGB chunk.
    gamma : float or None
        Code value = light ** gamma, from the gAMA chunk.
    """

    size: tuple[int, int]
    bits: int
    palette: bool
    srgb: bool
    gamma: float | None


def inspect_png(path: Path) -> PngFacts:
    """Check that a PNG is whole, and read its header.

    Raises
    ------
    FileError
        If it is cut short or damaged.
    """
    chunks: dict[bytes, bytes] = {}
    for kind, data in _chunks(path, path.read_bytes()):
        chunks.setdefault(kind, bytes(data) if kind != b"IDAT" else b"")
    if len(chunks.get(b"IHDR", b"")) != 13 or b"IDAT" not in chunks:
        raise FileError(f"{path}: the PNG has no picture in it; export it again")
    width, height, bits, color = struct.unpack(">IIBB", chunks[b"IHDR"][:10])
    gamma = int.from_bytes(chunks.get(b"gAMA", b"")) / 100_000
    return PngFacts((width, height), bits, color == _PALETTE, b"sRGB" in chunks, gamma or None)


def png_chunks(path: Path) -> list[tuple[bytes, bytes]]:
    """Type and data of every chunk of a PNG, the header first.

    Raises
    ------
    FileError
        If it is cut short or damaged.
    """
    return [(kind, bytes(data)) for kind, data in _chunks(path, path.read_bytes())]


def save_chunks(path: Path, chunks: Iterable[tuple[bytes, bytes]]) -> None:
    """Write a PNG of chunks, from the header to IEND."""
    with path.open("wb") as file:
        file.write(SIGNATURE)
        for kind, data in chunks:
            checksum = zlib.crc32(data, zlib.crc32(kind))
            file.writelines((struct.pack(">I", len(data)), kind, data, struct.pack(">I", checksum)))


def _chunks(path: Path, content: bytes) -> Iterator[tuple[bytes, memoryview]]:
    """Type and data of every chunk to IEND; whatever follows that belongs to somebody else."""
    view = memoryview(content)
    at, kind = len(SIGNATURE), b""
    while kind != b"IEND":
        if at + 12 > len(view):
            raise FileError(f"{path}: the PNG is cut short; copy or export it again")
        length, kind = struct.unpack(">I4s", view[at : at + 8])
        end = at + 8 + length
        if end + 4 > len(view):
            raise FileError(f"{path}: the PNG is cut short; copy or export it again")
        if zlib.crc32(view[at + 4 : end]) != int.from_bytes(view[end : end + 4]):
            raise FileError(f"{path}: the PNG is damaged (checksum); copy or export it again")
        yield kind, view[at + 8 : end]
        at = end + 4
