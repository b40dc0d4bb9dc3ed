"""Linear sRGB, from the colors of cameras and from hexadecimal digits."""

import re

import numpy as np

from blurmatte.checks import Array, Floats
from blurmatte.radiometry.transfer import SRGB

Matrix3 = tuple[tuple[float, ...], ...]

LUMA_WEIGHTS = 0.299, 0.587, 0.114  # of R', G', B': ITU-R BT.601, as in JPEG files
LUMA_WEIGHTS_709 = 0.2126, 0.7152, 0.0722  # the same: ITU-R BT.709


def ycbcr_matrix(luma_weights: tuple[float, float, float]) -> Array:
    """(3, 3) R'G'B' → Y', Cb, Cr, all of the same range."""
    red, _, blue = np.eye(3)
    return np.stack(
        [
            luma_weights,
            (blue - luma_weights) / (2 - 2 * luma_weights[2]),
            (red - luma_weights) / (2 - 2 * luma_weights[0]),
        ]
    )


YCBCR = ycbcr_matrix(LUMA_WEIGHTS)


def light_in_srgb(light: Floats, to_srgb: Matrix3 | None) -> Floats:
    """(..., 3) linear sRGB of light (..., 3), by the matrix `Meta.to_srgb`; unchanged if None."""
    if to_srgb is None:
        return light
    return np.asarray(light @ np.array(to_srgb, dtype=light.dtype).T)


def light_of_hex(*colors: str) -> Array:
    """(n, 3) linear sRGB, 0…1, of colors of six hexadecimal digits, with or without a #.

    Raises ValueError if a color is not written like that.
    """
    codes = []
    for color in colors:
        digits = re.fullmatch(r"#?([0-9a-fA-F]{6})", color)
        if digits is None:
            raise ValueError(f"a color must look like #d8ff3c, got {color!r}")
        codes.append([int(digits[1][i : i + 2], 16) for i in (0, 2, 4)])
    return np.asarray(SRGB.decode(np.array(codes, dtype=float).reshape(-1, 3) / 255))


def hex_of_light(light: Floats) -> str:
    """Linear sRGB (3,), 0…1, as sRGB-coded #rrggbb."""
    return "#{:02x}{:02x}{:02x}".format(*np.rint(255 * SRGB.encode(light)).astype(int))
