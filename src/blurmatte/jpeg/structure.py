"""What a JPEG holds: its coefficients, the order of its blocks, and its segments [ITU-T T.81 A.2, B].

A segment is a marker, a length and a body. A scan is followed by entropy-coded data that end at the
next marker. Coefficients are in zigzag order.

No permissively licensed library with wheels gives access to the quantized coefficients; hence this
package. Blocks that are not replaced decode to identical pixels.
"""

import struct
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from enum import IntEnum

import numpy as np

from blurmatte.checks import Codes16, Ints16, Ints32, Ints64

# (64,) row-major index of each coefficient in zigzag order [T.81 figure A.6].
ZIGZAG = np.array(
    sorted(
        range(64),
        key=lambda i: (sum(divmod(i, 8)), i // 8 if sum(divmod(i, 8)) % 2 else i % 8),
    )
)
MAX_CODE_BITS = 16  # of a Huffman code


class JpegError(ValueError):
    """The JPEG cannot be used; the message is a clause that gives the reason."""


@dataclass(frozen=True)
class Component:
    """A channel of a JPEG: its identifier, and its blocks per MCU across and down."""

    number: int
    across: int
    down: int


class Frame:
    """The frame of a JPEG: what follows from its size and its components."""

    # The APPn and COM segments as stored: EXIF, color profile, comments …
    metadata: Sequence[bytes]
    size: tuple[int, int]  # width and height in pixels, as stored
    components: tuple[Component, ...]

    @property
    def mcu(self) -> tuple[int, int]:
        """Width and height of a minimum coded unit (MCU) in pixels."""
        return tuple(8 * max(sides) for sides in zip(*self.sampling, strict=True))

    @property
    def sampling(self) -> tuple[tuple[int, int], ...]:
        """Blocks per MCU, across and down, of each component."""
        return tuple((c.across, c.down) for c in self.components)

    @property
    def is_rgb(self) -> bool:
        """True if the channels are red, green and blue, by Adobe's segment or the identifiers."""
        jfif = any(s[:2] == b"\xff\xe0" and s[4:9] == b"JFIF\0" for s in self.metadata)
        if len(self.components) != 3 or jfif:
            return False
        for s in self.metadata:
            if s[1] == Marker.APP14 and s[4:9] == b"Adobe" and len(s) >= 16:
                return s[15] == 0  # the color transform: none
        return [component.number for component in self.components] == list(b"RGB")

    def block_numbers(self) -> list[Ints32]:
        """(rows, columns) block indices of each component, padded to full MCUs."""
        columns, rows = (-(-n // side) for n, side in zip(self.size, self.mcu, strict=True))
        numbers, first = [], 0
        for across, down in self.sampling:
            shape = rows * down, columns * across
            count = shape[0] * shape[1]
            numbers.append(np.arange(first, first + count, dtype=np.int32).reshape(shape))
            first += count
        return numbers

    def scan_order(self, chosen: Sequence[int]) -> tuple[Ints32, Ints64]:
        """(units, n) block indices of each coded unit of a scan, and (n,) the component of each block.

        A scan of one component is coded block by block and stops at the picture's edge [T.81 A.2].
        """
        every = list(zip(self.block_numbers(), self.sampling, strict=True))
        parts = [every[index] for index in chosen]
        if len(chosen) == 1:
            ((numbers, own),) = parts
            sides = zip(self.size, own, self.mcu, strict=True)
            columns, rows = (-(-n * factor // side) for n, factor, side in sides)
            inside = numbers[:rows, :columns]
            return np.ascontiguousarray(inside.reshape(-1, 1)), np.zeros(1, np.int64)
        blocks, slots = [], []
        for slot, (numbers, (across, down)) in enumerate(parts):
            rows, columns = numbers.shape
            cut = numbers.reshape(rows // down, down, columns // across, across)
            blocks.append(cut.swapaxes(1, 2).reshape(-1, down * across))
            slots += [slot] * (down * across)
        return np.concatenate(blocks, axis=1), np.array(slots)


@dataclass(frozen=True, eq=False)
class Jpeg(Frame):
    """A JPEG without its entropy coding."""

    metadata: tuple[bytes, ...]
    size: tuple[int, int]
    components: tuple[Component, ...]
    # Tuple of (64,) uint16: the table of each component, in zigzag order
    quantization: tuple[Codes16, ...]
    # (N, 64) int16: quantized, in zigzag order: all blocks of the first component row by row, then
    # of the next
    coefficients: Ints16

    def blocks(self, index: int) -> Ints16:
        """(rows, columns, 64) view of the coefficients of one component, padded to full MCUs."""
        numbers = self.block_numbers()[index]
        part = self.coefficients[numbers[0, 0] : numbers[-1, -1] + 1]
        return part.reshape(*numbers.shape, 64)


class Marker(IntEnum):
    """Second bytes of markers [T.81 table B.1]."""

    SOF0 = 0xC0
    SOF1 = 0xC1
    SOF2 = 0xC2
    SOF15 = 0xCF
    DHT = 0xC4
    RST0 = 0xD0
    SOI = 0xD8
    EOI = 0xD9
    SOS = 0xDA
    DQT = 0xDB
    DRI = 0xDD
    APP0 = 0xE0
    APP14 = 0xEE
    APP15 = 0xEF
    COM = 0xFE


_SUPPORTED_FRAMES = (Marker.SOF0, Marker.SOF1, Marker.SOF2)


@dataclass(frozen=True, eq=False)
class Scan:
    """The header of a scan."""

    components: tuple[int, ...]  # indices into the components of the frame
    # Decoding tables of each component, see `decoding_table`
    dc: tuple[Codes16, ...]
    ac: tuple[Codes16, ...]
    band: tuple[int, int]  # the first and the last coefficient
    # The lowest bit known before, 0 for none; and the lowest bit in this scan
    high: int
    low: int
    interval: int  # MCUs between restart markers; 0 for none
    start: int  # offset of the entropy-coded data in the file


@dataclass(eq=False)
class Segments(Frame):
    """A parser of segments: its state after the segments read so far."""

    data: bytes
    metadata: list[bytes] = field(default_factory=list)  # APPn and COM, with their markers
    size: tuple[int, int] = (0, 0)
    progressive: bool = False
    components: tuple[Component, ...] = ()
    selectors: tuple[int, ...] = ()  # quantization table of each component
    quantization: dict[int, Codes16] = field(default_factory=dict)  # of components seen in a scan
    interval: int = 0
    known: dict[tuple[int, int], int] = field(default_factory=dict)  # lowest bit known so far
    _quantization_tables: dict[int, Codes16] = field(default_factory=dict)
    _huffman_tables: dict[int, Codes16] = field(default_factory=dict)

    def next_scan(self, at: int) -> Scan | None:
        """Parse from the marker at `at` to the data of the next scan; None at the end of the picture.

        Raises JpegError if the file is damaged or not supported.
        """
        for marker, begin, end in _segments(self.data, at):
            body = self.data[begin + 2 : end]
            try:
                if marker == Marker.SOS:
                    return self._scan(body, end)
                self._parse(marker, body)
            except (struct.error, IndexError) as error:
                raise JpegError("the JPEG is damaged (a segment is too short)") from error
        return None

    def check_complete(self) -> None:
        """Raise JpegError unless the scans contain every bit of every coefficient."""
        if not self.components:
            raise JpegError("the JPEG is damaged (it has no picture)")
        if sum(low == 0 for low in self.known.values()) < 64 * len(self.components):
            raise JpegError("the JPEG is truncated (scans are missing)")

    def _parse(self, marker: int, body: bytes) -> None:
        if _is_metadata(marker):
            self.metadata.append(stored_segment(marker, body))
        elif marker == Marker.DQT:
            self._define_quantization(body)
        elif marker == Marker.DHT:
            self._define_huffman(body)
        elif marker == Marker.DRI:
            (self.interval,) = struct.unpack(">H", body)
        elif marker in _SUPPORTED_FRAMES:
            self._frame(marker, body)
        elif Marker.SOF0 <= marker < Marker.SOF15 and marker != 0xC8:
            kind = "arithmetic coding" if marker > 0xC8 else "hierarchical"
            kind = "lossless" if marker == 0xC3 else kind
            raise JpegError(f"the kind of JPEG is not supported ({kind})")

    def _define_quantization(self, body: bytes) -> None:
        at = 0
        while at < len(body):
            wide, name = body[at] >> 4, body[at] & 15
            form, length = (">u2", 128) if wide else ("u1", 64)
            table = np.frombuffer(body[at + 1 : at + 1 + length].ljust(length, b"\0"), form)
            if not table.all():
                raise JpegError("the JPEG is damaged (a quantization step is zero)")
            self._quantization_tables[name] = table.astype(np.uint16)
            at += 1 + length

    def _define_huffman(self, body: bytes) -> None:
        at = 0
        while at < len(body):
            counts = body[at + 1 : at + 17]
            symbols = body[at + 17 : at + 17 + sum(counts)]
            self._huffman_tables[body[at]] = decoding_table(counts, symbols)
            at += 17 + len(symbols)

    def _frame(self, marker: int, body: bytes) -> None:
        if self.components:
            raise JpegError("the JPEG is damaged (it has two frames)")
        bits, height, width, count = struct.unpack_from(">BHHB", body)
        if bits != 8:
            raise JpegError(f"the JPEG has {bits} bits per channel, not 8")
        if count not in (1, 3):
            raise JpegError(f"the JPEG has {count} channels, not 1 or 3")
        if not (width and height):
            raise JpegError("the JPEG does not state its size")
        entries = [struct.unpack_from(">BBB", body, 6 + 3 * i) for i in range(count)]
        # The sampling factors of a single component have no meaning.
        factors = [(f >> 4, f & 15) if count > 1 else (1, 1) for _, f, _ in entries]
        if not all(1 <= a <= 4 and 1 <= d <= 4 for a, d in factors):
            raise JpegError("the JPEG is damaged (a sampling factor is invalid)")
        numbers = [number for number, _, _ in entries]
        if len(set(numbers)) < count:
            raise JpegError("the JPEG is damaged (two channels have the same identifier)")
        self.size, self.progressive = (width, height), marker == Marker.SOF2
        self.components = tuple(Component(n, *f) for n, f in zip(numbers, factors, strict=True))
        self.selectors = tuple(table for _, _, table in entries)

    def _scan(self, body: bytes, start: int) -> Scan:
        if not self.components:
            raise JpegError("the JPEG is damaged (a scan precedes the frame)")
        count = body[0]
        first, last, bits = struct.unpack_from(">BBB", body, 1 + 2 * count)
        numbers = [component.number for component in self.components]
        chosen = [body[1 + 2 * i] for i in range(count)]
        if not set(chosen) <= set(numbers) or len(set(chosen)) < count or not count:
            raise JpegError("the JPEG is damaged (the channels of a scan are invalid)")
        if not self.progressive:
            first, last, bits = 0, 63, 0
        if (
            not first <= last < 64
            or (first > 0 and count > 1)
            or (self.progressive and first == 0 < last)
        ):
            raise JpegError("the JPEG is damaged (the coefficients of a scan are invalid)")
        indices = tuple(numbers.index(number) for number in chosen)
        tables = [body[2 + 2 * i] for i in range(count)]
        none = np.zeros(0, np.uint16)
        dc = tuple(self._huffman_tables.get(t >> 4, none) for t in tables)
        ac = tuple(self._huffman_tables.get(t & 15 | 16, none) for t in tables)
        needed = (dc if first == 0 and not bits >> 4 else ()) + (ac if last else ())
        if not all(map(len, needed)):
            raise JpegError("the JPEG is damaged (a scan has no Huffman table)")
        scan = Scan(indices, dc, ac, (first, last), bits >> 4, bits & 15, self.interval, start)
        self._record(scan)
        return scan

    def _record(self, scan: Scan) -> None:
        """Record which bits of which coefficients a scan contains; check that scans are in order."""
        if scan.low > 13:  # low bits that a progressive scan may omit [T.81 table G.1]
            raise JpegError("the JPEG is damaged (a scan contains no bits)")
        for index in scan.components:
            selector = self.selectors[index]
            if selector not in self._quantization_tables:
                raise JpegError("the JPEG is damaged (a quantization table is missing)")
            self.quantization.setdefault(index, self._quantization_tables[selector])
            for k in range(scan.band[0], scan.band[1] + 1):
                before = self.known.get((index, k))
                expected = scan.low + 1 if scan.high else None
                if before != expected or (scan.high and scan.high != before):
                    raise JpegError("the JPEG is damaged (its scans are out of order)")
                self.known[index, k] = scan.low


def decoding_table(counts: bytes, symbols: bytes) -> Codes16:
    """(65536,) length · 256 + symbol, by the next 16 bits; 0 for an invalid code [T.81 annex C]."""
    lengths = np.repeat(np.arange(1, MAX_CODE_BITS + 1), list(counts.ljust(MAX_CODE_BITS, b"\0")))
    spans = 1 << (MAX_CODE_BITS - lengths)
    if len(symbols) != len(lengths) or spans.sum() > 1 << MAX_CODE_BITS:
        raise JpegError("a Huffman table of the JPEG is inconsistent")
    entries = (lengths << 8 | np.frombuffer(symbols, np.uint8)).astype(np.uint16)
    table = np.zeros(1 << MAX_CODE_BITS, np.uint16)
    table[: spans.sum()] = np.repeat(entries, spans)
    return table


def metadata_segments(data: bytes) -> list[bytes]:
    """The APPn and COM segments before the first scan, up to the first invalid segment."""
    found: list[bytes] = []
    with suppress(JpegError):
        for marker, at, end in _segments(data, 2):
            if marker == Marker.SOS:
                break
            if _is_metadata(marker):
                found.append(struct.pack(">BB", 0xFF, marker) + data[at:end])
    return found


def check_header(data: bytes) -> None:
    """Raise JpegError if anything but segments precedes the first scan."""
    for marker, _, _ in _segments(data, 2):
        if marker == Marker.SOS:
            return


def _segments(data: bytes, at: int) -> Iterator[tuple[int, int, int]]:
    """The segments from the marker at `at` to the end of the picture, without the data of scans.

    Each is a marker, and the offsets of its length and of its end.
    """
    while True:
        marker, at = _marker(data, at)
        if marker == Marker.EOI:
            return
        end = at + int.from_bytes(data[at : at + 2])
        if not at + 2 <= end <= len(data):
            raise JpegError("the JPEG is truncated")
        yield marker, at, end
        at = end


def stored_segment(marker: int, body: bytes) -> bytes:
    """A segment as it is stored."""
    return struct.pack(">BBH", 0xFF, marker, len(body) + 2) + body


def _is_metadata(marker: int) -> bool:
    return Marker.APP0 <= marker <= Marker.APP15 or marker == Marker.COM


def _marker(data: bytes, at: int) -> tuple[int, int]:
    """The marker at `at` and the offset after it; any number of fill bytes 0xFF may precede."""
    if at >= len(data) - 1:
        raise JpegError("the JPEG is truncated")
    if data[at] != 0xFF:
        raise JpegError("the JPEG is damaged (a marker is missing)")
    while at < len(data) and data[at] == 0xFF:
        at += 1
    if at >= len(data):
        raise JpegError("the JPEG is truncated")
    return data[at], at + 1
