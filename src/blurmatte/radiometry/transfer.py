"""Transfer curves: code values of a file ⇄ linear light; linear sRGB of cameras and hex digits.

In this file `v` is a code value scaled to 0…1 (255 or 65535 is 1) and `light` is linear, 1 = white.
Every curve is odd, so that noise below black survives a round trip.

The logarithmic curves of camera makers come from OpenColorIO's built-in configuration, as tables. Their
light is scene-linear: 0.18 is middle gray, and white exceeds 1. Code value 1 is the top of the file's
range, as OpenColorIO has it (full range, 1023 of 10 bits).
"""

import math
import re
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
import numpy.typing as npt

from blurmatte.checks import Array, Floats, check_kind
from blurmatte.errors import optional_library

Curve = Callable[[Any], Any]

TRANSFER_HINT = "use blurmatte.radiometry.named_transfer(name)"
_CHUNK = 1 << 16  # values interpolated at a time: they fit the processor's cache
TABLE = 16 * 255 + 1  # entries of a table: the code values of 8 bits, and 15 between each two
# Our names, and those of OpenColorIO's transforms: curves without a change of primaries.
LOG_CURVES = {
    "applelog": "Apple Log - Curve",
    "bmdfilm5": "BMDFilm Gen5 Log - Curve",
    "clog2": "C-Log2 - Curve",
    "clog3": "C-Log3 - Curve",
    "davinci": "DaVinci Intermediate Log - Curve",
    "dlog": "D-Log - Curve",
    "log3g10": "Log3G10 - Curve",
    "logc3": "ARRI LogC3 - Curve (EI800)",
    "logc4": "ARRI LogC4 - Curve",
    "slog3": "S-Log3 - Curve",
    "vlog": "V-Log - Curve",
}
_CONFIG = "studio-config-v4.0.0_aces-v2.0_ocio-v2.5"
Matrix3 = tuple[tuple[float, ...], ...]

LUMA_WEIGHTS = 0.299, 0.587, 0.114  # of R', G', B': ITU-R BT.601, as in JPEG files
LUMA_WEIGHTS_709 = 0.2126, 0.7152, 0.0722  # the same: ITU-R BT.709


@dataclass(frozen=True, repr=False)
class Transfer:
    """A pair of inverse curves between code values and linear light.

    Parameters
    ----------
    name : str
        As in `--transfer` and in reports.
    decode, encode : callable
        Arrays of code values (0…1) to linear light, and back; any shape.

    Examples
    --------
    >>> bm.SRGB
    Transfer(srgb)
    >>> [round(float(curve.decode(0.5)), 3) for curve in (bm.SRGB, bm.radiometry.REC709, bm.LINEAR)]
    [0.214, 0.26, 0.5]
    >>> square = bm.radiometry.Transfer("square", np.square, np.sqrt)
    """

    name: str
    decode: Curve
    encode: Curve

    def __repr__(self) -> str:
        return f"Transfer({self.name})"

    @classmethod
    def from_table(cls, name: str, light: npt.ArrayLike) -> "Transfer":
        """The curve that interpolates a table linearly.

        Below code value 0 it is mirrored at its first point, so that it is odd if that is light 0;
        above 1 it is extrapolated linearly.

        Parameters
        ----------
        name : str
        light : (N,) float
            Linear light of N >= 2 code values, equally spaced from 0 to 1; strictly increasing.

        Raises
        ------
        ValueError
            If there are fewer than two numbers, or they do not increase.
        """
        values = np.array(light, dtype=np.float64)
        if values.ndim != 1 or len(values) < 2 or not np.all(np.isfinite(values)):
            raise ValueError(
                f"light must be two or more finite numbers in a row, got shape {values.shape}"
            )
        if not np.all(np.diff(values) > 0):
            place = int(np.argmin(np.diff(values)))
            raise ValueError(
                "light must rise from each entry to the next, got "
                f"{values[place]:.6g}, {values[place + 1]:.6g}"
            )
        codes = np.arange(len(values)) / (len(values) - 1)
        return cls(name, _LinearInterpolation(codes, values), _LinearInterpolation(values, codes))

    def table(self, levels: int) -> Array:
        """(levels,) linear light of every code value of an integer file, `levels` = 256 or 65536."""
        return np.asarray(self.decode(np.arange(levels) / (levels - 1)), dtype=np.float64)

    def slope(self, light: Floats) -> Floats:
        """Derivative of linear light by code value, at linear `light` (...)."""
        v = self.encode(light)
        h = 1 / 1024
        slope: Floats = (self.decode(v + h) - self.decode(v - h)) / (2 * h)
        return slope


