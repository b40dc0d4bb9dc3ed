"""Pixels into a file, with what another file carries beside its own.

A PNG keeps what it has chunk by chunk; else see beside.py.
"""

import io
import struct
import zlib
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from blurmatte.errors import FileError
from blurmatte.files.beside import (
    EXIF_MARK,
    ICC_TAG,
    INCH,
    LAYOUT,
    METER,
    STALE,
    XMP_NAME,
    XMP_TAG,
    Beside,
    read_beside,
)
from blurmatte.files.encoding import icc_profile, png_encoding
from blurmatte.files.pixels import save_pixels
from blurmatte.files.png import png_chunks, save_chunks
from blurmatte.files.raster import Raster
from blurmatte.files.refusals import kind_of
from blurmatte.files.tags import (
    COLOR_SPACE,
    EXIF,
    RESOLUTION,
    RESOLUTION_UNIT,
    Tag,
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

_PLAIN = b"\0\0\0\0"  # not compressed, two bytes; no language; no translated name
_STRIP_OFFSETS, _STRIP_LENGTHS = 273, 279
_IS_SRGB = 1
# Without it OpenImageIO 3.2 fails to write the EXIF that it has not; none of its tags is kept.
_NO_EXIF = {"oiio:ColorSpace": "srgb_rec709_scene"}
_ONLY_TIFF = (33723, 34377)  # IPTC and Photoshop's resources: EXIF elsewhere does not hold them
_MOST_EXIF = 65533 - 2 - len(EXIF_MARK)  # of a JPEG: one segment
# Chunks of a PNG that hold, or describe, pixels; an animation's other frames.
_PIXEL_CHUNKS = (b"IHDR", b"IDAT", b"IEND", b"acTL", b"fcTL", b"fdAT")
_CHANNEL_CHUNKS = (b"tRNS", b"sBIT")


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
    layout = {name: tag for name, tag in parse_tags(written).items() if name in LAYOUT}
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
    more: dict[str, Any] = {"exif": EXIF_MARK + exif} if exif else {}
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
    tags = _own_tags(beside, STALE)
    if _says_srgb(raster):
        tags = _with_srgb(tags)
    if beside.dpi and RESOLUTION[0] not in tags:
        x, y = map(rational, beside.dpi)
        tags |= {RESOLUTION[0]: x, RESOLUTION[1]: y, RESOLUTION_UNIT: shorts(INCH)}
    if beside.profile:
        tags[ICC_TAG] = some_bytes(beside.profile)
    if beside.xmp:
        tags[XMP_TAG] = Tag(1, len(beside.xmp), beside.xmp)
    return tags


def _chunks_of(beside: Beside, raster: Raster) -> list[tuple[bytes, bytes]]:
    """All of it as the chunks of a PNG, in the order in which they must come."""
    chunks = []
    if beside.profile:
        chunks.append((b"iCCP", b"icc\0\0" + zlib.compress(beside.profile)))
    elif raster.tags.get("Exif:ColorSpace") == _IS_SRGB:
        chunks.append((b"sRGB", b"\0"))  # 0: perceptual
    if beside.dpi:
        x, y = (round(value / METER) for value in beside.dpi)
        chunks.append((b"pHYs", struct.pack(">2LB", x, y, 1)))
    exif = _exif_with_curve(beside, raster)
    if exif:
        chunks.append((b"eXIf", exif))
    if beside.xmp:
        chunks.append((b"iTXt", XMP_NAME + _PLAIN + beside.xmp))
    return chunks
