"""Metadata of picture files: EXIF, color profile, XMP and resolution, copied between formats.

PNG, JPEG and TIFF store them differently. A PNG written from a PNG keeps its chunks unchanged.

A JPEG may have further pictures, which would show it as before an edit: it may have a gain map for
HDR screens [Adobe gain map 1.0, ISO 21496-1, Ultra HDR], a clip [motion photo 1.0] or other pictures
[CIPA DC-007, MPF] behind the picture, and small copies of the picture in XMP and in Photoshop's
resources. They are not copied, so neither is what states them.
"""

import re
import struct
import zlib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from PIL.ExifTags import Base as TiffTag
from PIL.TiffTags import BYTE, UNDEFINED

from blurmatte.checks import AnyArray
from blurmatte.errors import FileError
from blurmatte.files.encoding import icc_profile, png_encoding, primaries_alone
from blurmatte.files.errors import damaged
from blurmatte.files.exif import (
    EXIF_MARK,
    ColorSpace,
    Tag,
    Tags,
    fractions,
    longs,
    nested,
    numbers,
    parse_tags,
    rational,
    shorts,
    tags_block,
    without_thumbnail,
)
from blurmatte.files.png import MAX_TEXT_BYTES, png_chunks, save_chunks
from blurmatte.files.raster import Raster
from blurmatte.files.raster_writing import compress_jpeg, save_pixels
from blurmatte.formats import JPEG, PNG, TIFF
from blurmatte.jpeg.structure import metadata_segments, stored_segment
from blurmatte.radiometry.transfer import SRGB

_XMP_MARK = b"http://ns.adobe.com/xap/1.0/\0"
_PNG_XMP = b"XML:com.adobe.xmp\0"  # keyword of an iTXt chunk
_INCH, _CENTIMETER = 2, 3  # values of RESOLUTION_UNIT
_INCH_M = 0.0254  # exact
# TIFF tags of the layout of pixels.
_LAYOUT = (256, 257, 258, 259, 262, 273, 277, 278, 279, 284, 317, 338, 339)
# TIFF tags that are not copied: layout, other pages, thumbnails, Photoshop's layers; XMP and ICC.
_NOT_COPIED = (
    *_LAYOUT,
    *(254, 255, 280, 281, 330, 332, 333, 334, 336, 340, 341, 347, 37724),
    *(TiffTag.XMLPacket, TiffTag.InterColorProfile),
    *(*range(263, 267), *range(288, 294), *range(320, 326), *range(512, 522), *range(529, 533)),
)
# PNG chunks of pixels and of animations, and those that describe the channels.
_PIXEL_CHUNKS = (b"IHDR", b"IDAT", b"IEND", b"acTL", b"fcTL", b"fdAT")
_CHANNEL_CHUNKS = (b"tRNS", b"sBIT")
_GAIN_MAP, _CLIP, _OTHERS = "HDR gain map", "clip", "further pictures"
_CAMERA = b"http://ns.google.com/photos/1.0/camera/"
# Namespaces of XMP, which of their names are about further pictures, and what these are.
_STATEMENTS = (
    (b"http://ns.adobe.com/hdr-gain-map/1.0/", rb"\w+", _GAIN_MAP),
    (b"http://ns.apple.com/HDRGainMap/1.0/", rb"\w+", _GAIN_MAP),
    (b"http://ns.google.com/photos/1.0/container/", rb"\w+", _OTHERS),
    (b"http://ns.google.com/photos/1.0/container/item/", rb"\w+", _OTHERS),
    (_CAMERA, rb"(?:MotionPhoto|MicroVideo)\w*", _CLIP),
    (b"http://ns.adobe.com/xap/1.0/", rb"Thumbnails", ""),
)
_SEGMENTS = {b"MPF\0": _OTHERS, b"urn:iso:std:iso:ts:21496:-1\0": _GAIN_MAP}
PHOTOSHOP_MARK = b"Photoshop 3.0\0"
_THUMBNAILS = (1033, 1036)  # numbers of Photoshop's resources


@dataclass(frozen=True)
class Metadata:
    """Metadata of a picture file but for its color profile."""

    exif: bytes  # a block of tags, see exif.py; empty if there is none
    xmp: bytes  # an XMP packet; empty if there is none
    dpi: tuple[float, float] | None  # pixels per inch, where stated outside EXIF


def read_metadata(raster: Raster) -> Metadata:
    """The metadata of the file of a raster."""
    readers = {PNG: _read_png, JPEG: _read_jpeg, TIFF: _read_tiff}
    if raster.format in readers:
        return readers[raster.format](raster)
    return Metadata(without_thumbnail(raster.exif), raster.xmp, None)


