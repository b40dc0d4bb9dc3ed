"""Bodies with flat faces: Sheet (a rectangle), Cube, and Sprite (a picture with alpha)."""

from dataclasses import dataclass
from itertools import product

import numpy as np
import numpy.typing as npt

from blurmatte.checks import Array, check_finite, check_positive
from blurmatte.color.model import ColorModel
from blurmatte.layer import Layer, check_layer
from blurmatte.rendering.coverage import box_coverage, cell_edges, polygon_coverage, resample
from blurmatte.rendering.lighting import (
    Lamp,
    check_color,
    check_lighting,
    hex_codes,
    lit,
    shade,
    spanning,
    true_model,
)
from blurmatte.rendering.pose import Pose

_SQUARE = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) / 2  # corners of the unit square, in order


@dataclass(frozen=True, eq=False)
class Sheet:
    """A rectangle of one color on both sides; unposed, it is upright and faces the camera.

    Parameters
    ----------
    width, height : float
        Pixels.
    color : (3,) float
        Linear light, independent of the orientation.

    Raises
    ------
    ValueError
        If a side is not positive or the color is black or negative.
    """

    width: float
    height: float
    color: Array

    def __post_init__(self) -> None:
        for name in ("width", "height"):
            check_positive(name, getattr(self, name), "pixels")
        object.__setattr__(self, "color", check_color("color", self.color))

    def __repr__(self) -> str:
        return f"Sheet({self.width:g}x{self.height:g}, {self.model.hex[0]})"

    @property
    def model(self) -> ColorModel:
        """The line through its color."""
        return ColorModel.from_samples(self.color, std=0)

    def reach(self, pose: Pose) -> tuple[float, float]:
        """Extent from the center in x and y, pixels."""
        x, y = np.abs(pose.plane) @ [self.width / 2, self.height / 2]
        return float(x), float(y)

    def sharp(self, x: Array, y: Array, pose: Pose) -> tuple[Array, Array]:
        """Coverage (h, w) and premultiplied light (h, w, 3) of pixels; see `Body.sharp`."""
        x_edges, y_edges = cell_edges(x), cell_edges(y)
        across, down = pose.plane * [self.width, self.height]
        if across[1] == 0 and down[0] == 0:
            area = box_coverage(x_edges, y_edges, abs(across[0]), abs(down[1]))
        else:
            area = polygon_coverage(x_edges, y_edges, _SQUARE @ np.array([across, down]).T)
        return area, area[..., None] * self.color


@dataclass(frozen=True, eq=False)
class Cube:
    """A cube seen from far away: ambient + Lambert. Unposed, only its face +z is visible.

    Parameters
    ----------
    side : float
        Pixels.
    color : (3,) or (6, 3) float
        Linear light of the paint under a white lamp at normal incidence: one for all faces, or one
        each for +x, −x, +y, −y, +z and −z.
    ambient : float
        Fraction of ambient light, 0…1, of the lamps' mean color.
    lamps : tuple of Lamp
        One or more. They do not turn with the cube.

    Raises
    ------
    TypeError, ValueError
        For a number outside its range, a color that is black or negative, or no lamps.
    """

    side: float
    color: Array
    ambient: float = 0.35
    lamps: tuple[Lamp, ...] = (Lamp(),)

    def __post_init__(self) -> None:
        check_positive("side", self.side, "pixels")
        check_lighting(self.lamps, self.ambient)
        color = np.array(self.color, dtype=float)
        if color.shape == (6, 3):
            for k, face in enumerate(color):
                check_color(f"color[{k}]", face)
        else:
            check_color("color", color)
        object.__setattr__(self, "color", color)

    def __repr__(self) -> str:
        return f"Cube(side {self.side:g}, {hex_codes(self.model)})"

    @property
    def model(self) -> ColorModel | None:
        """The line or plane of all colors of its faces; None if they span RGB."""
        return true_model(lit(np.atleast_2d(self.color), self.lamps, self.ambient))

    def reach(self, pose: Pose) -> tuple[float, float]:
        """Extent from the center in x and y, pixels."""
        x, y = self.side / 2 * np.abs(_projection(pose)).sum(axis=1)
        return float(x), float(y)

    def sharp(self, x: Array, y: Array, pose: Pose) -> tuple[Array, Array]:
        """Coverage (h, w) and premultiplied light (h, w, 3) of pixels; see `Body.sharp`."""
        x_edges, y_edges = cell_edges(x), cell_edges(y)
        coverage, light = np.zeros((len(y), len(x))), np.zeros((len(y), len(x), 3))
        faces = product(range(3), (1, -1))
        for (axis, sign), paint in zip(faces, np.broadcast_to(self.color, (6, 3)), strict=True):
            normal = sign * pose.rotation[:, axis]
            if normal[2] > 0:
                face = np.insert(_SQUARE, axis, sign / 2, axis=1)  # (4, 3) corners, side 1
                area = polygon_coverage(x_edges, y_edges, self.side * face @ _projection(pose).T)
                coverage += area
                light += area[..., None] * (paint * shade(normal, self.lamps, self.ambient))
        return coverage, light


