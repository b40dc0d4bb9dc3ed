"""Stacks of named maps as TIFF of 32-bit floats, as ImageJ opens them.

All pages are stored one after another, uncompressed, so that ImageJ need not read the directories.
Names of slices are in its own tags, which OpenImageIO cannot write: a count of bytes for each part
(50838), and the parts (50839), which begin with the kinds of what follows [ImageJ, ij.io.TiffEncoder].
"""

import struct
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from blurmatte.errors import FileError

_SHORT, _LONG, _ASCII, _BYTE = 3, 4, 2, 1  # types of TIFF
_MOST_BYTES = 2**32 - 2**20  # offsets of TIFF have 32 bits
_ROWS = 256  # that are converted at a time


def save_stack(path: Path, maps: Mapping[str, npt.NDArray[Any]], about: str) -> None:
    """Write maps (H, W) of one size as slices, each with its name; a text describes all.

    Raises FileError if they need more than 4 GB, which a TIFF cannot hold.
    """
    height, width = next(iter(maps.values())).shape
    size = 4 * height * width
    if size * len(maps) > _MOST_BYTES:
        raise FileError(
            f"{path}: write .exr; {len(maps)} maps of {width}x{height} need more than 4 GB"
        )
    said = f"ImageJ=1.54f\nimages={len(maps)}\nslices={len(maps)}\nunit=pixel\nmin=0.0\nmax=1.0\n"
    description, (counts, parts) = said.encode() + b"\0", _labels(list(maps), about)
    at = {"description": 8, "counts": 8 + len(description) + len(description) % 2}
    at["parts"] = at["counts"] + len(counts)
    data = at["parts"] + len(parts) + len(parts) % 2
    with path.open("wb") as file:
        file.write(struct.pack("<2sHI", b"II", 42, data + size * len(maps)))
        for start, block in zip(at.values(), (description, counts, parts), strict=True):
            file.write(bytes(start - file.tell()) + block)
        file.write(bytes(data - file.tell()))
        for one in maps.values():
            for first in range(0, height, _ROWS):
                file.write(np.ascontiguousarray(one[first : first + _ROWS], "<f4").tobytes())
        for k in range(len(maps)):
            entries = _page(width, height, data + k * size)
            if k == 0:
                entries += [
                    (270, _ASCII, len(description), at["description"]),
                    (50838, _LONG, len(counts) // 4, at["counts"]),
                    (50839, _BYTE, len(parts), at["parts"]),
                ]
            directory = b"".join(struct.pack("<HHII", *entry) for entry in sorted(entries))
            after = 0 if k == len(maps) - 1 else file.tell() + 2 + len(directory) + 4
            file.write(struct.pack("<H", len(entries)) + directory + struct.pack("<I", after))


def _page(width: int, height: int, offset: int) -> list[tuple[int, int, int, int]]:
    """Tag, type, count and value of the entries of a page of floats in one strip."""
    size = 4 * width * height
    numbers = {256: width, 257: height, 273: offset, 278: height, 279: size}
    codes = {
        258: 32,
        259: 1,
        262: 1,
        277: 1,
        339: 3,
    }  # bits, uncompressed, gray, one channel, float
    return [
        *((tag, _LONG, 1, value) for tag, value in numbers.items()),
        *((tag, _SHORT, 1, value) for tag, value in codes.items()),
    ]


def _labels(names: list[str], about: str) -> tuple[bytes, bytes]:
    """The values of ImageJ's tags for a text about all slices, and the names of the slices."""
    header = b"IJIJ"[::-1] + struct.pack("<4sI4sI", b"ofni", 1, b"lbal", len(names))
    texts = [text.encode("utf-16-le") for text in (about, *names)]
    counts = [len(header), *map(len, texts)]
    return struct.pack(f"<{len(counts)}I", *counts), header + b"".join(texts)
