"""The segments of a JPEG: what it says around its entropy-coded data [ITU-T T.81 annex B].

A JPEG is a row of segments: a marker, a length, data. A scan is followed by entropy-coded data,
which end at the next marker. Coefficients are in zigzag order throughout.
"""

import struct
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

Table = npt.NDArray[np.uint16]

_SOF, _OTHER_SOF = (0xC0, 0xC1, 0xC2), (0xC3, *range(0xC5, 0xC8), *range(0xC9, 0xCC), 0xCD, 0xCE)
_DHT, _DAC, _EOI, _SOS, _DQT, _DRI = 0xC4, 0xCC, 0xD9, 0xDA, 0xDB, 0xDD
_PROGRESSIVE = 0xC2
_RARE = {0xC3: "lossless", 0xC5: "hierarchical", 0xC6: "hierarchical", 0xC7: "hierarchical"}
_APP0, _APP15, _COM = 0xE0, 0xEF, 0xFE
_ADOBE, _ADOBE_RGB = b"\xff\xee", 0  # APP14, and its number for "not transformed"
_COEFFICIENTS = 64
_DEEPEST = 13  # bits that a progressive scan may leave for later ones [T.81 table G.1]


class JpegError(ValueError):
    """The JPEG cannot be used; the message says why, and follows the name of the file."""


@dataclass(frozen=True)
class Component:
    """A channel of a JPEG: its number, and how many of its blocks an MCU has across and down."""

    number: int
    across: int
    down: int


@dataclass(frozen=True, eq=False)
class Scan:
    """What a scan tells of its components' coefficients, and where its data are.

    Parameters
    ----------
    components : tuple of int
        Which ones, by their place in the frame.
    dc, ac : tuple of tables
        Of each component: for every 16 bits that may come next, length · 256 + symbol of the code they
        begin with; 0 for none.
    band : (int, int)
        The first and the last coefficient.
    high, low : int
        The lowest bit that is known, 0 for none yet; and the lowest that is told now.
    interval : int
        MCUs from one restart to the next; 0: there are none.
    start : int
        Where in the file its data begin.
    """

    components: tuple[int, ...]
    dc: tuple[Table, ...]
    ac: tuple[Table, ...]
    band: tuple[int, int]
    high: int
    low: int
    interval: int
    start: int


@dataclass(eq=False)
class Segments:
    """What was read so far, from the first segment on."""

    data: bytes
    kept: list[bytes] = field(default_factory=list)  # APPn and COM, with their markers
    size: tuple[int, int] = (0, 0)
    progressive: bool = False
    components: tuple[Component, ...] = ()
    selectors: tuple[int, ...] = ()  # which quantization table each component wants
    quantization: dict[int, Table] = field(default_factory=dict)  # of components seen in a scan
    interval: int = 0
    known: dict[tuple[int, int], int] = field(default_factory=dict)  # lowest bit told so far
    _quantization_tables: dict[int, Table] = field(default_factory=dict)
    _codes: dict[int, Table] = field(default_factory=dict)

    def next_scan(self, at: int) -> Scan | None:
        """Read on from a marker at `at` to the data of the next scan; None at the end of the picture.

        Raises
        ------
        JpegError
            If the file is damaged, or is of a kind that is not read here.
        """
        while True:
            marker, at = _marker(self.data, at)
            if marker == _EOI:
                return None
            if at + 2 > len(self.data):
                raise JpegError("is cut short")
            end = at + int.from_bytes(self.data[at : at + 2])
            if end > len(self.data) or end < at + 2:
                raise JpegError("is cut short")
            body = self.data[at + 2 : end]
            try:
                if marker == _SOS:
                    return self._scan(body, end)
                self._take(marker, body)
            except (struct.error, IndexError) as error:
                raise JpegError("is damaged (a segment is too short)") from error
            at = end

    def _take(self, marker: int, body: bytes) -> None:
        if _APP0 <= marker <= _APP15 or marker == _COM:
            self.kept.append(struct.pack(">BBH", 0xFF, marker, len(body) + 2) + body)
        elif marker == _DQT:
            self._quantize(body)
        elif marker == _DHT:
            self._define_codes(body)
        elif marker == _DRI:
            (self.interval,) = struct.unpack(">H", body)
        elif marker in _SOF:
            self._frame(marker, body)
        elif marker in _OTHER_SOF or marker == _DAC:
            raise JpegError(f"is of a rare kind ({_RARE.get(marker, 'arithmetic coding')})")

    def _quantize(self, body: bytes) -> None:
        at = 0
        while at < len(body):
            wide, name = body[at] >> 4, body[at] & 15
            form, length = (">u2", 128) if wide else ("u1", 64)
            table = np.frombuffer(body[at + 1 : at + 1 + length].ljust(length, b"\0"), form)
            if not table.all():
                raise JpegError("is damaged (a quantization table holds zero)")
            self._quantization_tables[name] = table.astype(np.uint16)
            at += 1 + length

    def _define_codes(self, body: bytes) -> None:
        at = 0
        while at < len(body):
            counts = body[at + 1 : at + 17]
            symbols = body[at + 17 : at + 17 + sum(counts)]
            self._codes[body[at]] = _lookup(counts, symbols)
            at += 17 + len(symbols)

    def _frame(self, marker: int, body: bytes) -> None:
        if self.components:
            raise JpegError("is damaged (it holds two frames)")
        bits, height, width, count = struct.unpack_from(">BHHB", body)
        if bits != 8:
            raise JpegError(f"has {bits} bits per channel, not 8")
        if count not in (1, 3):
            raise JpegError(f"has {count} channels, not 1 or 3")
        if not (width and height):
            raise JpegError("does not say its size")
        entries = [struct.unpack_from(">BBB", body, 6 + 3 * i) for i in range(count)]
        # Of a single component the factors mean nothing.
        factors = [(f >> 4, f & 15) if count > 1 else (1, 1) for _, f, _ in entries]
        if not all(1 <= a <= 4 and 1 <= d <= 4 for a, d in factors):
            raise JpegError("is damaged (a sampling factor is none)")
        numbers = [number for number, _, _ in entries]
        if len(set(numbers)) < count:
            raise JpegError("is damaged (two channels have one number)")
        self.size, self.progressive = (width, height), marker == _PROGRESSIVE
        self.components = tuple(Component(n, *f) for n, f in zip(numbers, factors, strict=True))
        self.selectors = tuple(table for _, _, table in entries)

    def _scan(self, body: bytes, start: int) -> Scan:
        if not self.components:
            raise JpegError("is damaged (a scan comes before the frame)")
        count = body[0]
        first, last, bits = struct.unpack_from(">BBB", body, 1 + 2 * count)
        numbers = [component.number for component in self.components]
        chosen = [body[1 + 2 * i] for i in range(count)]
        if not set(chosen) <= set(numbers) or len(set(chosen)) < count or not count:
            raise JpegError("is damaged (a scan is of channels that are not there)")
        if not self.progressive:
            first, last, bits = 0, _COEFFICIENTS - 1, 0
        if not first <= last < _COEFFICIENTS or (first > 0 and count > 1):
            raise JpegError("is damaged (a scan is of coefficients that are not there)")
        if self.progressive and first == 0 < last:
            raise JpegError("is damaged (a scan mixes what it may not)")
        places = tuple(numbers.index(number) for number in chosen)
        tables = [body[2 + 2 * i] for i in range(count)]
        none = np.zeros(0, np.uint16)
        dc = tuple(self._codes.get(t >> 4, none) for t in tables)
        ac = tuple(self._codes.get(t & 15 | 16, none) for t in tables)
        needed = (dc if first == 0 and not bits >> 4 else ()) + (ac if last else ())
        if not all(map(len, needed)):
            raise JpegError("is damaged (a scan has no Huffman table)")
        scan = Scan(places, dc, ac, (first, last), bits >> 4, bits & 15, self.interval, start)
        self._note(scan)
        return scan

    def _note(self, scan: Scan) -> None:
        """Remember which bits of which coefficients are known after a scan; they come in order."""
        if scan.low > _DEEPEST:
            raise JpegError("is damaged (a scan tells no bits)")
        for place in scan.components:
            selector = self.selectors[place]
            if selector not in self._quantization_tables:
                raise JpegError("is damaged (a quantization table is missing)")
            self.quantization.setdefault(place, self._quantization_tables[selector])
            for k in range(scan.band[0], scan.band[1] + 1):
                before = self.known.get((place, k))
                expected = scan.low + 1 if scan.high else None
                if before != expected or (scan.high and scan.high != before):
                    raise JpegError("is damaged (its scans do not follow each other)")
                self.known[place, k] = scan.low

    def check_complete(self) -> None:
        """Raise unless every bit of every coefficient was told."""
        if not self.components:
            raise JpegError("is damaged (it holds no picture)")
        told = sum(low == 0 for low in self.known.values())
        if told < _COEFFICIENTS * len(self.components):
            raise JpegError("is cut short (a part of its scans is missing)")


