"""Pixels that hold a body, and points in them, by which its coverage and light are counted."""

import numpy as np

from blurmatte.rendering.pose import AT_REST


def around(body, pose=AT_REST, shift=(0.31, -0.17)):
    """Pixel centers, from the center of the body, that hold all of it."""
    x, y = (np.arange(-np.ceil(r) - 1, np.ceil(r) + 2) for r in body.reach(pose))
    return x + shift[0], y + shift[1]


def points_in(x, y, n):
    """n × n points of every pixel."""
    px, py = ((v[:, None] + (np.arange(n) + 0.5) / n - 0.5).ravel() for v in (x, y))
    return np.stack(np.meshgrid(px, py), axis=-1)


def means(values, x, y, n):
    """Means over these points."""
    return values.reshape(len(y), n, len(x), n, *values.shape[2:]).mean((1, 3))
