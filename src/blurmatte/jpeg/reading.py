"""JPEG files to coefficients: 8 bits, sequential or progressive, Huffman codes [ITU-T T.81]."""

import numpy as np
import numpy.typing as npt

from blurmatte.jpeg import entropy
from blurmatte.jpeg.coefficients import ZIGZAG, Jpeg, JpegError, block_numbers, scan_order
from blurmatte.jpeg.segments import Marker, Scan, Segments, is_rgb
from blurmatte.radiometry.compression import Compression
from blurmatte.radiometry.orientation import Orientation

_UPRIGHT = Orientation()


def read_jpeg(data: bytes, max_pixels: int | None = None) -> Jpeg:
    """Read the coefficients of a JPEG.

    Bytes after the end of the picture are ignored. Pictures of more than `max_pixels` are rejected
    before memory is allocated. Raises JpegError if the file is damaged or not supported.
    """
    if data[:2] != bytes([0xFF, Marker.SOI]):
        raise JpegError("the file is no JPEG")
    segments = Segments(data)
    coefficients: npt.NDArray[np.int16] | None = None
    at = 2
    while scan := segments.next_scan(at):
        if coefficients is None:
            width, height = segments.size
            if max_pixels is not None and width * height > max_pixels:
                raise JpegError(f"the JPEG has {width} x {height} pixels, more than {max_pixels}")
            count = sum(n.size for n in block_numbers(segments.size, segments.components))
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
    sampling = tuple((c.across, c.down) for c in segments.components)
    if set(sampling[1:]) != {(1, 1)} or is_rgb(segments.metadata, segments.components):
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


def _decode(segments: Segments, scan: Scan, out: npt.NDArray[np.int16]) -> int:
    """Decode a scan into the blocks `out`; return the offset of the next marker."""
    order, slots = scan_order(segments.size, segments.components, scan.components)
    interval = scan.interval or len(order)
    data = np.frombuffer(segments.data, np.uint8)
    bits = np.zeros(len(data) - scan.start + entropy.PADDING_BYTES, np.uint8)
    bounds = np.zeros(-(-len(order) // interval) + 1, np.int64)
    end = int(entropy.unstuff(data, scan.start, bits, bounds))
    if end == entropy.TRUNCATED:
        raise JpegError("the JPEG is truncated")
    if end == entropy.BAD_RESTART:
        raise JpegError("the JPEG is damaged (a restart marker is out of order)")
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
