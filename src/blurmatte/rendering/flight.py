"""A ball that flies through space before a camera: the truth for what is measured in three dimensions.

Unlike a `Scene`, which sees from far away, this has perspective: the outline of the ball is traced
through the camera point by point, with all of its distortion.
"""

import numpy as np
import numpy.typing as npt

from blurmatte.checks import Floats
from blurmatte.intrinsics import Intrinsics
from blurmatte.layer import Layer
from blurmatte.radiometry import LinearImage
from blurmatte.rendering.coverage import cell_edges, polygon_coverage
from blurmatte.rendering.paint import check_color

Array = npt.NDArray[np.float64]

_CORNERS = 360  # of the outline: what they cut off is 3e-5 of the radius


def render_flight(
    plate: Floats,
    intrinsics: Intrinsics,
    positions: npt.ArrayLike,
    radius: float,
    color: npt.ArrayLike,
) -> tuple[LinearImage, Layer]:
    """The exact picture of a ball of one flat color, and its truth.

    Parameters
    ----------
    plate : (H, W, 3) float
        Linear light.
    intrinsics : Intrinsics
    positions : (T, 3) float
        Of its center at the middles of T equal parts of the exposure, meters from the camera.
    radius : float
        Meters.
    color : (3,) float
        Linear light.

    Raises
    ------
    ValueError
        If the ball is nowhere before the camera, or reaches the camera.
    """
    X = np.asarray(positions, dtype=float)
    if np.any(X[:, 2] <= radius):
        raise ValueError("positions must be in front of the camera by more than the radius")
    height, width = plate.shape[:2]
    alpha = np.zeros((height, width))
    for center in X:
        outline = intrinsics.project(outline_of(center, radius, _CORNERS))
        x0, y0 = np.clip(np.floor(outline.min(axis=0)) - 1, 0, (width, height)).astype(int)
        x1, y1 = np.clip(np.ceil(outline.max(axis=0)) + 2, 0, (width, height)).astype(int)
        if x0 < x1 and y0 < y1:
            edges = cell_edges(np.arange(x0, x1)), cell_edges(np.arange(y0, y1))
            alpha[y0:y1, x0:x1] += polygon_coverage(*edges, outline) / len(X)
    alpha = np.minimum(alpha, 1)
    layer = Layer(alpha, alpha[..., None] * check_color("color", color))
    return layer.over(LinearImage(np.asarray(plate, float))), layer


def outline_of(center: Array, radius: float, count: int) -> Array:
    """(count, 3) points of a sphere around its rim, as a pinhole at the origin sees it.

    Rays touch the sphere on the circle in which it meets the one whose diameter is the line from the
    pinhole to its center.
    """
    distance = float(np.linalg.norm(center))
    towards = center / distance
    across = np.linalg.svd(towards[None])[2][1:]
    sine = radius / distance
    angle = 2 * np.pi * np.arange(count) / count
    circle = np.stack([np.cos(angle), np.sin(angle)], axis=1) @ across
    return np.asarray(center * (1 - sine**2) + radius * np.sqrt(1 - sine**2) * circle)
