"""Transfer curves by name, among them the logarithmic curves of camera makers.

The logarithmic curves come from OpenColorIO's built-in configuration, as tables. Their light is
scene-linear: 0.18 is middle gray, and white exceeds 1. Code value 1 is the top of the file's range,
as OpenColorIO has it (full range, 1023 of 10 bits).
"""

import re
from functools import lru_cache

import numpy as np

from blurmatte.checks import check_kind
from blurmatte.errors import BlurmatteError
from blurmatte.radiometry.transfer import HLG, LINEAR, PQ, REC709, SRGB, TABLE, Transfer, gamma

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


@lru_cache
def log_curve(name: str) -> Transfer:
    """One of LOG_CURVES. Needs the `ocio` extra.

    Raises BlurmatteError if OpenColorIO is not installed.
    """
    try:
        import PyOpenColorIO as ocio
    except ImportError as error:
        raise BlurmatteError(
            f'the curve {name} comes from OpenColorIO: pip install "blurmatte[ocio]"'
        ) from error
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
    """
    check_kind("curve", curve, Transfer, "use blurmatte.named_transfer(name)")
    powers = (gamma(tenths / 10) for tenths in range(11, 31))
    candidates = [SRGB, REC709, LINEAR, *powers]
    light = curve.table(256)
    light = light / light[-1]
    off = [float(np.max(np.abs(other.table(256) - light))) for other in candidates]
    best = int(np.argmin(off))
    return candidates[best], off[best]
