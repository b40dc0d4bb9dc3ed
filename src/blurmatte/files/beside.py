"""What a picture file carries beside its pixels: EXIF, color profile, XMP, resolution.

It goes from any kind of file to any other, as it is; a PNG keeps what it has chunk by chunk.
"""

import io
import struct
import zlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from blurmatte.errors import FileError
from blurmatte.files.encoding import icc_profile, png_encoding
from blurmatte.files.jpeg_segments import kept_segments
from blurmatte.files.pixels import save_pixels
from blurmatte.files.png import png_chunks, save_chunks
from blurmatte.files.raster import Raster
from blurmatte.files.refusals import damaged, kind_of
from blurmatte.files.tags import (
    COLOR_SPACE,
    EXIF,
    RESOLUTION,
    RESOLUTION_UNIT,
    Tag,
    Tags,
    longs,
    numbers,
    parse_tags,
    rational,
    shorts,
    some_bytes,
    tags_block,
    without_thumbnail,
)
from blurmatte.radiometry import SRGB

_EXIF_MARK, _XMP_MARK = b"Exif\0\0", b"http://ns.adobe.com/xap/1.0/\0"
_XMP_NAME = b"XML:com.adobe.xmp\0"  # of a text in a PNG
_PLAIN = b"\0\0\0\0"  # not compressed, two bytes; no language; no translated name
_XMP_TAG, _ICC_TAG, _STRIP_OFFSETS, _STRIP_LENGTHS = 700, 34675, 273, 279
_IS_SRGB, _INCH, _CENTIMETER = 1, 2, 3
_METER = 0.0254  # of an inch
# Without it OpenImageIO 3.2 fails to write the EXIF that it has not; none of its tags is kept.
_NO_EXIF = {"oiio:ColorSpace": "srgb_rec709_scene"}
# How the pixels of a TIFF lie in it.
_LAYOUT = (256, 257, 258, 259, 262, 273, 277, 278, 279, 284, 317, 338, 339)
# What is said of the old pixels and their place, other pages, smaller pictures, Photoshop's layers; and
# what is carried apart.
_STALE = (
    *_LAYOUT,
    *(254, 255, 280, 281, 330, 332, 333, 334, 336, 340, 341, 347, 37724, _XMP_TAG, _ICC_TAG),
    *(*range(263, 267), *range(288, 294), *range(320, 326), *range(512, 522), *range(529, 533)),
)
_ONLY_TIFF = (33723, 34377)  # IPTC and Photoshop's resources: EXIF elsewhere does not hold them
_MOST_EXIF = 65533 - 2 - len(_EXIF_MARK)  # of a JPEG: one segment
# Chunks of a PNG that hold, or describe, pixels; an animation's other frames.
_PIXEL_CHUNKS = (b"IHDR", b"IDAT", b"IEND", b"acTL", b"fcTL", b"fdAT")
_CHANNEL_CHUNKS = (b"tRNS", b"sBIT")


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


def save_png(path: Path, raster: Raster, pixels: npt.NDArray[Any]) -> None:
    """Write pixels with what the file of `raster` carries; of a PNG every chunk as it is.

    Raises
    ------
    OSError
        If they do not all arrive.
    """
    save_pixels(path, [pixels], raster.names, {"oiio:UnassociatedAlpha": 1})
    new = png_chunks(path)
    header = new[0][1]
    if raster.png is not None:
        own = png_chunks(raster.path)
        left_out = _PIXEL_CHUNKS if own[0][1][9] == header[9] else _PIXEL_CHUNKS + _CHANNEL_CHUNKS
        others = [(kind, data) for kind, data in own if kind not in left_out]
        others = [(k, without_thumbnail(d) if k == b"eXIf" else d) for k, d in others]
    else:
        others = _chunks_of(read_beside(raster), raster)
    data = [(kind, data) for kind, data in new if kind == b"IDAT"]
    save_chunks(path, [(b"IHDR", header), *others, *data, (b"IEND", b"")])


