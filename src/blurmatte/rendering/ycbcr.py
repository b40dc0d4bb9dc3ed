"""Luma Y' and chroma Cb, Cr of R'G'B' code values: ITU-R BT.601, full range, as in JFIF."""

import numpy as np
import numpy.typing as npt

from blurmatte.checks import Floats

_RED, _GREEN, _BLUE = 0.299, 0.587, 0.114
_CB_RANGE, _CR_RANGE = 2 - 2 * _BLUE, 2 - 2 * _RED


def to_ycbcr(values: Floats) -> tuple[Floats, Floats, Floats]:
    """Y', Cb and Cr (H, W) of code values (H, W, 3); of 0…1, chroma is -0.5…0.5."""
    R, G, B = np.moveaxis(values, -1, 0)
    Y = _RED * R + _GREEN * G + _BLUE * B
    return Y, (B - Y) / _CB_RANGE, (R - Y) / _CR_RANGE


def from_ycbcr(Y: Floats, Cb: Floats, Cr: Floats) -> Floats:
    """Code values (H, W, 3), the inverse of `to_ycbcr`."""
    R, B = Y + _CR_RANGE * Cr, Y + _CB_RANGE * Cb
    return np.stack([R, (Y - _RED * R - _BLUE * B) / _GREEN, B], axis=-1)


def luma(values: Floats) -> Floats:
    """Y' (H, W) of code values (H, W, 3)."""
    return to_ycbcr(values)[0]


def ycbcr_variance(variance: Floats) -> npt.NDArray[np.float64]:
    """Variance of Y', Cb and Cr (..., 3) for independent noise of `variance` (..., 3) in R'G'B'."""
    rows = np.stack(to_ycbcr(np.eye(3)[None]), axis=-1)[0]  # [of R', G', B'; to Y', Cb, Cr]
    return np.asarray(variance @ rows**2)
