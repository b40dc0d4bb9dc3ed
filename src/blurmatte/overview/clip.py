"""The sheet of a clip: the ways of objects over the plate, their speeds and sizes over time."""

from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any

import numpy as np
import numpy.typing as npt

from blurmatte.motion import FrameMotion, Sighting
from blurmatte.overview.panels import (
    BRIGHT,
    GROUND,
    MARGIN,
    OTHER,
    STREAK,
    TALLEST,
    WIDTH,
    Color,
    Pixels,
    draw_line,
    enlargement,
    error_ellipse,
    fitted,
)
from blurmatte.overview.sheet import TITLE, Sheet
from blurmatte.radiometry import LinearImage
from blurmatte.radiometry.chart import new_figure, pixels

Array = npt.NDArray[np.float64]

_DPI = 100
_DASH = 8  # pixels of the sheet
# Ten colors that are told apart on dark and on white, matplotlib's and Tableau's.
_PALETTE = (
    "#1f77b4", "#ff7f0e", "#2ca02c", "#d62728", "#9467bd",
    "#8c564b", "#e377c2", "#7f7f7f", "#bcbd22", "#17becf",
)  # fmt: skip
_CHART = (WIDTH - 2 * MARGIN) / _DPI, 3.4  # inches


def draw_clip(plate: LinearImage, rows: Sequence[FrameMotion], words: Sequence[str] = ()) -> Pixels:
    """Draw the ways of objects through a clip over its plate, and speed and radius over time.

    The way within each exposure is bright, from one frame to the next it is blue; of several objects
    each has a color, and its number where it appears. Where the numbers of a frame are in doubt, its
    way is dashed and joined to nothing, and its points over time are hollow. Ellipses of one standard
    deviation of the centers are enlarged so that they can be seen; it says how much. Needs matplotlib
    (`pip install "blurmatte[plot]"`).

    Parameters
    ----------
    plate : LinearImage
        The scene without them.
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
    sights = [row.sighting for row in found if row.sighting is not None and not _doubted(row)]
    enlarged = _enlarged(sights, scale)
    objects = _objects(found)
    if len(objects) == 1:
        _draw_way(pen, found, scale, OTHER, STREAK, enlarged)
    else:
        for number, way in objects.items():
            _draw_way(pen, way, scale, _color(number), _color(number), enlarged)
            _number(pen, number, way, scale)
    frames, of = len({row.frame for row in found}), len({row.frame for row in rows})
    sheet = Sheet()
    several = f"{len(objects)} objects, " if len(objects) > 1 else ""
    sheet.title("clip", f"{several}found in {frames} of {of} frames")
    sheet.picture(np.asarray(picture))
    if found:
        sheet.picture(_over_time(objects))
    told = f"Ellipses: one standard deviation of the centers, {enlarged:g} times enlarged."
    sheet.sentences([*words, told, *_on_doubts(found)])
    return sheet.pixels()


def _doubted(row: FrameMotion) -> bool:
    return row.sighting is not None and bool(row.sighting.doubts)


def _on_doubts(found: Sequence[FrameMotion]) -> list[str]:
    """What dashes mean, if there are any."""
    count = sum(map(_doubted, found))
    if not count:
        return []
    return [
        f"Dashed and hollow: {count} of {len(found)}, whose numbers are in doubt; the table says why."
    ]


def _objects(found: Sequence[FrameMotion]) -> dict[int, list[FrameMotion]]:
    """What was found of each, by its number."""
    objects: dict[int, list[FrameMotion]] = {}
    for row in found:
        objects.setdefault(row.object or 1, []).append(row)
    return dict(sorted(objects.items()))


def _name(number: int) -> str:
    """The color of an object, again after ten."""
    return _PALETTE[(number - 1) % len(_PALETTE)]


def _color(number: int) -> Color:
    from PIL import ImageColor

    red, green, blue = ImageColor.getrgb(_name(number))[:3]
    return red, green, blue


def _draw_way(
    pen: Any,
    way: Sequence[FrameMotion],
    scale: float,
    between: Color,
    ellipses: Color,
    enlarged: float,
) -> None:
    """From each frame to the next, within each exposure, and how well the centers are known."""
    for a, b in pairwise(way):
        if a.track != b.track or _doubted(a) or _doubted(b):
            continue
        if a.sighting is not None and b.sighting is not None:
            draw_line(pen, [a.sighting.place, b.sighting.place], scale, between)
    for s in (row.sighting for row in way if row.sighting is not None):
        ends = np.array([(s.first_x, s.first_y), (s.last_x, s.last_y)])
        if s.doubts:
            _draw_dashes(pen, ends, scale, between)
            continue
        draw_line(pen, ends, scale, BRIGHT)
        draw_line(pen, error_ellipse(s.place, s.covariance, enlarged), scale, ellipses)


def _draw_dashes(pen: Any, ends: Array, scale: float, color: Color) -> None:
    """From one end (2, 2) to the other."""
    count = max(round(float(np.linalg.norm(ends[1] - ends[0])) * scale / (2 * _DASH)), 1)
    for k in range(count):
        t = (np.array([k, k + 0.5]) + 0.25)[:, None] / count
        draw_line(pen, (1 - t) * ends[0] + t * ends[1], scale, color)


def _number(pen: Any, number: int, way: Sequence[FrameMotion], scale: float) -> None:
    """Beside the place where it appears, on the dark so that it can be read anywhere."""
    from PIL import ImageFont

    first = way[0].sighting
    assert first is not None
    x, y = scale * np.array([first.x, first.y - 1.5 * first.radius])
    font = ImageFont.load_default(TITLE)
    box = pen.textbbox((x, y), str(number), font, anchor="mb")
    pen.rectangle((box[0] - 5, box[1] - 4, box[2] + 5, box[3] + 4), fill=GROUND)
    pen.text((x, y), str(number), _color(number), font, anchor="mb")


def _enlarged(sights: Sequence[Sighting], scale: float) -> float:
    """So that the usual ellipse can be seen."""
    if not sights:
        return 1.0
    usual = float(np.median([np.hypot(s.x_std, s.y_std) for s in sights]))
    return enlargement(usual, 20 / scale)


def _over_time(objects: Mapping[int, Sequence[FrameMotion]]) -> Pixels:
    """Speed within the exposures, and radius, with their errors."""
    timed = all(row.time is not None for way in objects.values() for row in way)
    figure = new_figure(_CHART, _DPI)
    for place, kind, what in (
        (121, "length", "speed, px per exposure"),
        (122, "radius", "radius, px"),
    ):
        axes = figure.add_subplot(place, xlabel="time, s" if timed else "frame", ylabel=what)
        highest = 0.0
        for number, way in objects.items():
            t = np.array([row.time if timed else row.frame for row in way], float)
            values, errors = (
                np.array([getattr(row.sighting, value) for row in way])
                for value in (kind, f"{kind}_std")
            )
            unsure = np.array([_doubted(row) for row in way])
            sure = ~unsure
            name = _name(number)
            drawn = {"color": name, "alpha": 0.8, "label": str(number)}
            axes.errorbar(t[sure], values[sure], errors[sure], fmt=".", **drawn)
            axes.plot(t[unsure], values[unsure], "o", color=name, alpha=0.6, mfc="none", ms=4)
            believed = values[sure] if sure.any() else values
            highest = max(highest, float(np.quantile(believed, 0.95)))
        axes.set_ylim(0, 1.3 * highest + 1e-6)
        axes.grid(alpha=0.3)
        if len(objects) > 1:
            axes.legend(title="object", fontsize="small")
    return pixels(figure)
