"""What is unknown of alpha because a file rounded luma and chroma to whole codes.

Noise usually spreads rounding over all codes, so that neighbors are not rounded alike. Compression
takes noise out: whatever has the same code in a plain part of a picture is off by the same, and no
mean of neighbors, nor of frames, makes that less. It is the same in image and plate where nothing
moved, so that their difference does not show it. Here it is drawn: for each code of luma and both
chromas how much it may be off, uniformly between half a code down and up. In fine structure, which has
many codes, that comes to nothing.
"""

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from blurmatte.checks import Floats
from blurmatte.matting.evidence import Pixels
from blurmatte.matting.pixelwise import in_strips
from blurmatte.matting.smooth_prior import BORDER, Evidence
from blurmatte.radiometry import LinearImage, Transfer

Array = npt.NDArray[np.float64]

# BT.601, as JPEG has it: luma and chroma of red, green and blue.
_CHROMA = np.array([[0.299, 0.587, 0.114], [-0.1687, -0.3313, 0.5], [0.5, -0.4187, -0.0813]])
_SAMPLES = 16
_SEED = 0  # the same answer every time


def rounded_pulls(pixels: Pixels, alpha: Floats, levels: Sequence[Evidence]) -> list[Array]:
    """By how much the pull of each cell of the last level may be off; one map for each sample.

    None at all if the picture is not of codes, or the object may have any colors: what neighbors share
    is not in the plate's texture.

    Parameters
    ----------
    pixels : Pixels
    alpha : (h, w)
        About what alpha is.
    levels : sequence of Evidence
        Of pixels first, each of twice the width.
    """
    from blurmatte.matting.rounding_kernel import add_rounded, by_codes  # numba takes half a second

    codes, transfer = pixels.image.meta.levels, pixels.image.meta.transfer
    if codes is None or transfer is None or pixels.model.rank == 3:
        return []
    kind = pixels.image.rgb.dtype
    _, B, V_C, V_B = pixels.with_edges
    told_by = B if pixels.coarse is None else pixels.coarse
    light = (np.ascontiguousarray(a, kind) for a in (told_by, V_C, V_B))
    N, color = np.ascontiguousarray(pixels.model.normals), np.linalg.inv(_CHROMA)
    (of_image, image), (of_plate, plate) = (
        _codes(picture, codes, transfer) for picture in (pixels.image, pixels.plate)
    )
    by_codes(*light, N, np.asarray(alpha, kind), pixels.use, color, image, plate)
    off = np.random.default_rng(_SEED).uniform(-0.5, 0.5, (_SAMPLES, 3, 3 * codes)).astype(kind)
    pulls = np.zeros((_SAMPLES, *levels[-1].mask.shape))
    width = 2 ** (len(levels) - 1)
    add_rounded(of_image, image, of_plate, plate, pixels.use, off, width, BORDER, pulls)
    return list(pulls)


def _codes(
    picture: LinearImage, levels: int, transfer: Transfer
) -> tuple[npt.NDArray[np.int32], Floats]:
    """(h, w, 3) codes of luma and chroma, from 0, and light of a code more of each channel."""
    kind, steps = picture.rgb.dtype, levels - 1
    of_code = (transfer.slope(transfer.table(levels)) / steps).astype(kind)
    codes, light = np.empty(picture.rgb.shape, np.int32), np.empty(picture.rgb.shape, kind)

    def rows(strip: slice) -> None:
        values = steps * transfer.encode(picture.rgb[strip])
        light[strip] = of_code[np.clip(np.rint(values), 0, steps).astype(np.intp)]
        chroma = np.rint(values @ _CHROMA.T + (0, steps, steps))
        codes[strip] = np.clip(chroma, 0, 3 * levels - 1)

    in_strips(rows, len(codes))
    return codes, light
