"""Tags of TIFF and EXIF, copied from file to file byte by byte [TIFF 6.0, EXIF 2.32].

EXIF is a TIFF without a picture: a header and a directory of tags. Values are not interpreted, so
that none changes, and neither do the notes of camera makers.
"""

import mmap
import struct
from collections.abc import Mapping
from dataclasses import dataclass
from enum import IntEnum
from typing import Union

import numpy as np
from PIL.ExifTags import Base as TiffTag
from PIL.TiffTags import DOUBLE, FLOAT, LONG, RATIONAL, SHORT, SIGNED_RATIONAL


class ColorSpace(IntEnum):
    """Values of the tag of that name; some programs write the second."""

    SRGB = 1
    ADOBE_RGB = 2
    UNCALIBRATED = 65535


EXIF_MARK = b"Exif\0\0"  # before the block in a JPEG; some programs write it in a PNG, too

# Bytes of a number of each type; rationals are fractions of two numbers.
_BYTES = {1: 1, 2: 1, 3: 2, 4: 4, 5: 4, 6: 1, 7: 1, 8: 2, 9: 4, 10: 4, 11: 4, 12: 8, 13: 4, 16: 8}
_DIRECTORIES = (TiffTag.ExifOffset, TiffTag.GPSInfo, TiffTag.ExifInteroperabilityOffset)


@dataclass(frozen=True)
class Tag:
    """A value: its type by number, the count, and its bytes, most significant first."""

    form: int
    count: int
    data: bytes


Tags = Mapping[int, Union[Tag, "Tags"]]


def shorts(*values: int) -> Tag:
    """A tag of 16-bit numbers."""
    return Tag(SHORT, len(values), struct.pack(f">{len(values)}H", *values))


def longs(*values: int) -> Tag:
    """A tag of 32-bit numbers."""
    return Tag(LONG, len(values), struct.pack(f">{len(values)}L", *values))


def rational(value: float) -> Tag:
    """A tag of one fraction, in thousandths."""
    return Tag(RATIONAL, 1, struct.pack(">2L", round(value * 1000), 1000))


def numbers(tag: Union[Tag, "Tags"]) -> list[int]:
    """The integers of a tag; none of a directory."""
    if not isinstance(tag, Tag):
        return []
    return [int(n) for n in np.frombuffer(tag.data, f">u{_BYTES[tag.form]}")]


def nested(tags: Tags, *names: int) -> Union[Tag, "Tags"]:
    """What a tag of nested directories holds; no tags if one of them is missing."""
    found: Tag | Tags = tags
    for name in names:
        found = {} if isinstance(found, Tag) else found.get(name, {})
    return found


def parse_tags(block: bytes | mmap.mmap, page: int = 0) -> Tags:
    """The tags of one directory of a TIFF or an EXIF block, with nested directories.

    Tags whose values lie outside the block are omitted. Raises ValueError if it is no such block.
    """
    order, big, at = _header(block)
    for _ in range(page):
        at = _directory(block, order, big, at, depth=1)[2]
    return _directory(block, order, big, at, depth=0)[0]


def fractions(tag: Union[Tag, "Tags"]) -> list[float]:
    """The quotients of pairs of integers of any type, or the floats of a tag; none if a divisor is 0.

    EXIF wants type 5, but some programs write pairs of shorter integers, or floats.
    """
    if isinstance(tag, Tag) and tag.form in (FLOAT, DOUBLE):
        return [float(n) for n in np.frombuffer(tag.data, f">f{_BYTES[tag.form]}")]
    values = numbers(tag)
    pairs = list(zip(values[::2], values[1::2], strict=False))
    return [] if any(divisor == 0 for _, divisor in pairs) else [n / d for n, d in pairs]


def tags_block(tags: Tags, order: str = ">") -> bytes:
    """A block of tags; `order` is ">" for big-endian or "<" for little-endian bytes."""
    mark = b"MM" if order == ">" else b"II"
    return mark + struct.pack(order + "HL", 42, 8) + _packed(tags, 8, order)


