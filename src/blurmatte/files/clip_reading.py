"""Clips to linear light by FFmpeg through PyAV: properties of a video stream, and its frames.

Numbers of curves, primaries and matrices are those of ITU-T H.273. FFmpeg converts Y'CbCr to R'G'B'
by the matrix and range of the stream; here R'G'B' becomes light with the primaries of sRGB.
"""

import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from blurmatte.checks import Bools
from blurmatte.errors import BlurmatteWarning, FileError, TransferWarning
from blurmatte.files.chroma_siting import left_sited
from blurmatte.files.encoding import CICP_CURVES, H273, to_srgb_primaries
from blurmatte.files.errors import check_exists, check_size
from blurmatte.files.icc import Matrix, Profile
from blurmatte.layer import Layer
from blurmatte.radiometry.image import LinearImage, Meta
from blurmatte.radiometry.transfer import REC709, Transfer

LIMITED_WHITE = 65281  # FFmpeg's 16-bit R'G'B' code of white, from limited-range Y'CbCr

# x, y of red, green and blue; 5 is for 625 lines, 6 for 525 lines.
_PRIMARIES = {
    1: ((0.640, 0.330), (0.300, 0.600), (0.150, 0.060)),
    5: ((0.640, 0.330), (0.290, 0.600), (0.150, 0.060)),
    6: ((0.630, 0.340), (0.310, 0.595), (0.155, 0.070)),
    7: ((0.630, 0.340), (0.310, 0.595), (0.155, 0.070)),
    9: ((0.708, 0.292), (0.170, 0.797), (0.131, 0.046)),
    12: ((0.680, 0.320), (0.265, 0.690), (0.150, 0.060)),
}


@dataclass(frozen=True)
class Clip:
    """Properties of a video stream.

    Parameters
    ----------
    path : Path
        The file.
    count : int
        Number of frames, for some clips an estimate.
    size : (width, height)
        After rotation, pixels.
    rate : float or None
        Frames per second, on average.
    encoding : Profile
        Curves, and the matrix to the primaries of sRGB.
    bits : int
        Per code value.
    white : int
        The code value of white in FFmpeg's R'G'B' of 8 or 16 bits.
    alpha : bool
        True if it has an alpha channel.
    """

    path: Path
    count: int
    size: tuple[int, int]
    rate: float | None
    encoding: Profile
    bits: int
    white: int
    alpha: bool


def open_clip(path: Path, transfer: Transfer | None, max_pixels: int, stacklevel: int) -> Clip:
    """Read the properties of a clip and decode its first frame.

    Raises
    ------
    FileError
        If it cannot be read, has no video, or its encoding of light is not supported.

    Warns
    -----
    BlurmatteWarning
        If the file is truncated.
    TransferWarning
        If the clip does not state how code values encode light, and they are taken as Rec. 709.
    """
    with _opened(path) as (container, stream):
        rate = stream.average_rate
        count = stream.frames or sum(p.size > 0 for p in container.demux(stream))
        available = _available_frames(stream, count)
    if available < 0.9 * count:  # rates are averages, and durations are rounded
        warnings.warn(
            f"{path}: copy or export it again if it should be complete; "
            f"it ends after about {available} of {count} frames",
            BlurmatteWarning,
            stacklevel=stacklevel + 1,
        )
        count = available
    with _opened(path) as (container, stream):
        check_size(path, (stream.width, stream.height), max_pixels)
        first = next(container.decode(stream), None)
        if first is None:
            raise FileError(f"{path}: copy or export it again; no frame can be decoded")
        encoding = Profile(
            (_curve(path, first, transfer, stacklevel + 1),) * 3, _matrix(path, first)
        )
        bits = max(part.bits for part in first.format.components)
        return Clip(
            path=path,
            count=count,
            size=_size(first),
            rate=float(rate) if rate else None,
            encoding=encoding,
            bits=bits,
            white=_white(first, bits),
            alpha=any(part.is_alpha for part in first.format.components),
        )


def _available_frames(stream: Any, stated: int) -> int:
    """Number of frames in the duration of a `VideoStream`; `stated` if the duration is unknown."""
    rate, unit = stream.average_rate, stream.time_base
    if not (rate and unit and stream.duration):
        return stated
    frames: int = round(stream.duration * unit * rate)
    return frames


def decode_frames(clip: Clip, numbers: range) -> Iterator[LinearImage]:
    """The frames of these numbers, in order, decoded one at a time.

    Raises
    ------
    FileError
        If the clip is damaged, or its frames differ in size.
    """
    curve, table = clip.encoding.curves[0], _table(clip)
    for number, frame in _decoded(clip, numbers):
        codes = _codes(clip, frame)
        light = to_srgb_primaries(table.take(codes), clip.encoding)
        when = f" ({frame.time:.2f} s)" if frame.time is not None else ""
        name = f"{clip.path.name} frame {number}{when}"
        meta = Meta(name, curve, 2**clip.bits, time=frame.time)
        yield LinearImage(light, valid=_unclipped(clip, codes), meta=meta)


def decode_layers(clip: Clip, numbers: range) -> Iterator[Layer]:
    """The frames of a clip with alpha, whose colors are straight.

    Raises
    ------
    FileError
        As `decode_frames`.
    """
    table = _table(clip)
    shift = 16 - clip.bits if clip.bits > 8 else 0
    top = np.float32(2**clip.bits - 1)
    for _, frame in _decoded(clip, numbers):
        codes = _codes(clip, frame, alpha=True)
        alpha = (codes[..., 3] >> shift) / top
        light = to_srgb_primaries(table.take(codes[..., :3]), clip.encoding)
        yield Layer(alpha, light * alpha[..., None])


