"""Cross-fade between two pictures, as a loop."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from blurmatte.checks import check_same_size
from blurmatte.radiometry import LinearImage, check_picture


def fade_between(first: LinearImage, second: LinearImage, count: int = 24) -> Iterator[LinearImage]:
    """Frames of a periodic cross-fade between two pictures, in linear light.

    With a plate as `first` and a layer over it as `second`, the layer fades in and out.

    Parameters
    ----------
    first, second : LinearImage
        Pictures of one size.
    count : int
        Number of frames, 2 or more.

    Yields
    ------
    LinearImage
        The frames in order; their noise is unknown.

    Raises
    ------
    ValueError
        If sizes differ or `count` is below 2.
    """
    check_picture("first", first)
    check_picture("second", second)
    check_same_size("the first picture", first.size, "the second", second.size)
    if count < 2:
        raise ValueError(f"count must be 2 or more frames, got {count}")
    first, second = first.in_srgb(), second.in_srgb()
    for number in range(count):
        share = np.float32((1 - np.cos(2 * np.pi * number / count)) / 2)
        yield replace(second, rgb=first.rgb + share * (second.rgb - first.rgb), noise=None)
