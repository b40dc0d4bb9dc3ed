"""Layers and pictures to clips: ProRes and H.264 by FFmpeg through PyAV, GIF and WebP by Pillow.

ProRes and H.264 have the curve, primaries, matrix and limited range of Rec. 709. The colors of a
ProRes with alpha are straight: FFmpeg's overlay assumes it, the file cannot state it, and division by
alpha would amplify the rounding of premultiplied colors.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import scipy

from blurmatte.checks import AnyArray, Codes8, Floats
from blurmatte.files.clip_decoding import video_library
from blurmatte.files.clip_reading import LIMITED_WHITE
from blurmatte.files.icc import H273
from blurmatte.formats import GIF, named
from blurmatte.layer import Layer
from blurmatte.radiometry.coded import rec709_converter
from blurmatte.radiometry.image import LinearImage
from blurmatte.radiometry.transfer import REC709, SRGB

_ALPHA_WHITE = 1023  # FFmpeg's encoder of ProRes takes 10 bits
# The finest quantization at any bit rate; Apple's programs check the vendor.
_PRORES = {"profile": "4444", "bits_per_mb": "8192", "vendor": "apl0"}
# Visually lossless; with a fixed number of threads the bytes are the same on every machine.
_H264 = {"crf": "16", "threads": "4"}


def save_prores(path: Path, things: Iterable[Layer | LinearImage | Any], rate: float) -> None:
    """ProRes 4444, with alpha if they are layers; needs PyAV."""
    with _clip(path, "prores_ks", rate, _PRORES) as add:
        for thing in things:
            colors = np.rint(_coded(thing) * LIMITED_WHITE).astype(np.uint16)
            if isinstance(thing, Layer):
                alpha = np.rint(np.clip(thing.alpha, 0, 1) * _ALPHA_WHITE).astype(np.uint16) << 6
                add(np.dstack([colors, alpha]), "rgba64le", "yuva444p10le")
            else:
                add(colors, "rgb48le", "yuv444p10le")


def save_h264(path: Path, pictures: Iterable[LinearImage | Any], rate: float) -> None:
    """H.264 for viewing; the last row or column of odd sizes is repeated, as 4:2:0 needs even sizes.

    Needs PyAV. Raises OSError, as all functions here, if the file cannot be written completely.
    """
    with _clip(path, "libx264", rate, _H264) as add:
        for picture in pictures:
            codes = np.rint(_coded(picture) * 255).astype(np.uint8)
            height, width = codes.shape[:2]
            even = np.pad(codes, ((0, height % 2), (0, width % 2), (0, 0)), mode="edge")
            add(even, "rgb24", "yuv420p")


def save_animation(path: Path, pictures: Iterable[LinearImage | Any], rate: float) -> None:
    """GIF or WebP in an endless loop."""
    from PIL import Image

    frames = (Image.fromarray(_srgb(picture)) for picture in pictures)
    if named(path) is GIF:
        # An octree keeps the colors of a small object; Pillow's median cut gives them to the scene.
        octree = Image.Quantize.FASTOCTREE
        frames = (frame.quantize(palette=frame.quantize(256, octree)) for frame in frames)
    first = next(frames)
    first.save(path, save_all=True, append_images=frames, duration=1000 / rate, loop=0, quality=90)


def _srgb(picture: LinearImage | Codes8) -> Codes8:
    if isinstance(picture, LinearImage):
        light = np.clip(picture.in_srgb().rgb, 0, 1)
        return np.asarray(np.rint(255 * SRGB.encode(light)), dtype=np.uint8)
    return picture


def _coded(thing: Layer | LinearImage | Codes8) -> Floats:
    """(H, W, 3) straight colors as code values of Rec. 709, 0…1."""
    if isinstance(thing, Layer):
        return _straight(thing)
    if isinstance(thing, LinearImage):
        return np.asarray(REC709.encode(np.clip(thing.in_srgb().rgb, 0, 1)))
    table = REC709.encode(SRGB.table(256)).astype(np.float32)
    return np.asarray(table.take(thing))


def _straight(layer: Layer) -> Floats:
    """Straight colors of the object, extended by the nearest ones around it.

    Black pixels around the object would bleed into its rim by the codec's 8-pixel blocks and by
    scaling.
    """
    if not (np.isfinite(layer.alpha).all() and np.isfinite(layer.premultiplied).all()):
        raise ValueError("use .exr or replace NaN; a clip cannot hold it")
    visible = layer.alpha >= 0.5 / _ALPHA_WHITE
    codes = np.zeros(layer.premultiplied.shape, np.float32)
    if visible.any():
        color = layer.premultiplied[visible] / layer.alpha[visible][:, None]
        codes[visible] = REC709.encode(np.clip(color, 0, 1))
        distance, (y, x) = scipy.ndimage.distance_transform_edt(~visible, return_indices=True)
        near = (distance > 0) & (distance <= 16)  # pixels
        codes[near] = codes[y[near], x[near]]
    return codes


@contextmanager
def _clip(
    path: Path, codec: str, rate: float, options: Mapping[str, str]
) -> Iterator[Callable[[AnyArray, str, str], None]]:
    """A function that adds one frame: code values, their format, and the format of the stream."""
    av = video_library(path)
    from av.video.reformatter import ColorRange

    steps = Fraction(rate).limit_denominator(1001)
    count = 0
    converter: Any = None

    def add(codes: AnyArray, form: str, pixels: str) -> None:
        """Encode one frame."""
        nonlocal count, converter
        source = av.VideoFrame.from_ndarray(codes, format=form)
        if count == 0:
            stream.height, stream.width = codes.shape[:2]
            stream.pix_fmt = pixels
            converter = rec709_converter(source, pixels)
        source.pts, source.time_base = count, 1 / steps
        converter.push(source)
        frame = converter.pull()
        frame.color_primaries = frame.color_trc = H273.BT709
        frame.pts, frame.time_base = count, 1 / steps
        target.mux(stream.encode(frame))
        count += 1

    try:
        with av.open(str(path), "w") as target:
            stream = target.add_stream(codec, rate=steps, options=dict(options))
            context = stream.codec_context
            context.color_primaries = context.color_trc = context.colorspace = H273.BT709
            context.color_range = ColorRange.MPEG
            yield add
            target.mux(stream.encode())
    except av.FFmpegError as error:
        raise OSError(error.errno, error.strerror) from error
