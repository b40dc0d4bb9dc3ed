"""Clips to linear light, by FFmpeg through PyAV: what a video stream says of itself, and its frames.

Numbers in the tags are those of ITU-T H.273. FFmpeg turns Y'CbCr of any range into R'G'B' by the
stream's own matrix; here R'G'B' becomes light with the primaries of sRGB.
"""

import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from blurmatte.checks import Bools
from blurmatte.errors import BlurmatteWarning, FileError, TransferWarning
from blurmatte.files.encoding import CICP_CURVES, to_srgb_primaries
from blurmatte.files.icc import Matrix, Profile
from blurmatte.files.refusals import check_size
from blurmatte.files.siting import co_sited
from blurmatte.layer import Layer
from blurmatte.radiometry import REC709, LinearImage, Meta, Transfer

if TYPE_CHECKING:
    from av.container import InputContainer
    from av.video.frame import VideoFrame
    from av.video.stream import VideoStream

_UNSAID = 2  # of curve, primaries and matrix: "unspecified"
_BT709, _BT601 = 1, 5  # matrices; 1 is BT.709's number everywhere
LIMITED_WHITE = 65281  # of 16 bits, as FFmpeg has it for Y'CbCr of the limited range
_CUT = 0.9  # of the frames: rates are averages, and durations rounded
_HD_HEIGHT = 720  # players take untagged clips of at least this height as BT.709, else as BT.601
_WHITE_D65 = (0.3127, 0.3290)
# x, y of red, green and blue. Those of 625 and 525 lines, 5 and 6, are kept apart from BT.709's.
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
    """What a video stream says of itself.

    Parameters
    ----------
    path : Path
        The file.
    count : int
        How many frames it claims to have.
    size : (width, height)
        As it is shown, pixels.
    rate : float or None
        Frames per second, on average.
    encoding : Profile
        Curves, and the matrix to the primaries of sRGB.
    bits : int
        Of a code value.
    white : int
        The code value of white, as FFmpeg's R'G'B' of 8 or 16 bits has it.
    alpha : bool
        It has an alpha channel.
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
    """Look at a clip and decode its first frame.

    Raises
    ------
    FileError
        If it cannot be read, has no video, or its light is encoded in a way beyond us.

    Warns
    -----
    BlurmatteWarning
        If the file was cut short.
    TransferWarning
        If nothing says how code values encode light, and they are taken as Rec. 709.
    """
    with _opened(path) as (container, stream):
        rate = stream.average_rate
        count = stream.frames or sum(p.size > 0 for p in container.demux(stream))
        there = _there(stream, count)
    if there < _CUT * count:
        warnings.warn(
            f"{path}: ends after about {there} of the {count} frames that it claims to have: it was "
            "cut short; copy or export it again if it should be whole",
            BlurmatteWarning,
            stacklevel=stacklevel + 1,
        )
        count = there
    with _opened(path) as (container, stream):
        check_size(path, (stream.width, stream.height), max_pixels)
        first = next(container.decode(stream), None)
        if first is None:
            raise FileError(f"{path}: no frame can be decoded; copy or export it again")
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


def _there(stream: "VideoStream", claimed: int) -> int:
    """How many frames fit into the time for which there are data; as claimed if that is not told."""
    rate, unit = stream.average_rate, stream.time_base
    if not (rate and unit and stream.duration):
        return claimed
    return round(stream.duration * unit * rate)


def decode_frames(clip: Clip, numbers: range) -> Iterator[LinearImage]:
    """The frames of these numbers, in order. One is in memory at a time.

    Raises
    ------
    FileError
        If the clip is damaged, or its frames change their size.
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
    """The same of a clip with alpha, whose colors are straight.

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


def _decoded(clip: Clip, numbers: range) -> "Iterator[tuple[int, VideoFrame]]":
    with _opened(clip.path) as (container, stream):
        stream.thread_type = "AUTO"
        frames = enumerate(container.decode(stream))
        for number, frame in islice(frames, numbers.start, numbers.stop, numbers.step):
            size = _size(frame)
            if size != clip.size:
                raise FileError(
                    f"{clip.path}: frame {number} is {size[0]}x{size[1]} pixels, the "
                    f"first {clip.size[0]}x{clip.size[1]}; cut the clip there"
                )
            yield number, frame


def _size(frame: "VideoFrame") -> tuple[int, int]:
    """As it is shown."""
    on_a_side = frame.rotation % 180 != 0
    return (frame.height, frame.width) if on_a_side else (frame.width, frame.height)


def _white(frame: "VideoFrame", bits: int) -> int:
    """White in the codes that FFmpeg makes of a frame.

    Of more than 8 bits it makes 16 without rounding white up: that of Y'CbCr in the limited range
    comes as 255 times 256 and a little, in the full range with zeros behind its bits.
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
    """Light of every code."""
    codes = np.arange(256 if clip.bits <= 8 else 65536)
    return np.asarray(clip.encoding.curves[0].decode(codes / clip.white), dtype=np.float32)


