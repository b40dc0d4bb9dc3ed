"""Damage to the bytes of a file: strategies of hypothesis.

Bits are flipped, bytes replaced, blocks removed, repeated and exchanged, the file is cut, numbers of
headers are replaced by extreme ones, and so are values of JSON, TOML and of the text in EXR headers.
"""

import re
import struct
import zlib
from collections.abc import Callable

from hypothesis import strategies as st

MAX_BLOCK = 64  # bytes
HEADER = 400  # bytes, where half of the damage is
MAX_CHANGES = 3
INTEGERS = (
    0,
    1,
    2,
    7,
    0x7F,
    0x80,
    0xFF,
    0x7FFF,
    0xFFFF,
    0x10000,
    0x7FFFFFFF,
    0x80000000,
    0xFFFFFFFF,
)
_HUGE = "1" + "0" * 400
VALUES = (
    *("0", "-1", "1", "0.5", "1e-320", "1e38", "-1e38", "1e308", "1e999", "NaN", "nan", "Infinity"),
    *("inf", "-inf", _HUGE, "9223372036854775808", "1" + "0" * 5000, "null", "true", "[]", "{}"),
    *('""', '"srgb"', '"ball"', '"arc"', '"#ffc032"', '"\\u0000"', "[1, 2]", "[[1]]", '{"a": 1}'),
    *("[" * 300 + "]" * 300, "{" * 300, "", "[1e30, 1e30, 1e30]", "100000", "1000"),
)
# A number, a word, or a text; of JSON and TOML.
_TOKEN = re.compile(rb'-?\d+(?:\.\d+)?(?:[eE][-+]?\d+)?|true|false|null|"[^"\\]*"')
_KEY = re.compile(rb'(?m)"?\b(\w+)"?\s*[:=]')
_NUMBER = re.compile(rb"-?\d+(?:\.\d+)?(?:[eE][-+]?\d+)?")
NUMBERS = (0, -1, 1, 2, 0.5, 1e-320, 1e-9, 1e-3, 100, 1000, 1e5, 1e6, -1e6, 1e9, 1e12, 1e38, 2**63)
_EXR_TEXT = re.compile(rb"(blurmatte:\w+|chromaticities)\0(string|chromaticities)\0")
_PNG = b"\x89PNG\r\n\x1a\n"


def damaged(content: bytes, is_text: bool) -> st.SearchStrategy[bytes]:
    """The content with one to MAX_CHANGES changes, and the sums of a PNG corrected in most cases."""
    changes = [_flip, _replace, _cut, _remove, _repeat, _insert]
    if is_text:  # most damage leaves a document whose syntax is valid
        changes = [_token, _token, _key, _line, *changes]
        likely = [_number]
    elif _EXR_TEXT.search(content):
        changes, likely = [_exr_text, *changes, _integer], [_exr_number, _exr_number, _exr_text]
    else:
        changes, likely = [*changes, _integer, _integer], changes

    @st.composite
    def strategy(draw: Callable) -> bytes:
        changed, kinds = content, draw(st.sampled_from((changes, likely)))
        for change in draw(st.lists(st.sampled_from(kinds), min_size=1, max_size=MAX_CHANGES)):
            if changed:
                changed = change(draw, changed)
        if changed.startswith(_PNG) and draw(st.integers(0, 3)):
            changed = with_sums(changed)
        return changed

    return strategy()


def with_sums(png: bytes) -> bytes:
    """A PNG with the correct checksum of each chunk, up to the first one that cannot be read."""
    at, parts = len(_PNG), [_PNG]
    while at + 12 <= len(png):
        (length,) = struct.unpack(">I", png[at : at + 4])
        if at + 12 + length > len(png):
            break
        body = png[at + 4 : at + 8 + length]
        parts += [png[at : at + 4], body, struct.pack(">I", zlib.crc32(body))]
        at += 12 + length
    return b"".join(parts) + png[at:]


def _place(draw: Callable, content: bytes) -> int:
    last = len(content) - 1
    return draw(st.one_of(st.integers(0, min(HEADER, last)), st.integers(0, last)))


def _flip(draw: Callable, content: bytes) -> bytes:
    at, bit = _place(draw, content), draw(st.integers(0, 7))
    return content[:at] + bytes([content[at] ^ 1 << bit]) + content[at + 1 :]