def _decoded(clip: Clip, numbers: range) -> Iterator[tuple[int, Any]]:
    """Numbers and `VideoFrame`s."""
    with _opened(clip.path) as (container, stream):
        stream.thread_type = "AUTO"
        frames = enumerate(container.decode(stream))
        for number, frame in islice(frames, numbers.start, numbers.stop, numbers.step):
            size = _size(frame)
            if size != clip.size:
                raise FileError(
                    f"{clip.path}: cut the clip at frame {number}; it has {size[0]}x{size[1]} pixels, "
                    f"but the first frame has {clip.size[0]}x{clip.size[1]}"
                )
            yield number, frame


def _size(frame: Any) -> tuple[int, int]:
    """Width and height after rotation."""
    sideways = frame.rotation % 180 != 0
    return (frame.height, frame.width) if sideways else (frame.width, frame.height)


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


def _table(clip: Clip) -> npt.NDArray[np.float32]:
    """Light of every code value."""
    codes = np.arange(256 if clip.bits <= 8 else 65536)
    return np.asarray(clip.encoding.curves[0].decode(codes / clip.white), dtype=np.float32)


def _codes(clip: Clip, frame: Any, alpha: bool = False) -> npt.NDArray[Any]:
    """(H, W, 3) R'G'B' code values of 8 or 16 bits, upright; with alpha as a fourth channel."""
    from av.video.reformatter import Interpolation

    # Without these flags code values are too small by one, and the chroma of 4:2:0 has steps.
    interpolation = (
        Interpolation.BICUBIC | Interpolation.FULL_CHR_H_INT | Interpolation.ACCURATE_RND
    )
    form = ("rgb24", "rgb48le", "rgba", "rgba64le")[2 * alpha + (clip.bits > 8)]
    default = (
        H273.BT709 if frame.height >= 720 else H273.BT601
    )  # as players treat clips without a matrix
    codes = (
        left_sited(frame)
        .reformat(
            format=form,
            src_colorspace=default if frame.colorspace == H273.UNSPECIFIED else None,
            interpolation=interpolation,
            threads=1,  # more threads are slower
        )
        .to_ndarray()
    )
    return np.rot90(codes, round(frame.rotation / 90))  # both are counterclockwise


def _unclipped(clip: Clip, codes: npt.NDArray[Any]) -> Bools:
    """(H, W) True where no channel is white."""
    white = clip.white - (clip.white >> (clip.bits + 1))  # less half a step of the file's bits
    red, green, blue = (codes[..., c] < white for c in range(3))
    return np.asarray(red & green & blue)


def _curve(path: Path, frame: Any, transfer: Transfer | None, stacklevel: int) -> Transfer:
    stated = int(frame.color_trc)
    if transfer is not None:
        return transfer
    if stated in CICP_CURVES:
        return CICP_CURVES[stated]
    if stated not in (0, H273.UNSPECIFIED):
        raise FileError(
            f"{path}: pass transfer= (--transfer) or convert the clip to BT.709; "
            f"its HDR or log curve (number {stated} of H.273) is not supported"
        )
    warnings.warn(
        f"{path}: pass transfer=REC709 (--transfer rec709) if that is right; "
        "the clip does not state how its code values encode light, and they are taken as Rec. 709",
        TransferWarning,
        stacklevel=stacklevel + 1,
    )
    return REC709


def _matrix(path: Path, frame: Any) -> Matrix | None:
    """(3, 3) matrix to the primaries of sRGB and BT.709; None if these are stated or nothing is."""
    stated = int(frame.color_primaries)
    if stated in (0, H273.BT709, H273.UNSPECIFIED):
        return None
    if stated not in _PRIMARIES:
        raise FileError(
            f"{path}: convert the clip to BT.709; its primaries (number {stated} of H.273) "
            "are not supported"
        )
    to_709 = np.linalg.solve(_to_xyz(_PRIMARIES[H273.BT709]), _to_xyz(_PRIMARIES[stated]))
    return np.asarray(to_709, dtype=np.float64)


def _to_xyz(primaries: Any) -> Matrix:
    """(3, 3) matrix from linear RGB, with white D65, to CIE XYZ (SMPTE RP 177)."""
    white = (0.3127, 0.3290)
    xyz = np.array([(x / y, 1, (1 - x - y) / y) for x, y in (*primaries, white)]).T
    return np.asarray(xyz[:, :3] * np.linalg.solve(xyz[:, :3], xyz[:, 3]), dtype=np.float64)


def video_library(path: Path) -> Any:
    """PyAV.

    Raises
    ------
    FileError
        If it is not installed.
    """
    try:
        import av
    except ImportError as error:
        raise FileError(
            f'{path}: pip install "blurmatte[video]", or use pictures; clips need PyAV'
        ) from error
    return av


@contextmanager
def _opened(path: Path) -> Iterator[tuple[Any, Any]]:
    """The container and its video stream; errors of FFmpeg become FileErrors."""
    av = video_library(path)
    check_exists(path, "give a clip, or the pictures in it")
    try:
        with av.open(str(path)) as container:
            if not container.streams.video:
                raise FileError(f"{path}: give a clip with pictures; the file holds no video")
            yield container, container.streams.video[0]
    except av.FFmpegError as error:
        raise FileError(
            f"{path}: copy or export it again; it is no clip, or it is damaged ({error.strerror})"
        ) from error
