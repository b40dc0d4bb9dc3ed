"""Clips that PyAV writes, for tests of how they are read."""

from contextlib import contextmanager

import numpy as np
import pytest


@contextmanager
def encoder(path, codec, size, pixels="yuv420p", rate=25, options=None, of_file=None):
    """The stream of a new clip, and a function that adds a frame, or RGB codes, to it."""
    av = pytest.importorskip("av")
    with av.open(str(path), "w", options=of_file or {}) as clip:
        stream = clip.add_stream(codec, rate=rate, options=options or {})
        stream.width, stream.height, stream.pix_fmt = *size, pixels

        def add(frame):
            if isinstance(frame, np.ndarray):
                frame = av.VideoFrame.from_ndarray(frame, format="rgb24")
            clip.mux(stream.encode(frame))

        yield stream, add
        clip.mux(stream.encode())