def current_segments(segments: Iterable[bytes]) -> tuple[bytes, ...]:
    """The metadata segments of a JPEG without thumbnails and statements about further pictures."""
    edits = (
        (0xE1, EXIF_MARK, without_thumbnail),
        (0xE1, _XMP_MARK, xmp_of_one_picture),
        (0xED, PHOTOSHOP_MARK, without_small_copies),
    )
    current = []
    for kind, body in ((segment[1], segment[4:]) for segment in segments):
        for marker, mark, edited in edits:
            if kind == marker and body.startswith(mark):
                body = mark + edited(body[len(mark) :])
        if not (kind == 0xE2 and body.startswith(tuple(_SEGMENTS))):
            current.append(stored_segment(kind, body))
    return tuple(current)


def save_png(path: Path, raster: Raster, pixels: AnyArray) -> None:
    """Write pixels with the metadata of the file of `raster`; of a PNG every chunk as stored.

    This and the next two raise OSError if the file cannot be written completely.
    """
    save_pixels(path, [pixels], raster.names, {"oiio:UnassociatedAlpha": 1})
    new = png_chunks(path)
    header = new[0][1]
    if raster.png is not None:
        own = png_chunks(raster.path)
        same_color_type = own[0][1][9] == header[9]
        omitted = _PIXEL_CHUNKS if same_color_type else _PIXEL_CHUNKS + _CHANNEL_CHUNKS
        others = [(kind, data) for kind, data in own if kind not in omitted]
        others = [(k, without_thumbnail(d) if k == b"eXIf" else d) for k, d in others]
        pixels_at = [kind for kind, _ in own if kind not in omitted or kind == b"IDAT"].index(
            b"IDAT"
        )
    else:
        others = _png_chunks_of(read_metadata(raster), raster)
        pixels_at = len(others)
    data = [(kind, data) for kind, data in new if kind == b"IDAT"]
    # Chunks behind the pixels stay there: readers ignore the orientation of an eXIf chunk behind them.
    chunks = [*others[:pixels_at], *data, *others[pixels_at:]]
    save_chunks(path, [(b"IHDR", header), *chunks, (b"IEND", b"")])


def save_tiff(path: Path, raster: Raster, pixels: AnyArray) -> None:
    """Write pixels with the metadata of the file of `raster`."""
    alpha = 0 if raster.associated else 1
    # OpenImageIO 3.2 fails to write a TIFF without a color space; the tag is not copied.
    options = {"oiio:ColorSpace": "srgb_rec709_scene", "oiio:UnassociatedAlpha": alpha}
    save_pixels(path, [pixels], raster.names, options)
    written = path.read_bytes()
    layout = {name: tag for name, tag in parse_tags(written).items() if name in _LAYOUT}
    offsets, lengths = (
        numbers(layout[tag]) for tag in (TiffTag.StripOffsets, TiffTag.StripByteCounts)
    )
    tags = _tiff_tags_of(read_metadata(raster), raster) | layout
    tags |= {TiffTag.StripOffsets: longs(*offsets), TiffTag.StripByteCounts: longs(*lengths)}
    start = len(tags_block(tags, "<"))
    ends = np.cumsum(lengths).tolist()
    new_offsets = (start + end - length for end, length in zip(ends, lengths, strict=True))
    tags[TiffTag.StripOffsets] = longs(*new_offsets)
    with path.open("wb") as file:
        file.write(tags_block(tags, "<"))
        for offset, length in zip(offsets, lengths, strict=True):
            file.write(memoryview(written)[offset : offset + length])


def save_new_jpeg(path: Path, raster: Raster, pixels: AnyArray) -> None:
    """Compress all pixels at quality 95, 4:4:4, with the metadata of the file of `raster`.

    Raises FileError if a JPEG cannot hold them.
    """
    if raster.alpha is not None and raster.alpha.min() < 1:
        raise FileError(f"{raster.path}: write .png or .tif; a JPEG cannot hold its alpha")
    metadata = read_metadata(raster)
    exif = _exif_with_color_space(metadata, raster)
    if len(exif) > 65533 - 2 - len(EXIF_MARK):  # one segment
        raise FileError(f"{raster.path}: write .png or .tif; its EXIF is too long for a JPEG")
    codes = raster_colors(raster, pixels)
    if codes.dtype == np.uint16:
        codes = np.rint(codes / 257).astype(np.uint8)
    stated = {"icc_profile": icc_profile(raster), "xmp": metadata.xmp, "dpi": metadata.dpi}
    stated["exif"] = EXIF_MARK + exif if exif else b""
    compress_jpeg(path, codes, **{name: value for name, value in stated.items() if value})


def raster_colors(raster: Raster, pixels: AnyArray) -> AnyArray:
    """(H, W, 3) red, green and blue of pixels with the channels of `raster`, or (H, W) gray."""
    if raster.gray:
        return np.ascontiguousarray(pixels[..., raster.names.index("Y")])
    return np.ascontiguousarray(pixels[..., [raster.names.index(name) for name in "RGB"]])


