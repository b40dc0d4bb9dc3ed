"""Errors of alpha from the rounding of luma and chroma to whole codes.

Noise usually dithers the rounding, so that neighbors are rounded independently. Compression removes
noise: pixels of a plain area with the same code have the same error, which no mean over neighbors or
frames reduces. Image and plate share it where nothing moved, so their difference does not show it. Here
it is simulated: each code of luma and both chromas gets a uniform error of up to half a code. In fine
structure, which has many codes, the errors average out.
"""

from collections.abc import Sequence

import numpy as np

from blurmatte.checks import Array, Floats, Ints32
from blurmatte.matting.evidence import PixelPairs
from blurmatte.matting.evidence_kernel import add_rounded, pull_of_codes
from blurmatte.matting.maps import in_strips
from blurmatte.matting.smooth_field import BORDER, CellEvidence
from blurmatte.radiometry import YCBCR, LinearImage, Transfer


def rounding_pulls(
    pixels: PixelPairs, alpha: Floats, levels: Sequence[CellEvidence], samples: int = 16
) -> list[Array]:
    """Errors of the pull of each cell of the last level, one map for each sample.

    Empty if the picture does not consist of codes, or the model has rank 3, whose evidence, texture,
    does not depend on errors that neighbors share.

    alpha (h, w): an estimate.
    levels: from pixels on, each of twice the width.
    samples: how many maps to draw, with a fixed seed.
    """
    codes, transfer = pixels.image.meta.levels, pixels.image.meta.transfer
    if codes is None or transfer is None or pixels.model.rank == 3:
        return []
    kind = pixels.image.rgb.dtype
    _, B, V_C, V_B = pixels.with_edges
    if pixels.coarse is not None:
        B = pixels.coarse
    light = (np.ascontiguousarray(a, kind) for a in (B, V_C, V_B))
    N, color = np.ascontiguousarray(pixels.model.normals), np.linalg.inv(YCBCR)
    (of_image, image), (of_plate, plate) = (
        _codes(picture, codes, transfer) for picture in (pixels.image, pixels.plate)
    )
    pull_of_codes(*light, N, np.asarray(alpha, kind), pixels.use, color, image, plate)
    off = np.random.default_rng(0).uniform(-0.5, 0.5, (samples, 3, 3 * codes)).astype(kind)
    pulls = np.zeros((samples, *levels[-1].mask.shape))
    width = 2 ** (len(levels) - 1)
    add_rounded(of_image, image, of_plate, plate, pixels.use, off, width, BORDER, pulls)
    return list(pulls)


def _codes(picture: LinearImage, levels: int, transfer: Transfer) -> tuple[Ints32, Floats]:
    """(h, w, 3) codes of luma and chroma, 0 or more, and the light per code of each channel."""
    kind, steps = picture.rgb.dtype, levels - 1
    of_code = (transfer.slope(transfer.table(levels)) / steps).astype(kind)
    codes, light = np.empty(picture.rgb.shape, np.int32), np.empty(picture.rgb.shape, kind)

    def rows(strip: slice) -> None:
        """Fill some rows."""
        values = steps * transfer.encode(picture.rgb[strip])
        light[strip] = of_code[np.clip(np.rint(values), 0, steps).astype(np.intp)]
        chroma = np.rint(values @ YCBCR.T + (0, steps, steps))
        codes[strip] = np.clip(chroma, 0, 3 * levels - 1)

    in_strips(rows, len(codes))
    return codes, light
