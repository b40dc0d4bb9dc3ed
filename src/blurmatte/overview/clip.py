"""The sheet of a clip: the way of an object over the plate, its speed and its size over time."""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from blurmatte.motion import FrameMotion, Sighting
from blurmatte.overview.panels import (
    BRIGHT,
    MARGIN,
    OTHER,
    STREAK,
    TALLEST,
    WIDTH,
    Pixels,
    draw_line,
    enlargement,
    error_ellipse,
    fitted,
)
from blurmatte.overview.sheet import Sheet
from blurmatte.radiometry import LinearImage
from blurmatte.radiometry.chart import new_figure, pixels

Array = npt.NDArray[np.float64]

_DPI = 100
_CHART = (WIDTH - 2 * MARGIN) / _DPI, 3.4  # inches


def draw_clip(plate: LinearImage, rows: Sequence[FrameMotion], words: Sequence[str] = ()) -> Pixels:
    """Draw the way of an object through a clip over its plate, and its speed and radius over time.

    The way within each exposure is bright, from one frame to the next it is thin and blue. Ellipses of
    one standard deviation of the centers are enlarged so that they can be seen; it says how much.
    Needs matplotlib (`pip install "blurmatte[plot]"`).

    Parameters
    ----------
    plate : LinearImage
        The scene without the object.
    rows : sequence of FrameMotion
        Of `measure_clip`.
    words : sequence of str
        Sentences to put on it.

    Returns
    -------
    (H, W, 3) uint8
        sRGB-coded, 1800 pixels wide.

    Raises
    ------
    BlurmatteError
        If matplotlib is not installed.
    """
    from PIL import ImageDraw

    found = [row for row in rows if row.sighting is not None]
    picture, scale = fitted(plate.in_srgb(), (WIDTH - 2 * MARGIN, TALLEST[0]))
    pen = ImageDraw.Draw(picture)
    sights = [row.sighting for row in found if row.sighting is not None]
    for a, b in pairwise(found):
        if a.track == b.track and a.sighting is not None and b.sighting is not None:
            draw_line(pen, [a.sighting.place, b.sighting.place], scale, OTHER)
    enlarged = _enlarged(sights, scale)
    for s in sights:
        draw_line(pen, [(s.first_x, s.first_y), (s.last_x, s.last_y)], scale, BRIGHT)
        draw_line(pen, error_ellipse(s.place, s.covariance, enlarged), scale, STREAK)
    sheet = Sheet()
    sheet.title("clip", f"found in {len(found)} of {len(rows)} frames")
    sheet.picture(np.asarray(picture))
    if found:
        sheet.picture(_over_time(found))
    told = f"Ellipses: one standard deviation of the centers, {enlarged:g} times enlarged."
    sheet.sentences([*words, told])
    return sheet.pixels()


def _enlarged(sights: Sequence[Sighting], scale: float) -> float:
    """So that the usual ellipse can be seen."""
    if not sights:
        return 1.0
    usual = float(np.median([np.hypot(s.x_std, s.y_std) for s in sights]))
    return enlargement(usual, 20 / scale)


def _over_time(found: Sequence[FrameMotion]) -> Pixels:
    """Speed within the exposures, and radius, with their errors."""
    timed = all(row.time is not None for row in found)
    t = [row.time if timed else row.frame for row in found]
    sights = [row.sighting for row in found if row.sighting is not None]
    figure = new_figure(_CHART, _DPI)
    for place, name, what in (
        (121, "length", "speed, px per exposure"),
        (122, "radius", "radius, px"),
    ):
        axes = figure.add_subplot(place, xlabel="time, s" if timed else "frame", ylabel=what)
        values = np.array([getattr(s, name) for s in sights])
        errors = np.array([getattr(s, f"{name}_std") for s in sights])
        axes.errorbar(t, values, errors, fmt=".", color="#1f77b4", ecolor="#9ec4e0")
        axes.set_ylim(0, 1.3 * float(np.quantile(values, 0.95)) + 1e-6)
        axes.grid(alpha=0.3)
    return pixels(figure)
