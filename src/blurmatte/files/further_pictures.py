"""What metadata say of further pictures in a file, which would show a picture as before an edit.

A JPEG may have a gain map for HDR screens [Adobe gain map 1.0, ISO 21496-1, Ultra HDR], a clip
[motion photo 1.0] or other pictures [CIPA DC-007, MPF] behind the picture, and small copies of the
picture in XMP and in Photoshop's resources. They are not copied, so neither is what states them.
"""

import re
import struct
from collections.abc import Sequence

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


def is_about_further_pictures(body: bytes) -> bool:
    """Whether the body of a JPEG's segment is the index or the format of further pictures."""
    return body.startswith(tuple(_SEGMENTS))


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
