"""FITS, the pictures of cameras of laboratories and telescopes: what their cards say of the numbers.

OpenImageIO gives the numbers as stored, big-endian ones in the order of the machine, the first row at
the top. They are proportional to light. Unsigned integers of 16 bits are stored as signed ones from
which BZERO, 32768, was subtracted.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from blurmatte.checks import AnyArray
from blurmatte.errors import FileError

CARDS = ("Bzero", "Bscale", "Bayerpat", "Exptime", "Exposure")  # by OpenImageIO's names
_UNSIGNED_16 = 1 << 15  # BZERO of unsigned integers of 16 bits


def check_cards(path: Path, kind: str, cards: Mapping[str, Any]) -> None:
    """Raise FileError for numbers that are no light from 0 to white, and for mosaics of colors.

    kind: the type of the numbers as stored.
    """
    try:
        zero, scale = _zero_and_scale(cards)
    except ValueError as error:
        raise FileError(f"{path}: save it again; its BZERO or BSCALE is no number") from error
    usual = {"uint8": (0, 1), "int16": (_UNSIGNED_16, 1)}
    if kind not in ("float", "double") and usual.get(kind) != (zero, scale):
        raise FileError(
            f"{path}: save it as unsigned integers of 16 bits (BZERO 32768), or as floats of which 1 "
            f"is a saturated pixel; its integers ({kind}, BZERO {zero:g}, BSCALE {scale:g}) have no "
            "white"
        )
    if cards.get("Bayerpat"):
        raise FileError(
            f"{path}: save it in color (debayer it); it is the mosaic {str(cards['Bayerpat']).strip()} "
            "of a color camera"
        )


def in_codes(path: Path, pixels: AnyArray, cards: Mapping[str, Any]) -> AnyArray:
    """Code values, or light, of the numbers as stored.

    Raises FileError if most floats are above white: then they are counts of a camera.
    """
    if pixels.dtype == np.int16:
        return (pixels.astype(np.int32) + _UNSIGNED_16).astype(np.uint16)
    if pixels.dtype.kind != "f":
        return pixels
    zero, scale = _zero_and_scale(cards)
    light = np.asarray(zero + scale * pixels, np.float32)
    typical = float(np.nanmedian(light)) if np.isfinite(light).any() else 0.0
    if typical > 1:
        raise FileError(
            f"{path}: divide it by the value of a saturated pixel, so that 1 is white; half of its "
            f"floats are above {typical:.3g}"
        )
    return light


def exposure_time(cards: Mapping[str, Any]) -> dict[str, float]:
    """Seconds, by OpenImageIO's name, if they are stated."""
    found = (cards[name] for name in ("Exptime", "Exposure") if name in cards)
    seconds = next((float(one) for one in found if isinstance(one, int | float)), None)
    return {} if seconds is None else {"ExposureTime": seconds}


def _zero_and_scale(cards: Mapping[str, Any]) -> tuple[float, float]:
    """BZERO and BSCALE."""
    return float(cards.get("Bzero", 0)), float(cards.get("Bscale", 1))