def _replace(draw: Callable, content: bytes) -> bytes:
    at = _place(draw, content)
    block = draw(st.one_of(st.binary(min_size=1, max_size=MAX_BLOCK), st.just(b"\xff" * 8)))
    return content[:at] + block + content[at + len(block) :]


def _cut(draw: Callable, content: bytes) -> bytes:
    return content[: _place(draw, content)]


def _block(draw: Callable, content: bytes) -> tuple[int, int]:
    at = _place(draw, content)
    return at, at + draw(st.integers(1, MAX_BLOCK))


def _remove(draw: Callable, content: bytes) -> bytes:
    start, end = _block(draw, content)
    return content[:start] + content[end:]


def _repeat(draw: Callable, content: bytes) -> bytes:
    start, end = _block(draw, content)
    return content[:end] + content[start:end] * draw(st.integers(1, 3)) + content[end:]


def _insert(draw: Callable, content: bytes) -> bytes:
    at = _place(draw, content)
    return content[:at] + draw(st.binary(min_size=1, max_size=MAX_BLOCK)) + content[at:]


def _integer(draw: Callable, content: bytes) -> bytes:
    """Two or four bytes, in either order."""
    at, value = _place(draw, content), draw(st.sampled_from(INTEGERS))
    form = draw(st.sampled_from(("<H", ">H", "<I", ">I")))
    block = struct.pack(form, value & (0xFFFF if form[1] == "H" else 0xFFFFFFFF))
    return content[:at] + block + content[at + len(block) :]


def _token(draw: Callable, content: bytes) -> bytes:
    tokens = list(_TOKEN.finditer(content))
    if not tokens:
        return content
    token = draw(st.sampled_from(tokens))
    value = draw(st.one_of(st.sampled_from(VALUES), st.text(max_size=8), st.floats().map(repr)))
    return content[: token.start()] + value.encode("utf-8", "replace") + content[token.end() :]


def _key(draw: Callable, content: bytes) -> bytes:
    """A key misspelled, or another one."""
    keys = list(_KEY.finditer(content))
    if not keys:
        return content
    key = draw(st.sampled_from(keys))
    new = draw(st.sampled_from((key[1] + b"s", key[1][:-1], b"fisheye_model", b"dist", b"D", b"x")))
    return content[: key.start(1)] + new + content[key.end(1) :]


def _number(draw: Callable, content: bytes) -> bytes:
    """Another number, or the same times a power of ten, or its negative."""
    found = list(_NUMBER.finditer(content))
    if not found:
        return content
    old = draw(st.sampled_from(found))
    scaled = [float(old[0]) * factor for factor in (-1, 10, 1000, 1e-3)]
    new = draw(st.sampled_from([*NUMBERS, *scaled]))
    text = repr(int(new) if b"." not in old[0] and new == int(new) else float(new))
    return content[: old.start()] + text.encode() + content[old.end() :]


def _line(draw: Callable, content: bytes) -> bytes:
    """A line removed, or moved to another place."""
    lines = content.splitlines(keepends=True)
    line = lines.pop(draw(st.integers(0, len(lines) - 1)))
    if lines and draw(st.booleans()):
        lines.insert(draw(st.integers(0, len(lines))), line)
    return b"".join(lines)


def _exr_text(draw: Callable, content: bytes) -> bytes:
    """A value in the text of an attribute."""
    return _in_exr(draw, content, _token)


def _exr_number(draw: Callable, content: bytes) -> bytes:
    """A number in the text of an attribute."""
    return _in_exr(draw, content, _number)


def _in_exr(draw: Callable, content: bytes, change: Callable) -> bytes:
    """Change the text of an attribute, whose length is stored before it."""
    attributes = list(_EXR_TEXT.finditer(content))
    if not attributes:
        return content
    start = draw(st.sampled_from(attributes)).end()
    (length,) = struct.unpack("<i", content[start : start + 4].ljust(4, b"\0"))
    end = start + 4 + max(length, 0)
    text = change(draw, content[start + 4 : end])
    return content[:start] + struct.pack("<i", len(text)) + text + content[end:]
