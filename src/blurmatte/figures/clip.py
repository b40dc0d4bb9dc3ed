"""The sheet of a clip: the ways of objects over the plate, their speeds and sizes over time."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
import numpy.typing as npt

from blurmatte.figures.chart import new_figure, pixels
from blurmatte.figures.panels import (
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
from blurmatte.figures.sheet import TITLE, Sheet
from blurmatte.motion.clip.detections import FrameMotion, Sighting
from blurmatte.motion.clip.positions_3d import BallPlace
from blurmatte.radiometry import LinearImage

Array = npt.NDArray[np.float64]

_DPI = 100
_DASH = 8  # pixels of the sheet
# Ten colors that are told apart on dark and on white, matplotlib's and Tableau's.
_PALETTE = (
    "#1f77b4", "#ff7f0e", "#2ca02c", "#d62728", "#9467bd",
    "#8c564b", "#e377c2", "#7f7f7f", "#bcbd22", "#17becf",
)  # fmt: skip
_CHART = (WIDTH - 2 * MARGIN) / _DPI, 3.4  # inches


def draw_clip(
    plate: LinearImage,
    rows: Sequence[FrameMotion],
    words: Sequence[str] = (),
    places: Sequence[BallPlace | None] | None = None,
) -> Pixels:
    """Draw the ways of objects through a clip over its plate, and speed and radius over time.

    The way within each exposure is bright, from one frame to the next it is blue; of several objects
    each has a color, and its number where it appears. Where the numbers of a frame are in doubt, its
    way is dashed and joined to nothing, and its points over time are hollow. Ellipses of one standard
    deviation of the centers are enlarged so that they can be seen; it says how much. With places in
    space also depth over time, and the speed is that in space. Needs matplotlib (`pip install
    "blurmatte[plot]"`).

    Parameters
    ----------
    plate : LinearImage
        The scene without them.
    rows : sequence of FrameMotion
        Of `measure_clip`.
    words : sequence of str
        Sentences to put on it.
    places : sequence of BallPlace or None, optional
        Of `places_in_space`, one for each row.

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
        sheet.picture(_over_time(rows, places))
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


@dataclass(frozen=True, eq=False)
class _Series:
    """What a chart shows of an object over time: values with errors, and which are in doubt."""

    t: Array
    values: Array
    errors: Array
    unsure: npt.NDArray[np.bool_]

    @property
    def believed(self) -> Array:
        """The values without doubts, or all if there is nothing else."""
        return self.values if self.unsure.all() else self.values[~self.unsure]


def _over_time(rows: Sequence[FrameMotion], places: Sequence[BallPlace | None] | None) -> Pixels:
    """Charts side by side: speed and radius, and of places in space depth."""
    timed = all(row.time is not None for row in rows)
    told = places if places is not None else [None] * len(rows)
    seen = [(row, ball) for row, ball in zip(rows, told, strict=True) if row.sighting is not None]
    charts = ["speed, px per exposure", "radius, px"]
    if places is not None:
        charts = ["speed in space, m/s", "radius, px", "depth, m"]
    figure = new_figure(_CHART, _DPI)
    for n, what in enumerate(charts, start=1):
        axes = figure.add_subplot(
            1, len(charts), n, xlabel="time, s" if timed else "frame", ylabel=what
        )
        by_object = {k: _series(seen, k, timed, what) for k in _numbers(seen)}
        for number, series in by_object.items():
            _draw_series(axes, series, number)
        believed = [s.believed for s in by_object.values() if len(s.values)]
        if what != "depth, m":  # what does not come near 0 is drawn around where it is
            highest = max((float(np.quantile(values, 0.95)) for values in believed), default=0.0)
            axes.set_ylim(0, 1.3 * highest + 1e-6)
        axes.grid(alpha=0.3)
        if len(by_object) > 1:
            axes.legend(title="object", fontsize="small")
    return pixels(figure)


def _numbers(seen: Sequence[tuple[FrameMotion, BallPlace | None]]) -> list[int]:
    return sorted({row.object or 1 for row, _ in seen})


def _series(
    seen: Sequence[tuple[FrameMotion, BallPlace | None]], number: int, timed: bool, what: str
) -> _Series:
    """Of an object, where there is a value."""
    points = []
    for row, ball in seen:
        value = _value(row, ball, what)
        if (row.object or 1) == number and value is not None:
            points.append((row.time if timed else row.frame, *value, _doubted(row)))
    t, values, errors, unsure = np.array(points, float).reshape(-1, 4).T
    return _Series(t, values, errors, unsure > 0)


def _value(row: FrameMotion, ball: BallPlace | None, what: str) -> tuple[float, float] | None:
    """What a chart shows of a frame, and its error."""
    one = row.sighting
    match what:
        case "radius, px" if one is not None:
            return one.radius, one.radius_std
        case "speed, px per exposure" if one is not None:
            return one.length, one.length_std
        case "depth, m" if ball is not None:
            return float(ball.place[2]), float(ball.place_std[2])
        case "speed in space, m/s" if ball is not None and ball.velocity is not None:
            return ball.speed, ball.speed_std
    return None


def _draw_series(axes: Any, series: _Series, number: int) -> None:
    name, sure = _name(number), ~series.unsure
    t, values = series.t, series.values
    drawn = {"color": name, "alpha": 0.8, "label": str(number)}
    axes.errorbar(t[sure], values[sure], series.errors[sure], fmt=".", **drawn)
    axes.plot(t[~sure], values[~sure], "o", color=name, alpha=0.6, mfc="none", ms=4)
