"""CodedFrame: a frame of a clip as code values, with its light on demand; and FFmpeg's filters.

Most frames of a long clip show nothing new: they are compared with the plate as code values, and only
the boxes in which something moved become light.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from typing import Any, Protocol, runtime_checkable

import numpy as np
import numpy.typing as npt

from blurmatte.checks import Box, Floats32
from blurmatte.radiometry.compression import CodingErrors
from blurmatte.radiometry.image import LinearImage, part_of

Planes = tuple[npt.NDArray[np.generic], npt.NDArray[np.generic], npt.NDArray[np.generic]]
# 4:2:0 shares the chroma of two columns at the left one: players and cameras assume this where it is
# not stated (ITU-T H.264, figure E-1). FFmpeg alone would put it between the columns.
_TO_BT709 = (
    "flags=bicubic+accurate_rnd:out_color_matrix=bt709:out_range=limited:out_chroma_loc=left"
)


@dataclass(frozen=True, eq=False)
class RgbCodes:
    """R'G'B' code values of a frame, and the light of each value.

    Parameters
    ----------
    codes : (H, W, 3) uint8 or uint16
    table : (n,) float32
        Linear light of each code value, the same for all channels.
    """

    codes: npt.NDArray[np.unsignedinteger]
    table: Floats32


@dataclass(frozen=True, eq=False)
class CodedFrame:
    """Code values of one frame."""

    number: int  # in its clip, from 0
    time: float | None  # presentation time, seconds
    # The first has a value for each pixel; the others have the same size, or half of it (rounded
    # up) in both directions. Y'CbCr or R'G'B', integers or floats
    planes: Planes
    zero: tuple[float, float, float]  # the value of each plane where there is no light, or no color
    step: float  # difference of two code values; 0 for floats
    # Linear light of a box (x0, y0, x1, y1), or of every n-th pixel of the frame
    light_of: Callable[[Box, int], LinearImage] = field(repr=False)
    # For each pixel, that `light_of` keeps once it was called; 0 if it keeps pictures of light
    light_bytes: int = 0
    # What `light_of` keeps; None if light does not follow from single code values
    rgb_codes: Callable[[], RgbCodes] | None = field(default=None, repr=False)

    @property
    def size(self) -> tuple[int, int]:
        """(width, height) in pixels."""
        height, width = self.planes[0].shape
        return width, height

    def light(self, box: Box | None = None, every: int = 1) -> LinearImage:
        """Linear light of a box, or of the whole frame; every n-th pixel of each row and column."""
        return self.light_of((0, 0, *self.size) if box is None else box, every)


def coded(number: int, image: LinearImage) -> CodedFrame:
    """A picture of linear light as a frame: its planes are red, green and blue light."""

    def light_of(box: Box, every: int) -> LinearImage:
        """Light of every n-th pixel of a box."""
        part = image.crop(box)
        return part if every == 1 else part_of(part, np.s_[::every, ::every])

    red, green, blue = (np.ascontiguousarray(image.rgb[..., c], np.float32) for c in range(3))
    planes = red, green, blue
    return CodedFrame(number, image.meta.time, planes, (0.0, 0.0, 0.0), 0.0, light_of)


@runtime_checkable
class CodedSequence(Protocol):
    """Frames of a file or of several, which can be read as code values in parts."""

    @property
    def numbers(self) -> range:
        """Numbers of the frames in the source."""
        ...

    @property
    def times(self) -> tuple[float, ...] | None:
        """Of all frames of the source, seconds; None if they are not known."""
        ...

    def coded(self, which: slice) -> Iterator[CodedFrame]:
        """Some of the frames."""
        ...

    def as_codes(self, picture: LinearImage) -> CodedFrame:
        """A picture of the same scene in the code values of the frames."""
        ...

    def coding_errors(self) -> CodingErrors | None:
        """Errors that a codec leaves in the frames; None if not known."""
        ...

    def parts(self, first: int, length: int) -> Iterator[slice]:
        """All frames from the first on in parts that are read on their own."""
        ...


def coded_frames(frames: Sequence[LinearImage], which: slice) -> Iterator[CodedFrame]:
    """Some of the frames of a clip as code values; pictures of light are numbered from 0."""
    if isinstance(frames, CodedSequence):
        yield from frames.coded(which)
        return
    for number in range(len(frames))[which]:
        yield coded(number, frames[number])


def each_coded(frames: Sequence[LinearImage]) -> Iterator[CodedFrame | None]:
    """Code values of each of the frames, in order; None for one that cannot be decoded."""
    place, numbers = 0, frames.numbers if isinstance(frames, CodedSequence) else range(len(frames))
    for frame in coded_frames(frames, slice(None)):
        at = numbers.index(frame.number)
        yield from [None] * (at - place)
        yield frame
        place = at + 1
    yield from [None] * (len(numbers) - place)


def in_codes_of(frames: Sequence[LinearImage], picture: LinearImage) -> CodedFrame:
    """A picture, such as the plate, in the code values of the frames of a clip."""
    if isinstance(frames, CodedSequence):
        return frames.as_codes(picture)
    return coded(-1, picture)


def filter_graph(frame: Any, *filters: tuple[str, str]) -> Any:
    """A graph of named filters with their options for frames like this `VideoFrame`."""
    from av.filter import Graph

    graph = Graph()
    source = graph.add_buffer(
        width=frame.width, height=frame.height, format=frame.format, time_base=Fraction(1)
    )
    parts = (source, *(graph.add(*one) for one in filters), graph.add("buffersink"))
    graph.link_nodes(*parts).configure()
    return graph


def rec709_converter(frame: Any, pixels: str) -> Any:
    """A graph that converts R'G'B' frames like this one to Y'CbCr of Rec. 709."""
    return filter_graph(frame, ("scale", _TO_BT709), ("format", pixels))