def save_tiff(path: Path, raster: Raster, pixels: npt.NDArray[Any]) -> None:
    """Write pixels with what the file of `raster` carries.

    Raises
    ------
    OSError
        If they do not all arrive.
    """
    alpha = 0 if raster.associated else 1
    save_pixels(path, [pixels], raster.names, {**_NO_EXIF, "oiio:UnassociatedAlpha": alpha})
    written = path.read_bytes()
    layout = {name: tag for name, tag in parse_tags(written).items() if name in _LAYOUT}
    places, lengths = numbers(layout[_STRIP_OFFSETS]), numbers(layout[_STRIP_LENGTHS])
    tags = _tags_of(read_beside(raster), raster) | layout
    tags |= {_STRIP_OFFSETS: longs(*places), _STRIP_LENGTHS: longs(*lengths)}
    start = len(tags_block(tags, "<"))
    ends = np.cumsum(lengths).tolist()
    tags[_STRIP_OFFSETS] = longs(*(start + e - n for e, n in zip(ends, lengths, strict=True)))
    with path.open("wb") as file:
        file.write(tags_block(tags, "<"))
        for place, length in zip(places, lengths, strict=True):
            file.write(memoryview(written)[place : place + length])


def save_new_jpeg(path: Path, raster: Raster, pixels: npt.NDArray[Any]) -> None:
    """Compress all pixels at quality 95, 4:4:4, with what the file of `raster` carries.

    Raises
    ------
    FileError
        If a JPEG cannot hold it.
    OSError
        If it does not all arrive.
    """
    from PIL import Image

    if raster.alpha is not None and raster.alpha.min() < 1:
        raise FileError(f"{raster.path}: has alpha, which a JPEG cannot hold; write .png or .tif")
    beside = read_beside(raster)
    exif = _exif_with_curve(beside, raster)
    if len(exif) > _MOST_EXIF:
        raise FileError(f"{raster.path}: its EXIF is too long for a JPEG; write .png or .tif")
    codes = raster_colors(raster, pixels)
    if codes.dtype == np.uint16:
        codes = np.rint(codes / 257).astype(np.uint8)
    more: dict[str, Any] = {"exif": _EXIF_MARK + exif} if exif else {}
    more |= {"icc_profile": beside.profile} if beside.profile else {}
    more |= {"xmp": beside.xmp} if beside.xmp else {}
    more |= {"dpi": beside.dpi} if beside.dpi else {}
    file = io.BytesIO()
    Image.fromarray(codes).save(file, "JPEG", quality=95, subsampling=0, **more)
    path.write_bytes(file.getbuffer())


