"""Test statistic of motion: the excess of the difference of image and plate over its noise.

In this file d = C − B is the difference of image and plate, z the same in standard deviations, and T
the sum of z² over the channels after smoothing, scaled to χ² with three degrees of freedom where
nothing moved. Large pictures are averaged over cells of several pixels, which bounds the cost.

Outliers are single pixels that are no light of the scene: fireflies of path tracers, hot and dead
pixels. A lens, an aperture and the area of a pixel spread
the light of the smallest thing over its neighbors. A pixel that fails, or a sample of a path tracer,
stays alone.
"""

from dataclasses import replace

import numpy as np
import scipy

from blurmatte.checks import Bools, Floats, Indices, strips
from blurmatte.radiometry import LinearImage, Noise, rounding_noise
from blurmatte.radiometry.image import VARIANCE_FLOOR, part_of
from blurmatte.statistics import cell_means, robust_std

SMOOTHING = (1.0, 3.0)  # std of T, cells: for small sharp and for faint broad streaks
_ROUNDING_STEPS = 4.0  # codes, to which JPEG and video round blocks
_LIGHT_BLOCK_PX = 8  # over which noise averages out, and changes of light do not
_MIN_LIGHT_CHANGE = 0.01  # standard deviation over the light; alpha is off by several times it
MIN_DEVIATION = 8.0  # standard deviations of d by which an outlier differs from its neighbors
# Of a point's light that a neighbor gets at least: a Gaussian point spread of 0.3 pixels leaves 5 %
MIN_SPREAD = 0.05
RING = 2  # pixels, of the neighbors beyond the nearest
STRIP_ROWS = 128  # of pixels or cells at a time, to save memory


def evidence(image: LinearImage, plate: LinearImage, cell: int) -> Floats:
    """(h, w) T of every cell: the largest over the scales of smoothing.

    A sum of z weighted by w has the variance Σw²; for Gaussian weights that is a Gaussian sum too, of
    1/√2 the scale. Division by it makes noise uniform up to the border.
    """
    z, weight, rounding = _normalized_difference(image, plate, cell)
    T = np.zeros(weight.shape, np.float32)
    for scale in SMOOTHING:
        white = _smoothed(weight, scale / np.sqrt(2)) / (4 * np.pi * scale**2)
        std = np.sqrt(np.maximum(white, 1e-6))
        steps = _ROUNDING_STEPS**2 * (4 * np.pi * scale**2)
        T_here = np.zeros_like(T)
        for c in range(3):
            smooth = _smoothed(z[..., c], scale) / std
            smooth -= np.median(smooth)
            T_here += smooth**2 / _null_variance(smooth, steps * rounding[..., c])
        T = np.maximum(T, T_here)
    return T


def _smoothed(values: Floats, scale: float) -> Floats:
    return np.asarray(scipy.ndimage.gaussian_filter(values, scale, mode="constant"))


def _null_variance(smooth: Floats, steps: Floats) -> Floats:
    """(h, w) variance of a smoothed z of one channel where nothing moved.

    It is 1 for white noise. The excess, by correlated noise of JPEG and video, drifting light and soft
    shadows, has long tails, so it counts twelve times. It is that of the 65 % quantile, or that of the
    90 % quantile up to the variance `steps` of a few codes: a codec may round a whole block up or down.
    """
    std = np.quantile(np.abs(smooth), (0.65, 0.9)) / (0.9346, 1.6449)  # 1 for a standard normal
    most, some = 12 * np.maximum(std**2 - 1, 0)
    return np.asarray(1 + np.maximum(most, np.minimum(some, steps)), dtype=smooth.dtype)


def _normalized_difference(
    image: LinearImage, plate: LinearImage, cell: int
) -> tuple[Floats, Floats, Floats]:
    """(h, w, 3) z of the cells' means, (h, w) 1 for valid cells and 0 for others, and (h, w, 3) the
    fraction of the variance that is due to rounding.

    The variance includes that of a subpixel shift at edges of the plate, estimated from these edges.
    """
    d, B, known = _cells_of(image, plate, cell)
    variance = _mean_variance(image, B, cell) + _mean_variance(plate, B, cell)
    edge = _edge_energy(B)
    variance = variance + 9 * _mean_square_shift(d, variance, edge) * edge + VARIANCE_FLOOR
    z = np.where(known[..., None], d / np.sqrt(variance), 0)
    rounding = (rounding_noise(image).variance(B) + rounding_noise(plate).variance(B)) / variance
    return tuple(np.asarray(a, dtype=np.float32) for a in (z, known, rounding))  # type: ignore[return-value]


def _cells_of(image: LinearImage, plate: LinearImage, cell: int) -> tuple[Floats, Floats, Bools]:
    """Means of difference and plate over cells, and whether these are mostly valid.

    Strips avoid copies of large pictures.
    """
    parts = []
    for rows in strips(len(image.valid), cell * STRIP_ROWS):
        used = image.valid[rows] & plate.valid[rows]
        d = np.where(used[..., None], image.rgb[rows] - plate.rgb[rows], 0)
        known = in_cells(used[..., None].astype(np.float32), cell)[..., 0] > 0.5
        parts.append((in_cells(d, cell), in_cells(plate.rgb[rows], cell), known))
    differences, plates, valid = map(np.concatenate, zip(*parts, strict=True))
    return differences, plates, valid


