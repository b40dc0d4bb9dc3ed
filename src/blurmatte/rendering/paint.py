"""The colors of what we render, and the model they span."""

import numpy as np
import numpy.typing as npt

from blurmatte.checks import Floats
from blurmatte.color.model import ColorModel

Array = npt.NDArray[np.float64]

_ALIKE = 1e-6  # colors that leave a line or plane by less, relative to the brightest, are in it


def check_color(name: str, value: npt.ArrayLike) -> Array:
    """`value` as (3,) linear light; ValueError unless finite, not negative and not black."""
    color = np.array(value, dtype=float)
    if color.shape != (3,) or not np.all(np.isfinite(color) & (color >= 0)) or not color.any():
        raise ValueError(
            f"{name} must be three linear values, not negative and not all 0, got {value!r}"
        )
    return color


def true_model(colors: Array) -> ColorModel | None:
    """The line or plane that colors (n, 3) span, known exactly; None if they span all of RGB."""
    rank = int(np.linalg.matrix_rank(colors, tol=_ALIKE * np.max(np.abs(colors))))
    return None if rank == 3 else ColorModel.from_samples(colors, rank, std=0)


def spanning(colors: Floats) -> Array:
    """At most three rows (k, 3) that span what colors (..., 3) span; not colors themselves."""
    return np.asarray(np.linalg.qr(colors.reshape(-1, 3).astype(float), mode="r"))
