"""Equal blocks of rows of an EXR, compressed once.

An EXR with ZIP compression is a header, a table of offsets, and a chunk for every 16 rows. Most blocks
of a solution in a large picture have the same values throughout. A shorter EXR is written, with one of
these blocks, and its chunk is repeated. The result has the bytes of the whole picture's EXR.
"""

import struct
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

BLOCK_ROWS = 16  # in a chunk of ZIP compression
_TALL = (b"dataWindow", b"displayWindow")  # attributes that state the height: x0, y0, x1, y1


def distinct_blocks(parts: Sequence[npt.NDArray[Any]]) -> npt.NDArray[np.intp]:
    """(n,) for each block of rows, the position of an equal one among the blocks to be written.

    parts (H, W) or (H, W, n): channels. Only blocks of one value for each channel are compared.
    """
    bits = [part.view(f"u{part.dtype.itemsize}") for part in parts]  # -0 is not 0
    height, even = len(bits[0]), dict[bytes, int]()
    written, sources = 0, []
    for row in range(0, height, BLOCK_ROWS):
        block = slice(row, row + BLOCK_ROWS)
        source = written
        if row + BLOCK_ROWS <= height and all(np.all(b[block] == b[row, 0]) for b in bits):
            source = even.setdefault(b"".join(b[row, 0].tobytes() for b in bits), written)
        written += source == written
        sources.append(source)
    return np.array(sources)


def written_rows(sources: npt.NDArray[np.intp], height: int) -> npt.NDArray[np.intp]:
    """The rows of a picture that are in the blocks to be written."""
    first = np.unique(sources, return_index=True)[1]
    rows = (first[:, None] * BLOCK_ROWS + np.arange(BLOCK_ROWS)).ravel()
    return np.asarray(rows[rows < height])


def repeat_blocks(path: Path, sources: npt.NDArray[np.intp], height: int) -> None:
    """Replace an EXR of the blocks to be written by that of the whole picture."""
    content = memoryview(path.read_bytes())
    header, table = _taller(content, height)
    count = int(sources.max()) + 1
    offsets = struct.unpack_from(f"<{count}Q", content, table)
    chunks = []
    for offset in offsets:
        (size,) = struct.unpack_from("<i", content, offset + 4)
        chunks.append(
            content[offset + 4 : offset + 8 + size]
        )  # without the number of its first row
    sizes = np.array([4 + len(chunks[source]) for source in sources])
    places = len(header) + 8 * len(sources) + np.cumsum(sizes) - sizes
    with path.open("wb") as file:
        file.write(header)
        file.write(places.astype("<u8").tobytes())
        for block, source in enumerate(sources):
            file.write(struct.pack("<i", block * BLOCK_ROWS))
            file.write(chunks[source])


def _taller(content: memoryview, height: int) -> tuple[bytes, int]:
    """The header of an EXR with another height, and its length."""
    header, at = bytearray(content[:8]), 8  # magic number and version
    while content[at] != 0:
        (name, kind), start = _texts(content, at)
        (size,) = struct.unpack_from("<i", content, start)
        value = bytearray(content[start + 4 : start + 4 + size])
        if name in _TALL:
            struct.pack_into("<i", value, 12, height - 1)
        header += name + b"\0" + kind + b"\0" + struct.pack("<i", size) + value
        at = start + 4 + size
    return bytes(header + b"\0"), at + 1


def _texts(content: memoryview, at: int) -> tuple[tuple[bytes, bytes], int]:
    """Name and type of an attribute, and where its length is."""
    texts = bytes(content[at : at + 512]).split(b"\0", 2)  # both have at most 255 bytes
    return (texts[0], texts[1]), at + len(texts[0]) + len(texts[1]) + 2
