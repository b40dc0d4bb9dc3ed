"""Sheet: a flat rectangle of one paint."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from blurmatte.color.model import ColorModel
from blurmatte.rendering.coverage import box_coverage, cell_edges, polygon_coverage
from blurmatte.rendering.paint import check_color
from blurmatte.rendering.pose import Pose

Array = npt.NDArray[np.float64]

_CORNERS = np.array([[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]])


@dataclass(frozen=True, eq=False)
class Sheet:
    """A rectangle, all of one color on both sides; upright and facing the camera until posed.

    Parameters
    ----------
    width, height : float
        Pixels.
    color : (3,) float
        Linear light, however it is turned.

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
            side = getattr(self, name)
            if not (np.isfinite(side) and side > 0):
                raise ValueError(f"{name} must be a positive number of pixels, got {side}")
        object.__setattr__(self, "color", check_color("color", self.color))

    def __repr__(self) -> str:
        return f"Sheet({self.width:g}x{self.height:g}, {self.model.hex[0]})"

    @property
    def model(self) -> ColorModel:
        """The line through its color."""
        return ColorModel.from_samples(self.color, std=0)

    def reach(self, pose: Pose) -> tuple[float, float]:
        """How far it extends from its center in x and y, pixels."""
        x, y = np.abs(pose.plane) @ [self.width / 2, self.height / 2]
        return float(x), float(y)

    def sharp(self, x: Array, y: Array, pose: Pose) -> tuple[Array, Array]:
        """Coverage (h, w) and premultiplied light (h, w, 3) of pixels, at one moment.

        `x` (w,) and `y` (h,) are neighboring pixel centers, from the center of the sheet.
        """
        x_edges, y_edges = cell_edges(x), cell_edges(y)
        across, down = pose.plane * [self.width, self.height]
        if across[1] == 0 and down[0] == 0:
            area = box_coverage(x_edges, y_edges, abs(across[0]), abs(down[1]))
        else:
            area = polygon_coverage(x_edges, y_edges, _CORNERS @ np.array([across, down]).T)
        return area, area[..., None] * self.color
