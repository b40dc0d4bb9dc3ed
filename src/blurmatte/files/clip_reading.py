"""Clips to linear light by FFmpeg through PyAV: properties of a video stream, and its frames.

Numbers of curves, primaries and matrices are those of ITU-T H.273. FFmpeg converts Y'CbCr to R'G'B'
by the matrix and range of the stream; here R'G'B' becomes light with the primaries of sRGB.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from pathlib import Path
from typing import Any

import numpy as np

from blurmatte.checks import AnyArray, Array, Bools, Box, Floats, Floats32, strips
from blurmatte.errors import FileError, TransferWarning, warn
from blurmatte.files import clip_geometry
from blurmatte.files.clip_decoding import decoded, decoded_packets, opened, video_library, videos_of
from blurmatte.files.clip_times import Timing, timing_of
from blurmatte.files.encoding import CICP_CURVES, to_srgb_primaries
from blurmatte.files.errors import check_size, check_square_pixels
from blurmatte.files.icc import CICP_PRIMARIES, H273, Profile, matrix_to_srgb
from blurmatte.layer import Layer
from blurmatte.radiometry.coded import CodedFrame, RgbCodes
from blurmatte.radiometry.compression import CodingErrors, FrameCoding
from blurmatte.radiometry.image import LinearImage, Meta
from blurmatte.radiometry.sensor import Orientation
from blurmatte.radiometry.transfer import LUMA_WEIGHTS, LUMA_WEIGHTS_709, REC709, Transfer

_ALPHA_DECODERS = {"vp8": "libvpx", "vp9": "libvpx-vp9"}  # FFmpeg's own decode no alpha
MAX_CHROMA_SHIFT_PX = 0.65  # of a saturated disc, measured: its luma counts less than its chroma
_UNSTATED = 0, H273.UNSPECIFIED  # transfer characteristics
LIMITED_WHITE = 65281  # FFmpeg's 16-bit R'G'B' code of white, from limited-range Y'CbCr


@dataclass(frozen=True)
class Clip:
    """Properties of a video stream."""

    path: Path  # the file
    size: tuple[int, int]  # upright, pixels
    timing: Timing  # number and times of the frames
    orientation: Orientation  # of the stored frames
    rotation: int  # the same as FFmpeg states it, degrees
    codec: str  # in FFmpeg's words, as the next
    pixel_format: str
    decoder: str  # name of FFmpeg's decoder; "" for the usual one
    # Where its chroma lies, in FFmpeg's words; "" if not known, None if it is not subsampled
    siting: str | None
    encoding: Profile  # curves, and the matrix to the primaries of sRGB
    bits: int  # per code value
    white: int  # the code value of white in FFmpeg's R'G'B' of 8 or 16 bits
    alpha: bool  # true if it has an alpha channel
    curve_assumed: bool = False  # true if neither the file nor the caller states the transfer curve

    @property
    def place_std(self) -> tuple[float, float]:
        """Error of all places in x and in y, pixels: 0 or the largest, if chroma's is not known."""
        std = MAX_CHROMA_SHIFT_PX / 2**0.5 if self.siting == "" else 0.0
        return (0.0, std) if self.orientation.transposed else (std, 0.0)


def open_clip(path: Path, transfer: Transfer | None, max_pixels: int) -> Clip:
    """Read the properties of a clip and decode its first frames.

    Raises FileError if it cannot be read, has no video, or its geometry or encoding of light is not
    supported. Warns BlurmatteWarning if the file is truncated, holds several videos, or was not
    taken at the rate it is played at. Warns TransferWarning if the clip does not state how code
    values encode light, and they are taken as Rec. 709.
    """
    with opened(path) as (container, stream):
        size = stream.width, stream.height
        check_size(path, size, max_pixels)
        check_square_pixels(
            path, size, stream.sample_aspect_ratio, "ffmpeg -i … -vf scale={}:{},setsar=1"
        )
        videos = videos_of(container)
        if len(videos) > 1:
            warn(
                f"{path}: extract another one if that is meant; it holds {len(videos)} videos, and "
                f"number {videos.index(stream) + 1} is read"
            )
        decoder = _decoder_with_alpha(path, stream)
        timing = timing_of(path, container, stream, partial(_all_decoded, path, decoder))
    with opened(path) as (container, stream):
        first = next(decoded_packets(container, stream, decoder))
        clip_geometry.check_progressive(path, first, stream.codec_context.field_order)
        orientation = clip_geometry.orientation_of(path, first)
        encoding = Profile((_curve(path, first, transfer),) * 3, _matrix(path, first))
        bits = max(part.bits for part in first.format.components)
        return Clip(
            path=path,
            size=orientation.size(first.width, first.height),
            timing=timing,
            orientation=orientation,
            rotation=first.rotation,
            codec=stream.codec.name,
            pixel_format=first.format.name,
            decoder=decoder,
            siting=clip_geometry.siting_of(first),
            encoding=encoding,
            bits=bits,
            white=_white(first, bits),
            alpha=any(part.is_alpha for part in first.format.components),
            curve_assumed=transfer is None and int(first.color_trc) in _UNSTATED,
        )


