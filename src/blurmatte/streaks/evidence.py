"""Evidence that something moved: how much more image and plate differ than by noise.

In this file d = C − B is the difference of image and plate, z the same in units of its standard
deviation, and T the sum of z² over the channels after smoothing, scaled so that it would be χ² with
three degrees of freedom if nothing had moved. Large pictures are looked at in cells of several
pixels, so that the search costs no more than for a picture of a million pixels.
"""

from collections.abc import Iterator, Sequence

import numpy as np
import numpy.typing as npt

from blurmatte.checks import Bools, Floats
from blurmatte.radiometry import LinearImage, NoiseModel, rounding_noise
from blurmatte.statistics import cell_means

SCALES = (1.0, 3.0)  # cells: smoothing that finds small sharp and faint broad streaks
SURE, POSSIBLE = 6.0**2, 3.5**2  # T: something moved here; part of it if it touches a sure place
_STRIP = 128  # cells, of rows that are looked at together
_STEPS = 4.0  # code values: to so many the blocks of JPEG and video are rounded
_MEDIAN_CHI2 = 0.79  # median over mean of the sum of three squares of noise


def evidence(
    image: LinearImage, plate: LinearImage, cell: int, scales: Sequence[float] = SCALES
) -> Floats:
    """(h, w) T of every cell: the largest over the scales of smoothing.

    A sum of z weighted by w has the variance Σw²; with Gaussian weights that is a Gaussian sum too,
    of 1/√2 the scale. Dividing by it leaves noise at the border as it is elsewhere.
    """
    z, weight, rounding = _normalized_difference(image, plate, cell)
    T = np.zeros(weight.shape, np.float32)
    for scale in scales:
        white = _smoothed(weight, scale / np.sqrt(2)) / (4 * np.pi * scale**2)
        std = np.sqrt(np.maximum(white, 1e-6))
        steps = _STEPS**2 * (4 * np.pi * scale**2)
        T_here = np.zeros_like(T)
        for c in range(3):
            smooth = _smoothed(z[..., c], scale) / std
            smooth -= np.median(smooth)
            T_here += smooth**2 / _spread2(smooth, steps * rounding[..., c])
        T = np.maximum(T, T_here)
    return T


def _smoothed(values: Floats, scale: float) -> Floats:
    from scipy.ndimage import gaussian_filter

    return np.asarray(gaussian_filter(values, scale, mode="constant"))


def _spread2(smooth: Floats, steps: Floats) -> Floats:
    """(h, w) variance of a smoothed z of one channel where nothing moved.

    White noise leaves 1. What there is beyond that is correlated noise of JPEG and video, light
    that drifts, soft shadows: long-tailed, so it counts twelve times. The quantile believes what
    two thirds of the picture say. A tenth is believed too, but no further than a few code values,
    `steps`: where neighbors have like light, a codec may round all of them up or down.
    """
    told = np.quantile(np.abs(smooth), (0.65, 0.9)) / (0.9346, 1.6449)  # of normal numbers 1
    most, some = 12 * np.maximum(told**2 - 1, 0)
    return np.asarray(1 + np.maximum(most, np.minimum(some, steps)), dtype=smooth.dtype)


def _normalized_difference(
    image: LinearImage, plate: LinearImage, cell: int
) -> tuple[Floats, Floats, Floats]:
    """(h, w, 3) difference of the cells' means over its standard deviation, (h, w) 1 where it is
    known and 0 elsewhere, (h, w, 3) the part of that variance which rounding alone has.

    Where the plate has edges, a shift by a fraction of a pixel makes a difference too. How large
    the shifts are is read off the edges themselves.
    """
    d, B, known = (
        np.concatenate(parts) for parts in zip(*_cells_of(image, plate, cell), strict=True)
    )
    variance = _mean_variance(image, B, cell) + _mean_variance(plate, B, cell)
    edge = _edge_energy(B)
    variance = variance + 9 * _shift2(d, variance, edge) * edge + 1e-14
    z = np.where(known[..., None], d / np.sqrt(variance), 0)
    rounding = (rounding_noise(image).variance(B) + rounding_noise(plate).variance(B)) / variance
    return tuple(np.asarray(a, dtype=np.float32) for a in (z, known, rounding))  # type: ignore[return-value]


def _cells_of(
    image: LinearImage, plate: LinearImage, cell: int
) -> Iterator[tuple[Floats, Floats, Bools]]:
    """The means of difference and plate over cells, and where most of a cell is known, in strips.

    Of a picture of many pixels no copy is made.
    """
    for start in range(0, len(image.valid), cell * _STRIP):
        rows = slice(start, start + cell * _STRIP)
        used = image.valid[rows] & plate.valid[rows]
        d = np.where(used[..., None], image.rgb[rows] - plate.rgb[rows], 0)
        known = in_cells(used[..., None].astype(np.float32), cell)[..., 0] > 0.5
        yield in_cells(d, cell), in_cells(plate.rgb[rows], cell), known


def shift_variance(image: LinearImage, plate: LinearImage, still: Bools) -> Floats:
    """(H, W, 3) variance that a plate shifted by a fraction of a pixel has at its own edges, light².

    How far it is shifted is read off the edges where `still`, (H, W) bool: nothing moved there.
    """
    d = np.asarray(image.rgb - plate.rgb, float)
    edge = _edge_energy(np.asarray(plate.rgb, float))
    return np.asarray(
        _shift2(d[still], (image.variance + plate.variance)[still], edge[still]) * edge
    )


def _shift2(d: Floats, variance: Floats, edge: Floats) -> float:
    """Mean squared shift, pixels², from what d² has beyond its variance at the strongest edges."""
    energy = edge.sum(axis=-1)
    if energy.size == 0:
        return 0.0
    strong = energy >= np.quantile(energy, 0.9)
    of_noise = _MEDIAN_CHI2 * np.median(variance.sum(axis=-1)[strong])
    excess = np.median((d**2).sum(axis=-1)[strong]) - of_noise
    return max(float(excess / (np.median(energy[strong]) + 1e-14)), 0.0)


def _edge_energy(B: Floats) -> Floats:
    """(h, w, 3) squared gradient, the largest of the neighbors: light² per cell²."""
    from scipy import ndimage

    energy = np.gradient(B, axis=0) ** 2 + np.gradient(B, axis=1) ** 2
    return np.asarray(ndimage.maximum_filter(energy, size=(3, 3, 1)))


def in_cells(values: npt.NDArray[np.floating], cell: int) -> Floats:
    """Means over cells of cell × cell pixels; the last ones reach to the border."""
    if cell == 1:
        return values
    height, width = (n // cell * cell for n in values.shape[:2])
    pad = [(0, -n % cell) for n in values.shape[:2]] + [(0, 0)]
    padded = np.pad(values, pad, mode="edge") if (height, width) != values.shape[:2] else values
    return cell_means(padded, cell)


def _mean_variance(picture: LinearImage, B: Floats, cell: int) -> Floats:
    if isinstance(picture.noise, NoiseModel):
        return np.asarray(picture.noise.variance(B) / cell**2)
    return np.asarray(in_cells(picture.variance, cell) / cell**2)