@dataclass(frozen=True, eq=False)
class _LinearInterpolation:
    """Linear interpolation between points (x, y), mirrored at the first, extrapolated at the last."""

    x: Array
    y: Array

    def __call__(self, x: Any) -> Any:
        where = np.asarray(x)
        y = np.empty(where.shape, where.dtype if where.dtype.kind == "f" else np.float64)
        inputs, outputs = np.ravel(where), y.reshape(-1)
        for start in range(0, inputs.size, _CHUNK):
            part = slice(start, start + _CHUNK)
            outputs[part] = self._some(inputs[part].astype(np.float64))
        return y if y.ndim else y[()]

    def _some(self, x: Array) -> Array:
        first, last = self.x[[0, -1]]
        y = np.interp(x, self.x, self.y)
        below, above = x < first, x > last
        if below.any():
            y[below] = 2 * self.y[0] - self._some(2 * first - x[below])
        if above.any():
            end = (self.y[-1] - self.y[-2]) / (last - self.x[-2])
            y[above] = self.y[-1] + end * (x[above] - last)
        return y


# Classes and not closures: they can be pickled for other processes.
@dataclass(frozen=True)
class Odd:
    """The odd continuation of a curve of non-negative numbers."""

    curve: Curve

    def __call__(self, x: Any) -> Any:
        """Its values at numbers of either sign."""
        return np.copysign(self.curve(np.abs(x)), x)


@dataclass(frozen=True)
class _Power:
    """A power of non-negative numbers."""

    exponent: float

    def __call__(self, x: Any) -> Any:
        return x**self.exponent


def _same(x: Any) -> Any:
    return x


def _srgb_decode(v: Floats) -> Floats:
    return np.where(v <= 0.04045, v / 12.92, ((v + 0.055) / 1.055) ** 2.4)


def _srgb_encode(light: Floats) -> Floats:
    return np.where(light <= 0.04045 / 12.92, light * 12.92, 1.055 * light ** (1 / 2.4) - 0.055)


# Rec. 709 prints 1.099 and 0.018; these make the curve continuous (Rec. 2020).
_A, _B = 1.09929682680944, 0.018053968510807


def _rec709_decode(v: Floats) -> Floats:
    return np.where(v < 4.5 * _B, v / 4.5, ((v + _A - 1) / _A) ** (1 / 0.45))


def _rec709_encode(light: Floats) -> Floats:
    return np.where(light < _B, 4.5 * light, _A * light**0.45 - (_A - 1))


SRGB = Transfer("srgb", Odd(_srgb_decode), Odd(_srgb_encode))  # IEC 61966-2-1:1999
REC709 = Transfer("rec709", Odd(_rec709_decode), Odd(_rec709_encode))  # ITU-R BT.709-6 §1.2
LINEAR = Transfer("linear", _same, _same)


_HLG_A = 0.17883277
_HLG_B, _HLG_C = 1 - 4 * _HLG_A, 0.5 - _HLG_A * math.log(4 * _HLG_A)


def _hlg_decode(v: Floats) -> Floats:
    """Inverse OETF, extrapolated above 1."""
    return np.where(v <= 0.5, v**2 / 3, (np.exp((v - _HLG_C) / _HLG_A) + _HLG_B) / 12)


def _hlg_encode(light: Floats) -> Floats:
    upper = np.maximum(12 * light - _HLG_B, 1 - _HLG_B)  # its branch begins at 1/12
    return np.where(light <= 1 / 12, np.sqrt(3 * light), _HLG_A * np.log(upper) + _HLG_C)


_PQ_M1, _PQ_M2 = 2610 / 16384, 2523 / 4096 * 128
_PQ_C1, _PQ_C2, _PQ_C3 = 3424 / 4096, 2413 / 4096 * 32, 2392 / 4096 * 32
_PQ_TOP = 1.01  # code value above which light is constant; the curve's pole is at 1.18
_PQ_WHITE = 203 / 10000  # of the peak: the white of graphics [ITU-R BT.2408]


def _pq_decode(v: Floats) -> Floats:
    """EOTF; 1 is 203 cd/m²."""
    power = np.minimum(v, _PQ_TOP) ** (1 / _PQ_M2)
    peak = np.maximum(power - _PQ_C1, 0) / (_PQ_C2 - _PQ_C3 * power)
    return peak ** (1 / _PQ_M1) / _PQ_WHITE


def _pq_encode(light: Floats) -> Floats:
    power = (light * _PQ_WHITE) ** _PQ_M1
    return ((_PQ_C1 + _PQ_C2 * power) / (1 + _PQ_C3 * power)) ** _PQ_M2


# ITU-R BT.2100-3: HLG by its inverse OETF, light of the scene; PQ by its EOTF, light of the display,
# which is that of the scene up to the rendering of the camera.
HLG = Transfer("hlg", Odd(_hlg_decode), Odd(_hlg_encode))
PQ = Transfer("pq", Odd(_pq_decode), Odd(_pq_encode))


