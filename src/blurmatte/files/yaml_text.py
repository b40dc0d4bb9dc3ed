"""The part of YAML in which programs write calibrations: mappings, lists and scalars.

Mappings and lists nest by indentation, and lists also in brackets, which may span lines. Tags such as
`!!opencv-matrix` are skipped. Anchors, mappings in braces and texts of several lines are refused.
"""

import re
from contextlib import suppress
from typing import Any

MAX_DEPTH = 16  # of nested mappings and lists; calibrations have 4

_KEY = re.compile(r"""(?:"([^"]*)"|'([^']*)'|([^\s\[\]{},"'#&*!|>%@`-][^:#]*?))\s*:(?:\s+|$)""")
_TAG = re.compile(r"!\S*\s*")
_WORDS = {"true": True, "false": False, "null": None, "~": None, "": None}

_Line = tuple[int, str]  # spaces before a line, and its text


def parse_yaml(text: str) -> Any:
    """Mappings, lists, numbers, texts, true, false and null; ValueError for anything else."""
    lines = _lines(text)
    if not lines:
        return None
    value, end = _block(lines, 0, 0)
    if end < len(lines):
        raise ValueError(f"the line {lines[end][1][:40]!r} is indented in an unexpected way")
    return value


def _lines(text: str) -> list[_Line]:
    """Lines with content, without comments; those of a list in brackets are joined."""
    found: list[_Line] = []
    for number, raw in enumerate(text.expandtabs(1).splitlines()):
        line = re.sub(r"(^|\s)#.*", "", raw).rstrip()
        if not line or line in ("---", "...") or (number == 0 and line.startswith("%YAML")):
            continue
        if found and found[-1][1].count("[") > found[-1][1].count("]"):
            found[-1] = found[-1][0], f"{found[-1][1]} {line.strip()}"
        else:
            found.append((len(line) - len(line.lstrip()), line.strip()))
    return found


def _block(lines: list[_Line], at: int, depth: int) -> tuple[Any, int]:
    """The mapping, list or scalar that begins with a line, and the number of the line behind it."""
    if depth > MAX_DEPTH:
        raise ValueError(f"it is nested more than {MAX_DEPTH} deep")
    margin, text = lines[at]
    if text == "-" or text.startswith("- "):
        return _list(lines, at, margin, depth)
    if _KEY.match(text) is None:
        return _scalar(text), at + 1
    found: dict[str, Any] = {}
    while at < len(lines) and lines[at][0] == margin:
        match = _KEY.match(lines[at][1])
        if match is None:
            break
        key = next(group for group in match.groups() if group is not None)
        if key in found:
            raise ValueError(f"it has the key {key} twice")
        rest = _TAG.sub("", lines[at][1][match.end() :], count=1).strip()
        at += 1
        nested = at < len(lines) and (
            lines[at][0] > margin or (lines[at][0] == margin and lines[at][1].startswith("- "))
        )
        if rest or not nested:
            found[key] = _scalar(rest)
        else:
            found[key], at = _block(lines, at, depth + 1)
    return found, at


def _list(lines: list[_Line], at: int, margin: int, depth: int) -> tuple[list[Any], int]:
    found = []
    while at < len(lines) and lines[at][0] == margin and lines[at][1].startswith("-"):
        text = lines[at][1][1:]
        inner = [(margin + 1 + len(text) - len(text.lstrip()), text.strip())]
        at += 1
        while at < len(lines) and lines[at][0] > margin:
            inner.append(lines[at])
            at += 1
        value, end = _block(inner, 0, depth + 1)
        if end < len(inner):
            raise ValueError(f"the line {inner[end][1][:40]!r} is indented in an unexpected way")
        found.append(value)
    return found, at


def _scalar(text: str) -> Any:
    """A list in brackets, a number, a word or a text."""
    if text.startswith("["):
        value, rest = _bracketed(text, 0)
        if rest:
            raise ValueError(f"{text[-40:]!r} does not end with its bracket")
        return value
    if text[:1] in ("{", "&", "*", "|", ">", "!", "%", "@", "`"):
        raise ValueError(f"{text[:40]!r} is a kind of YAML that is not supported")
    if len(text) > 1 and text[0] == text[-1] and text[0] in "\"'":
        return text[1:-1]
    if text.lower() in _WORDS:
        return _WORDS[text.lower()]
    for kind in (int, float):
        with suppress(ValueError):
            return kind(text.removeprefix("+").replace(".inf", "inf").replace(".nan", "nan"))
    return text


def _bracketed(text: str, depth: int) -> tuple[list[Any], str]:
    """The list that a text begins with, and the text behind it."""
    if depth > MAX_DEPTH:
        raise ValueError(f"it is nested more than {MAX_DEPTH} deep")
    found: list[Any] = []
    rest = text[1:].lstrip()
    while rest and not rest.startswith("]"):
        if rest.startswith("["):
            value, rest = _bracketed(rest, depth + 1)
        else:
            part = re.split(r"[,\]]", rest, maxsplit=1)[0]
            value, rest = _scalar(part.strip()), rest[len(part) :]
        found.append(value)
        rest = rest.lstrip().removeprefix(",").lstrip()
    if not rest:
        raise ValueError(f"{text[:40]!r} has no closing bracket")
    return found, rest[1:].strip()
