"""Processing of code values in a camera, their rounding, and their compression as a clip.

Phones reduce noise, apply a tone curve and sharpen. In this file `values` are R'G'B' code values 0…1,
(H, W, 3), and `codes` are the integers of a file. None of the three steps is linear in light, and the
file does not record them: decoding it as sRGB does not recover the light.

For a clip R'G'B' is converted to Y'CbCr with the matrix and limited range of Rec. 709, 8 bits, and
4:2:0 with chroma sited at the left column (ITU-T H.264, figure E-1). The transfer curve is left to the
caller.
"""

import io
from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import numpy as np
import scipy

from blurmatte.checks import Array, Codes, Codes8, Floats, check_not_negative, check_positive
from blurmatte.errors import optional_library
from blurmatte.radiometry import LUMA_WEIGHTS, SRGB, YCBCR, Transfer
from blurmatte.radiometry.coded import rec709_converter

Rng = int | np.random.Generator

_RATE = Fraction(30)  # frames per second; the rate control of a constant crf depends on it


@dataclass(frozen=True)
class Processing:
    """Noise reduction, then a tone curve, then sharpening of code values.

    Parameters
    ----------
    noise_reduction : float
        Threshold s of a guided filter, in standard deviations of the noise, 0 or more. A variation of
        luma within 5 x 5 pixels of s times the noise is halved; stronger edges are preserved. In
        uniform regions the noise of luma is divided by about 1 + s², at most by 7. Chroma is smoothed
        within 9 x 9 pixels and at 2 s.
    tone : float
        Contrast added by an S-curve v + tone · (3 v² - 2 v³ - v), 0…1. It fixes code values of 0, 0.5
        and 1; its slope is 1 + tone / 2 in the middle and 1 - tone at both ends.
    sharpening : float
        Amount of an unsharp mask, 0 or more: factor of the difference between luma and blurred luma,
        which is added to all three channels.
    sharpening_radius : float
        Standard deviation of that blur, pixels, above 0.

    Raises
    ------
    ValueError
        For a number outside its range.
    """

    noise_reduction: float = 0.0
    tone: float = 0.0
    sharpening: float = 0.0
    sharpening_radius: float = 1.0

    def __post_init__(self) -> None:
        for name in ("noise_reduction", "sharpening"):
            check_not_negative(name, getattr(self, name))
        if not 0 <= self.tone <= 1:
            raise ValueError(f"tone must lie between 0 and 1, got {self.tone}")
        check_positive("sharpening_radius", self.sharpening_radius, "pixels")

    @property
    def active(self) -> bool:
        """True if any step is active."""
        return self.noise_reduction > 0 or self.tone > 0 or self.sharpening > 0

    def apply(self, values: Floats, variance: Floats) -> Array:
        """Process code values whose noise has a variance; not clipped: sharpening overshoots."""
        result: Array = np.asarray(values, dtype=np.float64)
        if self.noise_reduction > 0:
            result = _denoised(result, variance, self.noise_reduction)
        if self.tone > 0:
            result = tone_curve(result, self.tone)
        if self.sharpening > 0:
            result = _sharpened(result, self.sharpening, self.sharpening_radius)
        return result


def tone_curve(values: Floats, tone: float) -> Array:
    """The S-curve of `Processing`, extrapolated linearly outside 0…1."""
    inside = np.clip(values, 0, 1)
    curve = inside + tone * inside * (1 - inside) * (2 * inside - 1)
    return np.asarray(curve + (1 - tone) * (values - inside))


def _denoised(values: Array, variance: Floats, strength: float) -> Array:
    ycbcr, variance = values @ YCBCR.T, variance @ YCBCR.T**2
    filters = (1, 5), (2, 9), (2, 9)  # factor of the threshold, and window, of Y', Cb and Cr
    parts = [
        _guided_filter(ycbcr[..., c], variance[..., c], factor * strength, window)
        for c, (factor, window) in enumerate(filters)
    ]
    return np.asarray(np.stack(parts, axis=-1) @ np.linalg.inv(YCBCR).T)


def _guided_filter(x: Floats, variance: Floats, strength: float, window: int) -> Floats:
    """Self-guided filter (He, Sun and Tang, 2013) of a map (H, W).

    In each window x is replaced by a x + (1 - a) mean(x) with a = var(x) / (var(x) + strength² · noise
    variance); a and (1 - a) mean(x) are averaged over overlapping windows.
    """
    mean = _window_mean(x, window)
    spread = np.maximum(_window_mean(x**2, window) - mean**2, 0)
    total = spread + strength**2 * _window_mean(variance, window)
    a = np.divide(spread, total, out=np.ones_like(total), where=total > 0)
    return _window_mean(a, window) * x + _window_mean((1 - a) * mean, window)


def _window_mean(x: Floats, window: int) -> Floats:
    return np.asarray(scipy.ndimage.uniform_filter(x, window, mode="reflect"))


