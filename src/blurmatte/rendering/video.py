"""H.264 compression of code values, as in clips of phones and cameras.

R'G'B' is converted to Y'CbCr with the matrix and limited range of Rec. 709, 8 bits, and 4:2:0 with
chroma sited at the left column (ITU-T H.264, figure E-1). The transfer curve is left to the caller.
"""

import io
from collections.abc import Sequence
from fractions import Fraction
from typing import Any

import numpy as np

from blurmatte.checks import Codes8
from blurmatte.errors import BlurmatteError
from blurmatte.radiometry.video_filters import rec709_converter
from blurmatte.rendering.codes import check_8_bit_codes

_RATE = Fraction(30)  # frames per second; the rate control of a constant crf depends on it


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
    try:
        import av
    except ImportError as error:
        raise BlurmatteError(
            "H.264 needs one package more: pip install 'blurmatte[video]'; or take a JPEG"
        ) from error
    return av
