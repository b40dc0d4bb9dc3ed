"""Cube: six flat faces under one or more lamps."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from blurmatte.color.model import ColorModel
from blurmatte.rendering.coverage import cell_edges, polygon_coverage
from blurmatte.rendering.lamp import Lamp, check_lighting, lit, shade
from blurmatte.rendering.paint import check_color, true_model
from blurmatte.rendering.pose import Pose

Array = npt.NDArray[np.float64]

_AROUND = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) / 2  # corners of a face, one after another


@dataclass(frozen=True, eq=False)
class Cube:
    """A cube, seen from far away: ambient + Lambert. At rest only its face +z is seen.

    Parameters
    ----------
    side : float
        Pixels.
    color : (3,) or (6, 3) float
        Linear light of the paint where a white lamp shines on it squarely: of all faces, or of those
        on +x, −x, +y, −y, +z and −z.
    ambient : float
        Part of the light that comes from everywhere, 0…1, of the lamps' mean color.
    lamps : tuple of Lamp
        One or more. They stay where they are when the cube turns.

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
        if not (np.isfinite(self.side) and self.side > 0):
            raise ValueError(f"side must be a positive number of pixels, got {self.side}")
        check_lighting(self.lamps, self.ambient)
        color = np.array(self.color, dtype=float)
        if color.shape == (6, 3):
            for k, face in enumerate(color):
                check_color(f"color[{k}]", face)
        else:
            check_color("color", color)
        object.__setattr__(self, "color", color)

    def __repr__(self) -> str:
        model = self.model
        colors = "all colors" if model is None else " + ".join(model.hex)
        return f"Cube(side {self.side:g}, {colors})"

    @property
    def model(self) -> ColorModel | None:
        """The line or plane of all that its faces can show; None if they fill RGB."""
        return true_model(lit(np.atleast_2d(self.color), self.lamps, self.ambient))

    def reach(self, pose: Pose) -> tuple[float, float]:
        """How far it extends from its center in x and y, pixels."""
        x, y = self.side / 2 * np.abs(_projection(pose)).sum(axis=1)
        return float(x), float(y)

    def sharp(self, x: Array, y: Array, pose: Pose) -> tuple[Array, Array]:
        """Coverage (h, w) and premultiplied light (h, w, 3) of pixels, at one moment.

        `x` (w,) and `y` (h,) are neighboring pixel centers, from the center of the cube.
        """
        x_edges, y_edges = cell_edges(x), cell_edges(y)
        coverage, light = np.zeros((len(y), len(x))), np.zeros((len(y), len(x), 3))
        for (axis, sign), paint in zip(_FACES, np.broadcast_to(self.color, (6, 3)), strict=True):
            normal = sign * pose.rotation[:, axis]
            if normal[2] > 0:
                corners = self.side * _face(axis, sign) @ _projection(pose).T
                area = polygon_coverage(x_edges, y_edges, corners)
                coverage += area
                light += area[..., None] * (paint * shade(normal, self.lamps, self.ambient))
        return coverage, light


_FACES = tuple((axis, sign) for axis in range(3) for sign in (1, -1))


def _face(axis: int, sign: int) -> Array:
    """(4, 3) corners of a face of the cube of side 1, in order around it."""
    return np.insert(_AROUND, axis, sign / 2, axis=1)


def _projection(pose: Pose) -> Array:
    """(2, 3) from the body to the picture."""
    return np.asarray(pose.stretch @ pose.rotation[:2])
