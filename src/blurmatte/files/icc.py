"""Colors of files: ICC profiles with a curve per channel and a matrix, and primaries that files state.

`v` is a code value (0…1), `light` is linear, and XYZ is relative to D50, the white of the profile
connection space [ICC.1:2022]. Profiles with look-up tables (printers, Lab) need a color management
system and are rejected.

Primaries are stated by number, by name or by chromaticities. Chromaticities are CIE (x, y) of red,
green, blue and white, eight numbers in this order. The conversion keeps XYZ as the file states it: a
white other than D65 is not adapted.
"""

import struct
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import IntEnum
from functools import lru_cache

import numpy as np

from blurmatte.checks import Array, Floats
from blurmatte.radiometry.transfer import LINEAR, SRGB, Odd, Transfer, gamma

# Of a matrix to sRGB: sRGB profiles differ so much in their adaptation to D50.
SAME_PRIMARIES = 3e-3

# Columns: red, green and blue of sRGB in XYZ, adapted to D50 by the Bradford transform.
_SRGB_TO_XYZ = np.array(
    [
        [0.4360747, 0.3850649, 0.1430804],
        [0.2225045, 0.7168786, 0.0606169],
        [0.0139322, 0.0971045, 0.7141733],
    ]
)
Chromaticities = tuple[float, ...]

_D65, _C, _D60 = (0.3127, 0.3290), (0.310, 0.316), (0.32168, 0.33767)
BT709 = (0.64, 0.33, 0.30, 0.60, 0.15, 0.06, *_D65)
_SMPTE170M = (0.630, 0.340, 0.310, 0.595, 0.155, 0.070, *_D65)
_BT2020 = (0.708, 0.292, 0.170, 0.797, 0.131, 0.046, *_D65)
_P3 = (0.680, 0.320, 0.265, 0.690, 0.150, 0.060)
ADOBE_RGB = (0.64, 0.33, 0.21, 0.71, 0.15, 0.06, *_D65)


class H273(IntEnum):
    """Code points of ITU-T H.273 for curves, primaries and matrices."""

    BT709 = 1
    UNSPECIFIED = 2
    BT601 = 5  # the matrix


# Color primaries of ITU-T H.273, table 2.
CICP_PRIMARIES: dict[int, Chromaticities] = {
    1: BT709,
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
    "rec709": BT709,
    "rec2020": _BT2020,
    "p3d65": (*_P3, *_D65),
    "adobergb": ADOBE_RGB,
    "ap0": (0.7347, 0.2653, 0, 1, 0.0001, -0.077, *_D60),
    "ap1": (0.713, 0.293, 0.165, 0.830, 0.128, 0.044, *_D60),
    "ciexyzd65": (1, 0, 0, 1, 0, 0, *_D65),
}


class ProfileError(ValueError):
    """The profile cannot be used; the message is a predicate that gives the reason."""


@dataclass(frozen=True, eq=False)
class Profile:
    """Code values to linear light with the primaries of sRGB and Rec. 709."""

    curves: tuple[Transfer, Transfer, Transfer]  # curves of red, green and blue
    # From linear light with the profile's primaries to sRGB primaries; None if they are equal
    matrix: Array | None
    assumed: bool = False  # true if neither the file nor the caller states the curves


@lru_cache(maxsize=8)  # pictures of one camera share one profile, and hence one Transfer
def parse_profile(data: bytes) -> Profile:
    """Read an ICC profile.

    Raises ProfileError if the profile is damaged, or is not a matrix profile of RGB or gray.
    """
    try:
        space, connection = data[16:20], data[20:24]
        if space not in (b"RGB ", b"GRAY"):
            raise ProfileError(f"is for {_text(space)} pictures")
        tags = _tags(data)
        needed = {b"kTRC"} if space == b"GRAY" else {b"rTRC", b"gTRC", b"bTRC", b"rXYZ", b"gXYZ"}
        if connection != b"XYZ " or not needed <= tags.keys():
            raise ProfileError("uses look-up tables")
        if space == b"GRAY":
            return Profile((_curve(tags[b"kTRC"]),) * 3, None)
        return _rgb(tags)
    except (struct.error, KeyError, IndexError) as error:
        raise ProfileError("is damaged") from error


def _text(signature: bytes) -> str:
    text = signature.decode("latin-1").strip()
    return text if text.isascii() and text.isprintable() and text else "unknown"


def _tags(data: bytes) -> dict[bytes, bytes]:
    (count,) = struct.unpack_from(">I", data, 128)
    if count > 1000:
        raise ProfileError("is damaged")
    entries = (struct.unpack_from(">4sII", data, 132 + 12 * i) for i in range(count))
    return {name: data[start : start + length] for name, start, length in entries}


def _rgb(tags: Mapping[bytes, bytes]) -> Profile:
    red, green, blue = (_curve(tags[name]) for name in (b"rTRC", b"gTRC", b"bTRC"))
    columns = [struct.unpack_from(">3i", tags[name], 8) for name in (b"rXYZ", b"gXYZ", b"bXYZ")]
    to_xyz = np.array(columns).T / 65536
    matrix = np.linalg.solve(_SRGB_TO_XYZ, to_xyz)
    same = bool(np.all(np.abs(matrix - np.eye(3)) < SAME_PRIMARIES))
    return Profile((red, green, blue), None if same else matrix)


