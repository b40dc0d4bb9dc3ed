"""The tags of TIFF and EXIF, moved from file to file as they are [TIFF 6.0, EXIF 2.32].

EXIF is a TIFF without a picture: a block of bytes with a header and a directory of tags. Values are not
interpreted, so that none changes; the notes of camera makers are bytes to us as to everybody.
"""

import struct
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Union

import numpy as np

_UNITS = {1: 1, 2: 1, 3: 2, 4: 4, 5: 4, 6: 1, 7: 1, 8: 2, 9: 4, 10: 4, 11: 4, 12: 8, 13: 4, 16: 8}
_PAIRS = (5, 10)  # rationals are two numbers
_SHORT, _LONG, _UNDEFINED = 3, 4, 7
_DIRECTORIES = (0x8769, 0x8825, 0xA005)  # EXIF, GPS, interoperability: tags that hold tags
_THUMBNAIL, _THUMBNAIL_LENGTH = 0x0201, 0x0202
_MOST = 4096  # tags in a directory: nobody has more
EXIF, COLOR_SPACE, RESOLUTION, RESOLUTION_UNIT = 0x8769, 0xA001, (0x011A, 0x011B), 0x0128


@dataclass(frozen=True)
class Tag:
    """A value: its type by number, how many there are, and its bytes, most significant first."""

    form: int
    count: int
    data: bytes


Tags = Mapping[int, Union[Tag, "Tags"]]


def shorts(*values: int) -> Tag:
    """A tag of 16-bit numbers."""
    return Tag(_SHORT, len(values), struct.pack(f">{len(values)}H", *values))


def longs(*values: int) -> Tag:
    """A tag of 32-bit numbers."""
    return Tag(_LONG, len(values), struct.pack(f">{len(values)}L", *values))


def rational(value: float) -> Tag:
    """A tag of one fraction."""
    return Tag(5, 1, struct.pack(">2L", round(value * 1000), 1000))


def some_bytes(data: bytes) -> Tag:
    """A tag of bytes that have a meaning of their own."""
    return Tag(_UNDEFINED, len(data), data)


def numbers(tag: Union[Tag, "Tags"]) -> list[int]:
    """The whole numbers of a tag."""
    if not isinstance(tag, Tag):
        return []
    return [int(n) for n in np.frombuffer(tag.data, f">u{_UNITS[tag.form]}")]


def parse_tags(block: bytes) -> Tags:
    """The tags of the first directory of a TIFF or an EXIF block, and of those within it.

    Tags whose values lie outside the block are left out.

    Raises
    ------
    ValueError
        If it is no such block.
    """
    order, big, at = _header(block)
    return _directory(block, order, big, at, depth=0)[0]


def tags_block(tags: Tags, order: str = ">") -> bytes:
    """A block of tags; `order` is ">" or "<", the most or the least significant byte first."""
    mark = b"MM" if order == ">" else b"II"
    return mark + struct.pack(order + "HL", 42, 8) + _packed(tags, 8, order)


def without_thumbnail(block: bytes) -> bytes:
    """An EXIF block that shows no small picture any more; all else stays in its place."""
    try:
        order, big, at = _header(block)
        _, end, following = _directory(block, order, big, at, depth=1)
        if not following or big:
            return block
        small, _, _ = _directory(block, order, big, following, depth=1)
    except ValueError:
        return block  # nobody can find a picture in it either
    result = bytearray(block)
    result[end - 4 : end] = b"\0" * 4
    place, length = (numbers(small.get(t, {}))[:1] for t in (_THUMBNAIL, _THUMBNAIL_LENGTH))
    if place and length and place[0] + length[0] <= len(block):
        result[place[0] : place[0] + length[0]] = b"\0" * length[0]
    return bytes(result)


def _header(block: bytes) -> tuple[str, bool, int]:
    """Order of bytes, whether offsets have 64 bits, and where the first directory is."""
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
    block: bytes, order: str, big: bool, at: int, depth: int
) -> tuple[dict[int, Union[Tag, "Tags"]], int, int]:
    """The tags of the directory at `at`, where it ends, and where the next one is, 0 for none."""
    offset, length = (order + "Q", 20) if big else (order + "L", 12)
    first = at + (8 if big else 2)
    width = struct.calcsize(offset)
    if first > len(block):
        raise ValueError("cut short")
    (count,) = struct.unpack(order + ("Q" if big else "H"), block[at:first])
    end = first + length * count + width
    if count > _MOST or end > len(block):
        raise ValueError("cut short")
    found: dict[int, Tag | Tags] = {}
    room = len(block)  # values do not overlap, but in files that are made to fill the memory
    for entry in range(first, end - width, length):
        name, form, many = struct.unpack_from(order + "HH" + offset[1], block, entry)
        size = _UNITS.get(form, 0) * many * (2 if form in _PAIRS else 1)
        value = entry + length - width
        (place,) = (value,) if size <= width else struct.unpack_from(offset, block, value)
        data = block[place : place + size]
        room -= size
        if room < 0:
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
    unit = _UNITS[form]
    if order == ">" or unit == 1:
        return data
    return np.frombuffer(data, f"<u{unit}").astype(f">u{unit}").tobytes()


def _packed(tags: Tags, at: int, order: str) -> bytes:
    """The directory of `tags` at `at`, with their values behind it."""
    entries, values = struct.pack(order + "H", len(tags)), b""
    behind = at + 2 + 12 * len(tags) + 4
    for name in sorted(tags):
        tag, place = tags[name], struct.pack(order + "L", behind + len(values))
        if not isinstance(tag, Tag):
            data = _packed(tag, behind + len(values), order)
            entries += struct.pack(order + "HHL", name, _LONG, 1) + place
        else:
            data = _swapped(tag.data, tag.form, order)
            inside = len(data) <= 4
            entries += struct.pack(order + "HHL", name, tag.form, tag.count)
            entries += data.ljust(4, b"\0") if inside else place
            data = b"" if inside else data
        values += data + b"\0" * (len(data) % 2)
    return entries + b"\0" * 4 + values
