"""Where the color of a video frame lies that several pixels share."""

from fractions import Fraction
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from av.video.frame import VideoFrame


def co_sited(frame: "VideoFrame") -> "VideoFrame":
    """The same; of 4:2:2 with the color of two columns where the left one is, as BT.601 has it.

    Decoders of MPEG and JPEG say where it is, and FFmpeg listens. Of ProRes, DNxHD and video that
    is not compressed nobody does, and it would be taken for between the two. (Of 4:2:0 no standard
    tells, then.) JPEG's, of full range, is between them.
    """
    import av
    from av.filter import Graph
    from av.video.reformatter import ColorRange

    width, height = frame.width, frame.height
    half = frame.format.chroma_width(width) < width, frame.format.chroma_height(height) < height
    if half != (True, False) or frame.color_range == ColorRange.JPEG:
        return frame
    graph = Graph()
    parts = (
        graph.add_buffer(width=width, height=height, format=frame.format, time_base=Fraction(1)),
        graph.add("setparams", "chroma_location=left"),
        graph.add("buffersink"),
    )
    graph.link_nodes(*parts).configure()
    graph.push(frame)
    sited = graph.pull()
    assert isinstance(sited, av.VideoFrame)
    return sited
