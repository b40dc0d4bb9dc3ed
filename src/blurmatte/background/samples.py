"""Samples of a clip: frames at equal distances, with their gains and their noise.

In this file x is the light of a frame, B the static light and g the gain of the frame per channel, by
which lamps or the exposure changed all of it: x = g B.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import islice, pairwise

import numpy as np
import numpy.typing as npt

from blurmatte.background import robust_mean_kernel as kernel
from blurmatte.calibration import fit_noise
from blurmatte.checks import Box, Floats, strips
from blurmatte.errors import PlateError
from blurmatte.radiometry import CodingError, LinearImage, NoiseModel, check_picture, rounding_noise
from blurmatte.radiometry.coded import CodedFrame, CodedSequence, RgbCodes
from blurmatte.statistics import MAD_TO_STD, MAX_RESIDUAL_STD

# Number of samples, estimation of noise and gain, and rejection of clips.
_MIN_SAMPLES = 20
_MAX_SAMPLES = 64
_MAX_BYTES = 1.0e9  # of all samples that are pictures, at 6 bytes a pixel
_MIN_CODED = 16  # samples of a clip, whose code values are kept
_MAX_CODED_BYTES = 1.5e8  # of them
_NOISE_PIXELS = 1e5  # of a frame
_NOISE_PAIRS = 3  # of frames, of which the median noise is taken
_GAIN_PIXELS = 1e4  # of a frame
_MIN_GAIN = 1e-3  # of a black frame
_MIN_BRIGHTNESS = 0.05  # of the maximum, for ratios of light
_MAX_GAIN_RATIO = 2.0  # between frames; larger ones come with other lamps and clipped pixels
_MAX_CHANGED_AREA = 0.5  # fraction of the picture between two samples; more is a cut
_MIN_CUT_CONTRAST = 0.1  # relative change of light, beyond noise, that counts as changed


LightOf = Callable[[Box, int], LinearImage]


@dataclass(frozen=True, eq=False)
class SampledLight:
    """Light of each sample: (H, W, 3) float32, as read, gain included."""

    parts: list[LightOf]  # light of a box of each
    size: tuple[int, int]  # (width, height)
    exact: bool  # whether it is the light of the frame, and not rounded to half precision
    codes: list[RgbCodes]  # of each, or none

    def __len__(self) -> int:
        return len(self.parts)

    def rows(self, k: int, rows: slice) -> LinearImage:
        """Some rows of a sample."""
        start, stop, step = rows.indices(self.size[1])
        whole = self.parts[k]((0, start, self.size[0], stop), 1)
        return LinearImage(whole.rgb[::step], valid=whole.valid[::step], meta=whole.meta)

    def bands(self, rows: slice) -> Iterator[LinearImage]:
        """Some rows of each sample."""
        return (self.rows(k, rows) for k in range(len(self)))

    def write(self, k: int, rows: slice, gain: Floats, out: Floats) -> None:
        """Write some rows (h, W, 3) of a sample over its gain (3,)."""
        if not self.codes:
            np.divide(self.rows(k, rows).rgb, gain, out=out)
            return
        one = self.codes[k]
        for c, table in enumerate(one.table / gain[:, None]):
            out[..., c] = table.take(one.codes[rows][..., c])


@dataclass(frozen=True, eq=False)
class Samples:
    """Frames at equal distances."""

    light: SampledLight
    gain: Floats  # (K, 3) float: of each frame; the median over the clip is near 1
    noise: NoiseModel  # of one frame
    few: Floats  # (K, 3, n) float: light of the pixels of `gain_grid`
    names: Sequence[str]  # of the frames, for errors
    count: int  # number of frames of the clip
    coding: CodingError | None  # that all frames share

    def gray(self, k: int) -> Floats:
        """(H, W) mean of the channels of a sample, at a common exposure."""
        width, height = self.light.size
        gray, gain = np.empty((height, width), np.float32), self.gain[k].astype(np.float32)
        for rows in strips(height):
            strip = np.empty((rows.stop - rows.start, width, 3), np.float32)
            self.light.write(k, rows, gain, strip)
            gray[rows] = (strip[..., 0] + strip[..., 1] + strip[..., 2]) / np.float32(3)
        return gray


class CutError(PlateError):
    """Frames of several scenes."""


def take_samples(frames: Iterable[LinearImage], registered: bool = False) -> Samples:
    """Read the frames once and keep a number of them that does not depend on the clip's length.

    Frames that are `registered` are of one scene.

    Raises PlateError if there are fewer than three frames, a cut, or too large a change of light.
    Raises ValueError if their sizes differ.
    """
    count = len(frames) if isinstance(frames, Sequence | CodedSequence) else sum(1 for _ in frames)
    light, rows, names, few = _equally_spaced(frames, count)
    if len(light) < 3:
        raise PlateError(f"a plate needs at least 3 frames, got {len(light)}; give more of them")
    small = np.array(few)
    if not registered:
        _check_no_cut(small, names)
    if light.exact:
        every = slice(None, None, _noise_step(light.size[0] * light.size[1]))
        rows = {k: light.rows(k, every) for pair in _pairs(len(light)) for k in pair}
    noise = _noise([(rows[i], rows[k]) for i, k in _pairs(len(light))])
    gain = _gains(small, noise)
    _check_drift(gain, names)
    errors = frames.coding_errors() if isinstance(frames, CodedSequence) else None
    still = None if errors is None else errors.still
    return Samples(light, gain, noise, small, names, count, still)


def max_coded_samples(pixels: int, bytes_per_pixel: int) -> int:
    """Number of frames of a clip whose code values are kept at most."""
    most = _MAX_CODED_BYTES / (bytes_per_pixel * pixels)
    return int(np.clip(most, _MIN_CODED, _MAX_SAMPLES))


def frame_name(frame: LinearImage, number: int) -> str:
    """Name of a frame in errors."""
    return frame.meta.source or f"frame {number}"


def size_error(frame: LinearImage, number: int, size: Sequence[int]) -> str:
    """Message about a frame that differs from the `size` (width, height) of the others."""
    return (
        f"frames must be of one size; {frame_name(frame, number)} is "
        f"{frame.size[0]}x{frame.size[1]}, others {size[0]}x{size[1]}"
    )


def fit_gain(light: Floats, static: Floats, variance: Floats) -> Floats:
    """(3,) gain g of light = g · static, both (3, n), from pixels that agree within `variance`."""
    gain = median_ratio(light[:, ::8], static[:, ::8])
    for c, (x, B, s2) in enumerate(zip(light, static, variance, strict=True)):
        for _ in range(2):
            inliers = (x - gain[c] * B) ** 2 < MAX_RESIDUAL_STD**2 * s2
            inliers &= x >= kernel.MIN_SEEN
            weight = inliers * B / s2
            if (total := float(np.sum(weight * B))) > 0:
                gain[c] = max(float(np.sum(weight * x)) / total, _MIN_GAIN)
    return gain


def median_ratio(light: Floats, static: Floats) -> Floats:
    """(3,) median of light over static, both (3, n), where static is not dark."""
    gain = np.ones(3)
    for c, (x, B) in enumerate(zip(light, static, strict=True)):
        # Of the scene: of a moving lamp only one of them has light.
        maximum = np.minimum(x, B).max()
        bright = (_MIN_BRIGHTNESS * maximum < B) & (x >= kernel.MIN_SEEN)
        if bright.any():
            gain[c] = max(float(np.median(x[bright] / B[bright])), _MIN_GAIN)
    return gain


def gain_grid(shape: Sequence[int]) -> tuple[slice, slice]:
    """Rows and columns of a regular grid of pixels that determine the gain."""
    step = max(1, int(np.sqrt(shape[0] * shape[1] / _GAIN_PIXELS)))
    return slice(step // 2, None, step), slice(step // 2, None, step)


def _equally_spaced(
    frames: Iterable[LinearImage], count: int
) -> tuple[SampledLight, dict[int, LinearImage], list[str], list[Floats]]:
    """Frames at equal distances; some rows of each that is rounded; names; light of a few pixels."""
    light, names, few = SampledLight([], (1, 1), False, []), list[str](), list[Floats]()
    rows = dict[int, LinearImage]()
    for number, frame in _samples(frames, count):
        if not isinstance(frame, CodedFrame):
            check_picture(f"frame {number}" if names else "the first frame", frame)
        if not names:
            light = SampledLight([], frame.size, isinstance(frame, CodedFrame), [])
        grid = gain_grid(frame.size[::-1])
        if isinstance(frame, CodedFrame):
            image = frame.light((grid[1].start, grid[0].start, *frame.size), grid[0].step)
            light.parts.append(frame.light_of)
            if frame.rgb_codes is not None:
                light.codes.append(frame.rgb_codes())
        else:
            if frame.size != light.size:
                raise ValueError(size_error(frame, number, light.size))
            rows[len(names)] = _noise_rows(frame)
            image = LinearImage(frame.rgb[grid], meta=frame.meta)
            light.parts.append(partial(_part, frame.rgb.astype(np.float16)))
        names.append(frame_name(image, number))
        few.append(np.ascontiguousarray(image.rgb.astype(float).reshape(-1, 3).T))
    return light, rows, names, few


def _samples(
    frames: Iterable[LinearImage], count: int
) -> Iterator[tuple[int, LinearImage | CodedFrame]]:
    """Numbers of the samples, and frames as code values where these are kept without a rounding."""
    if count and isinstance(frames, CodedSequence):
        first = next(frames.coded(slice(0, 1)))
        if first.light_bytes:
            width, height = first.size
            which = _spaced(count, max_coded_samples(width * height, first.light_bytes))
            yield from zip(range(count)[which], frames.coded(which), strict=False)
            return
    one = next(iter(frames), None)
    if one is None:
        return
    check_picture("the first frame", one)
    most = _MAX_BYTES / (6 * one.valid.size)
    which = _spaced(count, int(np.clip(most, _MIN_SAMPLES, _MAX_SAMPLES)))
    start, step = which.start, which.step  # a sequence can read only these
    every = frames[which] if isinstance(frames, Sequence) else islice(frames, start, None, step)
    yield from zip(range(count)[which], every, strict=False)


def _spaced(count: int, most: int) -> slice:
    """At most so many frames at equal distances."""
    step = max(1, -(-count // most))
    return slice((count - 1) % step // 2, None, step)


def _part(light: npt.NDArray[np.float16], box: Box, every: int) -> LinearImage:
    x0, y0, x1, y1 = box
    return LinearImage(light[y0:y1:every, x0:x1:every].astype(np.float32))


def _noise_rows(frame: LinearImage) -> LinearImage:
    """Rows that suffice to measure noise."""
    rows = slice(None, None, _noise_step(frame.valid.size))
    return LinearImage(frame.rgb[rows].copy(), valid=frame.valid[rows].copy(), meta=frame.meta)


def _noise_step(pixels: int) -> int:
    """Distance of these rows."""
    return max(1, round(pixels / _NOISE_PIXELS))


def _pairs(count: int) -> list[tuple[int, int]]:
    """Pairs of samples whose differences are noise.

    They are about half a clip apart, since video repeats unchanged blocks for long. The distances
    differ, since clips may be periodic.
    """
    half = count // 2
    starts = np.linspace(0, count - 1 - half, _NOISE_PAIRS).astype(int)
    return [(int(i), int(i) + max(half - shorter, 1)) for shorter, i in enumerate(starts)]


def _noise(pairs: Iterable[tuple[LinearImage, LinearImage]]) -> NoiseModel:
    """Noise of one frame from differences of pairs; the median of a few pairs."""
    models, parts = [], list(pairs)
    for a, b in parts:
        ratio = median_ratio(b.rgb.reshape(-1, 3).T, a.rgb.reshape(-1, 3).T)
        b = replace(b, rgb=(b.rgb / ratio).astype(np.float32))
        first, second = fit_noise(a, b)
        models.append((first.coefficients + second.coefficients) / 2)
    strengths = [float(np.sum(model @ [1, 0.2, 0.04])) for model in models]  # at a light of 0.2
    model = models[np.argsort(strengths)[len(models) // 2]]
    rounding = 3.0 * rounding_noise(parts[0][0]).coefficients  # it changes light by whole steps
    float16 = 2.0**-22 / 3  # variance of its rounding over light²
    return NoiseModel.from_coefficients(model + rounding + [1e-12, 0, float16])


def _check_no_cut(small: Floats, names: Sequence[str]) -> None:
    """Raise CutError if most of the picture changes between two samples."""
    after = np.stack([b / median_ratio(b, a)[:, None] for a, b in pairwise(small)])
    change = np.abs(after - small[:-1])
    noise = MAD_TO_STD * np.median(change, axis=(0, 2), keepdims=True)
    threshold = MAX_RESIDUAL_STD * noise
    threshold = threshold + _MIN_CUT_CONTRAST * np.maximum(after, small[:-1])
    areas = (change > threshold).any(axis=1).mean(axis=1)
    at = int(np.argmax(areas))
    if areas[at] > _MAX_CHANGED_AREA:
        raise CutError(
            f"the scene is cut between {names[at]} and {names[at + 1]}: {areas[at]:.0%} of the "
            "picture changes; give the part before or after it (--frames)"
        )


def _gains(small: Floats, noise: NoiseModel) -> Floats:
    """(K, 3) gain of each sample against their median, both by alternating estimation."""
    gain = np.ones((len(small), 3))
    unseen = small < kernel.MIN_SEEN
    for _ in range(2):
        static = small / gain[..., None]
        if unseen.any():
            seen = np.ma.masked_array(static, unseen)
            median = np.ma.median(seen, axis=0)  # type: ignore[no-untyped-call]
            static = np.ma.filled(median, kernel.UNSEEN)
        else:
            static = np.median(static, axis=0)
        variance = noise.variance(static.T).T
        gain = np.array([fit_gain(x, static, variance) for x in small])
        gain /= np.median(gain, axis=0)
    return gain


def _check_drift(gain: Floats, names: Sequence[str]) -> None:
    mean = gain.mean(axis=1)
    low, high = int(np.argmin(mean)), int(np.argmax(mean))
    if mean[high] > _MAX_GAIN_RATIO * mean[low]:
        raise PlateError(
            f"the light changes too much for one plate: {names[high]} is "
            f"{mean[high] / mean[low]:.1f} times as bright as {names[low]}, at most "
            f"{_MAX_GAIN_RATIO:g} is possible; give a part of the clip with steady light "
            "(--frames)"
        )
