"""Entropy coding of JPEG scans, compiled by Numba [ITU-T T.81 annexes F and G].

`at` is a bit offset into `bits`, the scan data without stuffed zeros and markers; -1 marks invalid
data. A block is 64 coefficients in zigzag order. `order` (units, n) holds the block indices of each
coded unit of a scan (an MCU, or one block), and `slots` (n,) the component of each block. A block
takes less than `PADDING_BYTES`, so one check of `at` after each block keeps all reads in bounds.
"""

import numpy as np

from blurmatte.compiling import njit

PADDING_BYTES = 1024  # at least 64 codes of 16 bits with 16 additional bits each: 256 bytes
SEQUENTIAL, DC_FIRST, DC_REFINED, AC_FIRST, AC_REFINED = range(5)
_MAX_DC = 1 << 14  # keeps DC differences within 15 bits; 8-bit pixels need 11
_RUN = 4  # index in `state` of the remaining end-of-band run, after the DC values of four slots


@njit(inline="always")
def _next16(bits, at):  # type: ignore[no-untyped-def]
    i = at >> 3
    window = (np.int64(bits[i]) << 16) | (np.int64(bits[i + 1]) << 8) | np.int64(bits[i + 2])
    return (window >> (8 - (at & 7))) & 0xFFFF


@njit(inline="always")
def _number(bits, at, size):  # type: ignore[no-untyped-def]
    """The signed value of the next `size` bits [T.81 F.2.2.1]."""
    value = _next16(bits, at) >> (16 - size)
    return value if size == 0 or value >> (size - 1) else value - (1 << size) + 1


@njit(inline="always")
def _difference(bits, at, table, state, slot):  # type: ignore[no-untyped-def]
    """Decode a DC difference and add it to the DC value of the component."""
    entry = np.int64(table[_next16(bits, at)])
    size = entry & 255
    if entry == 0 or size > 15:
        return np.int64(-1)
    at += entry >> 8
    state[slot] += _number(bits, at, size)
    return at + size if abs(state[slot]) < _MAX_DC else np.int64(-1)


@njit(inline="always")
def _ac_first(bits, at, table, block, state, first, last, low):  # type: ignore[no-untyped-def]
    """Decode coefficients first…last of a block, first pass; `low` is 0 in sequential scans."""
    if state[_RUN] > 0:
        state[_RUN] -= 1
        return at
    k = first
    while k <= last:
        entry = np.int64(table[_next16(bits, at)])
        if entry == 0:
            return np.int64(-1)
        at += entry >> 8
        run, size = (entry >> 4) & 15, entry & 15
        if size == 0:
            if run < 15:
                state[_RUN] = (1 << run) - 1 + (_next16(bits, at) >> (16 - run))
                return at + run
            k += 16
            continue
        k += run
        if k > last or size + low > 15:
            return np.int64(-1)
        block[k] = _number(bits, at, size) << low
        at, k = at + size, k + 1
    return at


@njit(inline="always")
def _refine(bits, at, block, k, bit):  # type: ignore[no-untyped-def]
    """Decode one correction bit of a nonzero coefficient."""
    if _next16(bits, at) >> 15:
        block[k] += bit if block[k] > 0 else -bit
    return at + 1


@njit()
def _ac_refined(bits, at, table, block, state, first, last, low):  # type: ignore[no-untyped-def]
    """Decode one more bit of the coefficients first…last of a block [T.81 G.1.2.3]."""
    bit = 1 << low
    k = first
    while k <= last and state[_RUN] == 0:
        entry = np.int64(table[_next16(bits, at)])
        run, size = (entry >> 4) & 15, entry & 15
        if entry == 0 or size > 1:
            return np.int64(-1)
        at += entry >> 8
        value = 0
        if size == 1:
            value = bit if _next16(bits, at) >> 15 else -bit
            at += 1
        elif run < 15:
            state[_RUN] = (1 << run) + (_next16(bits, at) >> (16 - run))
            at += run
            break
        while k <= last:  # skip `run` zeros, and refine the nonzero coefficients among them
            if block[k] != 0:
                at = _refine(bits, at, block, k, bit)
            elif run == 0:
                break
            else:
                run -= 1
            k += 1
        if value != 0:
            if k > last:
                return np.int64(-1)
            block[k] = value
        k += 1
    if state[_RUN] > 0:
        while k <= last:
            if block[k] != 0:
                at = _refine(bits, at, block, k, bit)
            k += 1
        state[_RUN] -= 1
    return at


