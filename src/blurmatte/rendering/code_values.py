"""Code values of a file: encoded, rounded and clipped."""

import numpy as np
import numpy.typing as npt

from blurmatte.checks import Floats
from blurmatte.radiometry import SRGB, Transfer

Codes = npt.NDArray[np.uint8] | npt.NDArray[np.uint16]

_BITS = (8, 10, 12, 16)


def encode_codes(light: Floats, bits: int, transfer: Transfer = SRGB) -> Codes:
    """Integer code values of linear `light`, any shape: encoded, rounded and clipped.

    They are those of `Camera.expose`: 10 and 12 bits fill the range of uint16.

    Raises
    ------
    ValueError
        If `bits` is neither 8, 10, 12 nor 16.
    """
    check_bits(bits)
    return rounded(transfer.encode(light), bits)


def check_bits(bits: int) -> None:
    """Raise ValueError unless files of so many bits can be made."""
    if bits not in _BITS:
        raise ValueError(f"bits must be 8, 10, 12 or 16, got {bits}")


def check_8_bit_codes(codes: Codes) -> None:
    """Raise TypeError unless they are (H, W, 3) uint8."""
    if codes.dtype != np.uint8 or codes.ndim != 3 or codes.shape[2] != 3:
        raise TypeError(f"codes must be (H, W, 3) uint8, got {codes.shape} {codes.dtype}")


def rounded(values: Floats, bits: int) -> Codes:
    """Code values 0…1 to integers: to the steps of `bits` first, then to the range of the dtype."""
    steps = 2**bits - 1
    codes: Floats = np.rint(steps * np.clip(values, 0, 1))
    if bits == 8:
        return codes.astype(np.uint8)
    codes = np.rint(codes * (65535 / steps))
    return codes.astype(np.uint16)