def _all_decoded(path: Path, decoder: str) -> Iterator[Any]:
    """The `VideoFrame`s of a clip from its beginning."""
    with opened(path) as (container, stream):
        yield from decoded_packets(container, stream, decoder)


def _decoder_with_alpha(path: Path, stream: Any) -> str:
    """Name of the decoder of VP8 and VP9 that reads their alpha; "" if the usual one does."""
    from av import codecs_available

    tags = {name.lower(): text for name, text in stream.metadata.items()}
    if tags.get("alpha_mode") != "1" or stream.codec.name not in _ALPHA_DECODERS:
        return ""
    name = _ALPHA_DECODERS[stream.codec.name]
    if name not in codecs_available:
        raise FileError(
            f"{path}: export ProRes 4444, EXR or PNG; its alpha needs {name}, which this PyAV lacks"
        )
    return name


def decode_frames(
    clip: Clip, numbers: range, coding_errors: Callable[..., CodingErrors | None] | None = None
) -> Iterator[LinearImage]:
    """The frames of these numbers, in order, decoded one at a time.

    Their errors by the codec are `coding_errors(clip, numbers)`, if it is given.

    Raises FileError if the clip is damaged or its frames differ in size, as do all decoders here.
    """
    for number, frame in _decoded(clip, numbers):
        coding = None
        if coding_errors is not None:
            coding = FrameCoding(partial(coding_errors, clip, (number,)))
        time = clip.timing.time_of(number, frame)
        yield _light(clip, _codes(clip, frame), number, time, coding)


def _light(
    clip: Clip,
    codes: AnyArray,
    number: int,
    time: float | None,
    coding: FrameCoding | None = None,
) -> LinearImage:
    """Linear light of some of the code values of a frame."""
    light = to_srgb_primaries(_table(clip).take(codes), clip.encoding)
    when = f" ({time:.2f} s)" if time is not None else ""
    name = f"{clip.path.name} frame {number}{when}"
    curve, readout = clip.encoding.curves[0], clip.orientation.readout
    levels = 2**clip.bits
    meta = Meta(name, curve, levels=levels, time=time, coding=coding, readout=readout)
    return LinearImage(light, valid=_unclipped(clip, codes), meta=meta)


def sited_by(clip: Clip, plate: LinearImage | None, number: int) -> Clip:
    """The clip, with its chroma where that of frame `number` agrees with a plate of the scene.

    Warns BlurmatteWarning if neither it nor the edges of the scene show where chroma lies.
    """
    if clip.siting is None:
        return clip
    if plate is not None and plate.size == clip.size:
        upright = replace(clip, siting="left", orientation=Orientation())
        for frame in decode_frames(upright, range(number, number + 1)):
            shown = clip.orientation.stored(plate.rgb)
            pair = (_chroma(clip, light) for light in (frame.rgb, shown))
            clip = replace(clip, siting=clip_geometry.siting_against(*pair) or clip.siting)
    if not clip.siting:
        warn(
            "neither the file nor edges of the scene show where its subsampled chroma lies: all places "
            f"may be up to {MAX_CHROMA_SHIFT_PX:g} px off alike, to one side"
        )
    return clip


def _chroma(clip: Clip, light: Floats) -> list[Array]:
    """Two differences of code values, which luma does not change."""
    codes = 255 * np.asarray(clip.encoding.curves[0].encode(np.maximum(light, 0)), float)
    return [codes[..., c] - codes[..., 1] for c in (0, 2)]


def decode_layers(clip: Clip, numbers: range) -> Iterator[Layer]:
    """The frames of a clip with alpha, whose colors are straight."""
    shift = 16 - clip.bits if clip.bits > 8 else 0
    top = np.float32(2**clip.bits - 1)
    for _, frame in _decoded(clip, numbers):
        codes = _codes(clip, frame, alpha=True)
        alpha = (codes[..., 3] >> shift) / top
        light = to_srgb_primaries(_table(clip).take(codes[..., :3]), clip.encoding)
        yield Layer(alpha, light * alpha[..., None])