def without_thumbnail(block: bytes) -> bytes:
    """An EXIF block without its thumbnail; all other values keep their offsets."""
    try:
        order, big, at = _header(block)
        _, end, following = _directory(block, order, big, at, depth=1)
        if not following or big:
            return block
        small, _, _ = _directory(block, order, big, following, depth=1)
    except ValueError:
        return block  # other programs cannot find a thumbnail in it either
    result = bytearray(block)
    result[end - 4 : end] = b"\0" * 4
    start, length = (
        numbers(small.get(tag, {}))[:1] for tag in (TiffTag.JpegIFOffset, TiffTag.JpegIFByteCount)
    )
    if start and length and start[0] + length[0] <= len(block):
        result[start[0] : start[0] + length[0]] = b"\0" * length[0]
    return bytes(result)


def _header(block: bytes | mmap.mmap) -> tuple[str, bool, int]:
    """Byte order, True for 64-bit offsets, and the offset of the first directory."""
    order = {b"II": "<", b"MM": ">"}.get(block[:2])
    if order is None or len(block) < 8:
        raise ValueError("no TIFF")
    (version,) = struct.unpack(order + "H", block[2:4])
    big = version == 43
    if version not in (42, 43) or (big and len(block) < 16):
        raise ValueError("no TIFF")
    (at,) = struct.unpack_from(order + ("Q" if big else "L"), block, 8 if big else 4)
    return order, big, at


def _directory(
    block: bytes | mmap.mmap, order: str, big: bool, at: int, depth: int
) -> tuple[dict[int, Union[Tag, "Tags"]], int, int]:
    """The tags of the directory at `at`, its end, and the offset of the next directory or 0."""
    offset, length = (order + "Q", 20) if big else (order + "L", 12)
    first = at + (8 if big else 2)
    width = struct.calcsize(offset)
    if first > len(block):
        raise ValueError("truncated")
    (count,) = struct.unpack(order + ("Q" if big else "H"), block[at:first])
    end = first + length * count + width
    if count > 4096 or end > len(block):  # more tags are damage
        raise ValueError("truncated")
    found: dict[int, Tag | Tags] = {}
    remaining = len(block)  # values do not overlap, except in files made to exhaust memory
    for entry in range(first, end - width, length):
        name, form, many = struct.unpack_from(order + "HH" + offset[1], block, entry)
        size = _BYTES.get(form, 0) * many * (2 if form in (RATIONAL, SIGNED_RATIONAL) else 1)
        value = entry + length - width
        (start,) = (value,) if size <= width else struct.unpack_from(offset, block, value)
        data = block[start : start + size]
        remaining -= size
        if remaining < 0:
            raise ValueError("damaged")
        if not size or len(data) < size:
            continue
        tag = Tag(form, many, _swapped(data, form, order))
        if name in _DIRECTORIES and depth < 2:
            try:
                found[name] = _directory(block, order, big, numbers(tag)[0], depth + 1)[0]
            except ValueError:
                continue
        else:
            found[name] = tag
    return found, end, struct.unpack_from(offset, block, end - width)[0]


def _swapped(data: bytes, form: int, order: str) -> bytes:
    unit = _BYTES[form]
    if order == ">" or unit == 1:
        return data
    return np.frombuffer(data, f"<u{unit}").astype(f">u{unit}").tobytes()


def _packed(tags: Tags, at: int, order: str) -> bytes:
    """The directory of `tags` at `at`, followed by its values."""
    entries, values = struct.pack(order + "H", len(tags)), b""
    behind = at + 2 + 12 * len(tags) + 4
    for name in sorted(tags):
        tag, start = tags[name], struct.pack(order + "L", behind + len(values))
        if not isinstance(tag, Tag):
            data = _packed(tag, behind + len(values), order)
            entries += struct.pack(order + "HHL", name, LONG, 1) + start
        else:
            data = _swapped(tag.data, tag.form, order)
            inside = len(data) <= 4
            entries += struct.pack(order + "HHL", name, tag.form, tag.count)
            entries += data.ljust(4, b"\0") if inside else start
            data = b"" if inside else data
        values += data + b"\0" * (len(data) % 2)
    return entries + b"\0" * 4 + values
