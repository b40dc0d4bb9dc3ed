"""Sprite: the picture of an object with its alpha, cut out and moved about."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from blurmatte.checks import check_finite
from blurmatte.color.model import ColorModel
from blurmatte.layer import Layer
from blurmatte.rendering.coverage import cell_edges, polygon_coverage
from blurmatte.rendering.paint import check_color, spanning, true_model
from blurmatte.rendering.pose import Pose

Array = npt.NDArray[np.float64]

_POINTS = 4  # across a pixel, for a sprite that is not shrunk
_MOST_POINTS = 64  # across a pixel, where one is seen almost from the edge
_INNER = 0.42  # radius between the points of a star, relative to the outer


@dataclass(frozen=True, eq=False)
class Sprite:
    """A flat picture of any shape, the same from both sides.

    The sprite is the bilinear function through its pixels, which falls to 0 within one pixel beyond
    them. What a pixel of the scene shows of it is the mean over 4 × 4 points, more where it is
    shrunk. So even a sprite at rest with its pixels on those of the scene is shown slightly smoother
    than it is; the sum over all pixels stays.

    Parameters
    ----------
    layer : Layer
        Alpha and premultiplied light. Its middle is the center of the body.

    Raises
    ------
    TypeError, ValueError
        Unless it is a Layer, finite, with alpha between 0 and 1 and light that is not negative nor
        all 0.
    """

    layer: Layer

    def __post_init__(self) -> None:
        if not isinstance(self.layer, Layer):
            raise TypeError(f"layer must be a Layer, got {type(self.layer).__name__}")
        alpha, light = self.layer.alpha, self.layer.premultiplied
        check_finite("alpha", alpha)
        check_finite("premultiplied", light)
        if alpha.min() < 0 or alpha.max() > 1:
            raise ValueError(f"alpha must be in 0…1, it is in {alpha.min():.4g}…{alpha.max():.4g}")
        if light.min() < 0 or light.max() == 0:
            raise ValueError(
                "premultiplied must not be negative nor all 0, "
                f"it is in {light.min():.4g}…{light.max():.4g}"
            )

    def __repr__(self) -> str:
        width, height = self.layer.size
        model = self.model
        return (
            f"Sprite({width}x{height}, {'all colors' if model is None else ' + '.join(model.hex)})"
        )

    @property
    def model(self) -> ColorModel | None:
        """The line or plane that its colors span, within 1e-6 of the brightest; None if neither."""
        return true_model(spanning(self.layer.premultiplied))

    def reach(self, pose: Pose) -> tuple[float, float]:
        """How far it extends from its center in x and y, pixels."""
        x, y = np.abs(pose.plane) @ (np.array(self.layer.size) + 1) / 2
        return float(x), float(y)

    def sharp(self, x: Array, y: Array, pose: Pose) -> tuple[Array, Array]:
        """Coverage (h, w) and premultiplied light (h, w, 3) of pixels, at one moment.

        `x` (w,) and `y` (h,) are neighboring pixel centers, from the center of the sprite.
        """
        from blurmatte.rendering import kernel  # numba takes half a second to import

        coverage, light = np.zeros((len(y), len(x))), np.zeros((len(y), len(x), 3))
        if abs(np.linalg.det(pose.plane)) > 1e-12:  # else it is seen from the edge: nothing
            to_sprite = np.asarray(np.linalg.inv(pose.plane), dtype=float)
            across, down = _points(to_sprite)
            kernel.resample(self._bordered, to_sprite, x, y, across, down, coverage, light)
        return coverage, light

    @property
    def _bordered(self) -> Array:
        """(h + 2, w + 2, 4) premultiplied light and alpha, with a border of nothing."""
        rgba = np.dstack([self.layer.premultiplied, self.layer.alpha]).astype(float)
        return np.pad(rgba, [(1, 1), (1, 1), (0, 0)])


def _points(to_sprite: Array) -> tuple[int, int]:
    """Points across and down a pixel: no wider apart than those of a sprite at rest."""
    steps = np.maximum(np.linalg.norm(to_sprite, axis=0), 1)
    across, down = np.minimum(np.ceil(_POINTS * steps), _MOST_POINTS).astype(int)
    return int(across), int(down)


def star_sprite(size: int, color: npt.ArrayLike, points: int = 5) -> Sprite:
    """A star of one color, one point up, with antialiased edges.

    Parameters
    ----------
    size : int
        Width and height of the picture, pixels; the star is 2 less across.
    color : (3,) float
        Linear light.
    points : int
        3 or more.

    Raises
    ------
    ValueError
        If `size` or `points` is not whole or below 3, or the color is black or negative.
    """
    for name, number in (("size", size), ("points", points)):
        if not (isinstance(number, int) and number >= 3):
            raise ValueError(f"{name} must be a whole number, 3 or more, got {number!r}")
    paint = check_color("color", color)
    radius = (size / 2 - 1) * np.where(np.arange(2 * points) % 2, _INNER, 1)
    turn = np.pi * np.arange(2 * points) / points
    corners = radius[:, None] * np.stack([np.sin(turn), -np.cos(turn)], axis=1)
    edges = cell_edges(np.arange(float(size)) - (size - 1) / 2)
    alpha = np.minimum(polygon_coverage(edges, edges, corners), 1)
    return Sprite(Layer(alpha, alpha[..., None] * paint))
