"""Figures of matplotlib as pixels; only this module needs the extra `plot`."""

from typing import Any

import numpy as np
import numpy.typing as npt

from blurmatte.errors import BlurmatteError


def new_figure(size: tuple[float, float], dpi: int) -> Any:
    """An empty figure of a size in inches; raises BlurmatteError if matplotlib is not installed."""
    try:
        from matplotlib.figure import Figure
    except ImportError as error:
        raise BlurmatteError('a plot needs matplotlib: pip install "blurmatte[plot]"') from error
    return Figure(size, dpi, layout="constrained")


def pixels(figure: Any) -> npt.NDArray[np.uint8]:
    """(H, W, 3) sRGB of a figure."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    canvas: Any = FigureCanvasAgg(figure)
    canvas.draw()
    return np.array(canvas.buffer_rgba(), np.uint8)[..., :3]