def kept_segments(data: bytes) -> list[bytes]:
    """The APPn and COM segments before the first scan, of any kind of JPEG; as many as make sense."""
    found: list[bytes] = []
    at = 2
    try:
        while True:
            marker, at = _marker(data, at)
            end = at + int.from_bytes(data[at : at + 2])
            if marker in (_SOS, _EOI) or end < at + 2:
                return found
            if _APP0 <= marker <= _APP15 or marker == _COM:
                found.append(struct.pack(">BB", 0xFF, marker) + data[at:end])
            at = end
    except JpegError:
        return found


def holds_rgb(kept: list[bytes], components: tuple[Component, ...]) -> bool:
    """The channels are red, green and blue, not luma and chroma: Adobe's marker or names say so."""
    if len(components) != 3 or any(s[:2] == b"\xff\xe0" and s[4:9] == b"JFIF\0" for s in kept):
        return False
    adobe = [s for s in kept if s.startswith(_ADOBE) and s[4:9] == b"Adobe" and len(s) >= 16]
    if adobe:
        return adobe[0][15] == _ADOBE_RGB
    return [component.number for component in components] == list(b"RGB")


def _marker(data: bytes, at: int) -> tuple[int, int]:
    """The marker at `at` and what comes after it; any number of 0xFF may come before."""
    if at >= len(data) - 1:
        raise JpegError("is cut short")
    if data[at] != 0xFF:
        raise JpegError("is damaged (a marker is missing)")
    while at < len(data) and data[at] == 0xFF:
        at += 1
    if at >= len(data):
        raise JpegError("is cut short")
    return data[at], at + 1


def _lookup(counts: bytes, symbols: bytes) -> Table:
    """Length · 256 + symbol for all 16 bits that begin with the code of a symbol [T.81 annex C]."""
    lengths = np.repeat(np.arange(1, 17), list(counts.ljust(16, b"\0")))
    spans = 1 << (16 - lengths)
    if len(symbols) != len(lengths) or spans.sum() > 1 << 16:
        raise JpegError("is damaged (a Huffman table does not add up)")
    entries = (lengths << 8 | np.frombuffer(symbols, np.uint8)).astype(np.uint16)
    table = np.zeros(1 << 16, np.uint16)
    table[: spans.sum()] = np.repeat(entries, spans)
    return table
