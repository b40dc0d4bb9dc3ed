"""Logarithmic curves of camera makers, from OpenColorIO's built-in configuration, as tables.

Light is scene-linear: 0.18 is middle gray and whites exceed 1. Code value 1 is the top of the file's
range, as OpenColorIO has it (full range, 1023 of 10 bits).
"""

from functools import lru_cache

import numpy as np

from blurmatte.errors import BlurmatteError
from blurmatte.radiometry.transfer import TABLE, Transfer

# Our names, and those of the transforms: pure curves, without a change of primaries.
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
    """The curve of one of LOG_CURVES. Needs the `ocio` extra.

    Raises
    ------
    BlurmatteError
        If OpenColorIO is not installed.
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
