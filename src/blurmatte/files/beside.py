"""What a picture file carries beside its pixels: EXIF, color profile, XMP, resolution.

It goes from any kind of file to any other as it is; see keeping.py.
"""

import struct
import zlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass

from blurmatte.files.encoding import icc_profile
from blurmatte.files.jpeg_segments import kept_segments
from blurmatte.files.png import png_chunks
from blurmatte.files.raster import Raster
from blurmatte.files.refusals import damaged, kind_of
from blurmatte.files.tags import (
    RESOLUTION,
    RESOLUTION_UNIT,
    Tag,
    Tags,
    numbers,
    parse_tags,
    shorts,
    tags_block,
    without_thumbnail,
)

EXIF_MARK, _XMP_MARK = b"Exif\0\0", b"http://ns.adobe.com/xap/1.0/\0"
XMP_NAME = b"XML:com.adobe.xmp\0"  # of a text in a PNG
XMP_TAG, ICC_TAG = 700, 34675
INCH, _CENTIMETER = 2, 3
METER = 0.0254  # of an inch
# How the pixels of a TIFF lie in it.
LAYOUT = (256, 257, 258, 259, 262, 273, 277, 278, 279, 284, 317, 338, 339)
# What is said of the old pixels and their place, other pages, smaller pictures, Photoshop's layers; and
# what is carried apart.
STALE = (
    *LAYOUT,
    *(254, 255, 280, 281, 330, 332, 333, 334, 336, 340, 341, 347, 37724, XMP_TAG, ICC_TAG),
    *(*range(263, 267), *range(288, 294), *range(320, 326), *range(512, 522), *range(529, 533)),
)


@dataclass(frozen=True)
class Beside:
    """What a file carries beside its pixels.

    Parameters
    ----------
    profile : bytes or None
        The ICC profile.
    exif : bytes
        A block of tags, see tags.py; empty if there is none.
    xmp : bytes
        A packet of XMP; empty if there is none.
    dpi : (float, float) or None
        Pixels per inch, where that is said outside EXIF.
    """

    profile: bytes | None
    exif: bytes
    xmp: bytes
    dpi: tuple[float, float] | None


def read_beside(raster: Raster) -> Beside:
    """What the file of a raster carries beside its pixels."""
    ways: Mapping[str, Callable[[Raster], Beside]] = {
        "PNG": _beside_png,
        "JPEG": _beside_jpeg,
        "TIFF": _beside_tiff,
    }
    return ways[kind_of(raster.path)](raster)


def current_segments(kept: tuple[bytes, ...]) -> tuple[bytes, ...]:
    """The segments of a JPEG without those that tell of other pictures: an index, a thumbnail."""
    current = []
    for segment in kept:
        head, body = segment[:4], segment[4:]
        if head[1] == 0xE1 and body.startswith(EXIF_MARK):
            segment = head + EXIF_MARK + without_thumbnail(body[len(EXIF_MARK) :])
        if not (head[1] == 0xE2 and body.startswith(b"MPF\0")):
            current.append(segment)
    return tuple(current)


def _beside_png(raster: Raster) -> Beside:
    exif, xmp, dpi = b"", b"", None
    for kind, data in png_chunks(raster.path):
        if kind == b"eXIf":
            exif = without_thumbnail(data.removeprefix(EXIF_MARK))
        elif kind == b"iTXt" and data.startswith(XMP_NAME):
            xmp = _text(data) or xmp
        elif kind == b"pHYs" and len(data) == 9 and data[8] == 1:
            x, y = struct.unpack(">2L", data[:8])
            dpi = x * METER, y * METER
    return Beside(icc_profile(raster), exif, xmp, dpi)


def _text(data: bytes) -> bytes:
    """The text of an iTXt chunk; empty if it makes no sense."""
    try:
        compressed, text = data[len(XMP_NAME)], data[len(XMP_NAME) + 2 :].split(b"\0", 2)[2]
        return zlib.decompress(text) if compressed else text
    except (IndexError, zlib.error):
        return b""


def _beside_jpeg(raster: Raster) -> Beside:
    exif, xmp, dpi = b"", b"", None
    for segment in kept_segments(raster.path.read_bytes()):
        kind, body = segment[1], segment[4:]
        if kind == 0xE1 and body.startswith(EXIF_MARK) and not exif:
            exif = without_thumbnail(body[len(EXIF_MARK) :])
        elif kind == 0xE1 and body.startswith(_XMP_MARK):
            xmp = body[len(_XMP_MARK) :]
        elif kind == 0xE0 and body.startswith(b"JFIF\0") and body[7:8] in (b"\1", b"\2"):
            x, y = struct.unpack(">2H", body[8:12])
            unit = 1 if body[7] == 1 else 2.54
            dpi = (x * unit, y * unit) if x and y else None
    return Beside(icc_profile(raster), exif, xmp, dpi)


def _beside_tiff(raster: Raster) -> Beside:
    try:
        tags = parse_tags(raster.path.read_bytes())
    except ValueError as error:
        raise damaged(raster.path, "TIFF", [f"its tags: {error}"]) from error
    xmp = tags.get(XMP_TAG)
    kept = {name: tag for name, tag in tags.items() if name not in STALE}
    exif = tags_block(kept) if kept else b""
    return Beside(icc_profile(raster), exif, xmp.data if isinstance(xmp, Tag) else b"", _dpi(kept))


def _dpi(tags: Tags) -> tuple[float, float] | None:
    (unit,) = numbers(tags.get(RESOLUTION_UNIT, shorts(INCH)))[:1] or [INCH]
    x, y = (numbers(tags[name]) if name in tags else [] for name in RESOLUTION)
    if unit not in (INCH, _CENTIMETER) or len(x) != 2 or len(y) != 2 or not x[1] * y[1]:
        return None
    scale = 1 if unit == INCH else 2.54
    return scale * x[0] / x[1], scale * y[0] / y[1]
