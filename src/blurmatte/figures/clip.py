"""The sheet of a clip: paths of objects over the plate, their speeds and sizes over time."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
import numpy.typing as npt

from blurmatte.figures.chart import new_figure, pixels
from blurmatte.figures.drawing import (
    Color,
    Palette,
    Pixels,
    draw_line,
    ellipse_enlargement,
    error_ellipse,
    fitted,
)
from blurmatte.figures.sheet import Page, Sheet
from blurmatte.motion.clip.detections import FrameMotion, Sighting
from blurmatte.motion.clip.positions_3d import BallPlace
from blurmatte.radiometry import LinearImage

Array = npt.NDArray[np.float64]

# Ten colors that are distinct on dark and on white, those of matplotlib and Tableau.
_PALETTE = (
    "#1f77b4", "#ff7f0e", "#2ca02c", "#d62728", "#9467bd",
    "#8c564b", "#e377c2", "#7f7f7f", "#bcbd22", "#17becf",
)  # fmt: skip


def draw_clip(
    plate: LinearImage,
    rows: Sequence[FrameMotion],
    words: Sequence[str] = (),
    places: Sequence[BallPlace | None] | None = None,
) -> Pixels:
    """Draw the paths of objects through a clip over its plate, and speed and radius over time.

    The path within each exposure is bright, that between frames is blue. Several objects have a color
    and a number each. Frames with doubtful numbers have a dashed, unconnected path and hollow points.
    Ellipses show one standard deviation of the centers, enlarged for visibility by a factor that the
    sheet states. With positions in space, the speed is that in space, and depth is shown too. Needs
    matplotlib (`pip install "blurmatte[plot]"`).

    Parameters
    ----------
    plate : LinearImage
        The scene without the objects.
    rows : sequence of FrameMotion
        Result of `measure_clip`.
    words : sequence of str
        Sentences to show on the sheet.
    places : sequence of BallPlace or None, optional
        Result of `places_in_space`, one for each row.

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
    picture, scale = fitted(plate.in_srgb(), (Page.width - 2 * Page.margin, Page.picture_height))
    pen = ImageDraw.Draw(picture)
    sights = [row.sighting for row in found if row.sighting is not None and not _doubted(row)]
    enlarged = _enlarged(sights, scale)
    objects = _objects(found)
    if len(objects) == 1:
        _draw_path(pen, found, scale, Palette.other, Palette.streak, enlarged)
    else:
        for number, path in objects.items():
            _draw_path(pen, path, scale, _color(number), _color(number), enlarged)
            _number(pen, number, path, scale)
    frames, of = len({row.frame for row in found}), len({row.frame for row in rows})
    sheet = Sheet()
    several = f"{len(objects)} objects, " if len(objects) > 1 else ""
    sheet.title("clip", f"{several}found in {frames} of {of} frames")
    sheet.picture(np.asarray(picture))
    if found:
        sheet.picture(_time_charts(rows, places))
    note = f"Ellipses: one standard deviation of the centers, {enlarged:g} times enlarged."
    sheet.sentences([*words, note, *_on_doubts(found)])
    return sheet.pixels()


def _doubted(row: FrameMotion) -> bool:
    return row.sighting is not None and bool(row.sighting.doubts)


def _on_doubts(found: Sequence[FrameMotion]) -> list[str]:
    """Explanation of dashes, if there are any."""
    count = sum(map(_doubted, found))
    if not count:
        return []
    return [
        f"Dashed and hollow: {count} of {len(found)}, whose numbers are in doubt; the table says why."
    ]


def _objects(found: Sequence[FrameMotion]) -> dict[int, list[FrameMotion]]:
    """Rows of each object, by its number."""
    objects: dict[int, list[FrameMotion]] = {}
    for row in found:
        objects.setdefault(row.object or 1, []).append(row)
    return dict(sorted(objects.items()))


def _name(number: int) -> str:
    """Color code of an object; the colors repeat after ten."""
    return _PALETTE[(number - 1) % len(_PALETTE)]


def _color(number: int) -> Color:
    from PIL import ImageColor

    red, green, blue = ImageColor.getrgb(_name(number))[:3]
    return red, green, blue


