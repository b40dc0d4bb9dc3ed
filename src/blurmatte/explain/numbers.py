"""Numbers with as many digits as their errors leave meaning."""

import math
from typing import Any

_OCTANTS = (  # clockwise in the picture
    "right",
    "right and down",
    "down",
    "left and down",
    "left",
    "left and up",
    "up",
    "right and up",
)


def rounded_std(std: float) -> str:
    """A standard deviation alone: one digit, or no fraction."""
    return f"{std:.0f}" if std >= 1 else f"{std:.1g}"


def with_error(value: float, std: float) -> str:
    """A number and its standard deviation, to two digits of that; four digits without one."""
    if not math.isfinite(std) or std <= 0:
        return f"{value:.4g}"
    digits = max(0, 1 - math.floor(math.log10(std)))
    return f"{value:.{digits}f} ± {std:.{digits}f}"


def with_article(noun: str) -> str:
    """The noun after its article."""
    return f"{'an' if noun[:1] in 'aeiou' else 'a'} {noun}"


def direction(degrees: float, std: float = 0.0) -> str:
    """An angle in the picture, −180 to 180, y down, and in words which way it points."""
    way, octant = "up" if degrees < 0 else "down", round(degrees / 45) % 8
    words = _OCTANTS[octant]
    return f"{with_error(abs(degrees), std)}° from right towards {way} ({words})"


def channels(values: Any, errors: Any) -> str:
    """Three numbers with their errors."""
    return ", ".join(
        f"{_digits(value, error)} ± {_digits(error, error)}"
        for value, error in zip(values, errors, strict=True)
    )


def _digits(value: float, error: float) -> str:
    """As many digits as an error of two digits leaves meaning."""
    last = 1 - math.floor(math.log10(error)) if error > 0 else 6
    return f"{round(value, last):.{max(last, 0)}f}"
