"""Single pixels that are no light of the scene: fireflies of path tracers, hot and dead pixels.

In this file d is the difference of image and plate. A lens, an aperture and the area of a pixel spread
the light of the smallest thing over its neighbors. A pixel that fails, or a sample of a path tracer,
stays alone.
"""

from dataclasses import replace

import numpy as np
import numpy.typing as npt

from blurmatte.checks import Bools, Floats
from blurmatte.radiometry import LinearImage, Noise

MIN_DEVIATION = 8.0  # standard deviations of d by which an outlier differs from its neighbors
# Of a point's light that a neighbor gets at least: a Gaussian point spread of 0.3 pixels leaves 5 %
MIN_SPREAD = 0.05
RING = 2  # pixels, of the neighbors beyond the nearest
STRIP_ROWS = 128  # of a picture at a time, to save memory


def outliers(image: LinearImage, plate: LinearImage) -> Bools:
    """(H, W) pixels whose d differs from that of all neighbors as no point spread allows.

    The noise is known. The four nearest neighbors of a pixel get `MIN_SPREAD` of its light, in the
    median, relative to a ring around them. Two adjacent outliers are found, larger groups are not.
    """
    found = np.zeros(image.valid.shape, bool)
    for first in range(0, len(found), STRIP_ROWS):
        rows = slice(max(first - RING, 0), first + STRIP_ROWS + RING)
        d = np.asarray(image.rgb[rows] - plate.rgb[rows], np.float32)
        sigma = np.sqrt(np.maximum(_variance(image, rows) + _variance(plate, rows), 1e-12))
        found[rows] |= _in_strip(d, sigma, image.valid[rows] & plate.valid[rows])
    return found


def _variance(picture: LinearImage, rows: slice) -> Floats:
    """Noise variance of some rows, without that of the others."""
    if isinstance(picture.noise, Noise):
        return picture.noise.variance(picture.rgb[rows])
    return picture.variance[rows]


def _in_strip(d: Floats, sigma: Floats, valid: Bools) -> Bools:
    """`outliers` in a strip of rows, without the first and last rows of it."""
    found = np.zeros(valid.shape, bool)
    for y, x in _candidates(d / sigma, valid):
        window = d[y - RING : y + RING + 1, x - RING : x + RING + 1].astype(float)
        ring = np.concatenate(
            [window[[0, -1]].reshape(-1, 3), window[1:-1, [0, -1]].reshape(-1, 3)]
        )
        level = np.median(ring, axis=0)
        own = window[RING, RING] - level
        c = int(np.argmax(np.abs(own) / sigma[y, x]))
        nearest = window[[1, 2, 2, 3], [2, 1, 3, 2], c] - level[c]
        spread = float(np.median(nearest * np.sign(own[c])))
        scatter = float(np.median(np.abs(ring[:, c] - level[c]))) + float(sigma[y, x, c])
        strong = abs(own[c]) > MIN_DEVIATION * scatter
        # The noise of the neighbors may hide their share: then a point is as likely.
        alone = spread + scatter < MIN_SPREAD * abs(own[c])
        found[y, x] = strong and alone
    return found


def _candidates(z: Floats, valid: Bools) -> npt.NDArray[np.intp]:
    """(n, 2) rows and columns of valid pixels that exceed six of their eight neighbors by far.

    Neighbors are compared for strong pixels only: of the others there are too many.
    """
    size = np.maximum(np.maximum(np.abs(z[..., 0]), np.abs(z[..., 1])), np.abs(z[..., 2]))
    strong = valid & (size > MIN_DEVIATION)
    strong[:RING] = strong[-RING:] = strong[:, :RING] = strong[:, -RING:] = False
    yx = np.argwhere(strong)
    return yx[_exceed_neighbors(size, yx)]


def _exceed_neighbors(size: Floats, yx: npt.NDArray[np.intp]) -> Bools:
    """(n,) whether the third largest of 3 x 3 pixels is less than half of the central one."""
    y, x = yx.T
    around = np.stack([size[y + i, x + j] for i in (-1, 0, 1) for j in (-1, 0, 1)])
    return np.asarray(np.partition(around, -3, axis=0)[-3] < size[y, x] / 2)


def without_outliers(image: LinearImage, plate: LinearImage) -> LinearImage:
    """The image whose `outliers` against the plate are not valid."""
    found = outliers(image, plate)
    return replace(image, valid=image.valid & ~found) if found.any() else image