def _sharpened(values: Array, amount: float, radius: float) -> Array:
    Y = values @ np.array(LUMA_WEIGHTS)
    return np.asarray(values + amount * (Y - scipy.ndimage.gaussian_filter(Y, radius))[..., None])


def encode_codes(light: Floats, bits: int, transfer: Transfer = SRGB) -> Codes:
    """Encode linear `light` of any shape as rounded and clipped integer code values.

    The codes are those of `Camera.expose`: 10 and 12 bits fill the range of uint16.
    """
    check_bits(bits)
    return rounded(transfer.encode(light), bits)


def check_bits(bits: int) -> None:
    """Raise ValueError unless `bits` is a supported bit depth."""
    if bits not in (8, 10, 12, 16):
        raise ValueError(f"bits must be 8, 10, 12 or 16, got {bits}")


def check_8_bit_codes(codes: Codes) -> None:
    """Raise TypeError unless `codes` is (H, W, 3) uint8."""
    if codes.dtype != np.uint8 or codes.ndim != 3 or codes.shape[2] != 3:
        raise TypeError(f"codes must be (H, W, 3) uint8, got {codes.shape} {codes.dtype}")


def rounded(values: Floats, bits: int) -> Codes:
    """Round values 0…1 to the steps of `bits`, then scale to uint8 (8 bits) or uint16."""
    steps = 2**bits - 1
    codes: Floats = np.rint(steps * np.clip(values, 0, 1))
    if bits == 8:
        return codes.astype(np.uint8)
    codes = np.rint(codes * (65535 / steps))
    return codes.astype(np.uint16)


def through_h264(pictures: Sequence[Codes8], crf: float) -> list[Codes8]:
    """Encode R'G'B' codes (H, W, 3) as one H.264 clip, yuv420p and Rec. 709, and decode its frames.

    Odd sizes are padded by repeating the last row or column. The result is deterministic. `crf` is the
    constant rate factor of x264, 0…51: 17 is almost invisible, 23 the default, 35 coarse. Raises
    BlurmatteError if PyAV is missing.
    """
    if not pictures:
        raise ValueError("pictures must be one or more, got none")
    for codes in pictures:
        check_8_bit_codes(codes)
        if codes.shape != pictures[0].shape:
            raise ValueError(
                f"pictures must have one size, got {pictures[0].shape} and {codes.shape}"
            )
    check_crf(crf)
    height, width = pictures[0].shape[:2]
    return [frame[:height, :width] for frame in _decoded(_encoded(pictures, crf))]


def check_crf(crf: float) -> None:
    """Raise ValueError unless `crf` is a constant rate factor of x264."""
    if not 0 <= crf <= 51:
        raise ValueError(f"crf must lie between 0 and 51, got {crf}")


def _encoded(pictures: Sequence[Codes8], crf: float) -> bytes:
    """Encode pictures as an MP4 file."""
    av = _video_library()
    from av.video.reformatter import ColorRange

    height, width = pictures[0].shape[:2]
    even = (0, height % 2), (0, width % 2), (0, 0)
    file = io.BytesIO()
    with av.open(file, "w", format="mp4") as target:
        # One thread: the rate control depends on the number of threads.
        stream = target.add_stream("libx264", rate=_RATE, options={"crf": str(crf), "threads": "1"})
        stream.pix_fmt = "yuv420p"
        stream.height, stream.width = height + height % 2, width + width % 2
        context = stream.codec_context
        # Rec. 709 in ITU-T H.273
        context.color_primaries = context.color_trc = context.colorspace = 1
        context.color_range = ColorRange.MPEG
        sources = [
            av.VideoFrame.from_ndarray(np.pad(codes, even, mode="edge"), format="rgb24")
            for codes in pictures
        ]
        converter = rec709_converter(sources[0], stream.pix_fmt)
        for number, source in enumerate(sources):
            source.pts, source.time_base = number, 1 / _RATE
            converter.push(source)
            frame: Any = converter.pull()
            frame.pts, frame.time_base = number, 1 / _RATE
            target.mux(stream.encode(frame))
        target.mux(stream.encode())
    return file.getvalue()


def _decoded(file: bytes) -> list[Codes8]:
    """R'G'B' codes of all frames, decoded with the file's matrix, range and chroma siting."""
    av = _video_library()
    from av.video.reformatter import Interpolation

    # The default flags round codes down and repeat chroma instead of interpolating it.
    flags = Interpolation.BICUBIC | Interpolation.FULL_CHR_H_INT | Interpolation.ACCURATE_RND
    with av.open(io.BytesIO(file)) as clip:
        stream = clip.streams.video[0]
        stream.codec_context.thread_count = 1
        frames = clip.decode(stream)
        return [f.reformat(format="rgb24", interpolation=flags).to_ndarray() for f in frames]


def _video_library() -> Any:
    needed = 'H.264 needs one package more: pip install "blurmatte[video]"; or take a JPEG'
    return optional_library("av", needed)
