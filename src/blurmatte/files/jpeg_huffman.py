"""The shortest Huffman codes for the symbols of a JPEG [ITU-T T.81 annexes C and K.2]."""

import numpy as np
import numpy.typing as npt

_LONGEST = 16
_RESERVED = 256  # a symbol that never comes: no code may be all ones

Codes = npt.NDArray[np.uint32]
Lengths = npt.NDArray[np.uint8]


def huffman_codes(counts: npt.NDArray[np.int64]) -> tuple[bytes, Codes, Lengths]:
    """The codes of symbols that come so often, at most 16 bits long.

    Parameters
    ----------
    counts : (256,) int
        At least one is not zero.

    Returns
    -------
    tuple of bytes, (256,) uint32 and (256,) uint8
        The symbols from the shortest code to the longest; code and length of each, 0 for those that
        do not come.
    """
    sizes = _sizes(counts)
    per_length = _limited(np.bincount([size for size in sizes if size]))
    symbols = sorted((s for s in range(256) if sizes[s]), key=lambda s: (sizes[s], s))
    codes, lengths = np.zeros(256, np.uint32), np.zeros(256, np.uint8)
    code, rest = 0, iter(symbols)
    for length in range(1, _LONGEST + 1):
        for _ in range(per_length[length]):
            symbol = next(rest)
            codes[symbol], lengths[symbol] = code, length
            code += 1
        code <<= 1
    return bytes(symbols), codes, lengths


def table_bytes(name: int, symbols: bytes, lengths: Lengths) -> bytes:
    """A table as a DHT segment holds it: its name, how many codes there are of each length, symbols."""
    per_length = np.bincount(lengths[list(symbols)], minlength=_LONGEST + 1)
    return bytes([name, *per_length[1:].tolist()]) + symbols


def _sizes(counts: npt.NDArray[np.int64]) -> list[int]:
    """Lengths of the codes of all symbols and the reserved one, unlimited [K.2, Code_size]."""
    weights = {symbol: int(n) for symbol, n in enumerate(counts) if n} | {_RESERVED: 1}
    groups = {symbol: [symbol] for symbol in weights}
    sizes = [0] * (_RESERVED + 1)
    while len(weights) > 1:
        # The rarest, and of equal ones the last, so that the reserved symbol gets a longest code.
        first, second = sorted(weights, key=lambda symbol: (weights[symbol], -symbol))[:2]
        weights[second] += weights.pop(first)
        groups[second] += groups.pop(first)
        for symbol in groups[second]:
            sizes[symbol] += 1
    return sizes


def _limited(per_length: npt.NDArray[np.int64]) -> list[int]:
    """How many codes have each length, none beyond 16 bits [K.2, Adjust_BITS].

    The reserved symbol, one of the longest codes, is gone.
    """
    bits: list[int] = per_length.tolist() + [0] * (_LONGEST + 1)
    for length in range(len(per_length) - 1, _LONGEST, -1):
        while bits[length]:
            shorter = length - 2
            while not bits[shorter]:
                shorter -= 1
            bits[length] -= 2  # a pair becomes one code a bit shorter …
            bits[length - 1] += 1
            bits[shorter + 1] += 2  # … and one of a shorter length makes room for the other
            bits[shorter] -= 1
    longest = max(length for length in range(1, _LONGEST + 1) if bits[length])
    bits[longest] -= 1
    return bits[: _LONGEST + 1]
