"""Replace blocks of a JPEG by newly compressed pixels; all other blocks keep their coefficients."""

import io
from dataclasses import replace

import numpy as np

from blurmatte.checks import Bools, Codes8
from blurmatte.jpeg.coefficients import ZIGZAG, Jpeg, JpegError
from blurmatte.jpeg.reading import read_jpeg
from blurmatte.jpeg.segments import is_rgb

# Sampling factors of all components to Pillow's `subsampling`.
_PILLOW_SUBSAMPLING = {
    ((1, 1),): 0,
    ((1, 1),) * 3: 0,
    ((2, 1), (1, 1), (1, 1)): 1,
    ((2, 2), (1, 1), (1, 1)): 2,
}


def replace_blocks(jpeg: Jpeg, codes: Codes8, changed: Bools) -> Jpeg:
    """Compress the MCUs that contain a changed pixel; all others keep their coefficients.

    codes (H, W, 3) or (H, W) uint8: the whole picture as stored (not rotated), R'G'B' or gray like
        `jpeg`. Unchanged pixels of an MCU with a changed pixel are compressed as well.
    changed (H, W).

    Raises JpegError if Pillow cannot compress with the sampling or the tables of `jpeg`.
    """
    if not changed.any():
        return jpeg
    if jpeg.sampling not in _PILLOW_SUBSAMPLING or is_rgb(jpeg.metadata, jpeg.components):
        raise JpegError("the chroma sampling of the JPEG is not supported")
    affected = _affected_mcus(jpeg, changed)
    rows, columns = np.flatnonzero(affected.any(axis=1)), np.flatnonzero(affected.any(axis=0))
    top, left, bottom, right = (
        int(n) for n in (rows[0], columns[0], rows[-1] + 1, columns[-1] + 1)
    )
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
