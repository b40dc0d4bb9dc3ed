"""A few frames spread over a clip, with their gains and their noise.

In this file x is the light of a frame, B the light that does not move, and g the gain of a frame: per
channel, the factor by which lamps or the camera's exposure made all of it brighter, x = g B.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import islice, pairwise

import numpy as np
import numpy.typing as npt

from blurmatte.calibration import fit_noise
from blurmatte.checks import Floats
from blurmatte.errors import PlateError
from blurmatte.radiometry import LinearImage, NoiseModel, check_picture, rounding_noise
from blurmatte.statistics import MAD_TO_STD

_MOST_SAMPLES, _LEAST_SAMPLES = 64, 20
_MOST_BYTES = 1.0e9  # of samples held; each takes 6 bytes a pixel
_NOISE_PIXELS, _NOISE_PAIRS = 1e5, 3
_LEAST_VARIANCE = 1e-12  # float32 knows no light better
_STEPS = 3.0  # times rounding's variance is half a step squared: rounded light jumps by steps
_HALF_ROUNDING = 2.0**-22 / 3  # of light²: samples are kept as float16
_GAIN_PIXELS = 1e4
_LEAST_GAIN = 1e-3  # a black frame has one, too
_SIGMAS = 4.0  # beyond it a pixel does not tell of gain
_DARK = 0.05  # of the brightest: below, ratios are noise
_MOST_DRIFT = 2.0  # gains beyond it come with other lamps, other shadows, clipped pixels
_CUT, _CUT_LIGHT = 0.5, 0.1  # share of the picture that changes at once, by more than this much


@dataclass(frozen=True, eq=False)
class Samples:
    """Frames spread over a clip.

    Parameters
    ----------
    light : (K, H, W, 3) float16
        As read: with their gain.
    gain : (K, 3) float
        Of each; the median over the clip is near 1.
    noise : NoiseModel
        Of one frame.
    names : sequence of str
        What errors call them.
    count : int
        How many frames the clip seems to have.
    """

    light: npt.NDArray[np.float16]
    gain: Floats
    noise: NoiseModel
    names: Sequence[str]
    count: int


def take_samples(frames: Iterable[LinearImage]) -> Samples:
    """Run through the frames and keep some, as many for any length of the clip.

    Raises
    ------
    PlateError
        If there are fewer than three frames, or they do not show one scene in one light.
    ValueError
        If their sizes differ.
    """
    count = len(frames) if isinstance(frames, Sequence) else sum(1 for _ in frames)
    light, parts, names = _spread(frames, count)
    if len(light) < 3:
        raise PlateError(f"a plate needs at least 3 frames, got {len(light)}; give more of them")
    _check_one_scene(light, names)
    noise = _noise(parts)
    gain = _gains(light, noise)
    _check_drift(gain, names)
    return Samples(light, gain, noise, names, count)


def frame_name(frame: LinearImage, number: int) -> str:
    """What an error calls a frame."""
    return frame.meta.source or f"frame {number}"


def other_size(frame: LinearImage, number: int, size: Sequence[int]) -> str:
    """The complaint about a frame that is not of the `size` (width, height) of the others."""
    return (
        f"frames must be of one size; {frame_name(frame, number)} is "
        f"{frame.size[0]}x{frame.size[1]}, others {size[0]}x{size[1]}"
    )


def fit_gain(light: Floats, still: Floats, variance: Floats) -> Floats:
    """(3,) g of light = g · still, both (3, n), where they agree within `variance` but for it."""
    gain = median_ratio(light[:, ::8], still[:, ::8])
    for c, (x, B, s2) in enumerate(zip(light, still, variance, strict=True)):
        for _ in range(2):
            weight = ((x - gain[c] * B) ** 2 < _SIGMAS**2 * s2) * B / s2
            if (total := float(np.sum(weight * B))) > 0:
                gain[c] = max(float(np.sum(weight * x)) / total, _LEAST_GAIN)
    return gain


def median_ratio(light: Floats, still: Floats) -> Floats:
    """(3,) median of light over still, both (3, n), where that is not dark."""
    gain = np.ones(3)
    for c, (x, B) in enumerate(zip(light, still, strict=True)):
        bright = _DARK * B.max() < B
        if bright.any():
            gain[c] = max(float(np.median(x[bright] / B[bright])), _LEAST_GAIN)
    return gain


def grid(shape: tuple[int, ...], pixels: float) -> tuple[slice, slice]:
    """About so many pixels, spread evenly over a picture."""
    step = max(1, int(np.sqrt(shape[0] * shape[1] / pixels)))
    return slice(step // 2, None, step), slice(step // 2, None, step)


def _spread(
    frames: Iterable[LinearImage], count: int
) -> tuple[npt.NDArray[np.float16], list[LinearImage], list[str]]:
    """Frames at equal distances, parts of them in full precision, and their names."""
    first = next(iter(frames), None)
    if first is None:
        return np.empty((0, 1, 1, 3), np.float16), [], []
    check_picture("the first frame", first)
    most = np.clip(_MOST_BYTES / (6 * first.valid.size), _LEAST_SAMPLES, _MOST_SAMPLES)
    step = max(1, -(-count // int(most)))
    start = (count - 1) % step // 2
    light = np.empty((-(-(count - start) // step), *first.rgb.shape), np.float16)
    parts, names = list[LinearImage](), list[str]()
    for frame in islice(_every(frames, start, step), len(light)):
        number = start + len(parts) * step
        check_picture(f"frame {number}", frame)
        if frame.size != first.size:
            raise ValueError(other_size(frame, number, first.size))
        light[len(parts)] = frame.rgb
        parts.append(_part(frame))
        names.append(frame_name(frame, number))
    return light[: len(parts)], parts, names


def _every(frames: Iterable[LinearImage], start: int, step: int) -> Iterator[LinearImage]:
    if isinstance(frames, Sequence):  # which may read those alone
        return iter(frames[start::step])
    return islice(iter(frames), start, None, step)


def _part(frame: LinearImage) -> LinearImage:
    """Some rows, enough to measure noise."""
    rows = slice(None, None, max(1, round(frame.valid.size / _NOISE_PIXELS)))
    return LinearImage(frame.rgb[rows].copy(), valid=frame.valid[rows].copy(), meta=frame.meta)


def _noise(parts: Sequence[LinearImage]) -> NoiseModel:
    """Of one frame: half that of the difference of two, the median of a few such.

    About half a clip is between the two, for what video does not send again stays the same for long;
    not always as much, for frames may repeat themselves.
    """
    models, half = [], len(parts) // 2
    starts = np.linspace(0, len(parts) - 1 - half, _NOISE_PAIRS).astype(int)
    for shorter, i in enumerate(starts):
        a, b = parts[i], parts[i + max(half - shorter, 1)]
        ratio = median_ratio(b.rgb.reshape(-1, 3).T, a.rgb.reshape(-1, 3).T)
        b = replace(b, rgb=(b.rgb / ratio).astype(np.float32))
        first, second = fit_noise(a, b)
        models.append((first.coefficients + second.coefficients) / 2)
    strengths = [float(np.sum(model @ [1, 0.2, 0.04])) for model in models]  # at a light of 0.2
    model = models[np.argsort(strengths)[len(models) // 2]]
    steps = _STEPS * rounding_noise(parts[0]).coefficients
    return NoiseModel.from_coefficients(model + steps + [_LEAST_VARIANCE, 0, _HALF_ROUNDING])


def _check_one_scene(light: Floats, names: Sequence[str]) -> None:
    """Refuse a clip with a cut: most of the picture changes between two samples."""
    small = _few_pixels(light)
    after = np.stack([b / median_ratio(b, a)[:, None] for a, b in pairwise(small)])
    change = np.abs(after - small[:-1])
    noise = MAD_TO_STD * np.median(change, axis=(0, 2), keepdims=True)
    much = change > _SIGMAS * noise + _CUT_LIGHT * np.maximum(after, small[:-1])
    shares = much.any(axis=1).mean(axis=1)
    at = int(np.argmax(shares))
    if shares[at] > _CUT:
        raise PlateError(
            f"the scene is cut between {names[at]} and {names[at + 1]}: {shares[at]:.0%} of the "
            "picture changes; give the part before or after it (--start, --stop)"
        )


def _few_pixels(light: Floats) -> Floats:
    """(K, 3, n) light of some pixels."""
    few = light[:, *grid(light.shape[1:], _GAIN_PIXELS)].astype(float)
    return np.ascontiguousarray(np.moveaxis(few.reshape(len(few), -1, 3), -1, 1))


def _gains(light: Floats, noise: NoiseModel) -> Floats:
    """(K, 3) of each sample against the median of all, which is found in turn with them."""
    small = _few_pixels(light)
    gain = np.ones((len(small), 3))
    for _ in range(2):
        still = np.median(small / gain[..., None], axis=0)
        variance = noise.variance(still.T).T
        gain = np.array([fit_gain(x, still, variance) for x in small])
        gain /= np.median(gain, axis=0)
    return gain


def _check_drift(gain: Floats, names: Sequence[str]) -> None:
    mean = gain.mean(axis=1)
    low, high = int(np.argmin(mean)), int(np.argmax(mean))
    if mean[high] > _MOST_DRIFT * mean[low]:
        raise PlateError(
            f"the light changes too much for one plate: {names[high]} is "
            f"{mean[high] / mean[low]:.1f} times as bright as {names[low]}, {_MOST_DRIFT:g} is the "
            "most; give a part of the clip with steady light (--start, --stop)"
        )
