"""The quantized coefficients of a JPEG: read, exchanged in some blocks, and written without loss.

That is written here because no library with wheels and a permissive license gives access to them.
What is decoded from an untouched block stays the same to the bit.
"""

import io
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from blurmatte.checks import Bools
from blurmatte.files.jpeg_blocks import block_numbers, mcu_size, scan_order
from blurmatte.files.jpeg_segments import Component, JpegError, Scan, Segments, holds_rgb
from blurmatte.radiometry import Compression

_SAMPLINGS = {
    ((1, 1),): 0,
    ((1, 1),) * 3: 0,
    ((2, 1), (1, 1), (1, 1)): 1,
    ((2, 2), (1, 1), (1, 1)): 2,
}
_SOI = b"\xff\xd8"
_MOST_STEP = 255  # of 8 bits; tables of 16 bits may hold more
# By EXIF orientation: whether axes are exchanged, then left and right, then above and below.
_TURNS = {
    1: (False, False, False), 2: (False, True, False), 3: (False, True, True),
    4: (False, False, True), 5: (True, False, False), 6: (True, True, False),
    7: (True, True, True), 8: (True, False, True),
}  # fmt: skip
# Row by row in a block, at which place in zigzag order [T.81 figure A.6].
_DIAGONALS = sorted(
    ((y, x) for y in range(8) for x in range(8)),
    key=lambda p: (sum(p), p[0] if sum(p) % 2 else p[1]),
)
ZIGZAG = np.array([8 * y + x for y, x in _DIAGONALS])


@dataclass(frozen=True, eq=False)
class Jpeg:
    """A JPEG, but for how its numbers are packed.

    Parameters
    ----------
    kept : tuple of bytes
        The APPn and COM segments as they are: EXIF, color profile, comments …
    size : (int, int)
        Width and height, as stored.
    components : tuple of Component
    quantization : tuple of (64,) uint16
        Of each component, in zigzag order.
    coefficients : (N, 64) int16
        Quantized, in zigzag order: all blocks of the first component row by row, then of the next.
    """

    kept: tuple[bytes, ...]
    size: tuple[int, int]
    components: tuple[Component, ...]
    quantization: tuple[npt.NDArray[np.uint16], ...]
    coefficients: npt.NDArray[np.int16]

    @property
    def mcu(self) -> tuple[int, int]:
        """Width and height of an MCU in pixels: the smallest part that is coded by itself."""
        return mcu_size(self.components)

    def blocks(self, place: int) -> npt.NDArray[np.int16]:
        """(rows, columns, 64) the coefficients of a component, a view; its last MCUs are full ones."""
        numbers = block_numbers(self.size, self.components)[place]
        part = self.coefficients[numbers[0, 0] : numbers[-1, -1] + 1]
        return part.reshape(*numbers.shape, 64)


def read_jpeg(data: bytes, max_pixels: int | None = None) -> Jpeg:
    """Read the coefficients of a JPEG: 8 bits, sequential or progressive, Huffman codes.

    Parameters
    ----------
    data : bytes
        The whole file. What follows the picture is not read.
    max_pixels : int, optional
        Larger pictures are refused before memory is taken.

    Raises
    ------
    JpegError
        If the file is damaged, or is of another kind.
    """
    if data[:2] != _SOI:
        raise JpegError("is no JPEG")
    segments = Segments(data)
    coefficients: npt.NDArray[np.int16] | None = None
    at = 2
    while scan := segments.next_scan(at):
        if coefficients is None:
            width, height = segments.size
            if max_pixels is not None and width * height > max_pixels:
                raise JpegError(f"claims {width} x {height} pixels, more than {max_pixels}")
            count = sum(n.size for n in block_numbers(segments.size, segments.components))
            coefficients = np.zeros((count, 64), np.int16)
        at = _decode(segments, scan, coefficients)
    segments.check_complete()
    if coefficients is None:
        raise JpegError("is damaged (it holds no picture)")
    tables = tuple(segments.quantization[i] for i in range(len(segments.components)))
    return Jpeg(tuple(segments.kept), segments.size, segments.components, tables, coefficients)


def compression_of(data: bytes, orientation: int) -> Compression | None:
    """What a JPEG file did to the code values of its picture, as it is when it is upright.

    None for gray pictures, for channels that are no luma and chroma, for more pixels that share chroma
    than two by two, and for steps that no other file could be written with.
    """
    try:
        segments = Segments(data)
        segments.next_scan(len(_SOI))
        tables = [segments.quantization[i][np.argsort(ZIGZAG)] for i in range(2)]
    except (JpegError, KeyError):
        return None
    sampling = tuple((c.across, c.down) for c in segments.components)
    if set(sampling[1:]) != {(1, 1)} or holds_rgb(segments.kept, segments.components):
        return None
    if not set(sampling[0]) <= {1, 2} or np.max(tables) > _MOST_STEP:
        return None
    luma, chroma = (tuple(map(tuple, table.reshape(8, 8).tolist())) for table in tables)
    return _upright(Compression(luma, chroma, sampling[0]), segments.size, orientation)


