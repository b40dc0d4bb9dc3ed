"""Chunks of PNG files, which OpenImageIO does not give access to.

A PNG is a signature and chunks: length, type, data, CRC. Damaged chunks are rejected here, because
libpng prints its complaints to stderr.
"""

import struct
import zlib
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

from blurmatte.errors import FileError
from blurmatte.files.errors import PNG_SIGNATURE


@dataclass(frozen=True)
class PngHeader:
    """The header of a PNG, and its chunks that state how code values encode light.

    Parameters
    ----------
    size : (int, int)
        Width and height, pixels.
    bits : int
        Per channel.
    palette : bool
        True if pixels are indices into a table of colors.
    srgb : bool
        True if there is an sRGB chunk.
    gamma : float or None
        Code value = light ** gamma, from the gAMA chunk.
    """

    size: tuple[int, int]
    bits: int
    palette: bool
    srgb: bool
    gamma: float | None


def inspect_png(path: Path) -> PngHeader:
    """Check that a PNG is complete, and read its header.

    Raises
    ------
    FileError
        If it is truncated or damaged.
    """
    chunks: dict[bytes, bytes] = {}
    for kind, data in _chunks(path, path.read_bytes()):
        chunks.setdefault(kind, bytes(data) if kind != b"IDAT" else b"")
    if len(chunks.get(b"IHDR", b"")) != 13 or b"IDAT" not in chunks:
        raise FileError(f"{path}: export it again; the PNG has no picture")
    width, height, bits, color = struct.unpack(">IIBB", chunks[b"IHDR"][:10])
    gamma = int.from_bytes(chunks.get(b"gAMA", b"")) / 100_000
    return PngHeader((width, height), bits, color == 3, b"sRGB" in chunks, gamma or None)


def check_png(path: Path, header: PngHeader) -> None:
    """Raise FileError for palettes and fewer than 8 bits; OpenImageIO would expand both to 8 bits."""
    if header.palette:
        raise FileError(f"{path}: export it as RGB; a palette rounds the colors of a PNG")
    if header.bits < 8:
        raise FileError(
            f"{path}: export 8 or 16 bits; it has fewer than 8 bits per channel ({header.bits})"
        )


def png_chunks(path: Path) -> list[tuple[bytes, bytes]]:
    """Type and data of every chunk of a PNG, the header first.

    Raises
    ------
    FileError
        If it is truncated or damaged.
    """
    return [(kind, bytes(data)) for kind, data in _chunks(path, path.read_bytes())]


def save_chunks(path: Path, chunks: Iterable[tuple[bytes, bytes]]) -> None:
    """Write a PNG of chunks, from the header to IEND."""
    with path.open("wb") as file:
        file.write(PNG_SIGNATURE)
        for kind, data in chunks:
            checksum = zlib.crc32(data, zlib.crc32(kind))
            file.writelines((struct.pack(">I", len(data)), kind, data, struct.pack(">I", checksum)))


def _chunks(path: Path, content: bytes) -> Iterator[tuple[bytes, memoryview]]:
    """Type and data of every chunk to IEND; bytes after that are ignored."""
    view = memoryview(content)
    at, kind = len(PNG_SIGNATURE), b""
    while kind != b"IEND":
        end = at + 8
        if at + 12 <= len(view):
            length, kind = struct.unpack(">I4s", view[at : at + 8])
            end += length
        if end + 4 > len(view):
            raise FileError(f"{path}: copy or export it again; the PNG is truncated")
        if zlib.crc32(view[at + 4 : end]) != int.from_bytes(view[end : end + 4]):
            raise FileError(f"{path}: copy or export it again; the PNG is damaged (checksum)")
        yield kind, view[at + 8 : end]
        at = end + 4