def _curve(tag: bytes) -> Transfer:
    """The curve of a tag; SRGB if it equals sRGB up to rounding to a table or to 16 bits."""
    if tag[:4] == b"curv":
        curve = _sampled(tag)
    elif tag[:4] == b"para":
        curve = _parametric(tag)
    else:
        raise ProfileError(f"has a curve of an unknown kind ({_text(tag[:4])})")
    v = np.linspace(0, 1, 1025)
    light = curve.decode(v)
    # Measured or rounded curves may decrease slightly between neighboring values.
    if not np.all(np.isfinite(light)) or np.any(np.diff(light) < -1e-4) or light[-1] <= light[0]:
        raise ProfileError("has a curve that does not rise")
    if np.abs(light - SRGB.decode(v)).max() < 1e-3:
        return SRGB
    return curve


def _sampled(tag: bytes) -> Transfer:
    (count,) = struct.unpack_from(">I", tag, 8)
    if count == 0:
        return LINEAR
    values = struct.unpack_from(f">{count}H", tag, 12)
    if count == 1:
        return _power(values[0] / 256)
    light = np.array(values) / 65535
    v = np.linspace(0, 1, count)
    codes = _Polyline(np.maximum.accumulate(light), v)
    return Transfer("icc", Odd(_Polyline(v, light)), Odd(codes))


def _power(exponent: float) -> Transfer:
    if exponent == 1:
        return LINEAR
    if not 0.1 <= exponent <= 10:
        raise ProfileError(f"has a curve with the exponent {exponent:g}")
    return gamma(exponent)


@dataclass(frozen=True, eq=False)
class _Polyline:
    """Linear interpolation, proportional above the last point."""

    x: Array
    y: Array

    def __call__(self, value: Floats) -> Floats:
        above = np.maximum(value / self.x[-1], 1)
        return np.asarray(np.interp(value, self.x, self.y) * above)


def _parametric(tag: bytes) -> Transfer:
    """Every function type is light = (a v + b)^g + e for v ≥ d, and c v + f below."""
    (kind,) = struct.unpack_from(">H", tag, 8)
    count = {0: 1, 1: 3, 2: 4, 3: 5, 4: 7}.get(kind)  # parameters [ICC.1 table 68]
    if count is None:
        raise ProfileError(f"has a curve of the unknown type {kind}")
    g, *rest = (p / 65536 for p in struct.unpack_from(f">{count}i", tag, 12))
    if kind == 0:
        return _power(g)
    a, b = rest[:2]
    if g <= 0 or a <= 0:
        raise ProfileError("has a curve that does not rise")
    if kind < 3:
        offset = rest[2] if kind == 2 else 0.0
        power = _PowerWithFoot(g, a, b, 0.0, -b / a, offset, offset)
    else:
        c, d, *shift = rest[2:]
        e, f = shift or (0.0, 0.0)
        power = _PowerWithFoot(g, a, b, c, d, e, f)
    return Transfer("icc", Odd(power.decode), Odd(power.encode))


@dataclass(frozen=True)
class _PowerWithFoot:
    """light = (a v + b)^g + e for v ≥ d, c v + f below."""

    g: float
    a: float
    b: float
    c: float
    d: float
    e: float
    f: float

    def decode(self, v: Floats) -> Floats:
        """Light of code values."""
        upper = np.maximum(self.a * v + self.b, 0) ** self.g + self.e
        return np.where(v >= self.d, upper, self.c * v + self.f)

    def encode(self, light: Floats) -> Floats:
        """Code values of light."""
        knee = max(self.a * self.d + self.b, 0) ** self.g + self.e
        upper = (np.maximum(light - self.e, 0) ** (1 / self.g) - self.b) / self.a
        foot = (light - self.f) / self.c if self.c else np.zeros_like(light)
        return np.maximum(np.where(light >= knee, upper, foot), 0)


def matrix_to_srgb(chromaticities: Sequence[float]) -> Array | None:
    """From linear light with these primaries to those of sRGB; None if they are equal.

    Raises ValueError if they are no primaries of three independent colors and a white.
    """
    with np.errstate(all="ignore"):
        try:
            matrix: Array = np.linalg.inv(xyz_of(BT709)) @ xyz_of(chromaticities)
        except np.linalg.LinAlgError as error:
            raise ValueError("are no three colors") from error
    # Beyond any real color space; a matrix like that would make noise of the picture.
    if not np.all(np.abs(matrix) < 100) or np.linalg.cond(matrix) > 1e4:
        raise ValueError("are no three colors")
    return None if bool(np.all(np.abs(matrix - np.eye(3)) < SAME_PRIMARIES)) else matrix


def xyz_of(chromaticities: Sequence[float]) -> Array:
    """Columns: XYZ of red, green and blue, whose sum is white with Y = 1."""
    x, y = np.reshape(np.asarray(chromaticities, dtype=float), (4, 2)).T
    colors = np.stack([x, y, 1 - x - y])
    return np.asarray(colors[:, :3] * np.linalg.solve(colors[:, :3], colors[:, 3] / y[3]))
