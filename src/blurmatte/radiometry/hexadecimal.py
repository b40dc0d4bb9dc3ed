"""Colors as people type them: #d8ff3c, an sRGB-coded color in hexadecimal digits."""

import re

import numpy as np
import numpy.typing as npt

from blurmatte.radiometry.transfer import SRGB


def light_of_hex(*colors: str) -> npt.NDArray[np.float64]:
    """Linear sRGB of sRGB-coded colors.

    Parameters
    ----------
    *colors : str
        Six hexadecimal digits each, with or without a # before them.

    Returns
    -------
    (n, 3) float
        0…1.

    Raises
    ------
    ValueError
        If a color is not written like that.
    """
    codes = []
    for color in colors:
        digits = re.fullmatch(r"#?([0-9a-fA-F]{6})", color)
        if digits is None:
            raise ValueError(f"a color must look like #d8ff3c, got {color!r}")
        codes.append([int(digits[1][i : i + 2], 16) for i in (0, 2, 4)])
    return np.asarray(SRGB.decode(np.array(codes, dtype=float).reshape(-1, 3) / 255))