def _draw_path(
    pen: Any,
    path: Sequence[FrameMotion],
    scale: float,
    between: Color,
    ellipses: Color,
    enlarged: float,
) -> None:
    """Draw the path between frames, within each exposure, and the error ellipses of the centers."""
    for a, b in pairwise(path):
        if a.track != b.track or _doubted(a) or _doubted(b):
            continue
        if a.sighting is not None and b.sighting is not None:
            draw_line(pen, [a.sighting.place, b.sighting.place], scale, between)
    for s in (row.sighting for row in path if row.sighting is not None):
        ends = np.array([(s.first_x, s.first_y), (s.last_x, s.last_y)])
        if s.doubts:
            _draw_dashes(pen, ends, scale, between)
            continue
        draw_line(pen, ends, scale, Palette.bright)
        draw_line(pen, error_ellipse(s.place, s.covariance, enlarged), scale, ellipses)


def _draw_dashes(pen: Any, ends: Array, scale: float, color: Color) -> None:
    """Draw a dashed line between two ends (2, 2), with dashes of 8 pixels of the sheet."""
    count = max(round(float(np.linalg.norm(ends[1] - ends[0])) * scale / (2 * 8)), 1)
    for k in range(count):
        t = (np.array([k, k + 0.5]) + 0.25)[:, None] / count
        draw_line(pen, (1 - t) * ends[0] + t * ends[1], scale, color)


def _number(pen: Any, number: int, path: Sequence[FrameMotion], scale: float) -> None:
    """Draw the number of an object above its first position, on a dark background."""
    from PIL import ImageFont

    first = path[0].sighting
    assert first is not None
    x, y = scale * np.array([first.x, first.y - 1.5 * first.radius])
    font = ImageFont.load_default(Page.title_size)
    box = pen.textbbox((x, y), str(number), font, anchor="mb")
    pen.rectangle((box[0] - 5, box[1] - 4, box[2] + 5, box[3] + 4), fill=Palette.ground)
    pen.text((x, y), str(number), _color(number), font, anchor="mb")


def _enlarged(sights: Sequence[Sighting], scale: float) -> float:
    """Factor at which an ellipse of median size is visible."""
    if not sights:
        return 1.0
    usual = float(np.median([np.hypot(s.x_std, s.y_std) for s in sights]))
    return ellipse_enlargement(usual, 20 / scale)


@dataclass(frozen=True, eq=False)
class _Series:
    """Values of an object over time with their errors, and which of them are doubtful."""

    t: Array
    values: Array
    errors: Array
    unsure: npt.NDArray[np.bool_]

    @property
    def believed(self) -> Array:
        """The values without doubts, or all values if every one is doubtful."""
        return self.values if self.unsure.all() else self.values[~self.unsure]


def _time_charts(rows: Sequence[FrameMotion], places: Sequence[BallPlace | None] | None) -> Pixels:
    """Charts of speed and radius, and of depth for positions in space."""
    timed = all(row.time is not None for row in rows)
    balls = places if places is not None else [None] * len(rows)
    seen = [(row, ball) for row, ball in zip(rows, balls, strict=True) if row.sighting is not None]
    charts = ["speed, px per exposure", "radius, px"]
    if places is not None:
        charts = ["speed in space, m/s", "radius, px", "depth, m"]
    dpi = 100
    figure = new_figure(((Page.width - 2 * Page.margin) / dpi, 3.4), dpi)
    for n, what in enumerate(charts, start=1):
        axes = figure.add_subplot(
            1, len(charts), n, xlabel="time, s" if timed else "frame", ylabel=what
        )
        by_object = {k: _series(seen, k, timed, what) for k in _numbers(seen)}
        for number, series in by_object.items():
            _draw_series(axes, series, number)
        believed = [s.believed for s in by_object.values() if len(s.values)]
        if what != "depth, m":  # depths are far from 0
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
    """Series of an object over the frames that have a value."""
    points = []
    for row, ball in seen:
        value = _value(row, ball, what)
        if (row.object or 1) == number and value is not None:
            points.append((row.time if timed else row.frame, *value, _doubted(row)))
    t, values, errors, unsure = np.array(points, float).reshape(-1, 4).T
    return _Series(t, values, errors, unsure > 0)


def _value(row: FrameMotion, ball: BallPlace | None, what: str) -> tuple[float, float] | None:
    """Value of a frame in a chart, and its error."""
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
