"""Chunks of PNG files, which OpenImageIO does not give access to.

A PNG is a signature and chunks: length, type, data, CRC. Damaged chunks are rejected here by name;
libpng finds damaged pixels.
"""

import struct
import zlib
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

from blurmatte.errors import FileError
from blurmatte.files.errors import damaged
from blurmatte.formats import PNG_SIGNATURE

_LENGTHS = {b"IHDR": 13, b"gAMA": 4, b"cHRM": 32, b"sRGB": 1, b"cICP": 4}
MAX_TEXT_BYTES = 1 << 24  # of all text and the profile, inflated; libpng reads more very slowly


@dataclass(frozen=True)
class PngHeader:
    """The header of a PNG, and its chunks that state how code values encode light."""

    size: tuple[int, int]  # width and height, pixels
    bits: int  # per channel
    palette: bool  # true if pixels are indices into a table of colors
    srgb: bool  # true if there is an sRGB chunk
    gamma: float | None  # code value = light ** gamma, from the gAMA chunk
    # CIE (x, y) of red, green, blue and white, from the cHRM chunk
    chromaticities: tuple[float, ...] | None
    # Primaries, curve, matrix and full range by ITU-T H.273, from the cICP chunk
    cicp: tuple[int, ...] | None
    exif: bytes  # the block of an eXIf chunk before the pixels


def inspect_png(path: Path) -> PngHeader:
    """The header of a PNG; raises FileError if it is truncated or damaged."""
    chunks: dict[bytes, bytes] = {}
    inflatable = MAX_TEXT_BYTES
    for kind, data in _chunks(path, path.read_bytes()):
        _check_chunk(path, kind, len(data))
        if kind == b"IHDR" and chunks:
            raise damaged(path, "PNG", ["it has a second header"])
        inflatable -= _inflated_text(kind, bytes(data), inflatable)
        if inflatable < 0:
            raise FileError(
                f"{path}: export it again without text and profile; those of the PNG inflate to more "
                f"than {MAX_TEXT_BYTES >> 20} MiB"
            )
        if b"IDAT" not in chunks:  # later chunks do not count for the pixels
            chunks.setdefault(kind, bytes(data) if kind != b"IDAT" else b"")
    if len(chunks.get(b"IHDR", b"")) != 13 or b"IDAT" not in chunks:
        raise FileError(f"{path}: export it again; the PNG has no picture")
    width, height, bits, color = struct.unpack(">IIBB", chunks[b"IHDR"][:10])
    gamma = int.from_bytes(chunks.get(b"gAMA", b"")) / 100_000
    white_first = [n / 100_000 for n in struct.unpack(">8I", chunks.get(b"cHRM", bytes(32)))]
    return PngHeader(
        (width, height),
        bits,
        color == 3,
        b"sRGB" in chunks,
        gamma or None,
        (*white_first[2:], *white_first[:2]) if b"cHRM" in chunks else None,
        tuple(chunks[b"cICP"]) if b"cICP" in chunks else None,
        chunks.get(b"eXIf", b""),
    )


def check_png(path: Path, header: PngHeader) -> None:
    """Raise FileError for palettes and fewer than 8 bits, which OpenImageIO would expand to 8 bits."""
    if header.palette:
        raise FileError(f"{path}: export it as RGB; a palette rounds the colors of a PNG")
    if header.bits < 8:
        raise FileError(
            f"{path}: export 8 or 16 bits; it has fewer than 8 bits per channel ({header.bits})"
        )


def _check_chunk(path: Path, kind: bytes, length: int) -> None:
    """Raise FileError for chunks that libpng complains about, and those of Xcode."""
    if kind == b"CgBI":
        raise FileError(
            f"{path}: convert it back (xcrun pngcrush -revert-iphone-optimizations IN OUT), or give "
            "the original; it is a PNG that Xcode changed for the iPhone (CgBI)"
        )
    name = kind.decode("latin-1")
    if not (name.isascii() and name.isalpha()):
        raise FileError(f"{path}: copy or export it again; the PNG is damaged (a chunk's name)")
    if name[0].isupper() and kind not in (b"IHDR", b"PLTE", b"IDAT", b"IEND"):
        raise FileError(f"{path}: export it again; the PNG needs an extension ({name})")
    if length != _LENGTHS.get(kind, length):
        raise FileError(
            f"{path}: export it again; the PNG is damaged: its {name} chunk has {length} bytes instead "
            f"of {_LENGTHS[kind]}"
        )


def _inflated_text(kind: bytes, data: bytes, limit: int) -> int:
    """Bytes of a compressed text or profile, up to one more than `limit`; 0 if it is invalid."""
    if kind not in (b"zTXt", b"iTXt", b"iCCP"):
        return 0
    parts = data.split(b"\0", 1)[-1]
    body = parts[1:] if kind != b"iTXt" else parts[2:].split(b"\0", 2)[-1] * (parts[:1] == b"\1")
    try:
        return len(zlib.decompressobj().decompress(body, limit + 1))
    except zlib.error:
        return 0


def png_chunks(path: Path) -> list[tuple[bytes, bytes]]:
    """Type and data of every chunk of a PNG, the header first; FileError if it is damaged."""
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