def decode_coded(clip: Clip, numbers: range) -> Iterator[CodedFrame]:
    """The frames of these numbers as code values, Y'CbCr 4:2:0 of 8 bits; see `CodedFrame`.

    The clip stays open, for the frames after them.

    Raises
    ------
    FileError
        As `decode_frames`.
    """
    for number, frame in _decoded(clip, numbers, keep_open=True):
        yield _coded(clip, number, frame)


def coded_picture(clip: Clip, picture: LinearImage) -> CodedFrame:
    """A picture of linear sRGB in the code values that `decode_coded` gives."""
    av = video_library(clip.path)
    rgb = np.empty(picture.rgb.shape, np.uint16)
    for strip in strips(len(rgb)):
        light = picture.rgb[strip].astype(float)
        if clip.encoding.matrix is not None:
            light = light @ np.linalg.inv(clip.encoding.matrix).T
        codes = clip.encoding.curves[0].encode(np.clip(light, 0, 1))
        rgb[strip] = np.rint(65535 * np.clip(codes, 0, 1))
    _, like = next(_decoded(clip, range(1)))
    frame = av.VideoFrame.from_ndarray(rgb, format="rgb48le").reformat(
        format="yuv420p",
        dst_colorspace=_usual_matrix(like) if like.format.is_rgb else _stated_matrix(like),
        dst_color_range=like.color_range if _is_planar(like) else None,
        threads=1,
    )
    planes = planes_of(frame)
    return CodedFrame(-1, None, planes, zero_of(like), 1.0, lambda box, every: picture.crop(box))


def _coded(clip: Clip, number: int, frame: Any) -> CodedFrame:
    """A `VideoFrame` as code values; its light is converted when it is first asked for."""
    same = planar(frame)
    time, size = clip.timing.time_of(number, frame), 3 if clip.bits <= 8 else 6
    luma, blue, red = (
        np.ascontiguousarray(clip.orientation.upright(plane)) for plane in planes_of(same)
    )
    light_of = _LightOf(clip, number, time, frame)
    rgb_codes = light_of.rgb_codes if clip.encoding.matrix is None else None
    planes = luma, blue, red
    return CodedFrame(number, time, planes, zero_of(same), 1.0, light_of, size, rgb_codes)


@dataclass(eq=False)
class _LightOf:
    """Light of boxes of a `VideoFrame`, of which only R'G'B' codes are kept once it is asked for."""

    clip: Clip
    number: int
    time: float | None
    frame: Any
    codes: AnyArray | None = None

    def __call__(self, box: Box, every: int) -> LinearImage:
        x0, y0, x1, y1 = box
        part = self.rgb_codes().codes[y0:y1:every, x0:x1:every]
        return _light(self.clip, part, self.number, self.time)

    def rgb_codes(self) -> RgbCodes:
        """The code values of the frame, which are kept."""
        if self.codes is None:
            self.codes, self.frame = _codes(self.clip, self.frame), None
        return RgbCodes(self.codes, _table(self.clip))


def _is_planar(frame: Any) -> bool:
    """Whether a frame has the planes of `CodedFrame` already."""
    return frame.format.name in ("yuv420p", "yuvj420p")


def planar(frame: Any) -> Any:
    """A `VideoFrame` with the planes of `CodedFrame`: itself, if it has these."""
    return frame if _is_planar(frame) else frame.reformat(format="yuv420p", threads=1)


def planes_of(frame: Any) -> tuple[AnyArray, AnyArray, AnyArray]:
    """Views of luma and both chroma planes of a frame of 4:2:0 and 8 bits."""
    luma, blue, red = (
        np.frombuffer(plane, np.uint8).reshape(plane.height, plane.line_size)[:, : plane.width]
        for plane in frame.planes
    )
    return luma, blue, red


def luma_weights(frame: Any) -> tuple[float, float, float]:
    """Of the matrix of a `VideoFrame`, if it is that of BT.601 or BT.709."""
    return LUMA_WEIGHTS_709 if _stated_matrix(frame) == H273.BT709 else LUMA_WEIGHTS


def zero_of(frame: Any) -> tuple[float, float, float]:
    """Code values of black and of gray."""
    from av.video.reformatter import ColorRange

    full = frame.color_range == ColorRange.JPEG or frame.format.name == "yuvj420p"
    return (0.0 if full else 16.0, 128.0, 128.0)


def _stated_matrix(frame: Any) -> int:
    """Number of H.273 of the matrix of a frame, or of the usual one of its size."""
    stated = int(frame.colorspace)
    return _usual_matrix(frame) if stated == H273.UNSPECIFIED else stated