@dataclass(frozen=True, eq=False)
class Sprite:
    """A flat picture of any shape, the same on both sides.

    The sprite is the bilinear function through its pixels, which falls to 0 within one pixel outside
    them. A pixel of the scene shows its mean over 4 × 4 points, or more where the sprite is shrunk.
    So even an unposed sprite on the pixel grid is rendered slightly smoother than its layer; the sum
    over all pixels is preserved.

    Parameters
    ----------
    layer : Layer
        Alpha and premultiplied light. Its middle is the center of the body.

    Raises
    ------
    TypeError, ValueError
        Unless it is a finite Layer with alpha within 0…1 and light that is nonnegative and not all 0.
    """

    layer: Layer

    def __post_init__(self) -> None:
        check_layer("layer", self.layer)
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
        return f"Sprite({width}x{height}, {hex_codes(self.model)})"

    @property
    def model(self) -> ColorModel | None:
        """The line or plane of its colors, within 1e-6 of the brightest; None if they span RGB."""
        return true_model(spanning(self.layer.premultiplied))

    def reach(self, pose: Pose) -> tuple[float, float]:
        """Extent from the center in x and y, pixels."""
        x, y = np.abs(pose.plane) @ (np.array(self.layer.size) + 1) / 2
        return float(x), float(y)

    def sharp(self, x: Array, y: Array, pose: Pose) -> tuple[Array, Array]:
        """Coverage (h, w) and premultiplied light (h, w, 3) of pixels; see `Body.sharp`."""
        coverage, light = np.zeros((len(y), len(x))), np.zeros((len(y), len(x), 3))
        if abs(np.linalg.det(pose.plane)) > 1e-12:  # edge-on, nothing is visible
            to_sprite = np.asarray(np.linalg.inv(pose.plane), dtype=float)
            across, down = sample_counts(to_sprite)
            resample(self._bordered, to_sprite, x, y, across, down, coverage, light)
        return coverage, light

    @property
    def _bordered(self) -> Array:
        """(h + 2, w + 2, 4) premultiplied light and alpha with a border of zeros."""
        rgba = np.dstack([self.layer.premultiplied, self.layer.alpha]).astype(float)
        return np.pad(rgba, [(1, 1), (1, 1), (0, 0)])


def sample_counts(to_sprite: Array) -> tuple[int, int]:
    """Sample points across and down a pixel, at least 4 per sprite pixel; at most 64.

    `to_sprite` (2, 2) maps pixels of the scene to pixels of the sprite. The upper bound limits the
    cost of sprites that are seen almost edge-on.
    """
    steps = np.maximum(np.linalg.norm(to_sprite, axis=0), 1)
    across, down = np.minimum(np.ceil(4 * steps), 64).astype(int)
    return int(across), int(down)


def star_sprite(size: int, color: npt.ArrayLike, points: int = 5) -> Sprite:
    """A star of one color, one point up, with antialiased edges.

    Parameters
    ----------
    size : int
        Width and height of the picture, pixels; the star is 2 pixels smaller.
    color : (3,) float
        Linear light.
    points : int
        3 or more.

    Raises
    ------
    ValueError
        If `size` or `points` is not an integer of 3 or more, or the color is black or negative.
    """
    for name, number in (("size", size), ("points", points)):
        if not (isinstance(number, int) and number >= 3):  # type: ignore[redundant-expr]
            raise ValueError(f"{name} must be a whole number, 3 or more, got {number!r}")
    paint = check_color("color", color)
    inner = 0.42  # radius of the notches relative to the points
    radius = (size / 2 - 1) * np.where(np.arange(2 * points) % 2, inner, 1)
    turn = np.pi * np.arange(2 * points) / points
    corners = radius[:, None] * np.stack([np.sin(turn), -np.cos(turn)], axis=1)
    edges = cell_edges(np.arange(float(size)) - (size - 1) / 2)
    alpha = np.minimum(polygon_coverage(edges, edges, corners), 1)
    return Sprite(Layer(alpha, alpha[..., None] * paint))


def _projection(pose: Pose) -> Array:
    """(2, 3) map from the body to the picture."""
    return np.asarray(pose.stretch @ pose.rotation[:2])