def raster_colors(raster: Raster, pixels: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """(H, W, 3) red, green and blue of pixels like those of `raster`, or (H, W) gray."""
    if raster.gray:
        return np.ascontiguousarray(pixels[..., raster.names.index("Y")])
    return np.ascontiguousarray(pixels[..., [raster.names.index(name) for name in "RGB"]])


def current_segments(kept: tuple[bytes, ...]) -> tuple[bytes, ...]:
    """The segments of a JPEG without those that tell of other pictures: an index, a thumbnail."""
    current = []
    for segment in kept:
        head, body = segment[:4], segment[4:]
        if head[1] == 0xE1 and body.startswith(_EXIF_MARK):
            segment = head + _EXIF_MARK + without_thumbnail(body[len(_EXIF_MARK) :])
        if not (head[1] == 0xE2 and body.startswith(b"MPF\0")):
            current.append(segment)
    return tuple(current)


def _beside_png(raster: Raster) -> Beside:
    exif, xmp, dpi = b"", b"", None
    for kind, data in png_chunks(raster.path):
        if kind == b"eXIf":
            exif = without_thumbnail(data.removeprefix(_EXIF_MARK))
        elif kind == b"iTXt" and data.startswith(_XMP_NAME):
            xmp = _text(data) or xmp
        elif kind == b"pHYs" and len(data) == 9 and data[8] == 1:
            x, y = struct.unpack(">2L", data[:8])
            dpi = x * _METER, y * _METER
    return Beside(icc_profile(raster), exif, xmp, dpi)


def _text(data: bytes) -> bytes:
    """The text of an iTXt chunk; empty if it makes no sense."""
    try:
        compressed, text = data[len(_XMP_NAME)], data[len(_XMP_NAME) + 2 :].split(b"\0", 2)[2]
        return zlib.decompress(text) if compressed else text
    except (IndexError, zlib.error):
        return b""


def _beside_jpeg(raster: Raster) -> Beside:
    exif, xmp, dpi = b"", b"", None
    for segment in kept_segments(raster.path.read_bytes()):
        kind, body = segment[1], segment[4:]
        if kind == 0xE1 and body.startswith(_EXIF_MARK) and not exif:
            exif = without_thumbnail(body[len(_EXIF_MARK) :])
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
    xmp = tags.get(_XMP_TAG)
    kept = {name: tag for name, tag in tags.items() if name not in _STALE}
    exif = tags_block(kept) if kept else b""
    return Beside(icc_profile(raster), exif, xmp.data if isinstance(xmp, Tag) else b"", _dpi(kept))


def _dpi(tags: Tags) -> tuple[float, float] | None:
    (unit,) = numbers(tags.get(RESOLUTION_UNIT, shorts(_INCH)))[:1] or [_INCH]
    x, y = (numbers(tags[name]) if name in tags else [] for name in RESOLUTION)
    if unit not in (_INCH, _CENTIMETER) or len(x) != 2 or len(y) != 2 or not x[1] * y[1]:
        return None
    scale = 1 if unit == _INCH else 2.54
    return scale * x[0] / x[1], scale * y[0] / y[1]


def _own_tags(beside: Beside, stale: tuple[int, ...]) -> dict[int, Any]:
    try:
        tags = parse_tags(beside.exif)
    except ValueError:  # not every camera and program writes EXIF that holds together
        return {}
    return {name: tag for name, tag in tags.items() if name not in stale}


def _with_srgb(tags: dict[int, Any]) -> dict[int, Any]:
    inner = tags.get(EXIF, {})
    return tags | {EXIF: {**inner, COLOR_SPACE: shorts(_IS_SRGB)}}


def _exif_with_curve(beside: Beside, raster: Raster) -> bytes:
    """The EXIF of a file that is no TIFF: as it was, and sRGB where a PNG said so in its own way."""
    said = raster.tags.get("Exif:ColorSpace") == _IS_SRGB or not _says_srgb(raster)
    if kind_of(raster.path) != "TIFF" and said:
        return beside.exif
    tags = _own_tags(beside, _ONLY_TIFF)
    tags = tags if said else _with_srgb(tags)
    return tags_block(tags) if tags else b""


def _says_srgb(raster: Raster) -> bool:
    """A PNG's own chunks say that it is sRGB, and no profile does."""
    stated = png_encoding(raster) if icc_profile(raster) is None else None
    if stated is not None and stated.curves[0] is not SRGB:
        raise FileError(
            f"{raster.path}: says how it encodes light in a way that only PNG has; write .png"
        )
    return stated is not None


def _tags_of(beside: Beside, raster: Raster) -> dict[int, Any]:
    """All of it as the tags of a TIFF."""
    tags = _own_tags(beside, _STALE)
    if _says_srgb(raster):
        tags = _with_srgb(tags)
    if beside.dpi and RESOLUTION[0] not in tags:
        x, y = map(rational, beside.dpi)
        tags |= {RESOLUTION[0]: x, RESOLUTION[1]: y, RESOLUTION_UNIT: shorts(_INCH)}
    if beside.profile:
        tags[_ICC_TAG] = some_bytes(beside.profile)
    if beside.xmp:
        tags[_XMP_TAG] = Tag(1, len(beside.xmp), beside.xmp)
    return tags


def _chunks_of(beside: Beside, raster: Raster) -> list[tuple[bytes, bytes]]:
    """All of it as the chunks of a PNG, in the order in which they must come."""
    chunks = []
    if beside.profile:
        chunks.append((b"iCCP", b"icc\0\0" + zlib.compress(beside.profile)))
    elif raster.tags.get("Exif:ColorSpace") == _IS_SRGB:
        chunks.append((b"sRGB", b"\0"))  # 0: perceptual
    if beside.dpi:
        x, y = (round(value / _METER) for value in beside.dpi)
        chunks.append((b"pHYs", struct.pack(">2LB", x, y, 1)))
    exif = _exif_with_curve(beside, raster)
    if exif:
        chunks.append((b"eXIf", exif))
    if beside.xmp:
        chunks.append((b"iTXt", _XMP_NAME + _PLAIN + beside.xmp))
    return chunks
