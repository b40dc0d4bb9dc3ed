"""Huffman tables of a JPEG: decoding tables and optimal codes [ITU-T T.81 annexes C and K.2]."""

import numpy as np
import numpy.typing as npt

from blurmatte.jpeg.coefficients import JpegError

_MAX_LENGTH = 16  # bits of a code


Codes = npt.NDArray[np.uint32]
Lengths = npt.NDArray[np.uint8]
Table = npt.NDArray[np.uint16]


def decoding_table(counts: bytes, symbols: bytes) -> Table:
    """(65536,) length · 256 + symbol, by the next 16 bits; 0 for an invalid code [T.81 annex C]."""
    lengths = np.repeat(np.arange(1, _MAX_LENGTH + 1), list(counts.ljust(_MAX_LENGTH, b"\0")))
    spans = 1 << (_MAX_LENGTH - lengths)
    if len(symbols) != len(lengths) or spans.sum() > 1 << _MAX_LENGTH:
        raise JpegError("a Huffman table of the JPEG is inconsistent")
    entries = (lengths << 8 | np.frombuffer(symbols, np.uint8)).astype(np.uint16)
    table = np.zeros(1 << _MAX_LENGTH, np.uint16)
    table[: spans.sum()] = np.repeat(entries, spans)
    return table


def huffman_codes(counts: npt.NDArray[np.int64]) -> tuple[bytes, Codes, Lengths]:
    """Optimal codes of at most 16 bits for symbols with the given frequencies.

    At least one of the frequencies (256,) is positive. Returns the symbols in the order of their
    code lengths; code and length of each symbol, (256,), 0 for those that do not occur.
    """
    sizes = _unlimited_lengths(counts)
    per_length = _limited_lengths(np.bincount([size for size in sizes if size]))
    symbols = sorted((s for s in range(256) if sizes[s]), key=lambda s: (sizes[s], s))
    codes, lengths = np.zeros(256, np.uint32), np.zeros(256, np.uint8)
    code, remaining = 0, iter(symbols)
    for length in range(1, _MAX_LENGTH + 1):
        for _ in range(per_length[length]):
            symbol = next(remaining)
            codes[symbol], lengths[symbol] = code, length
            code += 1
        code <<= 1
    return bytes(symbols), codes, lengths


def table_bytes(name: int, symbols: bytes, lengths: Lengths) -> bytes:
    """A table as stored in a DHT segment: identifier, number of codes per length, symbols."""
    per_length = np.bincount(lengths[list(symbols)], minlength=_MAX_LENGTH + 1)
    return bytes([name, *per_length[1:].tolist()]) + symbols


def _unlimited_lengths(counts: npt.NDArray[np.int64]) -> list[int]:
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


def _limited_lengths(per_length: npt.NDArray[np.int64]) -> list[int]:
    """Number of codes of each length up to 16 bits, without the reserved one [K.2, Adjust_BITS]."""
    bits: list[int] = per_length.tolist() + [0] * (_MAX_LENGTH + 1)
    for length in range(len(per_length) - 1, _MAX_LENGTH, -1):
        while bits[length]:
            shorter = length - 2
            while not bits[shorter]:
                shorter -= 1
            bits[length] -= 2  # a pair becomes one code that is one bit shorter …
            bits[length - 1] += 1
            bits[shorter + 1] += 2  # … and a shorter code is split into two for the other
            bits[shorter] -= 1
    longest = max(length for length in range(1, _MAX_LENGTH + 1) if bits[length])
    bits[longest] -= 1
    return bits[: _MAX_LENGTH + 1]
