"""Many frames of a scene → one plate of what does not move, with its error.

The first run through the frames keeps a few dozen and finds the light that each pixel shows most
often. The second one averages all frames that agree with it. In this file B is the plate, δ its
difference from the mode, v the variance of one frame and n the number of frames a pixel was free in.
"""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from blurmatte.background.average import Sums, sum_frames
from blurmatte.background.mode import Modes, find_modes
from blurmatte.background.samples import take_samples
from blurmatte.background.stillness import check_still
from blurmatte.checks import Bools, Floats
from blurmatte.errors import PlateError
from blurmatte.radiometry import LINEAR, LinearImage, Meta, rounding_variance

_LEAST_SHARE, _LEAST_FRAMES = 0.15, 2  # of the frames agree on the mode, or nothing is known
# Light that is seen in most frames is the scene's. If it is seen less often, another one must be much
# rarer still, for the most frequent may be something that came to rest.
_MOST, _RIVAL_SHARE = 0.55, 0.35
_CLIPPED_SHARE = 0.01  # of the free frames: with more of them the mean is too dark
_NEIGHBORS, _PIXELS_TRUSTED = (
    5,
    16,
)  # pixels a side; how many frames the neighbors' scatter counts as
_BLOCKS = 33  # pixels a side: over what noise hangs together is about the same
_TINY = 1e-14  # float32 knows no light better
_HARMONICS = np.arange(1, 40)


@dataclass(frozen=True, eq=False)
class PlateFit:
    """A plate made of frames.

    Parameters
    ----------
    plate : LinearImage
        float32 light, with a variance for each pixel; `valid` is False where no light was seen much
        more often than others, or it is clipped.
    coverage : (H, W) float32
        Share of the frames in which the pixel was seen free; 0 where that is not known.
    gain : (N, 3) float
        How much brighter each frame is than the plate, per channel; divided out.
    """

    plate: LinearImage
    coverage: Floats
    gain: Floats

    def __repr__(self) -> str:
        return f"PlateFit({self.plate!r}, {len(self.gain)} frames)"