def _decoded(clip: Clip, numbers: range, keep_open: bool = False) -> Iterator[tuple[int, Any]]:
    """Numbers and `VideoFrame`s."""
    missing = 0
    for number, frame in decoded(clip.path, clip.timing, clip.decoder, numbers, keep_open):
        if frame is None:
            missing += 1
        else:
            yield number, _checked(clip, number, frame)
    if missing > 0:
        warn(
            f"{clip.path}: copy or export it again; {missing} of {clip.timing.count} frames cannot be "
            "decoded"
        )


def _checked(clip: Clip, number: int, frame: Any) -> Any:
    """The frame; raises FileError unless it is like the first one."""
    clip_geometry.check_progressive(clip.path, frame, 0)
    size = clip.orientation.size(frame.width, frame.height)
    # The display matrix itself is in `side_data`, which would keep every frame in memory.
    if size != clip.size or frame.rotation != clip.rotation:
        raise FileError(
            f"{clip.path}: cut the clip at frame {number}; it has {size[0]}x{size[1]} pixels, "
            f"but the first frame has {clip.size[0]}x{clip.size[1]}, or it is turned otherwise"
        )
    return frame


def _white(frame: Any, bits: int) -> int:
    """The code value of white in FFmpeg's R'G'B' of a frame.

    More than 8 bits become 16, and white is not rescaled to 65535: from limited-range Y'CbCr it is
    slightly more than 255 · 256, from full range its low bits are zero.
    """
    from av.video.reformatter import ColorRange

    if bits <= 8:
        return 255
    if frame.format.is_rgb:
        return 65535
    gray = sum(not part.is_alpha for part in frame.format.components) == 1
    if gray or frame.color_range == ColorRange.JPEG:
        return 65535 - (65535 >> bits)
    return LIMITED_WHITE


@lru_cache(maxsize=2)  # of the clip that is read, and one that is compared with it
def _table(clip: Clip) -> Floats32:
    """Light of every code value."""
    codes = np.arange(256 if clip.bits <= 8 else 65536)
    return np.asarray(clip.encoding.curves[0].decode(codes / clip.white), dtype=np.float32)


def _codes(clip: Clip, frame: Any, alpha: bool = False) -> AnyArray:
    """(H, W, 3) R'G'B' code values of 8 or 16 bits, upright; with alpha as a fourth channel."""
    from av.video.reformatter import Interpolation

    # Without these flags code values are too small by one, and the chroma of 4:2:0 has steps.
    interpolation = (
        Interpolation.BICUBIC | Interpolation.FULL_CHR_H_INT | Interpolation.ACCURATE_RND
    )
    form = ("rgb24", "rgb48le", "rgba", "rgba64le")[2 * alpha + (clip.bits > 8)]
    default = _usual_matrix(frame)
    codes = (
        clip_geometry.with_siting(frame, clip.siting)
        .reformat(
            format=form,
            src_colorspace=default if frame.colorspace == H273.UNSPECIFIED else None,
            interpolation=interpolation,
            threads=1,  # more threads are slower
        )
        .to_ndarray()
    )
    return clip.orientation.upright(codes)


def _usual_matrix(frame: Any) -> int:
    """The matrix that players assume for clips without one."""
    return H273.BT709 if frame.height >= 720 else H273.BT601


def _unclipped(clip: Clip, codes: AnyArray) -> Bools:
    """(H, W) True where no channel is white."""
    white = clip.white - (clip.white >> (clip.bits + 1))  # less half a step of the file's bits
    red, green, blue = (codes[..., c] < white for c in range(3))
    return np.asarray(red & green & blue)


def _curve(path: Path, frame: Any, transfer: Transfer | None) -> Transfer:
    stated = int(frame.color_trc)
    if transfer is not None:
        return transfer
    if stated in CICP_CURVES:
        return CICP_CURVES[stated]
    if stated not in _UNSTATED:
        raise FileError(
            f"{path}: its curve (number {stated} of H.273) is not supported; name that of the camera "
            "with transfer= (--transfer), such as slog3, or convert the clip to BT.709"
        )
    warn(
        f"{path}: the clip does not state how its code values encode light, and they are taken as "
        "Rec. 709; if that is right, pass transfer=REC709 (--transfer rec709)",
        TransferWarning,
    )
    return REC709


def _matrix(path: Path, frame: Any) -> Array | None:
    """(3, 3) matrix to the primaries of sRGB and BT.709; None if these are stated or nothing is."""
    stated = int(frame.color_primaries)
    if stated in (0, H273.BT709, H273.UNSPECIFIED):
        return None
    if stated not in CICP_PRIMARIES:
        raise FileError(
            f"{path}: convert the clip to BT.709; its primaries (number {stated} of H.273) "
            "are not supported"
        )
    return matrix_to_srgb(CICP_PRIMARIES[stated])
