"""JPEG files to coefficients, and back to a sequential JPEG with one scan [ITU-T T.81].

Blocks can be replaced by newly compressed pixels; all other blocks keep their coefficients.
"""

import io
import re
import struct
from dataclasses import replace

import numpy as np

from blurmatte.checks import Bools, Codes8, Codes32, Ints16, Ints64, box_of
from blurmatte.jpeg import entropy
from blurmatte.jpeg.structure import (
    MAX_CODE_BITS,
    ZIGZAG,
    Jpeg,
    JpegError,
    Marker,
    Scan,
    Segments,
    stored_segment,
)
from blurmatte.radiometry.compression import Compression
from blurmatte.radiometry.sensor import Orientation

_UPRIGHT = Orientation()
# In coded data a byte 0xFF is followed by a zero; any number of them may precede a marker.
_STUFFED, _MARKER = re.compile(rb"\xff+\0"), re.compile(rb"\xff([^\0\xff])")
# Sampling factors of all components to Pillow's `subsampling`.
_PILLOW_SUBSAMPLING = {
    ((1, 1),): 0,
    ((1, 1),) * 3: 0,
    ((2, 1), (1, 1), (1, 1)): 1,
    ((2, 2), (1, 1), (1, 1)): 2,
}


def read_jpeg(data: bytes, max_pixels: int | None = None) -> Jpeg:
    """Read the coefficients of a JPEG.

    Bytes after the end of the picture are ignored. Pictures of more than `max_pixels` are rejected
    before memory is allocated. Raises JpegError if the file is damaged or not supported.
    """
    if data[:2] != bytes([0xFF, Marker.SOI]):
        raise JpegError("the file is no JPEG")
    segments = Segments(data)
    coefficients: Ints16 | None = None
    at = 2
    while scan := segments.next_scan(at):
        if coefficients is None:
            width, height = segments.size
            if max_pixels is not None and width * height > max_pixels:
                raise JpegError(f"the JPEG has {width} x {height} pixels, more than {max_pixels}")
            count = sum(n.size for n in segments.block_numbers())
            coefficients = np.zeros((count, 64), np.int16)
        at = _decode(segments, scan, coefficients)
    segments.check_complete()
    if coefficients is None:
        raise JpegError("the JPEG is damaged (it has no picture)")
    tables = tuple(segments.quantization[i] for i in range(len(segments.components)))
    return Jpeg(tuple(segments.metadata), segments.size, segments.components, tables, coefficients)


def compression_of(data: bytes, orientation: Orientation = _UPRIGHT) -> Compression | None:
    """The quantization and chroma subsampling of a JPEG file, as of the upright picture.

    None for gray pictures, for RGB channels, for chroma subsampled by more than 2 x 2, and for
    quantization steps beyond 8 bits.
    """
    try:
        segments = Segments(data)
        segments.next_scan(2)
        tables = [segments.quantization[i][np.argsort(ZIGZAG)] for i in range(2)]
    except (JpegError, KeyError):
        return None
    sampling = segments.sampling
    if set(sampling[1:]) != {(1, 1)} or segments.is_rgb:
        return None
    if not set(sampling[0]) <= {1, 2} or np.max(tables) > 255:
        return None
    luma, chroma = (tuple(map(tuple, table.reshape(8, 8).tolist())) for table in tables)
    return _upright(Compression(luma, chroma, sampling[0]), segments.size, orientation)


def _upright(stored: Compression, size: tuple[int, int], orientation: Orientation) -> Compression:
    """The compression of the picture after rotation to its orientation."""
    if orientation.transposed:
        stored, size = stored.transposed(), size[::-1]
    if orientation.left_right:
        stored = stored.mirrored(size[0])
    if orientation.upside_down:
        stored = stored.transposed().mirrored(size[1]).transposed()
    return stored


