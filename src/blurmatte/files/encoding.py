"""How the code values of a picture file encode light: asked of its caller, its profile, its tags.

The first that answers wins: the caller's `transfer`, the ICC profile, PNG's cICP, sRGB and gAMA
chunks, EXIF. Floats that nobody explains are linear; integers are taken as sRGB, with a warning.
"""

import warnings
from typing import Any

import numpy as np
import numpy.typing as npt

from blurmatte.checks import Floats
from blurmatte.errors import FileError, TransferWarning
from blurmatte.files.icc import Matrix, Profile, ProfileError, parse_profile
from blurmatte.files.raster import Raster
from blurmatte.radiometry import LINEAR, REC709, SRGB, Transfer, gamma

# Transfer characteristics of ITU-T H.273 that are a plain curve.
CICP_CURVES = {
    **dict.fromkeys((1, 6, 14, 15), REC709),
    4: gamma(2.2),
    5: gamma(2.8),
    8: LINEAR,
    13: SRGB,
}
_CICP_REC709 = 1  # primaries
_ASSUMED = Profile((SRGB, SRGB, SRGB), None)


def icc_profile(raster: Raster) -> bytes | None:
    """The ICC profile of a file, if it has one."""
    profile = raster.tags.get("ICCProfile")
    return None if profile is None else np.asarray(profile, dtype=np.uint8).tobytes()


def encoding_of(raster: Raster, transfer: Transfer | None, stacklevel: int) -> Profile | None:
    """The curves and the primaries of a file; None: its floats are light already.

    A `transfer` from the caller replaces the curves of the ICC profile, not its primaries.

    Raises
    ------
    FileError
        If the file's own words are beyond us: look-up tables, HDR curves.
    """
    if transfer is not None:
        return Profile((transfer, transfer, transfer), _matrix(raster))
    found = _from_profile(raster) or png_encoding(raster)
    if found or raster.levels is None:
        return found
    if raster.tags.get("Exif:ColorSpace") != 1:
        warnings.warn(
            f"{raster.path}: has no color profile; its code values are taken as sRGB. "
            "If that is right, pass transfer=SRGB (--transfer srgb) to say so",
            TransferWarning,
            stacklevel=stacklevel + 1,
        )
    return _ASSUMED


def to_light(numbers: npt.NDArray[Any], encoding: Profile | None) -> Floats:
    """Linear float32 light of (H, W, 3) code values 0…1 or light that was stored as floats."""
    if encoding is None:
        return numbers.astype(np.float32, copy=False)
    light = np.empty(numbers.shape, np.float32)
    for c, curve in enumerate(encoding.curves):
        light[..., c] = curve.decode(numbers[..., c])
    return to_srgb_primaries(light, encoding)


def from_light(light: Floats, encoding: Profile | None) -> npt.NDArray[np.float64]:
    """(N, 3) code values 0…1, or light that is stored as floats: what `to_light` turns into `light`.

    Not clipped. In float64, so that rounding does not move code values of 16 bits.
    """
    values = light.astype(np.float64)
    if encoding is None:
        return values
    if encoding.matrix is not None:
        values = np.linalg.solve(encoding.matrix, values.T).T.astype(np.float64)
    columns = [curve.encode(values[:, c]) for c, curve in enumerate(encoding.curves)]
    return np.stack(columns, axis=-1)


def to_srgb_primaries(light: Floats, encoding: Profile) -> Floats:
    """The same light as seen by the primaries of sRGB."""
    if encoding.matrix is None:
        return light
    return np.asarray(light @ encoding.matrix.T.astype(light.dtype))


def png_encoding(raster: Raster) -> Profile | None:
    """What the chunks of a PNG say of its curve and primaries, but for its ICC profile."""
    if raster.png is None:
        return None
    if "CICP" in raster.tags:
        return _from_cicp(raster)
    if raster.png.srgb:
        return _ASSUMED
    if raster.png.gamma is None:
        return None
    curve = _power(raster.png.gamma)
    return Profile((curve, curve, curve), None) if curve else None


def _from_profile(raster: Raster) -> Profile | None:
    data = icc_profile(raster)
    if data is None:
        return None
    try:
        return parse_profile(data)
    except ProfileError as error:
        raise FileError(
            f"{raster.path}: its color profile {error}; convert the picture to sRGB first"
        ) from error


def _matrix(raster: Raster) -> Matrix | None:
    data = icc_profile(raster)
    try:
        return parse_profile(data).matrix if data is not None else None
    except ProfileError:  # the caller knows better than a profile that cannot be used
        return None


def _from_cicp(raster: Raster) -> Profile:
    primaries, curve, *_ = (int(number) for number in raster.tags["CICP"])
    if primaries != _CICP_REC709 or curve not in CICP_CURVES:
        raise FileError(
            f"{raster.path}: its cICP chunk asks for other colors than sRGB's "
            f"({primaries}, {curve}); convert the picture to sRGB first"
        )
    return Profile((CICP_CURVES[curve],) * 3, None)


def _power(exponent: float) -> Transfer | None:
    """The curve of a gAMA chunk. 1/2.2 is how sRGB was written before it had a chunk of its own."""
    if abs(exponent - 1 / 2.2) < 0.005:
        return SRGB
    if abs(exponent - 1) < 0.001:
        return LINEAR
    return gamma(1 / exponent) if 0.1 <= exponent <= 10 else None
