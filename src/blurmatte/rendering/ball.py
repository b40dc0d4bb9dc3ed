"""Ball: a shaded sphere."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from blurmatte.color.model import ColorModel
from blurmatte.rendering.coverage import cell_edges, disc_coverage
from blurmatte.rendering.paint import WHITE, check_color, true_model

Array = npt.NDArray[np.float64]

_CELLS = 4  # points across a pixel where light is sampled; coverage is exact, by cells


@dataclass(frozen=True, eq=False)
class Ball:
    """A sphere in white light: ambient + Lambert, and a highlight if it is glossy.

    Directions are (x, y, z) with x right, y down and z towards the camera, of any length.

    Parameters
    ----------
    radius : float
        Pixels.
    color : (3,) float
        Linear light of the paint where the lamp shines on it squarely.
    ambient : float
        Part of the light that comes from everywhere, 0…1; 1 shows a flat disc.
    lamp : (3,) float
        Direction towards the lamp.
    highlight : float
        Linear light of the white highlight at its brightest; 0 for a dull ball.
    shininess : float
        Exponent of the highlight (Blinn–Phong): larger is smaller and sharper.
    second_color : (3,) float, optional
        Paint of a band around the ball.
    band : float
        Half the width of that band, in radii, 0…1.
    axis : (3,) float
        Pole of that band.

    Raises
    ------
    ValueError
        For a number outside its range, or a glossy ball in two paints: its colors would fill RGB.
    """

    radius: float
    color: Array
    ambient: float = 0.35
    lamp: tuple[float, float, float] = (-0.45, -0.7, 0.55)
    highlight: float = 0.0
    shininess: float = 30.0
    second_color: Array | None = None
    band: float = 0.35
    axis: tuple[float, float, float] = (0.3, 1.0, 0.25)

    def __post_init__(self) -> None:
        if not (np.isfinite(self.radius) and self.radius > 0):
            raise ValueError(f"radius must be a positive number of pixels, got {self.radius}")
        for name in ("ambient", "band"):
            if not 0 <= getattr(self, name) <= 1:
                raise ValueError(f"{name} must lie between 0 and 1, got {getattr(self, name)}")
        if not (np.isfinite(self.highlight) and self.highlight >= 0):
            raise ValueError(f"highlight must be finite and not negative, got {self.highlight}")
        if not (np.isfinite(self.shininess) and self.shininess >= 1):
            raise ValueError(f"shininess must be 1 or more, got {self.shininess}")
        for name in ("lamp", "axis"):
            _unit(name, getattr(self, name))
        object.__setattr__(self, "color", check_color("color", self.color))
        if self.second_color is not None:
            second = check_color("second_color", self.second_color)
            object.__setattr__(self, "second_color", second)
        true_model(*self._colors)

    def __repr__(self) -> str:
        gloss = f", highlight {self.highlight:g}" if self.highlight else ""
        return f"Ball(radius {self.radius:g}, {' + '.join(self.model.hex)}{gloss})"

    @property
    def _colors(self) -> list[Array]:
        second = [] if self.second_color is None else [self.second_color]
        return [self.color, *second, *([WHITE] if self.highlight else [])]

    @property
    def model(self) -> ColorModel:
        """Its colors: a line for one paint, a plane with a highlight or a second paint."""
        return true_model(*self._colors)

    @property
    def reach(self) -> tuple[float, float]:
        """How far it extends from its center in x and y, pixels."""
        return self.radius, self.radius

    def sharp(self, x: Array, y: Array) -> tuple[Array, Array]:
        """Coverage (h, w) and premultiplied light (h, w, 3) of pixels at rest.

        `x` (w,) and `y` (h,) are neighboring pixel centers, from the center of the ball.
        """
        x_edges, y_edges = cell_edges(x, _CELLS), cell_edges(y, _CELLS)
        area = disc_coverage(x_edges, y_edges, self.radius)
        normal = self._normals(_middle(x_edges), _middle(y_edges))
        light = sum(
            _per_pixel(area * weight)[..., None] * color
            for weight, color in zip(self._weights(normal), self._colors, strict=True)
        )
        return _per_pixel(area), np.asarray(light)

    def _normals(self, x: Array, y: Array) -> tuple[Array, Array, Array]:
        """(h, w) each, unit normals x, y, z; a cell beyond the rim takes the rim's."""
        nx, ny = x / self.radius, y[:, None] / self.radius
        stretch = np.maximum(np.hypot(nx, ny), 1)
        nx, ny = nx / stretch, ny / stretch
        return nx, ny, np.sqrt(np.maximum(1 - nx**2 - ny**2, 0))

    def _weights(self, normal: tuple[Array, Array, Array]) -> list[Array]:
        """(h, w) for each of the colors: how much of it is seen."""
        lamp = _unit("lamp", self.lamp)
        shade = self.ambient + (1 - self.ambient) * np.maximum(_dot(lamp, normal), 0)
        weights = [shade]
        if self.second_color is not None:
            banded = np.abs(_dot(_unit("axis", self.axis), normal)) < self.band
            weights = [shade * ~banded, shade * banded]
        if self.highlight:
            halfway = _unit("lamp", lamp + np.array([0, 0, 1]))  # between lamp and camera
            gloss = np.maximum(_dot(halfway, normal), 0) ** self.shininess
            weights.append(self.highlight * gloss)
        return weights


def _unit(name: str, direction: Sequence[float] | Array) -> Array:
    d = np.asarray(direction, dtype=float)
    if d.shape != (3,) or not np.all(np.isfinite(d)) or not np.linalg.norm(d) > 1e-9:
        raise ValueError(f"{name} must be a direction (x, y, z), got {direction}")
    return np.asarray(d / np.linalg.norm(d))


def _dot(direction: Array, normal: tuple[Array, Array, Array]) -> Array:
    a, b, c = direction
    nx, ny, nz = normal
    return np.asarray(a * nx + b * ny + c * nz)


def _middle(edges: Array) -> Array:
    return (edges[1:] + edges[:-1]) / 2


def _per_pixel(cells: Array) -> Array:
    h, w = cells.shape
    return np.asarray(cells.reshape(h // _CELLS, _CELLS, w // _CELLS, _CELLS).sum(axis=(1, 3)))
