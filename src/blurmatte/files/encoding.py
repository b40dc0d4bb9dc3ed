"""How the code values of a picture file encode light, by its caller, its profile or its tags.

The first source that states it wins: the caller's `transfer`, the ICC profile, PNG's cICP, sRGB and
gAMA chunks, EXIF. Otherwise floats are linear, and integers are taken as sRGB with a warning.
"""

import warnings
from enum import IntEnum
from typing import Any

import numpy as np
import numpy.typing as npt

from blurmatte.checks import Floats
from blurmatte.errors import FileError, TransferWarning
from blurmatte.files.icc import Matrix, Profile, ProfileError, parse_profile
from blurmatte.files.raster import IS_SRGB, Raster
from blurmatte.radiometry.transfer import LINEAR, REC709, SRGB, Transfer, gamma


class H273(IntEnum):
    """Code points of ITU-T H.273 for curves, primaries and matrices."""

    BT709 = 1
    UNSPECIFIED = 2
    BT601 = 5  # the matrix


# Transfer characteristics of ITU-T H.273 that are plain curves.
CICP_CURVES = {
    **dict.fromkeys((1, 6, 14, 15), REC709),
    4: gamma(2.2),
    5: gamma(2.8),
    8: LINEAR,
    13: SRGB,
}

_ASSUMED = Profile((SRGB, SRGB, SRGB), None)


def icc_profile(raster: Raster) -> bytes | None:
    """The ICC profile of a file, if it has one."""
    profile = raster.tags.get("ICCProfile")
    return None if profile is None else np.asarray(profile, dtype=np.uint8).tobytes()


def encoding_of(raster: Raster, transfer: Transfer | None, stacklevel: int) -> Profile | None:
    """The curves and the primaries of a file; None for floats that are linear light.

    A `transfer` from the caller replaces the curves of the ICC profile, not its primaries.

    Raises
    ------
    FileError
        If the file states an encoding that is not supported: look-up tables, HDR curves.

    Warns
    -----
    TransferWarning
        If the file states no encoding and its integers are taken as sRGB.
    """
    if transfer is not None:
        return Profile((transfer, transfer, transfer), _primaries_matrix(raster))
    found = _from_profile(raster) or png_encoding(raster)
    if found or raster.levels is None:
        return found
    if raster.tags.get("Exif:ColorSpace") != IS_SRGB:
        warnings.warn(
            f"{raster.path}: pass transfer=SRGB (--transfer srgb) if that is right; "
            "the file has no color profile and its code values are taken as sRGB",
            TransferWarning,
            stacklevel=stacklevel + 1,
        )
    return _ASSUMED


def to_light(numbers: npt.NDArray[Any], encoding: Profile | None) -> Floats:
    """Linear float32 light of (H, W, 3) code values 0…1, or of light that is stored as floats."""
    if encoding is None:
        return numbers.astype(np.float32, copy=False)
    light = np.empty(numbers.shape, np.float32)
    for c, curve in enumerate(encoding.curves):
        light[..., c] = curve.decode(numbers[..., c])
    return to_srgb_primaries(light, encoding)


def from_light(light: Floats, encoding: Profile | None) -> npt.NDArray[np.float64]:
    """(N, 3) code values 0…1, or floats to store, of linear light; the inverse of `to_light`.

    Not clipped. In float64, so that rounding does not change 16-bit code values.
    """
    values = light.astype(np.float64)
    if encoding is None:
        return values
    if encoding.matrix is not None:
        values = np.linalg.solve(encoding.matrix, values.T).T.astype(np.float64)
    columns = [curve.encode(values[:, c]) for c, curve in enumerate(encoding.curves)]
    return np.stack(columns, axis=-1)


def to_srgb_primaries(light: Floats, encoding: Profile) -> Floats:
    """Linear light converted to the primaries of sRGB."""
    if encoding.matrix is None:
        return light
    return np.asarray(light @ encoding.matrix.T.astype(light.dtype))


def png_encoding(raster: Raster) -> Profile | None:
    """The encoding that the chunks of a PNG state, without its ICC profile."""
    if raster.png is None:
        return None
    if "CICP" in raster.tags:
        return _from_cicp(raster)
    if raster.png.srgb:
        return _ASSUMED
    if raster.png.gamma is None:
        return None
    curve = _gamma_curve(raster.png.gamma)
    return Profile((curve, curve, curve), None) if curve else None


def _from_profile(raster: Raster) -> Profile | None:
    data = icc_profile(raster)
    if data is None:
        return None
    try:
        return parse_profile(data)
    except ProfileError as error:
        raise FileError(
            f"{raster.path}: convert the picture to sRGB; its color profile {error}"
        ) from error


def _primaries_matrix(raster: Raster) -> Matrix | None:
    data = icc_profile(raster)
    try:
        return parse_profile(data).matrix if data is not None else None
    except ProfileError:  # the caller's curve replaces a profile that cannot be used
        return None


def _from_cicp(raster: Raster) -> Profile:
    primaries, curve, *_ = (int(number) for number in raster.tags["CICP"])
    if primaries != H273.BT709 or curve not in CICP_CURVES:
        raise FileError(
            f"{raster.path}: convert the picture to sRGB; its cICP chunk states primaries "
            f"{primaries} and curve {curve} of H.273, which are not supported"
        )
    return Profile((CICP_CURVES[curve],) * 3, None)


def _gamma_curve(exponent: float) -> Transfer | None:
    """The curve of a gAMA chunk; 1/2.2 stands for sRGB in files without an sRGB chunk."""
    if abs(exponent - 1 / 2.2) < 0.005:
        return SRGB
    if abs(exponent - 1) < 0.001:
        return LINEAR
    return gamma(1 / exponent) if 0.1 <= exponent <= 10 else None
