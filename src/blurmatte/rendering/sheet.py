"""Sheet: a flat upright rectangle of one paint."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from blurmatte.color.model import ColorModel
from blurmatte.rendering.coverage import box_coverage, cell_edges
from blurmatte.rendering.paint import check_color, true_model

Array = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Sheet:
    """A rectangle with sides along x and y, all of one color.

    Parameters
    ----------
    width, height : float
        Pixels.
    color : (3,) float
        Linear light.

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
        return true_model(self.color)

    @property
    def reach(self) -> tuple[float, float]:
        """How far it extends from its center in x and y, pixels."""
        return self.width / 2, self.height / 2

    def sharp(self, x: Array, y: Array) -> tuple[Array, Array]:
        """Coverage (h, w) and premultiplied light (h, w, 3) of pixels at rest.

        `x` (w,) and `y` (h,) are neighboring pixel centers, from the center of the sheet.
        """
        area = box_coverage(cell_edges(x), cell_edges(y), self.width, self.height)
        return area, area[..., None] * self.color