def _read_png(raster: Raster) -> Metadata:
    exif, xmp, dpi, pixels_seen = b"", b"", None, False
    for kind, data in png_chunks(raster.path):
        pixels_seen |= kind == b"IDAT"
        if kind == b"eXIf":
            exif = without_thumbnail(data.removeprefix(EXIF_MARK))
            exif = _without_orientation(exif) if pixels_seen else exif
        elif kind == b"iTXt" and data.startswith(_PNG_XMP):
            xmp = _png_text(data) or xmp
        elif kind == b"pHYs" and len(data) == 9 and data[8] == 1:
            x, y = struct.unpack(">2L", data[:8])
            dpi = x * _INCH_M, y * _INCH_M
    return Metadata(exif, xmp, dpi)


def _without_orientation(exif: bytes) -> bytes:
    """EXIF from behind the pixels of a PNG, where readers ignore its orientation."""
    tags = _tags_of(exif, (TiffTag.Orientation,))
    return tags_block(tags) if tags else b""


def _png_text(data: bytes) -> bytes:
    """The text of an iTXt chunk; empty if it is invalid."""
    try:
        compressed, text = data[len(_PNG_XMP)], data[len(_PNG_XMP) + 2 :].split(b"\0", 2)[2]
        return zlib.decompressobj().decompress(text, MAX_TEXT_BYTES) if compressed else text
    except (IndexError, zlib.error):
        return b""


def _read_jpeg(raster: Raster) -> Metadata:
    exif, xmp, dpi = b"", b"", None
    for segment in current_segments(metadata_segments(raster.path.read_bytes())):
        kind, body = segment[1], segment[4:]
        if kind == 0xE1 and body.startswith(EXIF_MARK) and not exif:
            exif = body[len(EXIF_MARK) :]
        elif kind == 0xE1 and body.startswith(_XMP_MARK):
            xmp = body[len(_XMP_MARK) :]
        elif kind == 0xE0 and body.startswith(b"JFIF\0") and body[7:8] in (b"\1", b"\2"):
            x, y = struct.unpack(">2H", body[8:12])
            unit = 1 if body[7] == 1 else 2.54
            dpi = (x * unit, y * unit) if x and y else None
    return Metadata(exif, xmp, dpi)


def _read_tiff(raster: Raster) -> Metadata:
    try:
        tags = parse_tags(raster.path.read_bytes(), raster.page)
    except ValueError as error:
        raise damaged(raster.path, "TIFF", [f"its tags: {error}"]) from error
    xmp = tags.get(TiffTag.XMLPacket)
    kept = {name: tag for name, tag in tags.items() if name not in _NOT_COPIED}
    resources = kept.get(TiffTag.ImageResources)
    if isinstance(resources, Tag):
        data = without_small_copies(resources.data)
        kept[TiffTag.ImageResources] = Tag(resources.form, len(data), data)
    exif = tags_block(kept) if kept else b""
    return Metadata(exif, xmp.data if isinstance(xmp, Tag) else b"", _dpi(kept))


def _dpi(tags: Tags) -> tuple[float, float] | None:
    (unit,) = numbers(tags.get(TiffTag.ResolutionUnit, shorts(_INCH)))[:1] or [_INCH]
    x, y = (fractions(nested(tags, tag)) for tag in (TiffTag.XResolution, TiffTag.YResolution))
    if unit not in (_INCH, _CENTIMETER) or len(x) != 1 or len(y) != 1:
        return None
    scale = 1 if unit == _INCH else 2.54
    return scale * x[0], scale * y[0]


def _tags_of(exif: bytes, omitted: tuple[int, ...]) -> dict[int, Any]:
    """The EXIF tags, without those omitted; none if the block is invalid."""
    try:
        tags = parse_tags(exif)
    except ValueError:  # some cameras and programs write invalid EXIF
        return {}
    return {name: tag for name, tag in tags.items() if name not in omitted}


def _with_srgb(tags: dict[int, Any]) -> dict[int, Any]:
    inner = tags.get(TiffTag.ExifOffset, {})
    return tags | {TiffTag.ExifOffset: {**inner, TiffTag.ColorSpace: shorts(ColorSpace.SRGB)}}


def _exif_with_color_space(metadata: Metadata, raster: Raster) -> bytes:
    """The EXIF for a PNG or JPEG; it states sRGB where the chunks of a PNG did."""
    stated = raster.tags.get("Exif:ColorSpace") == ColorSpace.SRGB or not _png_states_srgb(raster)
    if raster.format is not TIFF and stated:
        return metadata.exif
    of_tiff = TiffTag.IPTCNAA, TiffTag.ImageResources  # which only a TIFF may hold
    tags = _tags_of(metadata.exif, of_tiff)
    tags = tags if stated else _with_srgb(tags)
    return tags_block(tags) if tags else b""