def _decode(segments: Segments, scan: Scan, out: Ints16) -> int:
    """Decode a scan into the blocks `out`; return the offset of the next marker."""
    order, slots = segments.scan_order(scan.components)
    interval = scan.interval or len(order)
    parts, end = _intervals(segments.data, scan.start, -(-len(order) // interval))
    bits = np.frombuffer(b"".join(parts) + bytes(entropy.PADDING_BYTES), np.uint8)
    bounds = np.cumsum([0, *map(len, parts)])
    invalid = np.zeros(1 << 16, np.uint16)
    dc, ac = (
        np.stack([table if len(table) else invalid for table in tables])
        for tables in (scan.dc, scan.ac)
    )
    if not segments.progressive:
        mode = entropy.SEQUENTIAL
    elif scan.band[0] == 0:
        mode = entropy.DC_REFINED if scan.high else entropy.DC_FIRST
    else:
        mode = entropy.AC_REFINED if scan.high else entropy.AC_FIRST
    band = (*scan.band, scan.low)
    if not entropy.decode_scan(bits, bounds, interval, order, slots, mode, dc, ac, band, out):
        raise JpegError("the JPEG is damaged or truncated")
    return end


def _intervals(data: bytes, start: int, count: int) -> tuple[list[bytes], int]:
    """The restart intervals of a scan without stuffed zeros, and the offset of the next marker."""
    parts: list[bytes] = []
    for marker in _MARKER.finditer(data, start):
        parts.append(_STUFFED.sub(b"\xff", data[start : marker.start()].rstrip(b"\xff")))
        start, number = marker.end(), marker[1][0] - Marker.RST0
        last = not 0 <= number < 8
        if last != (len(parts) == count) or not (last or number == (len(parts) - 1) % 8):
            raise JpegError("the JPEG is damaged (a restart marker is out of order)")
        if last:
            return parts, marker.start()
    raise JpegError("the JPEG is truncated")


def jpeg_bytes(jpeg: Jpeg) -> bytes:
    """The file of a JPEG: sequential, without restart markers.

    Raises JpegError if the coefficients or the chroma sampling do not fit a sequential JPEG.
    """
    if sum(across * down for across, down in jpeg.sampling) > 10:  # blocks per MCU [T.81 B.2.3]
        raise JpegError("the sampling factors of the JPEG are too large for one scan")
    order, slots = jpeg.scan_order(range(len(jpeg.components)))
    blocks = jpeg.coefficients
    # Besides nonzero coefficients, a block has at most: DC, three long zero runs, end of block.
    tokens = np.empty(np.count_nonzero(blocks) + 5 * len(blocks), np.uint32)
    counts = np.zeros((4, 256), np.int64)
    used = entropy.tokenize(blocks, order, slots, tokens, counts)
    if used < 0:
        raise JpegError("the JPEG is damaged (a coefficient is too large)")
    codes, lengths, tables = _huffman_tables(counts)
    bits = int((counts * (lengths + np.arange(256) % 16)).sum())
    packed = np.empty(-(-bits // 8), np.uint8)
    entropy.pack(tokens[:used], codes, lengths, packed)
    return b"".join(
        [
            struct.pack(">BB", 0xFF, Marker.SOI),
            *jpeg.metadata,
            _quantization_segment(jpeg),
            _frame_segment(jpeg),
            stored_segment(Marker.DHT, tables),
            _scan_segment(jpeg),
            packed.tobytes().replace(b"\xff", b"\xff\0"),
            struct.pack(">BB", 0xFF, Marker.EOI),
        ]
    )


def _huffman_tables(counts: Ints64) -> tuple[Codes32, Codes8, bytes]:
    """(4, 256) code and length of every symbol, and the body of the DHT segment."""
    codes, lengths = np.zeros((4, 256), np.uint32), np.zeros((4, 256), np.uint8)
    body = b""
    for i, name in enumerate((0x00, 0x01, 0x10, 0x11)):
        if counts[i].any():
            symbols, codes[i], lengths[i] = huffman_codes(counts[i])
            body += table_bytes(name, symbols, lengths[i])
    return codes, lengths, body


def _table_indices(jpeg: Jpeg) -> list[int]:
    """The quantization table of each component; equal tables are written once."""
    tables = [table.tobytes() for table in jpeg.quantization]
    different = list(dict.fromkeys(tables))
    return [different.index(table) for table in tables]


def _quantization_segment(jpeg: Jpeg) -> bytes:
    body = b""
    for name, table in dict(zip(_table_indices(jpeg), jpeg.quantization, strict=True)).items():
        wide = int(table.max() > 255)
        body += bytes([wide << 4 | name]) + table.astype(">u2" if wide else "u1").tobytes()
    return stored_segment(Marker.DQT, body)


def _frame_segment(jpeg: Jpeg) -> bytes:
    width, height = jpeg.size
    body = struct.pack(">BHHB", 8, height, width, len(jpeg.components))
    for c, table in zip(jpeg.components, _table_indices(jpeg), strict=True):
        body += bytes([c.number, c.across << 4 | c.down, table])
    wide = any(table.max() > 255 for table in jpeg.quantization)  # baseline has 8-bit tables only
    return stored_segment(Marker.SOF1 if wide else Marker.SOF0, body)


def _scan_segment(jpeg: Jpeg) -> bytes:
    parts = [bytes([c.number, 0x11 if i else 0x00]) for i, c in enumerate(jpeg.components)]
    return stored_segment(Marker.SOS, bytes([len(parts)]) + b"".join(parts) + b"\0\x3f\0")


def huffman_codes(counts: Ints64) -> tuple[bytes, Codes32, Codes8]:
    """Optimal codes of at most 16 bits for symbols with the given frequencies.

    At least one of the frequencies (256,) is positive. Returns the symbols in the order of their
    code lengths; code and length of each symbol, (256,), 0 for those that do not occur.
    """
    sizes = _unlimited_lengths(counts)
    per_length = _limited_lengths(np.bincount([size for size in sizes if size]))
    symbols = sorted((s for s in range(256) if sizes[s]), key=lambda s: (sizes[s], s))
    codes, lengths = np.zeros(256, np.uint32), np.zeros(256, np.uint8)
    code, remaining = 0, iter(symbols)
    for length in range(1, MAX_CODE_BITS + 1):
        for _ in range(per_length[length]):
            symbol = next(remaining)
            codes[symbol], lengths[symbol] = code, length
            code += 1
        code <<= 1
    return bytes(symbols), codes, lengths


def table_bytes(name: int, symbols: bytes, lengths: Codes8) -> bytes:
    """A table as stored in a DHT segment: identifier, number of codes per length, symbols."""
    per_length = np.bincount(lengths[list(symbols)], minlength=MAX_CODE_BITS + 1)
    return bytes([name, *per_length[1:].tolist()]) + symbols


def _unlimited_lengths(counts: Ints64) -> list[int]:
    """Code lengths of all symbols and the reserved one, without a limit [K.2, Code_size]."""
    reserved = len(counts)  # a pseudo-symbol that gets the code of all ones, which T.81 forbids
    weights = {symbol: int(n) for symbol, n in enumerate(counts) if n} | {reserved: 1}
    groups = {symbol: [symbol] for symbol in weights}
    sizes = [0] * (reserved + 1)
    while len(weights) > 1:
        # Ties go to the larger symbol, so that the reserved symbol gets a longest code.
        first, second = sorted(weights, key=lambda symbol: (weights[symbol], -symbol))[:2]
        weights[second] += weights.pop(first)
        groups[second] += groups.pop(first)
        for symbol in groups[second]:
            sizes[symbol] += 1
    return sizes


def _limited_lengths(per_length: Ints64) -> list[int]:
    """Number of codes of each length up to 16 bits, without the reserved one [K.2, Adjust_BITS]."""
    bits: list[int] = per_length.tolist() + [0] * (MAX_CODE_BITS + 1)
    for length in range(len(per_length) - 1, MAX_CODE_BITS, -1):
        while bits[length]:
            shorter = length - 2
            while not bits[shorter]:
                shorter -= 1
            bits[length] -= 2  # a pair becomes one code that is one bit shorter …
            bits[length - 1] += 1
            bits[shorter + 1] += 2  # … and a shorter code is split into two for the other
            bits[shorter] -= 1
    longest = max(length for length in range(1, MAX_CODE_BITS + 1) if bits[length])
    bits[longest] -= 1
    return bits[: MAX_CODE_BITS + 1]


def replace_blocks(jpeg: Jpeg, codes: Codes8, changed: Bools) -> Jpeg:
    """Compress the MCUs that contain a changed pixel; all others keep their coefficients.

    codes (H, W, 3) or (H, W) uint8: the whole picture as stored (not rotated), R'G'B' or gray like
        `jpeg`. Unchanged pixels of an MCU with a changed pixel are compressed as well.
    changed (H, W).

    Raises JpegError if Pillow cannot compress with the sampling or the tables of `jpeg`.
    """
    if not changed.any():
        return jpeg
    if jpeg.sampling not in _PILLOW_SUBSAMPLING or jpeg.is_rgb:
        raise JpegError("the chroma sampling of the JPEG is not supported")
    affected = _affected_mcus(jpeg, changed)
    left, top, right, bottom = box_of(affected)
    width, height = jpeg.mcu
    new = _compress(jpeg, codes[top * height : bottom * height, left * width : right * width])
    result = replace(jpeg, coefficients=jpeg.coefficients.copy())
    for index, c in enumerate(jpeg.components):
        mask = affected[top:bottom, left:right].repeat(c.down, axis=0).repeat(c.across, axis=1)
        target = result.blocks(index)[c.down * top :, c.across * left :]
        target[: mask.shape[0], : mask.shape[1]][mask] = new.blocks(index)[mask]
    return result


def _affected_mcus(jpeg: Jpeg, changed: Bools) -> Bools:
    """(rows, columns) of MCUs: True where one contains a changed pixel."""
    width, height = jpeg.mcu
    rows, columns = changed.shape
    full = np.pad(changed, ((0, -rows % height), (0, -columns % width)))
    cut = full.reshape(-(-rows // height), height, -(-columns // width), width)
    return np.asarray(cut.any(axis=(1, 3)))


def _compress(jpeg: Jpeg, codes: Codes8) -> Jpeg:
    """Compress pixels by Pillow with the tables and the sampling of a JPEG."""
    from PIL import Image

    natural = [np.zeros(64, int) for _ in jpeg.components]
    for table, zigzag in zip(natural, jpeg.quantization, strict=True):
        table[ZIGZAG] = zigzag
    file = io.BytesIO()
    Image.fromarray(np.ascontiguousarray(codes)).save(
        file,
        "JPEG",
        qtables=[table.tolist() for table in natural],
        subsampling=_PILLOW_SUBSAMPLING[jpeg.sampling],
    )
    new = read_jpeg(file.getvalue())
    same = all(map(np.array_equal, new.quantization, jpeg.quantization))
    if not same or new.sampling != jpeg.sampling:
        raise JpegError("the quantization tables of the JPEG are not supported")
    return new
