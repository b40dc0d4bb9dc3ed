"""The published estimate of the color line (2007), for comparison.

In this file C and B are the light of image and plate at n pixels of the streak, and m = C × B.
"""

import numpy as np

from blurmatte.checks import Floats
from blurmatte.color.model import ColorModel


def published_color_line(image_colors: Floats, plate_colors: Floats) -> ColorModel:
    """The line through black nearest to the lines C–B of all pixels ([GC07 §3.1]).

    Black, C and B span a plane that contains the object's color, so the line is perpendicular to every
    m = C × B: it is m₁ × m₂ for two pixels, and the eigenvector of Σ m mᵀ with the least eigenvalue
    for more. Exact without noise. Noise of the image adds σ²(|B|² I − B Bᵀ) to each m mᵀ, whose least
    eigenvector is the plate's color, and noise of the plate the same with the image's color.
    `fit_color` has no such bias.

    Parameters
    ----------
    image_colors, plate_colors : (n, 3) float
        Linear light of image and plate at n >= 2 pixels of the streak.

    Returns
    -------
    ColorModel
        Rank 1. The paper gives no error, so the covariance is zero.

    Raises
    ------
    ValueError
        For fewer than two pixels, or shapes that differ.
    """
    C, B = (np.asarray(a, dtype=float).reshape(-1, 3) for a in (image_colors, plate_colors))
    if C.shape != B.shape or len(C) < 2:
        raise ValueError(
            f"two or more pixels of both pictures are needed, got {len(C)} of the image and "
            f"{len(B)} of the plate"
        )
    m = np.cross(C, B)
    line = np.linalg.eigh(m.T @ m)[1][:, :1]
    return ColorModel(line if line.sum() > 0 else -line)
