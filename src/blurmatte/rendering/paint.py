"""The colors of what we render, and the model they span."""

import numpy as np
import numpy.typing as npt

from blurmatte.color.model import ColorModel

Array = npt.NDArray[np.float64]

WHITE = np.ones(3)  # the light of every scene; 1 = sensor white


def check_color(name: str, value: npt.ArrayLike) -> Array:
    """`value` as (3,) linear light; ValueError unless finite, not negative and not black."""
    color = np.array(value, dtype=float)
    if color.shape != (3,) or not np.all(np.isfinite(color) & (color >= 0)) or not color.any():
        raise ValueError(
            f"{name} must be three linear values, not negative and not all 0, got {value!r}"
        )
    return color


def true_model(*colors: Array) -> ColorModel:
    """The line or plane that one or more colors span, known exactly.

    Raises
    ------
    ValueError
        If they span all of RGB: no direction is left that tells object from plate.
    """
    rank = int(np.linalg.matrix_rank(np.stack(colors), tol=1e-6 * np.max(colors)))
    if rank == 3:
        raise ValueError("the colors of an object must span a line or a plane, these span all RGB")
    return ColorModel.from_samples(np.stack(colors), rank, std=0)
