"""Primaries that files state, by number, by name or by chromaticities, to those of sRGB.

Chromaticities are CIE (x, y) of red, green, blue and white, eight numbers in this order. The
conversion keeps XYZ as the file states it: a white other than D65 is not adapted.
"""

from collections.abc import Sequence

import numpy as np

from blurmatte.checks import Array
from blurmatte.files.icc import SAME_PRIMARIES

Chromaticities = tuple[float, ...]

_D65, _C, _D60 = (0.3127, 0.3290), (0.310, 0.316), (0.32168, 0.33767)
_BT709 = (0.64, 0.33, 0.30, 0.60, 0.15, 0.06, *_D65)
_SMPTE170M = (0.630, 0.340, 0.310, 0.595, 0.155, 0.070, *_D65)
_BT2020 = (0.708, 0.292, 0.170, 0.797, 0.131, 0.046, *_D65)
_P3 = (0.680, 0.320, 0.265, 0.690, 0.150, 0.060)
ADOBE_RGB = (0.64, 0.33, 0.21, 0.71, 0.15, 0.06, *_D65)

# Color primaries of ITU-T H.273, table 2.
CICP_PRIMARIES: dict[int, Chromaticities] = {
    1: _BT709,
    4: (0.67, 0.33, 0.21, 0.71, 0.14, 0.08, *_C),
    5: (0.64, 0.33, 0.29, 0.60, 0.15, 0.06, *_D65),
    6: _SMPTE170M,
    7: _SMPTE170M,
    8: (0.681, 0.319, 0.243, 0.692, 0.145, 0.049, *_C),
    9: _BT2020,
    10: (1, 0, 0, 1, 0, 0, 1 / 3, 1 / 3),
    11: (*_P3, 0.314, 0.351),
    12: (*_P3, *_D65),
    22: (0.630, 0.340, 0.295, 0.605, 0.155, 0.077, *_D65),
}
# By the names of the Color Interop Forum: the middle part of lin_ap1_scene.
INTEROP_PRIMARIES: dict[str, Chromaticities] = {
    "rec709": _BT709,
    "rec2020": _BT2020,
    "p3d65": (*_P3, *_D65),
    "adobergb": ADOBE_RGB,
    "ap0": (0.7347, 0.2653, 0, 1, 0.0001, -0.077, *_D60),
    "ap1": (0.713, 0.293, 0.165, 0.830, 0.128, 0.044, *_D60),
    "ciexyzd65": (1, 0, 0, 1, 0, 0, *_D65),
}


def matrix_to_srgb(chromaticities: Sequence[float]) -> Array | None:
    """From linear light with these primaries to those of sRGB; None if they are equal.

    Raises ValueError if they are no primaries of three independent colors and a white.
    """
    with np.errstate(all="ignore"):
        try:
            matrix: Array = np.linalg.inv(_to_xyz(_BT709)) @ _to_xyz(chromaticities)
        except np.linalg.LinAlgError as error:
            raise ValueError("are no three colors") from error
    # Beyond any real color space; a matrix like that would make noise of the picture.
    if not np.all(np.abs(matrix) < 100) or np.linalg.cond(matrix) > 1e4:
        raise ValueError("are no three colors")
    return None if bool(np.all(np.abs(matrix - np.eye(3)) < SAME_PRIMARIES)) else matrix


def _to_xyz(chromaticities: Sequence[float]) -> Array:
    """Columns: XYZ of red, green and blue, whose sum is white with Y = 1."""
    x, y = np.reshape(np.asarray(chromaticities, dtype=float), (4, 2)).T
    colors = np.stack([x, y, 1 - x - y])
    return np.asarray(colors[:, :3] * np.linalg.solve(colors[:, :3], colors[:, 3] / y[3]))
