"""Filters of FFmpeg, by PyAV, that convert frames of clips."""

from fractions import Fraction
from typing import Any

# 4:2:0 shares the chroma of two columns at the left one: players and cameras assume this where it is
# not stated (ITU-T H.264, figure E-1). FFmpeg alone would put it between the columns.
_TO_BT709 = (
    "flags=bicubic+accurate_rnd:out_color_matrix=bt709:out_range=limited:out_chroma_loc=left"
)


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
