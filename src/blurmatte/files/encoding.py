"""How the code values of a picture file encode light, by its caller, its profile or its tags.

The first source that states it wins: PNG's cICP chunk, the ICC profile, PNG's sRGB, gAMA and cHRM
chunks, the color box of AVIF and HEIC, the attributes of an EXR, EXIF. The caller's `transfer` replaces
the curves. Otherwise floats are linear, and integers are taken as sRGB with a warning.
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from blurmatte.checks import AnyArray, Array, Floats
from blurmatte.errors import FileError, TransferWarning, warn
from blurmatte.files import icc
from blurmatte.files.exif import ColorSpace
from blurmatte.files.png import PngHeader
from blurmatte.files.raster import CICP, DCF, PRIMARIES, Raster
from blurmatte.formats import EXR, FITS
from blurmatte.radiometry.transfer import HLG, LINEAR, PQ, REC709, SRGB, Transfer, gamma

# Transfer characteristics of ITU-T H.273 that are plain curves.
CICP_CURVES = {
    **dict.fromkeys((1, 6, 14, 15), REC709),
    4: gamma(2.2),
    5: gamma(2.8),
    8: LINEAR,
    13: SRGB,
    16: PQ,
    18: HLG,
}

_INTEROP_CURVES = {
    **{"lin": LINEAR, "srgb": SRGB},
    **{f"g{tenths}": gamma(tenths / 10) for tenths in (18, 22, 24, 26)},
}
_ASSUMED = icc.Profile((SRGB, SRGB, SRGB), None)
Curves = tuple[Transfer, Transfer, Transfer]


def icc_profile(raster: Raster) -> bytes | None:
    """The ICC profile of a file, if it has one."""
    profile = raster.tags.get("ICCProfile")
    if profile is None or isinstance(profile, bytes):
        return profile
    return np.asarray(profile, dtype=np.uint8).tobytes()


def encoding_of(raster: Raster, transfer: Transfer | None) -> icc.Profile | None:
    """The curves and the primaries of a file; None for floats that are linear light of sRGB.

    A `transfer` from the caller replaces the curves that the file states, not its primaries.

    Raises FileError if the file states an encoding that is not supported: look-up
    tables. Warns TransferWarning if the file states no encoding and its integers are taken as sRGB.
    """
    given = None if transfer is None else (transfer,) * 3
    found = _stated(raster, given)
    if found is not None:
        return found
    matrix = primaries_alone(raster)
    if given is None and raster.levels is None:
        return None if matrix is None else icc.Profile((LINEAR,) * 3, matrix)
    if given is None and raster.tags.get("Exif:ColorSpace") != ColorSpace.SRGB:
        warn(
            f"{raster.path}: the file has no color profile, and its code values are taken as sRGB; "
            "if that is right, pass transfer=SRGB (--transfer srgb)",
            TransferWarning,
        )
        return icc.Profile(_ASSUMED.curves, matrix, assumed=True)
    return icc.Profile(given or _ASSUMED.curves, matrix)


def _stated(raster: Raster, given: Curves | None) -> icc.Profile | None:
    """The encoding that a file states, with the curves `given` if there are any."""
    chunks = png_encoding(raster, given)
    data = icc_profile(raster)
    if data is not None and not (raster.png and raster.png.cicp):
        return _from_profile(raster, data, given)
    if chunks is not None:
        return chunks
    if CICP in raster.tags:
        return _from_cicp(raster.path, raster.tags[CICP], given)
    if raster.format is EXR:
        return _from_exr(raster, given)
    if raster.format is FITS and raster.levels:
        return icc.Profile(given or (LINEAR,) * 3, None)
    if raster.tags.get("Exif:ColorSpace") == ColorSpace.ADOBE_RGB or raster.tags.get(DCF) == b"R03":
        return icc.Profile(given or (gamma(563 / 256),) * 3, icc.matrix_to_srgb(icc.ADOBE_RGB))
    return None


def to_light(numbers: AnyArray, encoding: icc.Profile | None) -> Floats:
    """Linear float32 light of (H, W, 3) code values 0…1, or of light that is stored as floats."""
    if encoding is None:
        return numbers.astype(np.float32, copy=False)
    light = np.empty(numbers.shape, np.float32)
    for c, curve in enumerate(encoding.curves):
        light[..., c] = curve.decode(numbers[..., c])
    return to_srgb_primaries(light, encoding)


def from_light(light: Floats, encoding: icc.Profile | None) -> Array:
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


def to_srgb_primaries(light: Floats, encoding: icc.Profile) -> Floats:
    """Linear light converted to the primaries of sRGB."""
    if encoding.matrix is None:
        return light
    return np.asarray(light @ encoding.matrix.T.astype(light.dtype))


def png_encoding(raster: Raster, given: Curves | None = None) -> icc.Profile | None:
    """The encoding that the chunks of a PNG state, without its ICC profile, but by cICP before it."""
    header = raster.png
    if header is None:
        return None
    if header.cicp:
        return _from_cicp(raster.path, header.cicp, given)
    if header.srgb:
        return icc.Profile(given or _ASSUMED.curves, None)
    curve = _gamma_curve(header) if header.gamma else None
    return icc.Profile(given or (curve,) * 3, primaries_alone(raster)) if curve else None


def primaries_alone(raster: Raster) -> Array | None:
    """From the primaries in a PNG's cHRM chunk or in EXIF, which hold no curve, to those of sRGB."""
    stated = raster.png.chromaticities if raster.png else None
    if stated is None and raster.tags.get("Exif:ColorSpace") != ColorSpace.SRGB:
        stated = raster.tags.get(PRIMARIES)
    return None if stated is None else _matrix(raster.path, "primaries", stated)