def gamma(exponent: float) -> Transfer:
    """Pure power curve: light = v ** exponent.

    Raises
    ------
    ValueError
        Unless 0.1 <= exponent <= 10.

    Examples
    --------
    >>> print(f"{bm.radiometry.gamma(2.2).decode(0.5):.3f}")
    0.218
    """
    if not 0.1 <= exponent <= 10:
        raise ValueError(f"gamma must lie between 0.1 and 10, got {exponent}")
    return Transfer(
        f"gamma{exponent:g}",
        Odd(_Power(exponent)),
        Odd(_Power(1 / exponent)),
    )


@lru_cache
def log_curve(name: str) -> Transfer:
    """One of LOG_CURVES. Needs the `ocio` extra.

    Raises BlurmatteError if OpenColorIO is not installed.
    """
    needed = f'the curve {name} comes from OpenColorIO: pip install "blurmatte[ocio]"'
    ocio = optional_library("PyOpenColorIO", needed)
    config = ocio.Config.CreateFromBuiltinConfig(_CONFIG)
    transform = config.getNamedTransform(LOG_CURVES[name])
    processor = config.getProcessor(transform, ocio.TRANSFORM_DIR_FORWARD)
    codes = np.linspace(0, 1, TABLE, dtype=np.float32)
    light = np.ascontiguousarray(np.repeat(codes[:, None], 3, axis=1))
    processor.getDefaultCPUProcessor().applyRGB(light)
    return Transfer.from_table(name, light[:, 0])


def named_transfer(name: str) -> Transfer:
    """The transfer curve of a name.

    srgb, rec709, linear; gamma2.2 with any exponent; hlg, whose light is that of the scene, and pq,
    that of the screen, 1 at 203 cd/m² [ITU-R BT.2100, BT.2408]; or a camera maker's logarithmic curve,
    whose light is scene-linear with 0.18 for middle gray: slog3, logc3 (EI 800), logc4, vlog, clog2,
    clog3, log3g10, davinci, dlog, bmdfilm5, applelog. The logarithmic curves need the `ocio` extra.

    Raises
    ------
    ValueError
        For any other name.
    BlurmatteError
        If OpenColorIO is needed and not installed.

    Examples
    --------
    >>> bm.radiometry.named_transfer("gamma1.8")
    Transfer(gamma1.8)
    """
    check_kind("name", name, str, 'such as "srgb"')
    known = {curve.name: curve for curve in (SRGB, REC709, LINEAR, HLG, PQ)}
    if name in known:
        return known[name]
    if name in LOG_CURVES:
        return log_curve(name)
    power = re.fullmatch(r"gamma(\d+(\.\d+)?)", name)
    if power is None:
        names = ", ".join([*known, *LOG_CURVES])
        raise ValueError(f"no transfer is called {name!r}; use {names}, or e.g. gamma2.2")
    return gamma(float(power[1]))


def nearest_transfer(curve: Transfer) -> tuple[Transfer, float]:
    """The nearest of srgb, rec709, linear and gamma1.1 to gamma3.0, and its distance.

    Light is compared after both curves are scaled to 1 at code value 1.

    Returns
    -------
    tuple of Transfer and float
        The curve, and the largest difference of light, as a fraction of full scale.

    Examples
    --------
    >>> curve, difference = bm.radiometry.nearest_transfer(bm.radiometry.gamma(2.21))
    >>> print(f"{curve.name}, to {difference:.3f}")
    gamma2.2, to 0.002
    """
    check_kind("curve", curve, Transfer, TRANSFER_HINT)
    powers = (gamma(tenths / 10) for tenths in range(11, 31))
    candidates = [SRGB, REC709, LINEAR, *powers]
    light = curve.table(256)
    light = light / light[-1]
    off = [float(np.max(np.abs(other.table(256) - light))) for other in candidates]
    best = int(np.argmin(off))
    return candidates[best], off[best]


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


def is_hex(color: str) -> bool:
    """Whether it is a color of six hexadecimal digits, with or without a #."""
    return re.fullmatch("#?[0-9a-fA-F]{6}", color) is not None


def light_of_hex(*colors: str) -> Array:
    """(n, 3) linear sRGB, 0…1, of colors of six hexadecimal digits, with or without a #.

    Raises ValueError if a color is not written like that.
    """
    codes = []
    for color in colors:
        if not is_hex(color):
            raise ValueError(f"a color must look like #d8ff3c, got {color!r}")
        codes.append(list(bytes.fromhex(color.removeprefix("#"))))
    return np.asarray(SRGB.decode(np.array(codes, dtype=float).reshape(-1, 3) / 255))


def hex_of_light(light: Floats) -> str:
    """Linear sRGB (3,), 0…1, as sRGB-coded #rrggbb."""
    return "#{:02x}{:02x}{:02x}".format(*np.rint(255 * SRGB.encode(light)).astype(int))
