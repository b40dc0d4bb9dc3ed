"""Pictures for benchmarks and tests: noise alone, and a ball in flight before a calibrated camera.

The flight is ground truth for 3-D measurements. The outline of the ball is projected point by point,
with all distortion of the camera.
"""

import numpy as np
import numpy.typing as npt

from blurmatte.checks import Array, Floats, check_light
from blurmatte.intrinsics import Intrinsics
from blurmatte.layer import Layer
from blurmatte.radiometry import LinearImage, NoiseModel
from blurmatte.rendering.camera import noisy
from blurmatte.rendering.coverage import cell_edges, polygon_coverage
from blurmatte.rendering.lighting import check_color
from blurmatte.rendering.processing import Rng


def add_noise(light: Floats, noise: NoiseModel, rng: Rng) -> Floats:
    """Add photon and read noise to light; the result has the shape and dtype of `light`.

    Both are drawn together from a normal distribution with their variance at the exact light: a good
    approximation above about 20 electrons per pixel (light > 20 · gain). The parameters are those of
    `Camera.photograph`.
    """
    light = check_light("light", light)
    return np.asarray(noisy(light, noise, np.random.default_rng(rng)), dtype=light.dtype)


def render_flight(
    plate: Floats,
    intrinsics: Intrinsics,
    positions: npt.ArrayLike,
    radius: float,
    color: npt.ArrayLike,
) -> tuple[LinearImage, Layer]:
    """Render a ball of one flat color in flight exactly, with its true layer.

    The outline is a polygon of 360 vertices, exact to 3e-5 of the radius. Raises ValueError if the
    ball is behind the camera or reaches it.

    positions (T, 3): of its center at the middles of T equal parts of the exposure, meters, in camera
        coordinates.
    radius: meters.
    color (3,): linear light, like the plate's.
    """
    X = np.asarray(positions, dtype=float)
    if np.any(X[:, 2] <= radius):
        raise ValueError("positions must be in front of the camera by more than the radius")
    height, width = plate.shape[:2]
    alpha = np.zeros((height, width))
    for center in X:
        outline = intrinsics.project(outline_of(center, radius, 360))
        x0, y0 = np.clip(np.floor(outline.min(axis=0)) - 1, 0, (width, height)).astype(int)
        x1, y1 = np.clip(np.ceil(outline.max(axis=0)) + 2, 0, (width, height)).astype(int)
        if x0 < x1 and y0 < y1:
            edges = cell_edges(np.arange(x0, x1)), cell_edges(np.arange(y0, y1))
            alpha[y0:y1, x0:x1] += polygon_coverage(*edges, outline) / len(X)
    alpha = np.minimum(alpha, 1)
    layer = Layer(alpha, alpha[..., None] * check_color("color", color))
    return layer.over(LinearImage(np.asarray(plate, float))), layer


def outline_of(center: Array, radius: float, count: int) -> Array:
    """(count, 3) points on the rim of a sphere as seen by a pinhole at the origin.

    Tangent rays touch the sphere on its circle of intersection with the sphere whose diameter is the
    segment from the pinhole to the center (Thales).
    """
    distance = float(np.linalg.norm(center))
    towards = center / distance
    across = np.linalg.svd(towards[None])[2][1:]
    sine = radius / distance
    angle = 2 * np.pi * np.arange(count) / count
    circle = np.stack([np.cos(angle), np.sin(angle)], axis=1) @ across
    return np.asarray(center * (1 - sine**2) + radius * np.sqrt(1 - sine**2) * circle)