def _matrix(path: Path, name: str, chromaticities: Sequence[float]) -> Array | None:
    try:
        return icc.matrix_to_srgb(chromaticities)
    except ValueError as error:
        raise FileError(f"{path}: convert the picture to sRGB; its {name} {error}") from error


def _from_profile(raster: Raster, data: bytes, given: Curves | None) -> icc.Profile:
    try:
        profile = icc.parse_profile(data)
    except icc.ProfileError as error:
        if given:  # the caller's curve replaces a profile that cannot be used
            return icc.Profile(given, None)
        raise FileError(
            f"{raster.path}: convert the picture to sRGB; its color profile {error}"
        ) from error
    return icc.Profile(given, profile.matrix) if given else profile


def _from_exr(raster: Raster, given: Curves | None) -> icc.Profile | None:
    """By `colorInteropID`, which OpenImageIO also finds in ACES containers, and by `chromaticities`."""
    xy, name = raster.tags.get("chromaticities"), str(raster.tags.get("oiio:ColorSpace", ""))
    matrix = None if xy is None else _matrix(raster.path, "chromaticities", xy)
    if name in ("", "unknown", "data"):
        return None if matrix is None else icc.Profile(given or (LINEAR,) * 3, matrix)
    curve, _, space = name.removesuffix("_scene").removesuffix("_display").partition("_")
    if curve not in _INTEROP_CURVES or space not in icc.INTEROP_PRIMARIES:
        raise FileError(
            f"{raster.path}: convert it to lin_rec709_scene; its colorInteropID states {name!r}, which "
            "is not supported"
        )
    named = icc.matrix_to_srgb(icc.INTEROP_PRIMARIES[space])
    if xy is not None and not np.allclose(_or_eye(matrix), _or_eye(named), atol=0.01):
        raise FileError(
            f"{raster.path}: export it again; its chromaticities are not those of its "
            f"colorInteropID {name!r}"
        )
    if named is None and curve == "lin" and given is None:
        return None
    return icc.Profile(given or (_INTEROP_CURVES[curve],) * 3, named)


def _or_eye(matrix: Array | None) -> Array:
    return np.eye(3) if matrix is None else matrix


def _from_cicp(path: Path, cicp: tuple[int, ...], given: Curves | None) -> icc.Profile:
    primaries, curve, matrix, full_range = cicp
    advice = f"{path}: convert the picture to sRGB; its code points (CICP) state"
    if primaries not in icc.CICP_PRIMARIES or not (given or curve in CICP_CURVES):
        raise FileError(
            f"{advice} primaries {primaries} and curve {curve} of H.273, which are not supported"
        )
    if matrix or not full_range:
        what = "Y'CbCr" if matrix else "video range, where black is 16 and white 235"
        raise FileError(f"{advice} {what}, which is not supported")
    curves = given or (CICP_CURVES[curve],) * 3
    return icc.Profile(curves, icc.matrix_to_srgb(icc.CICP_PRIMARIES[primaries]))


def _gamma_curve(header: PngHeader) -> Transfer | None:
    """The curve of a gAMA chunk; 1/2.2 stands for sRGB in files without an sRGB chunk."""
    exponent, adobe = header.gamma or 0.0, header.chromaticities == icc.ADOBE_RGB
    if abs(exponent - 1 / 2.2) < 0.005 and not adobe:
        return SRGB
    if abs(exponent - 1) < 0.001:
        return LINEAR
    return gamma(1 / exponent) if 0.1 <= exponent <= 10 else None
