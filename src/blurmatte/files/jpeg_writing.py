"""A JPEG of coefficients: sequential, in one scan, with the shortest Huffman codes [ITU-T T.81]."""

import struct

import numpy as np
import numpy.typing as npt

from blurmatte.files.jpeg import Jpeg
from blurmatte.files.jpeg_blocks import scan_order
from blurmatte.files.jpeg_huffman import Codes, Lengths, huffman_codes, table_bytes
from blurmatte.files.jpeg_segments import JpegError

_SOI, _EOI = b"\xff\xd8", b"\xff\xd9"
_MOST_IN_MCU = 10  # blocks [T.81 B.2.3]


def jpeg_bytes(jpeg: Jpeg) -> bytes:
    """The file of a JPEG. Its restart markers, and that it was progressive, are not kept.

    Raises
    ------
    JpegError
        If its coefficients or its sampling do not fit a sequential JPEG.
    """
    from blurmatte.files.jpeg_entropy import pack, tokenize

    if sum(c.across * c.down for c in jpeg.components) > _MOST_IN_MCU:
        raise JpegError("has sampling factors that are too large for one scan")
    order, slots = scan_order(jpeg.size, jpeg.components, range(len(jpeg.components)))
    blocks = jpeg.coefficients
    # Beside each coefficient that is not 0: the DC, three long runs of zeros, the end of the block.
    tokens = np.empty(np.count_nonzero(blocks) + 5 * len(blocks), np.uint32)
    counts = np.zeros((4, 256), np.int64)
    used = tokenize(blocks, order, slots, tokens, counts)
    if used < 0:
        raise JpegError("is damaged (a coefficient is too large)")
    codes, lengths, tables = _tables(counts)
    bits = int((counts * (lengths + np.arange(256) % 16)).sum())
    packed = np.empty(2 * (bits // 8 + 1), np.uint8)
    length = pack(tokens[:used], codes, lengths, packed)
    data = packed[:length].tobytes()
    head = b"".join(jpeg.kept) + _quantization_bytes(jpeg) + _frame_bytes(jpeg)
    return _SOI + head + _segment(0xC4, tables) + _scan_bytes(jpeg) + data + _EOI


def _tables(counts: npt.NDArray[np.int64]) -> tuple[Codes, Lengths, bytes]:
    """Code and length of every symbol of the four tables, and the segment that tells them."""
    codes, lengths = np.zeros((4, 256), np.uint32), np.zeros((4, 256), np.uint8)
    told = b""
    for i, name in enumerate((0x00, 0x01, 0x10, 0x11)):
        if counts[i].any():
            symbols, codes[i], lengths[i] = huffman_codes(counts[i])
            told += table_bytes(name, symbols, lengths[i])
    return codes, lengths, told


def _segment(marker: int, body: bytes) -> bytes:
    return struct.pack(">BBH", 0xFF, marker, len(body) + 2) + body


def _selectors(jpeg: Jpeg) -> list[int]:
    """Which table each component uses, where equal ones are written once."""
    tables = [table.tobytes() for table in jpeg.quantization]
    different = list(dict.fromkeys(tables))
    return [different.index(table) for table in tables]


def _quantization_bytes(jpeg: Jpeg) -> bytes:
    body = b""
    for name, table in dict(zip(_selectors(jpeg), jpeg.quantization, strict=True)).items():
        wide = int(table.max() > 255)
        body += bytes([wide << 4 | name]) + table.astype(">u2" if wide else "u1").tobytes()
    return _segment(0xDB, body)


def _frame_bytes(jpeg: Jpeg) -> bytes:
    width, height = jpeg.size
    body = struct.pack(">BHHB", 8, height, width, len(jpeg.components))
    for c, table in zip(jpeg.components, _selectors(jpeg), strict=True):
        body += bytes([c.number, c.across << 4 | c.down, table])
    wide = any(table.max() > 255 for table in jpeg.quantization)  # baseline has 8 bits
    return _segment(0xC1 if wide else 0xC0, body)


def _scan_bytes(jpeg: Jpeg) -> bytes:
    parts = [bytes([c.number, 0x11 if i else 0x00]) for i, c in enumerate(jpeg.components)]
    return _segment(0xDA, bytes([len(parts)]) + b"".join(parts) + b"\0\x3f\0")