@njit()
def _block(bits, at, mode, dc, ac, block, state, slot, band):  # type: ignore[no-untyped-def]
    first, last, low = band
    if mode == SEQUENTIAL:
        at = _difference(bits, at, dc, state, slot)
        if at < 0:
            return at
        block[0] = state[slot]
        at = _ac_first(bits, at, ac, block, state, 1, last, 0)
        state[_RUN] = 0
        return at
    if mode == DC_FIRST:
        at = _difference(bits, at, dc, state, slot)
        if abs(state[slot]) << low >= _MAX_DC:
            return np.int64(-1)
        block[0] = state[slot] << low
        return at
    if mode == DC_REFINED:
        block[0] |= (_next16(bits, at) >> 15) << low
        return at + 1
    if mode == AC_FIRST:
        return _ac_first(bits, at, ac, block, state, first, last, low)
    return _ac_refined(bits, at, ac, block, state, first, last, low)


@njit()
def decode_scan(bits, bounds, interval, order, slots, mode, dc, ac, band, out):  # type: ignore[no-untyped-def]
    """Decode a scan into the blocks `out` (n, 64); return False if the data are invalid.

    `band` is the first and the last coefficient, and the lowest bit in the scan.
    """
    state = np.zeros(_RUN + 1, np.int64)
    for part in range(bounds.shape[0] - 1):
        state[:] = 0
        at, limit = np.int64(8 * bounds[part]), 8 * bounds[part + 1]
        for unit in range(part * interval, min((part + 1) * interval, order.shape[0])):
            for j in range(slots.shape[0]):
                slot = slots[j]
                block = out[order[unit, j]]
                at = _block(bits, at, mode, dc[slot], ac[slot], block, state, slot, band)
                if at < 0 or at > limit:
                    return False
    return True


@njit(inline="always")
def _size(value):  # type: ignore[no-untyped-def]
    """Number of bits of a coefficient's magnitude."""
    size, rest = 0, abs(value)
    while rest:
        size += 1
        rest >>= 1
    return size


@njit(inline="always")
def _token(table, symbol, value, size, counts):  # type: ignore[no-untyped-def]
    """Pack table, symbol and additional bits into one number; count the symbol."""
    counts[table, symbol] += 1
    more = value if value >= 0 else value + (1 << size) - 1
    return np.uint32((table << 24) | (symbol << 16) | more)


@njit()
def tokenize(blocks, order, slots, tokens, counts):  # type: ignore[no-untyped-def]
    """Write the tokens of a sequential scan and count its symbols; return the number of tokens.

    Tables 0 and 2 code DC and AC of the first component, 1 and 3 those of the others. Returns -1 if
    a coefficient is too large.
    """
    before = np.zeros(4, np.int64)
    n, run = 0, 0
    for unit in range(order.shape[0]):
        for j in range(slots.shape[0]):
            slot = slots[j]
            table = 1 if slot else 0
            block = blocks[order[unit, j]]
            value = np.int64(block[0]) - before[slot]
            before[slot] += value
            size = _size(value)
            if size > 15:
                return -1
            tokens[n] = _token(table, size, value, size, counts)
            n, run = n + 1, 0
            for k in range(1, 64):
                value = np.int64(block[k])
                if value == 0:
                    run += 1
                    continue
                while run > 15:
                    tokens[n] = _token(table + 2, 0xF0, 0, 0, counts)
                    n, run = n + 1, run - 16
                size = _size(value)
                if size > 15:
                    return -1
                tokens[n] = _token(table + 2, run << 4 | size, value, size, counts)
                n, run = n + 1, 0
            if run:
                tokens[n] = _token(table + 2, 0, 0, 0, counts)
                n += 1
    return n


@njit()
def pack(tokens, codes, lengths, out):  # type: ignore[no-untyped-def]
    """Write the tokens' Huffman codes and additional bits to `out`, which they fill.

    The last byte is padded with ones.
    """
    held, count, n = np.uint64(0), np.int64(0), 0
    for i in range(tokens.shape[0]):
        token = tokens[i]
        table, symbol = np.int64(token >> 24), np.int64(token >> 16) & 255
        size, length = symbol & 15, np.int64(lengths[table, symbol])
        code = (np.uint64(codes[table, symbol]) << np.uint64(size)) | np.uint64(token & 0xFFFF)
        held = (held << np.uint64(length + size)) | code
        count += length + size
        while count >= 8:
            count -= 8
            out[n] = (held >> np.uint64(count)) & np.uint64(255)
            n += 1
    if count:
        rest = 8 - count
        out[n] = ((held << np.uint64(rest)) | np.uint64((1 << rest) - 1)) & np.uint64(255)
