"""Layers and pictures to clips: ProRes and H.264 by FFmpeg through PyAV, GIF and WebP by Pillow.

All of FFmpeg are in the curve, primaries, matrix and limited range of Rec. 709, number 1 of ITU-T
H.273. In a ProRes with alpha colors are straight. Nothing in the file tells; FFmpeg's overlay takes
it so unless told otherwise, and the rounding of premultiplied colors would be divided by alpha.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from fractions import Fraction
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from blurmatte.checks import Floats
from blurmatte.files.clips import LIMITED_WHITE, video_library
from blurmatte.layer import Layer
from blurmatte.radiometry import REC709, SRGB, LinearImage

if TYPE_CHECKING:
    from av.filter import Graph
    from av.video.frame import VideoFrame

_BT709 = 1
_ALPHA_TOP = 1023  # 10 bits are what FFmpeg's encoder of ProRes takes
# A block of the codec is 8 pixels wide, and whoever scales a layer mixes a few pixels.
_REACH = 16
# The finest steps everywhere, however many bits that takes; vendor is what Apple's programs look for.
_PRORES = {"profile": "4444", "bits_per_mb": "8192", "vendor": "apl0"}
# Hardly to be told from the original; with a fixed number of threads the same bytes on every machine.
_H264 = {"crf": "16", "threads": "4"}
_TO_BT709 = (
    "flags=bicubic+accurate_rnd:out_color_matrix=bt709:out_range=limited:out_chroma_loc=left"
)
_QUALITY = 90  # of WebP


def save_prores(path: Path, things: Iterable[Layer | LinearImage | Any], rate: float) -> None:
    """ProRes 4444, with alpha if they are layers.

    Raises
    ------
    FileError
        If PyAV is missing.
    OSError
        If not all arrives.
    """
    with _clip(path, "prores_ks", rate, _PRORES) as add:
        for thing in things:
            colors = np.rint(_coded(thing) * LIMITED_WHITE).astype(np.uint16)
            if isinstance(thing, Layer):
                alpha = np.rint(np.clip(thing.alpha, 0, 1) * _ALPHA_TOP).astype(np.uint16) << 6
                add(np.dstack([colors, alpha]), "rgba64le", "yuva444p10le")
            else:
                add(colors, "rgb48le", "yuv444p10le")


def save_h264(path: Path, pictures: Iterable[LinearImage | Any], rate: float) -> None:
    """H.264 to look at; an odd size gets the last row or column once more, for 4:2:0 needs even ones.

    Raises
    ------
    FileError
        If PyAV is missing.
    OSError
        If not all arrives.
    """
    with _clip(path, "libx264", rate, _H264) as add:
        for picture in pictures:
            codes = np.rint(_coded(picture) * 255).astype(np.uint8)
            height, width = codes.shape[:2]
            even = np.pad(codes, ((0, height % 2), (0, width % 2), (0, 0)), mode="edge")
            add(even, "rgb24", "yuv420p")


def save_animation(path: Path, pictures: Iterable[LinearImage | Any], rate: float) -> None:
    """GIF or WebP that runs for ever.

    Raises
    ------
    OSError
        If not all arrives.
    """
    from PIL import Image

    frames = (Image.fromarray(_srgb(picture)) for picture in pictures)
    first = next(frames)
    first.save(
        path, save_all=True, append_images=frames, duration=1000 / rate, loop=0, quality=_QUALITY
    )


def _srgb(picture: LinearImage | npt.NDArray[np.uint8]) -> npt.NDArray[np.uint8]:
    if isinstance(picture, LinearImage):
        light = np.clip(picture.in_srgb().rgb, 0, 1)
        return np.asarray(np.rint(255 * SRGB.encode(light)), dtype=np.uint8)
    return picture


def _coded(thing: Layer | LinearImage | npt.NDArray[np.uint8]) -> Floats:
    """(H, W, 3) straight colors as code values of Rec. 709, 0…1."""
    if isinstance(thing, Layer):
        return _straight(thing)
    if isinstance(thing, LinearImage):
        return np.asarray(REC709.encode(np.clip(thing.in_srgb().rgb, 0, 1)))
    table = REC709.encode(SRGB.table(256)).astype(np.float32)
    return np.asarray(table.take(thing))


def _straight(layer: Layer) -> Floats:
    """Colors of what is there, and around it the nearest ones.

    Black beside the object would be mixed into its rim by the codec's blocks, and by scaling.
    """
    from scipy.ndimage import distance_transform_edt

    if not (np.isfinite(layer.alpha).all() and np.isfinite(layer.premultiplied).all()):
        raise ValueError("NaN cannot be written to a clip; use .exr or fill it")
    there = layer.alpha >= 0.5 / _ALPHA_TOP
    codes = np.zeros(layer.premultiplied.shape, np.float32)
    if there.any():
        color = layer.premultiplied[there] / layer.alpha[there][:, None]
        codes[there] = REC709.encode(np.clip(color, 0, 1))
        distance, (y, x) = distance_transform_edt(~there, return_indices=True)
        near = (distance > 0) & (distance <= _REACH)
        codes[near] = codes[y[near], x[near]]
    return codes


@contextmanager
def _clip(
    path: Path, codec: str, rate: float, options: Mapping[str, str]
) -> Iterator[Callable[[npt.NDArray[Any], str, str], None]]:
    """A function that adds one frame: codes, their format, and the format of the stream."""
    av = video_library(path)
    from av.video.reformatter import ColorRange

    steps = Fraction(rate).limit_denominator(1001)
    count = 0
    converter: Graph

    def add(codes: npt.NDArray[Any], form: str, pixels: str) -> None:
        nonlocal count, converter
        source = av.VideoFrame.from_ndarray(codes, format=form)
        if count == 0:
            stream.height, stream.width = codes.shape[:2]
            stream.pix_fmt = pixels
            converter = _converter(source, pixels)
        source.pts, source.time_base = count, 1 / steps
        converter.push(source)
        frame = converter.pull()
        assert isinstance(frame, av.VideoFrame)
        frame.color_primaries = frame.color_trc = _BT709
        frame.pts, frame.time_base = count, 1 / steps
        target.mux(stream.encode(frame))
        count += 1

    try:
        with av.open(str(path), "w") as target:
            stream = target.add_stream(codec, rate=steps, options=dict(options))
            context = stream.codec_context
            context.color_primaries = context.color_trc = context.colorspace = _BT709
            context.color_range = ColorRange.MPEG
            yield add
            target.mux(stream.encode())
    except av.FFmpegError as error:
        raise OSError(error.errno, error.strerror) from error


def _converter(frame: "VideoFrame", pixels: str) -> "Graph":
    """What turns frames like this one into Y'CbCr of Rec. 709.

    In 4:2:0 the color of two columns is that of the left one: so players and cameras have it where
    nothing is said (ITU-T H.264, figure E-1), and FFmpeg alone would put it between them.
    """
    from av.filter import Graph

    graph = Graph()
    parts = (
        graph.add_buffer(
            width=frame.width, height=frame.height, format=frame.format, time_base=Fraction(1, 1)
        ),
        graph.add("scale", _TO_BT709),
        graph.add("format", pixels),
        graph.add("buffersink"),
    )
    for part, following in pairwise(parts):
        part.link_to(following)
    graph.configure()
    return graph
