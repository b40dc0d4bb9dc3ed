"""Numbers as picture files: OpenImageIO writes PNG, TIFF and EXR, Pillow JPEG.

Failures to write are OSError, as for any file.

An EXR with ZIP compression is a header, a table of offsets, and a chunk for every 16 rows. Most blocks
of a solution in a large picture have the same values throughout. A shorter EXR is written, with one of
these blocks, and its chunk is repeated. The result has the bytes of the whole picture's EXR.
"""

import io
import struct
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from PIL.ExifTags import Base as TiffTag

from blurmatte.checks import AnyArray, Codes8, Indices
from blurmatte.files.errors import plain_name
from blurmatte.files.exif import ColorSpace
from blurmatte.formats import EXR, PNG, TIFF, named

BLOCK_ROWS = 16  # in a chunk of ZIP compression
_TALL = (b"dataWindow", b"displayWindow")  # attributes that state the height: x0, y0, x1, y1


def save_pixels(
    path: Path,
    parts: Sequence[AnyArray],
    names: Sequence[str],
    tags: Mapping[str, Any],
) -> None:
    """Write numbers losslessly: integers as integers, all floats as float32.

    path: its extension determines the format.
    parts (H, W) or (H, W, n): channels, one part after another, all of the type of the first.
    names: of the channels.
    tags: attributes of the file, by OpenImageIO's names.

    Raises OSError if the file cannot be written completely.
    """
    import OpenImageIO as oiio

    dtype = np.dtype(np.float32) if parts[0].dtype.kind == "f" else parts[0].dtype
    stored, form = "float" if dtype.kind == "f" else dtype.name, named(path)
    (height, width), sources = parts[0].shape[:2], None
    rows = np.arange(height)
    if form is EXR:
        sources = distinct_blocks(parts)
        rows = written_rows(sources, height)
    spec = oiio.ImageSpec(width, len(rows), len(names), stored)
    spec.channelnames = tuple(names)
    if form is PNG:
        spec["png:compressionLevel"] = 4  # a quarter of the time of level 6, 5 % larger files
        # Paeth's filter in all rows: files as small as with one chosen for each, in 60 % of the time.
        spec["png:filter"] = 0x80
    spec.alpha_channel = names.index("A") if "A" in names else -1
    if form in (TIFF, EXR):
        spec["compression"] = "zip"
        spec["DateTime"] = "1970:01:01 00:00:00"  # the same picture gives the same bytes
    for name, value in tags.items():
        spec[name] = value
    with plain_name(path, None) as name:
        target = oiio.ImageOutput.create(name)
        if target is None:
            raise OSError(_first_line(oiio.geterror()))
        written = target.open(name, spec) and _write_strips(target, parts, rows, dtype)
        complaint = target.geterror()  # PNG reports a full disk only here
        closed = target.close()
        complaint += target.geterror()
    if complaint or not (written and closed):
        raise OSError(_first_line(complaint))
    if sources is not None and len(rows) < height:
        repeat_blocks(path, sources, height)


def _write_strips(
    target: Any,
    parts: Sequence[AnyArray],
    rows: Indices,
    dtype: np.dtype[Any],
) -> bool:
    """Interleave some rows of the parts strip by strip, without a second copy of the picture."""
    count = 256  # a multiple of the compressed blocks of EXR and TIFF
    for first in range(0, len(rows), count):
        some = rows[first : first + count]
        strip = np.dstack([part[some] for part in parts]).astype(dtype, copy=False)
        end = first + len(some)
        if not target.write_scanlines(first, end, 0, np.ascontiguousarray(strip)):
            return False
    return True


def save_jpeg(path: Path, codes: Codes8, exposure_time: float | None = None) -> None:
    """Write (H, W, 3) sRGB code values, see `compress_jpeg`, and what they mean."""
    from PIL import Image
    from PIL.TiffImagePlugin import IFDRational

    exif = Image.Exif()
    ifd = exif.get_ifd(TiffTag.ExifOffset)
    ifd[TiffTag.ColorSpace] = ColorSpace.SRGB
    if exposure_time:
        ifd[TiffTag.ExposureTime] = IFDRational(round(exposure_time * 1e6), 1_000_000)
    compress_jpeg(path, codes, exif=exif)


