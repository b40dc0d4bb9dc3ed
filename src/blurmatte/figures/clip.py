"""The sheet of a clip: paths of objects over the plate; places, speeds and sizes over time."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from itertools import pairwise
from typing import Any

import numpy as np

from blurmatte.checks import Array, Bools, Codes8
from blurmatte.errors import BlurmatteError
from blurmatte.figures import drawing, style
from blurmatte.figures.sheet import Canvas, Layout, Panel
from blurmatte.layer import Layer
from blurmatte.motion.clip.detections import FrameMotion, Sighting, by_object
from blurmatte.motion.clip.fall import FreeFall
from blurmatte.motion.clip.positions_3d import BallPlace
from blurmatte.motion.clip.summary import ObjectSummary
from blurmatte.motion.picture.motion import Motion, Scale
from blurmatte.radiometry import LinearImage

MAX_PATHS_HEIGHT = 1300  # pixels of the sheet
MATTES_HEIGHT = 900  # pixels of the sheet, of frames and their alpha together

# Ten colors that are distinct on dark and on white, those of matplotlib and Tableau.
_PALETTE = (
    "#1f77b4", "#ff7f0e", "#2ca02c", "#d62728", "#9467bd",
    "#8c564b", "#e377c2", "#7f7f7f", "#bcbd22", "#17becf",
)  # fmt: skip


@dataclass(frozen=True, eq=False)
class Matte:
    """A frame of a clip, by its number, and the layer that was separated from it."""

    frame: int
    image: LinearImage
    layer: Layer


@dataclass(frozen=True, eq=False)
class ClipPhysics:
    """What is known of the objects of a clip in meters and seconds.

    Parameters
    ----------
    scales : mapping of int to Scale
        Size of a pixel where an object moved, by its number.
    falls : mapping of int to FreeFall
        The parabola through the positions of an object, by its number.
    speeds : sequence of (float, float) or None, optional
        Speed in each row and its error, m/s; None in a row without one.
    places : sequence of BallPlace or None, optional
        Result of `places_in_space`, one for each row.

    Examples
    --------
    >>> scale = bm.Scale(0.002)
    >>> physics = bm.figures.ClipPhysics({1: scale}, {1: bm.motion.fit_fall(rows, scale)})
    """

    scales: Mapping[int, Scale] = field(default_factory=dict)
    falls: Mapping[int, FreeFall] = field(default_factory=dict)
    speeds: Sequence[tuple[float, float] | None] | None = None
    places: Sequence[BallPlace | None] | None = None

    @classmethod
    def of(
        cls,
        lines: Sequence[Mapping[str, Any]],
        found: Sequence[ObjectSummary],
        places: Sequence[BallPlace | None] | None,
    ) -> ClipPhysics:
        """From the rows of `clip_table`, the summary of each object, and the places in space."""
        metric = any(line["speed_unit"] == "m/s" for line in lines)
        speeds = [
            None if one["speed"] is None else (one["speed"], one["speed_std"]) for one in lines
        ]
        return cls(
            {one.number: one.scale for one in found if one.scale is not None},
            {one.number: one.fall for one in found if one.fall is not None},
            speeds if metric else None,
            places,
        )


def draw_clip(
    plate: LinearImage,
    rows: Sequence[FrameMotion],
    words: Sequence[str] = (),
    physics: ClipPhysics | None = None,
    name: str = "clip",
    mattes: Sequence[Matte] = (),
) -> Codes8:
    """Draw the paths of objects through a clip over its plate; place, speed and radius over time.

    The path within each exposure is bright, that between frames is blue. Several objects have a color
    and a number each; a legend names the colors. Frames with doubtful numbers have a dashed,
    unconnected path and hollow points. Crosses show the principal standard deviations of the centers,
    enlarged for visibility by a factor that the sheet states. With a scale, the charts are in meters,
    and a fall is drawn as a curve through the positions; with positions in space, depth is shown too.
    The charts need matplotlib (`pip install "blurmatte[plot]"`); without it the sheet has none and
    says so.

    Parameters
    ----------
    plate : LinearImage
        The scene without the objects.
    rows : sequence of FrameMotion
        Result of `measure_clip`.
    words : sequence of str
        Sentences to show on the sheet.
    physics : ClipPhysics, optional
        What is known in meters and seconds; without it the charts are in pixels.
    name : str
        Of the clip, the title.
    mattes : sequence of Matte
        Frames that are shown with their alpha, three in a row; the sheet has none without them.

    Returns
    -------
    (H, W, 3) uint8
        sRGB-coded, 1800 pixels wide.

    Examples
    --------
    >>> sheet = bm.figures.draw_clip(plate, rows)
    """
    physics = physics or ClipPhysics()
    found = [row for row in rows if row.sighting is not None]
    picture, enlarged = _paths(plate, found, physics.scales)
    frames, of = len({row.frame for row in found}), len({row.frame for row in rows})
    sheet, count = Canvas(), len(by_object(found))
    several = f"{count} objects, " if count > 1 else ""
    sheet.title(name, f"{several}found in {frames} of {of} frames")
    notes, parts = list[str](), [picture]
    if found:
        try:
            parts = _with_charts(picture, charts_of(rows, physics))
        except BlurmatteError as error:
            notes.append(f"No charts: {error}.")
    for part in parts:
        sheet.picture(part, _legend(by_object(found), enlarged) if part is parts[0] else ())
    _draw_mattes(sheet, mattes)
    sheet.sentences([*words, *notes, *_legend_in_words(found, physics)])
    return sheet.pixels()


def _legend_in_words(found: Sequence[FrameMotion], physics: ClipPhysics) -> Iterator[str]:
    """What the curves in the charts and the hollow points mean, where there are any."""
    if any(not fall.rejection for fall in physics.falls.values()):
        yield "Gray curve in the charts: the parabola of the fall."
    if doubted := sum(map(_doubted, found)):
        yield (
            f"Dashed and hollow: {doubted} of {len(found)}, whose numbers are in doubt; the table says "
            "why."
        )


def _draw_mattes(sheet: Canvas, mattes: Sequence[Matte]) -> None:
    """Draw the surroundings of the object in each frame, and below them its alpha, of one scale."""
    solved = [one for one in mattes if not one.layer.empty]
    if not solved:
        return
    boxes = np.array([one.layer.box for one in solved])
    sides = (boxes[:, 2:] - boxes[:, :2]).max(axis=0)
    room = np.minimum(sides + 2 * max(8, int(sides.max()) // 4), solved[0].layer.size)
    corners = np.clip((boxes[:, :2] + boxes[:, 2:] - room) // 2, 0, solved[0].layer.size - room)
    crops = [(int(x), int(y), int(x + room[0]), int(y + room[1])) for x, y in corners]
    parts = [one.layer.crop(crop) for one, crop in zip(solved, crops, strict=True)]
    peak = drawing.round_up(max(float(part.alpha.max()) for part in parts))
    shown = [
        Panel(drawing.srgb_codes(one.image.in_srgb().crop(crop).rgb), f"frame {one.frame}")
        for one, crop in zip(solved, crops, strict=True)
    ]
    shown += [
        Panel.gray(part.alpha, peak, f"alpha {one.frame}")
        for one, part in zip(solved, parts, strict=True)
    ]
    size = int(room[0]), int(room[1])
    layout = Layout.best(size, len(shown), len(solved), MATTES_HEIGHT)
    sheet.grid(shown, "frames and their alpha", layout)


def _legend(objects: Mapping[int, object], enlarged: float) -> list[tuple[drawing.Color, str]]:
    """What the colors of the paths mean."""
    by = f", {enlarged:g} times enlarged" if enlarged > 1 else ""
    crosses = f"standard deviations of the centers{by}"
    within = (style.BRIGHT, "path within an exposure")
    if len(objects) < 2:
        between = (style.OTHER, "path between frames")
        return [within, between, (style.STREAK, f"crosses: {crosses}")]
    first, *others = ((_color(number), f"object {number}") for number in objects)
    return [within, (first[0], f"{first[1]}: path between frames; crosses: {crosses}"), *others]


def _paths(
    plate: LinearImage, found: Sequence[FrameMotion], scales: Mapping[int, Scale]
) -> tuple[Codes8, float]:
    """The plate with the paths of all objects, and the factor that enlarges the crosses."""
    from PIL import ImageDraw

    picture, scale = drawing.fitted(plate.in_srgb(), (style.CONTENT_WIDTH, MAX_PATHS_HEIGHT))
    pen = ImageDraw.Draw(picture)
    sights = [row.sighting for row in found if row.sighting is not None and not _doubted(row)]
    enlarged = _enlarged(sights, scale)
    objects = by_object(found)
    if len(objects) == 1:
        _draw_path(pen, found, scale, style.OTHER, style.STREAK, enlarged)
    else:
        for number, path in objects.items():
            _draw_path(pen, path, scale, _color(number), _color(number), enlarged)
            _number(pen, number, path, scale)
    if len(scales) == 1:
        (only,) = scales.values()
        _draw_scale_bar(pen, picture.size, scale / only.meters_per_pixel)
    return np.asarray(picture), enlarged


def _draw_scale_bar(pen: Any, size: tuple[int, int], per_meter: float) -> None:
    """Draw a bar of 1, 2 or 5 times a power of ten meters in the lower left corner."""
    from PIL import ImageFont

    lengths = [m * 10.0**k for k in range(-6, 5) for m in (1, 2, 5)]
    length = max((one for one in lengths if one * per_meter <= size[0] / 4), default=lengths[0])
    x, y, width = 24, size[1] - 24, length * per_meter
    font = ImageFont.load_default(style.BODY_SIZE)
    pen.rectangle((x - 8, y - 34, x + max(width, 80) + 8, y + 10), style.GROUND)
    pen.line([(x, y), (x + width, y)], style.BRIGHT, 3)
    pen.text((x, y - 28), f"{length:g} m", style.BRIGHT, font)


def _doubted(row: FrameMotion) -> bool:
    return row.sighting is not None and bool(row.sighting.doubts)


def _motion(row: FrameMotion) -> Motion | None:
    return None if row.sighting is None else row.sighting.motion


def _name(number: int) -> str:
    """Color code of an object; the colors repeat after ten."""
    return _PALETTE[(number - 1) % len(_PALETTE)]


def _color(number: int) -> drawing.Color:
    return drawing.color_of_hex(_name(number))


def _draw_path(
    pen: Any,
    path: Sequence[FrameMotion],
    scale: float,
    between: drawing.Color,
    crosses: drawing.Color,
    enlarged: float,
) -> None:
    """Draw the path between frames, within each exposure, and the errors of the centers."""
    for a, b in pairwise(path):
        if a.track != b.track or _doubted(a) or _doubted(b):
            continue
        if a.sighting is not None and b.sighting is not None:
            drawing.draw_line(
                pen, [a.sighting.motion.center, b.sighting.motion.center], scale, between
            )
    for row in path:
        if (s := _motion(row)) is None:
            continue
        ends = s.trajectory.xy[[0, -1]]
        if _doubted(row):
            _draw_dashes(pen, ends, scale, between)
            continue
        drawing.draw_line(pen, ends, scale, style.BRIGHT)
        for axis in enlarged * drawing.principal_axes(s.center_covariance):
            drawing.draw_line(pen, [s.center - axis, s.center + axis], scale, crosses)


def _draw_dashes(pen: Any, ends: Array, scale: float, color: drawing.Color) -> None:
    """Draw a dashed line between two ends (2, 2), with dashes of 8 pixels of the sheet."""
    count = max(round(float(np.linalg.norm(ends[1] - ends[0])) * scale / (2 * 8)), 1)
    for k in range(count):
        t = (np.array([k, k + 0.5]) + 0.25)[:, None] / count
        drawing.draw_line(pen, (1 - t) * ends[0] + t * ends[1], scale, color)


def _number(pen: Any, number: int, path: Sequence[FrameMotion], scale: float) -> None:
    """Draw the number of an object above its first position, on a dark background."""
    from PIL import ImageFont

    first = path[0].sighting
    assert first is not None
    x, y = scale * (first.motion.center - (0, 1.5 * first.motion.radius))
    font = ImageFont.load_default(style.TITLE_SIZE)
    box = pen.textbbox((x, y), str(number), font, anchor="mb")
    pen.rectangle((box[0] - 5, box[1] - 4, box[2] + 5, box[3] + 4), fill=style.GROUND)
    pen.text((x, y), str(number), _color(number), font, anchor="mb")


def _enlarged(sights: Sequence[Sighting], scale: float) -> float:
    """Factor at which a cross of median size is visible."""
    if not sights:
        return 1.0
    usual = float(np.median([np.hypot(*s.motion.center_std) for s in sights]))
    return drawing.ellipse_enlargement(usual, 20 / scale)


@dataclass(frozen=True, eq=False)
class _Series:
    """Values of an object over time with their errors, and which of them are doubtful."""

    t: Array
    values: Array
    errors: Array
    unsure: Bools

    @property
    def believed(self) -> Array:
        """The values without doubts, or all values if every one is doubtful."""
        return self.values if self.unsure.all() else self.values[~self.unsure]


@dataclass(frozen=True, eq=False)
class _Chart:
    """A quantity and its error in each row, or None.

    `fall` gives that of a falling object, by its number and the positions (n, 2) or (n, 3) of a
    parabola.
    """

    label: str
    values: Sequence[tuple[float, float] | None]
    fall: Callable[[int, Array], Array] | None = None
    from_zero: bool = False
    downward: bool = False


@dataclass(frozen=True, eq=False)
class _Charts:
    """All charts of a clip with its rows."""

    rows: Sequence[FrameMotion]
    charts: Sequence[_Chart]
    falls: Mapping[int, FreeFall]

    @property
    def timed(self) -> bool:
        """True if the times of all frames are known."""
        return all(row.time is not None for row in self.rows)

    def series(self, chart: _Chart, number: int) -> _Series:
        """Values of an object over the frames that have one."""
        points = []
        for k, row in enumerate(self.rows):
            value = chart.values[k] if row.sighting is not None else None
            if (row.object or 1) == number and value is not None:
                points.append((row.time if self.timed else row.frame, *value, _doubted(row)))
        t, values, errors, unsure = np.array(points, float).reshape(-1, 4).T
        return _Series(t, values, errors, unsure > 0)


def charts_of(rows: Sequence[FrameMotion], physics: ClipPhysics) -> _Charts:
    """Charts of place, speed and radius, in meters where they are known."""
    charts = _in_picture(rows, physics) if physics.places is None else _in_space(physics.places)
    motions = map(_motion, rows)
    radii = [None if one is None else (one.radius, one.radius_std) for one in motions]
    return _Charts(rows, [*charts, _Chart("radius, px", radii, from_zero=True)], physics.falls)


def _in_space(places: Sequence[BallPlace | None]) -> list[_Chart]:
    """Charts of a ball in space: y is down there, height up."""
    charts = []
    for axis, (name, sign) in enumerate((("x", 1), ("height", -1), ("depth", 1))):
        values = [
            None if ball is None else (sign * float(ball.place[axis]), float(ball.place_std[axis]))
            for ball in places
        ]
        charts.append(_Chart(f"{name}, m", values, partial(_coordinate, axis, sign)))
    speeds = [
        None if ball is None or ball.velocity is None else (ball.speed, ball.speed_std)
        for ball in places
    ]
    return [*charts, _Chart("speed in space, m/s", speeds, from_zero=True)]


def _coordinate(axis: int, sign: int, number: int, at: Array) -> Array:
    """A coordinate (n,) of positions (n, 3) in space."""
    return np.asarray(sign * at[:, axis])


def _in_picture(rows: Sequence[FrameMotion], physics: ClipPhysics) -> list[_Chart]:
    """Charts of objects in the picture; in meters from their first place if all have a scale."""
    firsts = {n: path[0].sighting for n, path in by_object(rows).items()}
    scaled = bool(firsts) and firsts.keys() <= physics.scales.keys()

    def position(axis: int, number: int, at: Array) -> Array:
        """A coordinate (n,) of positions (n, 2): pixels, or meters to the right or up."""
        first = firsts[number]
        if not scaled or first is None:
            return np.asarray(at[:, axis])
        sign = (1, -1)[axis] * physics.scales[number].meters_per_pixel
        return np.asarray(sign * (at[:, axis] - first.motion.center[axis]))

    seen = [(row.object or 1, _motion(row)) for row in rows]
    charts = []
    for axis, label in enumerate(("x, m", "height, m") if scaled else ("x, px", "y, px")):
        values: list[tuple[float, float] | None] = []
        for number, one in seen:
            if one is None:
                values.append(None)
                continue
            unit = physics.scales[number].meters_per_pixel if scaled else 1.0
            std = unit * float(one.center_std[axis])
            values.append((float(position(axis, number, one.center[None])[0]), std))
        down = axis == 1 and not scaled
        charts.append(_Chart(label, values, partial(position, axis), downward=down))
    label, speeds = "speed, m/s", physics.speeds
    if speeds is None:
        label = "speed, px per exposure"
        speeds = [None if one is None else (one.length, one.length_std) for _, one in seen]
    return [*charts, _Chart(label, speeds, from_zero=True)]


def _with_charts(picture: Codes8, charts: _Charts) -> list[Codes8]:
    """The picture and below it the charts, or one page with the charts right of a narrow picture."""
    room = style.CONTENT_WIDTH
    rest = room - picture.shape[1] - style.GAP
    if rest < room / 3:
        columns = 2 if len(charts.charts) == 4 else 3
        lines = -(-len(charts.charts) // columns)
        return [picture, _drawn(charts, (room, 300 * lines), columns)]
    height = max(picture.shape[0], 220 * len(charts.charts))
    page = np.full((height, room, 3), style.GROUND, np.uint8)
    page[: picture.shape[0], : picture.shape[1]] = picture
    page[:, -rest:] = _drawn(charts, (rest, height), 1)
    return [page]


def _drawn(charts: _Charts, size: tuple[int, int], columns: int) -> Codes8:
    """Draw the charts in columns on (width, height) pixels."""
    dpi = 100
    figure = drawing.new_figure((size[0] / dpi, size[1] / dpi), dpi)
    with drawing.sheet_style(figure):
        _draw_axes(figure, charts, columns)
        return drawing.figure_pixels(figure)


def _draw_axes(figure: Any, charts: _Charts, columns: int) -> None:
    """Draw each chart in its place."""
    lines = -(-len(charts.charts) // columns)
    for n, chart in enumerate(charts.charts):
        last = n + columns >= len(charts.charts)
        when = "time, s" if charts.timed else "frame"
        axes = figure.add_subplot(
            lines, columns, n + 1, xlabel=when if last else "", ylabel=chart.label
        )
        curves = {number: charts.series(chart, number) for number in by_object(charts.rows)}
        for number, series in curves.items():
            _draw_series(axes, series, number)
            if chart.fall is not None and charts.timed:
                _draw_fall(axes, series, charts.falls.get(number), number, chart.fall)
        if chart.from_zero:
            believed = [s.believed for s in curves.values() if len(s.values)]
            highest = max((float(np.quantile(values, 0.95)) for values in believed), default=0.0)
            axes.set_ylim(0, 1.3 * highest + 1e-6)
        if chart.downward:
            axes.invert_yaxis()
        axes.grid()
        if len(curves) > 1:
            axes.legend(title="object", fontsize="small")


def _draw_fall(
    axes: Any,
    series: _Series,
    fall: FreeFall | None,
    number: int,
    coordinate: Callable[[int, Array], Array],
) -> None:
    """Draw the parabola of a fall over the times of its object."""
    if fall is None or fall.rejection or not len(series.t):
        return
    t = np.linspace(series.t[0], series.t[-1], 200)
    since = (t - fall.time)[:, None]
    at = fall.place + fall.velocity * since + 0.5 * fall.acceleration * since**2
    axes.plot(t, coordinate(number, at), color="0.6", lw=1, zorder=1)


def _draw_series(axes: Any, series: _Series, number: int) -> None:
    name, sure = _name(number), ~series.unsure
    t, values = series.t, series.values
    drawn = {"color": name, "alpha": 0.8, "label": str(number)}
    axes.errorbar(t[sure], values[sure], series.errors[sure], fmt=".", **drawn)
    axes.plot(t[~sure], values[~sure], "o", color=name, alpha=0.6, mfc="none", ms=4)