def _upright(stored: Compression, size: tuple[int, int], orientation: int) -> Compression:
    """Of the picture turned and mirrored as the EXIF tag says."""
    transposed, mirrored, upside_down = _TURNS.get(orientation, _TURNS[1])
    if transposed:
        stored, size = stored.transposed(), size[::-1]
    if mirrored:
        stored = stored.mirrored(size[0])
    if upside_down:
        stored = stored.transposed().mirrored(size[1]).transposed()
    return stored


def exchanged(jpeg: Jpeg, codes: npt.NDArray[np.uint8], changed: Bools) -> Jpeg:
    """Compress the MCUs anew that hold a changed pixel; all others stay as they are.

    Parameters
    ----------
    jpeg : Jpeg
    codes : (H, W, 3) or (H, W) uint8
        The whole picture as stored (not turned), R'G'B' or gray as `jpeg` is. Of pixels that did not
        change those in touched MCUs count.
    changed : (H, W) bool

    Raises
    ------
    JpegError
        If Pillow cannot compress in the way of `jpeg`.
    """
    if not changed.any():
        return jpeg
    sampling = tuple((c.across, c.down) for c in jpeg.components)
    if sampling not in _SAMPLINGS or holds_rgb(list(jpeg.kept), jpeg.components):
        raise JpegError("samples its channels in a rare way")
    touched = _touched(jpeg, changed)
    rows, columns = np.flatnonzero(touched.any(axis=1)), np.flatnonzero(touched.any(axis=0))
    top, left = int(rows[0]), int(columns[0])
    box = np.s_[top : int(rows[-1]) + 1, left : int(columns[-1]) + 1]
    new = _compressed(jpeg, _pixels_of(codes, jpeg.mcu, box), _SAMPLINGS[sampling])
    result = replace(jpeg, coefficients=jpeg.coefficients.copy())
    for place, c in enumerate(jpeg.components):
        mask = touched[box].repeat(c.down, axis=0).repeat(c.across, axis=1)
        here, source = np.s_[c.down * top :, c.across * left :], new.blocks(place)
        target = result.blocks(place)[here][: mask.shape[0], : mask.shape[1]]
        target[mask] = source[mask]
    return result


def _pixels_of(
    codes: npt.NDArray[np.uint8], mcu: tuple[int, int], box: tuple[slice, slice]
) -> npt.NDArray[np.uint8]:
    (width, height), (down, across) = mcu, box
    part = codes[
        down.start * height : down.stop * height, across.start * width : across.stop * width
    ]
    return np.ascontiguousarray(part)


def _touched(jpeg: Jpeg, changed: Bools) -> Bools:
    """(rows, columns) of MCUs: is there a changed pixel?"""
    width, height = jpeg.mcu
    rows, columns = changed.shape
    full = np.pad(changed, ((0, -rows % height), (0, -columns % width)))
    cut = full.reshape(-(-rows // height), height, -(-columns // width), width)
    return np.asarray(cut.any(axis=(1, 3)))


def _compressed(jpeg: Jpeg, codes: npt.NDArray[np.uint8], sampling: int) -> Jpeg:
    """Compress pixels with the tables and the sampling of a JPEG; Pillow does it."""
    from PIL import Image

    natural = [np.zeros(64, int) for _ in jpeg.components]
    for table, zigzag in zip(natural, jpeg.quantization, strict=True):
        table[ZIGZAG] = zigzag
    file = io.BytesIO()
    Image.fromarray(codes).save(
        file, "JPEG", qtables=[table.tolist() for table in natural], subsampling=sampling
    )
    new = read_jpeg(file.getvalue())
    same = all(map(np.array_equal, new.quantization, jpeg.quantization))
    if not same or [(c.across, c.down) for c in new.components] != [
        (c.across, c.down) for c in jpeg.components
    ]:
        raise JpegError("quantizes its channels in a rare way")
    return new


def _decode(segments: Segments, scan: Scan, out: npt.NDArray[np.int16]) -> int:
    """Decode a scan into all blocks; where the next marker is."""
    from blurmatte.files import jpeg_entropy as entropy

    components = segments.components
    order, slots = scan_order(segments.size, components, scan.components)
    interval = scan.interval or len(order)
    data = np.frombuffer(segments.data, np.uint8)
    bits = np.zeros(len(data) - scan.start + entropy.PADDING, np.uint8)
    bounds = np.zeros(-(-len(order) // interval) + 1, np.int64)
    end = int(entropy.unstuff(data, scan.start, bits, bounds))
    if end == entropy.CUT_SHORT:
        raise JpegError("is cut short")
    if end == entropy.BAD_RESTART:
        raise JpegError("is damaged (a restart marker is not where it should be)")
    none = np.zeros(1 << 16, np.uint16)
    dc, ac = (
        np.stack([table if len(table) else none for table in tables])
        for tables in (scan.dc, scan.ac)
    )
    mode, (first, last) = _mode(segments, scan), scan.band
    if not entropy.decode_scan(
        bits, bounds, interval, order, slots, mode, dc, ac, first, last, scan.low, out
    ):
        raise JpegError("is damaged or cut short")
    return end


def _mode(segments: Segments, scan: Scan) -> int:
    from blurmatte.files import jpeg_entropy as entropy

    if not segments.progressive:
        return entropy.SEQUENTIAL
    if scan.band[0] == 0:
        return entropy.DC_REFINED if scan.high else entropy.DC_FIRST
    return entropy.AC_REFINED if scan.high else entropy.AC_FIRST