def compress_jpeg(path: Path, codes: Codes8, **options: Any) -> None:
    """Write (H, W, 3) or (H, W) code values at quality 95 without chroma subsampling.

    Pillow writes it: on a full disk OpenImageIO's JPEG library terminates the process.

    Raises OSError if the file cannot be written completely.
    """
    from PIL import Image

    content = io.BytesIO()  # if it wrote to the file, Pillow would not notice a full disk
    Image.fromarray(codes).save(content, "JPEG", quality=95, subsampling=0, **options)
    path.write_bytes(content.getvalue())


def _first_line(text: str) -> str:
    return next((line.strip() for line in text.splitlines() if line.strip()), "no reason given")


def distinct_blocks(parts: Sequence[AnyArray]) -> Indices:
    """(n,) for each block of rows, the position of an equal one among the blocks to be written.

    parts (H, W) or (H, W, n): channels. Only blocks of one value for each channel are compared.
    """
    bits = [part.view(f"u{part.dtype.itemsize}") for part in parts]  # -0 is not 0
    height, even = len(bits[0]), dict[bytes, int]()
    written, sources = 0, []
    for row in range(0, height, BLOCK_ROWS):
        block = slice(row, row + BLOCK_ROWS)
        source = written
        if row + BLOCK_ROWS <= height and all(np.all(b[block] == b[row, 0]) for b in bits):
            source = even.setdefault(b"".join(b[row, 0].tobytes() for b in bits), written)
        written += source == written
        sources.append(source)
    return np.array(sources)


def written_rows(sources: Indices, height: int) -> Indices:
    """The rows of a picture that are in the blocks to be written."""
    first = np.unique(sources, return_index=True)[1]
    rows = (first[:, None] * BLOCK_ROWS + np.arange(BLOCK_ROWS)).ravel()
    return np.asarray(rows[rows < height])


def repeat_blocks(path: Path, sources: Indices, height: int) -> None:
    """Replace an EXR of the blocks to be written by that of the whole picture."""
    content = memoryview(path.read_bytes())
    header, table = _taller(content, height)
    count = int(sources.max()) + 1
    offsets = struct.unpack_from(f"<{count}Q", content, table)
    chunks = []
    for offset in offsets:
        (size,) = struct.unpack_from("<i", content, offset + 4)
        # Without the number of its first row.
        chunks.append(content[offset + 4 : offset + 8 + size])
    sizes = np.array([4 + len(chunks[source]) for source in sources])
    places = len(header) + 8 * len(sources) + np.cumsum(sizes) - sizes
    with path.open("wb") as file:
        file.write(header)
        file.write(places.astype("<u8").tobytes())
        for block, source in enumerate(sources):
            file.write(struct.pack("<i", block * BLOCK_ROWS))
            file.write(chunks[source])


def _taller(content: memoryview, height: int) -> tuple[bytes, int]:
    """The header of an EXR with another height, and its length."""
    header, at = bytearray(content[:8]), 8  # magic number and version
    while content[at] != 0:
        (name, kind), start = _texts(content, at)
        (size,) = struct.unpack_from("<i", content, start)
        value = bytearray(content[start + 4 : start + 4 + size])
        if name in _TALL:
            struct.pack_into("<i", value, 12, height - 1)
        header += name + b"\0" + kind + b"\0" + struct.pack("<i", size) + value
        at = start + 4 + size
    return bytes(header + b"\0"), at + 1


def _texts(content: memoryview, at: int) -> tuple[tuple[bytes, bytes], int]:
    """Name and type of an attribute, and where its length is."""
    texts = bytes(content[at : at + 512]).split(b"\0", 2)  # both have at most 255 bytes
    return (texts[0], texts[1]), at + len(texts[0]) + len(texts[1]) + 2