def make_plate(frames: Iterable[LinearImage]) -> PlateFit:
    """The scene without what moves in front of it, from frames of a camera that stands still.

    A pixel's plate is the light that it shows most often, at least 15 % of the time and clearly more
    often than any other: something may stay in front of it for up to 40 % of the time. All frames
    that agree with it within their noise are averaged. Light that grows or fades over the whole picture
    is divided out; the plate has the light of the middle of it.

    The frames are run through twice (three times if they have no length), one at a time; what is
    held in memory does not depend on how many there are.

    Parameters
    ----------
    frames : iterable of LinearImage
        Of one size, that can be run through again: `read_frames`, or a list. At least three.

    Returns
    -------
    PlateFit
        The plate, its coverage, and the gain of each frame. The variance contains noise, of video as
        far as it hangs together in time, and the rounding to code values that noise does not even out.

    Raises
    ------
    PlateError
        If there are fewer than three frames, the camera moved, the scene is cut, its light changes by
        more than a factor of two, or no pixel was seen free.
    TypeError, ValueError
        If the frames are no LinearImages of one size, or can be run through only once.
    """
    if iter(frames) is frames:
        raise TypeError(
            "frames can be run through only once, but are needed twice; "
            "give read_frames(...) or a list"
        )
    samples = take_samples(frames)
    light = float(np.median(samples.light[len(samples.light) // 2]))
    variance = float(samples.noise.variance(np.full(3, light)).sum()) / 9
    check_still(samples.light, samples.gain, variance, samples.names)
    modes, count = find_modes(samples), samples.count
    del samples  # a gigabyte, of large frames
    sums = sum_frames(frames, modes, count)
    return _finished(sums, modes, next(iter(frames)))


def _finished(sums: Sums, modes: Modes, frame: LinearImage) -> PlateFit:
    gain = np.array(sums.gain)
    _, free, clipped, close, rival = np.moveaxis(sums.counts, -1, 0)
    known = (free > _MOST * len(gain)) | (rival <= _RIVAL_SHARE * close)
    known &= free >= max(_LEAST_SHARE * len(gain), _LEAST_FRAMES)
    valid = known & (clipped <= _CLIPPED_SHARE * free)
    if not valid.any():
        raise PlateError(
            "no pixel was seen free: none shows the same light for a good part of the frames, "
            "unclipped; give more frames, or some without the object"
        )
    n = np.maximum(free, 1)[..., None]
    rgb = modes.light + sums.total / n
    noise = np.empty_like(modes.light)
    for c in range(3):  # one at a time: of large frames a channel takes a lot of memory
        rounding = _rounding(rgb[..., c], frame.meta)
        noise[..., c] = _variance(sums, c, known, modes.variance[..., c], rounding)
    meta = Meta(source=f"plate of {len(gain)} frames")
    plate = LinearImage(rgb.astype(np.float32), noise, valid, meta)
    return PlateFit(plate, np.where(known, free / len(gain), 0).astype(np.float32), gain)


def _variance(sums: Sums, c: int, known: Bools, usual: Floats, rounding: Floats) -> Floats:
    """(H, W) variance of a channel of B: v / n, times how noise hangs together, and rounding.

    Neighborhoods are averaged in units of the variance that is `usual` for a frame.

    Noise of video is alike in frames that follow each other. So batches of them are compared with
    each other, as if each were one measurement (batch means; P. Welch, 1983): over batches of n,

        Var B = Σ (S − n δ)² / ((Σ n)² − Σ n²).

    Eight batches tell that badly for one pixel; what they tell of a neighborhood is believed.
    """
    n = np.maximum(sums.counts[..., 1], 2).astype(float)
    delta, q = sums.total[..., c] / n, sums.batch_counts
    v = np.maximum(sums.squares[..., c] - n * delta**2, 0) / (n - 1)
    local = usual * _around(v / usual, (n - 1) * known, _NEIGHBORS)
    v = ((n - 1) * v + _PIXELS_TRUSTED * local) / (n - 1 + _PIXELS_TRUSTED)
    usable = known & (n**2 > 1.5 * q)
    scatter = sums.batch_squares[..., c] - 2 * delta * sums.batch_products[..., c] + delta**2 * q
    scatter = np.where(usable, scatter / np.maximum(n**2 - q, 1), 0)
    white, of_batches = (_around(a * n / usual, 1.0 * usable, _BLOCKS) for a in (v / n, scatter))
    together = np.maximum(of_batches / np.maximum(white, _TINY), 1)
    kept = _left_of_rounding(local / np.maximum(rounding, _TINY))
    return np.asarray(v * together / n + rounding * kept + _TINY)


def _rounding(light: Floats, meta: Meta) -> Floats:
    """Variance that rounding makes in one frame at each light; 0 if it held floats."""
    if meta.levels is None:
        return np.zeros_like(light)
    return rounding_variance(light, meta.levels, meta.transfer or LINEAR)


def _around(values: Floats, weight: Floats, side: int) -> Floats:
    """(H, W) weighted mean over the neighborhood of each pixel."""
    from scipy.ndimage import uniform_filter

    weighted, total = (uniform_filter(a, side) for a in (values * weight, weight))
    # Its running sums leave something where there is nothing.
    return np.asarray(np.maximum(weighted, 0) / np.maximum(total, 1e-6))


def _left_of_rounding(scatter: Floats) -> Floats:
    """Of the variance 1/12 of rounding, the share that a mean over frames keeps.

    Noise of a standard deviation σ, in code values, evens it out: of its variance remains
    b = Σ exp(−(2πkσ)²) / 2π²k², and the rounded values scatter by σ² + 1/12 − b (from the Fourier
    series of the rounding error, Widrow & Kollár 2008). `scatter` is that in units of 1/12.
    """
    sigma = np.linspace(0, 1, 200)
    b = (
        np.exp(-((2 * np.pi * np.outer(sigma, _HARMONICS)) ** 2)) / (2 * np.pi**2 * _HARMONICS**2)
    ).sum(-1)
    return np.asarray(np.interp(scatter, 12 * (sigma**2 + 1 / 12 - b), 12 * b, right=0.0))
