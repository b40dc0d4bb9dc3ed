"""What cannot be the line time of a rolling shutter, such as milliseconds given for microseconds."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from blurmatte.motion.linking import FrameMotion

_SLOWEST = 1.0  # s; the slowest electronic shutters, of large still cameras, take a third of that
LASTS = 1.1  # of the time from frame to frame: files tell their rate on average, and so-so


def check_line_time(line_time: float, rows: float) -> None:
    """ValueError if it is no number, or reading so many rows of a picture took too long."""
    _check(line_time, rows, _SLOWEST, "no camera takes more than {:g} s to read a picture")


def check_line_time_of_clip(line_time: float, rows: Sequence[FrameMotion]) -> None:
    """The same of frames, each of which is read before the next one is."""
    lowest = max((row.sighting.y for row in rows if row.sighting is not None), default=0.0)
    times = sorted({row.time for row in rows if row.time is not None})
    check_line_time(line_time, lowest)
    if len(times) > 1:
        lasts = float(np.median(np.diff(times)))
        _check(line_time, lowest, LASTS * lasts, "a frame must be read within {:.3g} s")


def _check(line_time: float, rows: float, most: float, why: str) -> None:
    if not np.isfinite(line_time):
        raise ValueError(f"line_time must be finite seconds, got {line_time}")
    if abs(line_time) * rows > most:
        raise ValueError(
            f"a line_time of {line_time:g} s is {abs(line_time) * rows:.3g} s for {rows:.0f} rows, and "
            f"{why.format(most)}; is it in microseconds, like 15e-6 s (15us)?"
        )