def _png_states_srgb(raster: Raster) -> bool:
    """True if the chunks of a PNG state sRGB, and it has no ICC profile."""
    if raster.png is None:
        return False
    profile, cicp = icc_profile(raster) is not None, raster.png.cicp is not None
    stated = None if profile and not cicp else png_encoding(raster)
    curve = SRGB if stated is None else stated.curves[0]
    matrix = primaries_alone(raster) if stated is None and not profile else None
    if stated is not None:
        matrix = stated.matrix
    if curve is not SRGB or matrix is not None or (profile and cicp):
        raise FileError(f"{raster.path}: write .png; only a PNG can state its encoding of light")
    return stated is not None


def _tiff_tags_of(metadata: Metadata, raster: Raster) -> dict[int, Any]:
    """All metadata as tags of a TIFF."""
    tags = _tags_of(metadata.exif, _NOT_COPIED)
    if _png_states_srgb(raster):
        tags = _with_srgb(tags)
    if metadata.dpi and TiffTag.XResolution not in tags:
        x, y = map(rational, metadata.dpi)
        tags |= {TiffTag.XResolution: x, TiffTag.YResolution: y}
        tags |= {TiffTag.ResolutionUnit: shorts(_INCH)}
    if profile := icc_profile(raster):
        tags[TiffTag.InterColorProfile] = Tag(UNDEFINED, len(profile), profile)
    if metadata.xmp:
        tags[TiffTag.XMLPacket] = Tag(BYTE, len(metadata.xmp), metadata.xmp)
    return tags


def _png_chunks_of(metadata: Metadata, raster: Raster) -> list[tuple[bytes, bytes]]:
    """All metadata as chunks of a PNG, in the required order."""
    chunks = []
    if profile := icc_profile(raster):
        chunks.append((b"iCCP", b"icc\0\0" + zlib.compress(profile)))
    elif raster.tags.get("Exif:ColorSpace") == ColorSpace.SRGB:
        chunks.append((b"sRGB", b"\0"))  # rendering intent: perceptual
    if metadata.dpi:
        x, y = (round(value / _INCH_M) for value in metadata.dpi)
        chunks.append((b"pHYs", struct.pack(">2LB", x, y, 1)))
    exif = _exif_with_color_space(metadata, raster)
    if exif:
        chunks.append((b"eXIf", exif))
    if metadata.xmp:
        # Not compressed (two bytes), no language, no translated keyword.
        chunks.append((b"iTXt", _PNG_XMP + b"\0\0\0\0" + metadata.xmp))
    return chunks


def xmp_of_one_picture(xmp: bytes) -> bytes:
    """A packet of XMP without statements about further pictures; all else byte by byte."""
    for space, names, _ in _STATEMENTS:
        for name in _names(xmp, space, names):
            xmp = re.sub(rb"\s+" + name + rb"\s*=\s*(?:\"[^\"]*\"|'[^']*')", b"", xmp)
            element = rb"\s*<" + name + rb"(?:\s[^<>]*)?(?:/>|>.*?</" + name + rb"\s*>)"
            xmp = re.sub(element, b"", xmp, flags=re.DOTALL)
    return xmp


def _names(xmp: bytes, space: bytes, names: bytes) -> list[bytes]:
    """Patterns of the qualified names of a namespace, one for each of its prefixes."""
    declared = rb"xmlns:([\w.-]+)\s*=\s*[\"']" + re.escape(space) + rb"[\"']"
    return [re.escape(prefix) + b":" + names for prefix in set(re.findall(declared, xmp))]


def without_small_copies(resources: bytes) -> bytes:
    """Photoshop's resources without those that are small copies of the picture."""
    kept, at = b"", 0
    while resources[at : at + 4] == b"8BIM" and at + 12 <= len(resources):
        name = resources[at + 6] // 2 * 2 + 2  # its length byte, and padded to even
        (number,) = struct.unpack_from(">H", resources, at + 4)
        start = at + 6 + name
        length = int.from_bytes(resources[start : start + 4])
        end = start + 4 + length + length % 2
        kept += b"" if number in _THUMBNAILS else resources[at:end]
        at = end
    return kept + resources[at:]


def further_pictures(segments: Sequence[bytes]) -> list[str]:
    """What a JPEG has besides its picture, by its segments: gain map, clip, further pictures."""
    found = set()
    for body in (segment[4:] for segment in segments):
        found |= {kind for mark, kind in _SEGMENTS.items() if body.startswith(mark)}
        for space, names, kind in _STATEMENTS:
            if any(re.search(name + rb"[\s=>/]", body) for name in _names(body, space, names)):
                found.add(kind)
    more = found - {"", _OTHERS}  # their index lists the gain map and the clip, too
    return sorted(more or found - {""})