def _codes(clip: Clip, frame: "VideoFrame", alpha: bool = False) -> npt.NDArray[Any]:
    """(H, W, 3) R'G'B' codes of 8 or 16 bits, upright; with alpha as a fourth."""
    from av.video.reformatter import Interpolation as Way

    # Without these flags codes come out one too dark, and the chroma of 4:2:0 in steps.
    way = Way.BICUBIC | Way.FULL_CHR_H_INT | Way.ACCURATE_RND
    form = ("rgb24", "rgb48le", "rgba", "rgba64le")[2 * alpha + (clip.bits > 8)]
    unsaid = _BT709 if frame.height >= _HD_HEIGHT else _BT601
    codes = (
        co_sited(frame)
        .reformat(
            format=form,
            src_colorspace=unsaid if frame.colorspace == _UNSAID else None,
            interpolation=way,
            threads=1,  # more of them are slower
        )
        .to_ndarray()
    )
    return np.rot90(codes, round(frame.rotation / 90))  # both count against the clock


def _unclipped(clip: Clip, codes: npt.NDArray[Any]) -> Bools:
    """(H, W) where no channel is white."""
    white = clip.white - (clip.white >> (clip.bits + 1))  # half a step of the file's own bits below
    red, green, blue = (codes[..., c] < white for c in range(3))
    return np.asarray(red & green & blue)


def _curve(path: Path, frame: "VideoFrame", transfer: Transfer | None, stacklevel: int) -> Transfer:
    said = int(frame.color_trc)
    if transfer is not None:
        return transfer
    if said in CICP_CURVES:
        return CICP_CURVES[said]
    if said not in (0, _UNSAID):
        raise FileError(
            f"{path}: its light is encoded by an HDR or log curve (number {said} of H.273) that is "
            "not known here; pass transfer= (--transfer) or convert it to BT.709"
        )
    warnings.warn(
        f"{path}: does not say how its code values encode light; they are taken as Rec. 709. "
        "If that is right, pass transfer=REC709 (--transfer rec709) to say so",
        TransferWarning,
        stacklevel=stacklevel + 1,
    )
    return REC709


def _matrix(path: Path, frame: "VideoFrame") -> Matrix | None:
    """To the primaries of sRGB, which are BT.709's; None if it has them or does not say."""
    said = int(frame.color_primaries)
    if said in (0, _BT709, _UNSAID):
        return None
    if said not in _PRIMARIES:
        raise FileError(
            f"{path}: has primaries that are not known here (number {said} of H.273); "
            "convert it to BT.709"
        )
    to_709 = np.linalg.solve(_to_xyz(_PRIMARIES[_BT709]), _to_xyz(_PRIMARIES[said]))
    return np.asarray(to_709, dtype=np.float64)


def _to_xyz(primaries: Any) -> Matrix:
    """(3, 3) CIE XYZ of linear RGB, of which (1, 1, 1) is D65 (SMPTE RP 177)."""
    xyz = np.array([(x / y, 1, (1 - x - y) / y) for x, y in (*primaries, _WHITE_D65)]).T
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
            f'{path}: clips need one package more: pip install "blurmatte[video]"; or take pictures'
        ) from error
    return av


@contextmanager
def _opened(path: Path) -> "Iterator[tuple[InputContainer, VideoStream]]":
    """The file and its video stream; complaints of FFmpeg become one line."""
    av = video_library(path)
    _check_there(path)
    try:
        with av.open(str(path)) as container:
            if not container.streams.video:
                raise FileError(f"{path}: holds no video; give a clip with pictures in it")
            yield container, container.streams.video[0]
    except av.FFmpegError as error:
        raise FileError(
            f"{path}: is no clip, or it is damaged ({error.strerror}); copy or export it again"
        ) from error


def _check_there(path: Path) -> None:
    if not path.exists():
        raise FileError(f"{path}: there is no such file; check the name")
    if path.is_dir():
        raise FileError(f"{path}: is a folder; give a clip, or the pictures in it")
    if path.stat().st_size == 0:
        raise FileError(f"{path}: the file is empty; copy or export it again")