def shift_variance(image: LinearImage, plate: LinearImage, still: Bools) -> Floats:
    """(H, W, 3) variance by a subpixel shift of the plate at its edges, light².

    The shift is estimated from edges where nothing moved: `still`, (H, W) bool.
    """
    d = np.asarray(image.rgb - plate.rgb, float)
    edge = _edge_energy(np.asarray(plate.rgb, float))
    return np.asarray(
        _mean_square_shift(d[still], (image.variance + plate.variance)[still], edge[still]) * edge
    )


def _mean_square_shift(d: Floats, variance: Floats, edge: Floats) -> float:
    """Mean square shift, pixels², from the excess of d² over its variance at the strongest edges.

    The variance needs no direction, and shifts too small for `background.camera_motion` count, too.
    """
    energy = edge.sum(axis=-1)
    if energy.size == 0:
        return 0.0
    strong = energy >= np.quantile(energy, 0.9)
    noise = 0.79 * np.median(variance.sum(axis=-1)[strong])  # median over mean of χ², 3 d.o.f.
    excess = np.median((d**2).sum(axis=-1)[strong]) - noise
    return max(float(excess / (np.median(energy[strong]) + VARIANCE_FLOOR)), 0.0)


def light_change(image: LinearImage, plate: LinearImage) -> float:
    """Standard deviation of image − plate over blocks, as a fraction of the light.

    0 unless it exceeds what noise, rounding and the codec leave. Medians leave out whatever moved.
    """
    side = _LIGHT_BLOCK_PX
    d, B, known = _cells_of(image, plate, side)
    if np.count_nonzero(known) < side:
        return 0.0
    steps = np.diff(
        np.where((image.valid & plate.valid)[..., None], image.rgb - plate.rgb, 0), axis=1
    )
    of_noise = np.array([robust_std(steps[..., c]) for c in range(3)]) ** 2 / 2
    changed = np.array([robust_std(d[known][:, c]) for c in range(3)]) ** 2
    light = np.maximum(np.median(B[known], axis=0), 1e-6)
    rounding = rounding_noise(image).variance(light) + rounding_noise(plate).variance(light)
    least = of_noise / side + _ROUNDING_STEPS**2 * rounding
    excess = np.where(changed > least, changed - least, 0) ** 0.5 / light
    change = float(excess.max())
    return change if change > _MIN_LIGHT_CHANGE else 0.0


def _edge_energy(B: Floats) -> Floats:
    """(h, w, 3) squared gradient, the maximum over 3 x 3 cells: light² per cell²."""
    energy = np.gradient(B, axis=0) ** 2 + np.gradient(B, axis=1) ** 2
    return np.asarray(scipy.ndimage.maximum_filter(energy, size=(3, 3, 1)))


def in_cells(values: Floats, cell: int) -> Floats:
    """Means over cells of `cell` x `cell` pixels; the picture is extended to whole cells."""
    if cell == 1:
        return values
    height, width = (n // cell * cell for n in values.shape[:2])
    pad = [(0, -n % cell) for n in values.shape[:2]] + [(0, 0)]
    padded = np.pad(values, pad, mode="edge") if (height, width) != values.shape[:2] else values
    return cell_means(padded, cell)


def _mean_variance(picture: LinearImage, B: Floats, cell: int) -> Floats:
    if isinstance(picture.noise, Noise):
        return np.asarray(picture.noise.variance(B) / cell**2)
    return np.asarray(in_cells(picture.variance, cell) / cell**2)


def outliers(image: LinearImage, plate: LinearImage) -> Bools:
    """(H, W) pixels whose d differs from that of all neighbors as no point spread allows.

    The noise is known. The four nearest neighbors of a pixel get `MIN_SPREAD` of its light, in the
    median, relative to a ring around them. Two adjacent outliers are found, larger groups are not.
    """
    found = np.zeros(image.valid.shape, bool)
    for first in range(0, len(found), STRIP_ROWS):
        rows = slice(max(first - RING, 0), first + STRIP_ROWS + RING)
        C, B = (part_of(picture, rows) for picture in (image, plate))
        d = np.asarray(C.rgb - B.rgb, np.float32)
        sigma = np.sqrt(np.maximum(C.variance + B.variance, 1e-12))
        found[rows] |= _in_strip(d, sigma, C.valid & B.valid)
    return found


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


def _candidates(z: Floats, valid: Bools) -> Indices:
    """(n, 2) rows and columns of valid pixels that exceed six of their eight neighbors by far.

    Neighbors are compared for strong pixels only: of the others there are too many.
    """
    size = np.maximum(np.maximum(np.abs(z[..., 0]), np.abs(z[..., 1])), np.abs(z[..., 2]))
    strong = valid & (size > MIN_DEVIATION)
    strong[:RING] = strong[-RING:] = strong[:, :RING] = strong[:, -RING:] = False
    yx = np.argwhere(strong)
    return yx[_exceed_neighbors(size, yx)]


def _exceed_neighbors(size: Floats, yx: Indices) -> Bools:
    """(n,) whether the third largest of 3 x 3 pixels is less than half of the central one."""
    y, x = yx.T
    around = np.stack([size[y + i, x + j] for i in (-1, 0, 1) for j in (-1, 0, 1)])
    return np.asarray(np.partition(around, -3, axis=0)[-3] < size[y, x] / 2)


def without_outliers(image: LinearImage, plate: LinearImage) -> LinearImage:
    """The image whose `outliers` against the plate are not valid."""
    found = outliers(image, plate)
    return replace(image, valid=image.valid & ~found) if found.any() else image
