"""Sheets of a solution and of a plate.

That of a solution has the whole picture, findings in words, and the streak enlarged; that of a plate
its light, the coverage of each pixel, and its error.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from blurmatte.background import ParallaxRegion, PlateFit, PlateGuess
from blurmatte.checks import Box, Codes8, Floats, check_same_size, enclosing, grown, rows_columns
from blurmatte.color.model import ColorModel
from blurmatte.explain.explain import explain
from blurmatte.explain.solution import (
    alpha_peak,
    alternatives_in_words,
    alternatives_of,
    doubts,
    grade_in_words,
    likeliest_shape,
    sure_pixels,
)
from blurmatte.figures import drawing, style
from blurmatte.figures.sheet import Canvas, Layout, Panel, size_text
from blurmatte.matting.maps import Grade, Quality
from blurmatte.matting.solution import Solution, check_solution
from blurmatte.matting.summary import MAX_ALTERNATIVES, Alternative
from blurmatte.radiometry import LinearImage, check_picture

_BANNERS = {Grade.PLAUSIBLE: style.STREAK, Grade.ASSUMED: style.WARNING}
_FLAGS: dict[Quality, tuple[drawing.Color, str]] = {
    Quality.MISFIT: ((255, 122, 40), "misfit"),
    Quality.PLATE_IN_MODEL: ((88, 120, 255), "plate in model"),
    Quality.SATURATED: (style.UNKNOWN, "clipped"),
    Quality.SHADOW: ((150, 90, 220), "only darker"),
    Quality.OCCLUDED: ((90, 200, 230), "behind something"),
}


def draw_overview(image: LinearImage, plate: LinearImage, solution: Solution) -> Codes8:
    """Draw a solution on one sheet.

    Parameters
    ----------
    image, plate : LinearImage
        The solved pictures.
    solution : Solution
        Their solution.

    Returns
    -------
    (H, W, 3) uint8
        sRGB-coded, 1800 pixels wide.

    Raises
    ------
    ValueError
        If the sizes differ.

    Examples
    --------
    >>> sheet = bm.figures.draw_overview(image, plate, solution)
    >>> bm.write("overview.png", sheet)
    """
    check_picture("image", image)
    check_picture("plate", plate)
    check_solution("solution", solution)
    check_same_size("image", image.size, "plate", plate.size)
    check_same_size("image", image.size, "solution", solution.size)
    image, layout = image.in_srgb(), _layout(solution, 8 if plate.is_guess else 6)
    place = _surroundings(solution, layout)
    panels = _panels(image, plate, solution, place)
    sheet = Canvas()
    names = [picture.meta.source for picture in (image, plate) if picture.meta.source]
    sheet.title(
        " over ".join(names) or "blurmatte", f"{size_text(solution.size)} px, {solution.solver}"
    )
    for line in _warned(solution):
        sheet.banner(line, _BANNERS[solution.grade])
    _head(sheet, _whole(image, solution), solution)
    sheet.grid(panels, "the streak", layout)
    return sheet.pixels()


def _warned(solution: Solution) -> list[str]:
    """Text of the banner: the grade and its meaning, unless it is the best grade."""
    return [] if solution.grade is Grade.CONFIRMED else grade_in_words(solution)


def _head(sheet: Canvas, whole: Codes8, solution: Solution) -> None:
    """Draw the whole picture and, to its right, the findings in words."""
    sheet.paste(whole, style.MARGIN, sheet.y)
    x = style.MARGIN + whole.shape[1] + style.GAP + 8
    y = _draw_model(sheet, x, solution)
    y = _draw_alternatives(sheet, x, y, solution)
    y = sheet.heading(x, y + 14, "what was found")
    doubtful = doubts(solution)
    drawn = len(_warned(solution)) + len(alternatives_in_words(solution))
    for fact in explain(solution)[drawn:]:  # the others are in the banner and under the swatches
        y = sheet.line(x, y, fact, style.WARNING if fact in doubtful else style.BRIGHT) + 5
    sheet.y = max(y, sheet.y + whole.shape[0]) + style.GAP


def _draw_model(sheet: Canvas, x: int, solution: Solution) -> int:
    """Draw swatches of the color model and its evidence; returns the bottom."""
    model = solution.model
    y = sheet.heading(x, sheet.y, "color of the object")
    width = min(style.WIDTH - style.MARGIN - x, 520)
    if solution.stats.is_gray:
        return sheet.text(x, y, width, "gray, without a hue", style.TITLE_SIZE, style.BRIGHT) + y
    for row in _swatch(model, width):
        sheet.paste(row, x, y)
        y += row.shape[0]
    y += 8
    if len({other.hex for other in model.possible}) > 1:
        for row in _possible(model):
            sheet.paste(row, x, y)
            y += row.shape[0] + 4
        region = "the color, and the rim of what it is in 95 of 100 cases"
        y += sheet.text(x, y, width, region, style.BODY_SIZE, style.DIM) + 8
    sure = f", ± {model.angle_std:.2g}°" if model.evidence and model.rank < 3 else ""
    y += sheet.text(x, y, width, model.in_words + sure, style.TITLE_SIZE, style.BRIGHT) + 6
    for sentence in explain(model):
        y = sheet.line(x, y, sentence, style.DIM) + 3
    return y


def _draw_alternatives(sheet: Canvas, x: int, y: int, solution: Solution) -> int:
    """Draw a row of swatches, the solution's own first, and sentences; returns the bottom.

    Draws nothing if the grade is confirmed or no hypotheses were compared.
    """
    found, width = alternatives_of(solution), style.WIDTH - style.MARGIN - x
    if not found:
        return y
    y = sheet.heading(x, y + 14, "what else fits")
    gap = 10
    column = min((width + gap) // MAX_ALTERNATIVES - gap, 130)
    bottoms = [
        _draw_swatch(sheet, x + i * (column + gap), y, column, one, solution.stats.is_gray)
        for i, one in enumerate(found)
    ]
    y = max(bottoms) + 6
    for line in alternatives_in_words(solution):
        y = sheet.line(x, y, f"{line[0].upper()}{line[1:]}.") + 3
    return y


def _draw_swatch(sheet: Canvas, x: int, y: int, width: int, one: Alternative, gray: bool) -> int:
    """Draw one color with its hex code, factor of alpha and weight; returns the bottom.

    Of gray pictures without the color.
    """
    if not gray:
        height = 48
        sheet.paste(drawing.swatch(one.hex, (height, width)), x, y)
        y += height + 6
    weight = f"weight {one.weight:.2f}" if one.weight >= 0.01 else "weight < 0.01"
    name = () if gray else (one.hex,)
    factor = "hides nothing" if one.hides_nothing else f"alpha x {one.alpha_factor:.2f}"
    for line in (*name, factor, weight):
        color = style.BRIGHT if one.matters else style.DIM
        y += sheet.text(x, y, width, line, style.BODY_SIZE, color)
    return y


def _panels(
    image: LinearImage, plate: LinearImage, solution: Solution, place: tuple[slice, slice]
) -> list[Panel]:
    part = solution.within(place)
    layer = part.layer
    peak = drawing.round_up(min(alpha_peak(part), 1))
    background = replace(
        image, rgb=drawing.checkerboard(part.alpha.shape), valid=part.streak, noise=None
    )
    return [
        Panel(image.rgb[place], "image"),
        *_plate_panels(plate, place),
        Panel.gray(layer.alpha, peak, "alpha"),
        Panel(layer.premultiplied, "light", "that is added, over black")
        if solution.stats.only_adds_light
        else Panel(_shown_color(part), "color", "where alpha is above 3 sigma"),
        _error_panel(part),
        Panel(layer.over(background).rgb, "layer", "over a checkerboard"),
    ]


def _plate_panels(plate: LinearImage, place: tuple[slice, slice]) -> list[Panel]:
    """The plate; of a guess also another scene that agrees with the surroundings, and its error."""
    light, (rows, columns) = plate.in_srgb().rgb[place], place
    if not isinstance(plate, PlateGuess):
        return [Panel(light, "plate")]
    shown = columns.start, rows.start, columns.stop, rows.stop
    box = enclosing([plate.surroundings, shown])
    part, place = plate.around_hidden(box), rows_columns(shown, box)
    std = np.where(part.hidden, np.sqrt(np.asarray(part.variance).mean(axis=-1)), 0)
    top = drawing.round_up(float(np.percentile(std[part.hidden], 98)))
    return [
        Panel(light, "plate", "a guess"),
        Panel(part.plates[1].in_srgb().rgb[place], "as likely", "another scene"),
        Panel.heat(std[place], top, "plate error", "std of the guess, 1 is white"),
    ]


def _surroundings(solution: Solution, layout: Layout) -> tuple[slice, slice]:
    """Slices of the streak's box and its surroundings, as large as the layout permits."""
    lengths, around = _lengths(solution), []
    sides = zip(solution.streak_place, lengths, layout.room[::-1], solution.size[::-1], strict=True)
    for side, length, room, whole in sides:
        most = max(8, max(lengths) // 3, length // 2)
        rim = max(0, min(most, (room - length) // 2))
        count = min(length + 2 * rim, whole)
        start = min(max(side.start - rim, 0), whole - count)  # shifted inwards at the border
        around.append(slice(start, start + count))
    return around[0], around[1]


def _layout(solution: Solution, count: int) -> Layout:
    """The layout of so many panels with a margin of an eighth, or of 4 pixels if that enlarges more."""
    down, across = _lengths(solution)
    width, height = solution.size
    layouts = []
    for rim in (max(4, max(across, down) // 8), 4):
        size = min(across + 2 * rim, width), min(down + 2 * rim, height)
        layouts.append(Layout.best(size, count))
    return max(layouts, key=lambda layout: layout.scale)


def _lengths(solution: Solution) -> list[int]:
    """Height and width of the streak."""
    return [side.stop - side.start for side in solution.streak_place]


def _swatch(model: ColorModel, width: int) -> list[Codes8]:
    """Rows of a swatch: shades of one paint; of several their mean, and mixtures of two below it."""
    rows, height = list[Codes8](), 56
    if model.rank > 1 and model.color:
        height = 56 if model.rank == 3 else 40
        rows.append(drawing.swatch(model.color, (height, width)))
        height = 56 - height
    if model.rank < 3:
        mix = np.linspace(0, 1, width)[None, :, None]
        first, last = (0 * model.srgb[0], *model.srgb)[-2:]
        rows.append(drawing.srgb_codes((1 - mix) * first + mix * last).repeat(height, axis=0))
    return rows


def _possible(model: ColorModel) -> list[Codes8]:
    """A row of swatches of the possible colors for each color of the model."""
    colors = np.stack([other.srgb for other in model.possible], axis=1)
    return [drawing.srgb_codes(row[None]).repeat(24, axis=0).repeat(48, axis=1) for row in colors]


def _shown_color(part: Solution) -> Floats:
    color = part.layer.straight()
    color[~sure_pixels(part)] = drawing.light_of_codes(np.array(style.NEUTRAL, np.uint8))
    return color


def _error_panel(part: Solution) -> Panel:
    inside = part.streak & part.known
    std = part.alpha_std[inside]
    top = drawing.round_up(float(np.percentile(std, 98))) if std.size else 1.0
    with np.errstate(invalid="ignore"):
        position = np.clip(np.nan_to_num(part.alpha_std / top, nan=1.0), 0, 1)
    pixels = drawing.heat_codes(position)
    legend: list[tuple[drawing.Color | None, str]] = [(None, f"0 to {top:g}")]
    for flag, (color, name) in _FLAGS.items():
        flagged = part.streak & ((part.quality & flag) != 0)
        pixels[flagged] = color
        share = float(np.mean(flagged[part.streak])) if part.streak.any() else 0.0
        if share >= 0.0005:
            legend.append((color, f"{name} {share:.1%}"))
    outside = drawing.heat_codes(np.zeros_like(position)) // 2
    pixels = np.where(part.streak[..., None], pixels, outside)
    return Panel(pixels, "error", "std of alpha in the streak", legend)


def _whole(image: LinearImage, solution: Solution) -> Codes8:
    """The whole picture with a box around each moving object."""
    from PIL import ImageDraw

    text_width = 560
    room = style.CONTENT_WIDTH - style.GAP - text_width, style.MAX_PICTURE_HEIGHT
    picture, scale = drawing.fitted(image, room)
    size, pen = picture.size, ImageDraw.Draw(picture)
    for box in solution.stats.other_boxes:
        pen.rectangle(_scaled(box, scale, size), outline=style.OTHER, width=1)
    _draw_sweep(pen, solution, scale)
    rows, columns = solution.streak_place
    box = columns.start, rows.start, columns.stop, rows.stop
    pen.rectangle(_scaled(box, scale, size), outline=style.STREAK, width=3)
    return np.asarray(picture)


def _draw_sweep(pen: Any, solution: Solution, scale: float) -> None:
    """Draw the path and the silhouette at both ends, if the sweep is the likeliest hypothesis."""
    shape = likeliest_shape(solution)
    if shape is None:
        return
    drawing.draw_line(pen, shape.xy, scale)
    for outline in shape.outlines:
        drawing.draw_line(pen, [*outline, outline[0]], scale)


def _scaled(box: Box, scale: float, size: tuple[int, int]) -> list[float]:
    """Corners of a frame around a box, clipped to the picture."""
    x0, y0, x1, y1 = (round(scale * edge) for edge in box)
    corners = (max(x0 - 2, 0), max(y0 - 2, 0)), (min(x1 + 1, size[0] - 1), min(y1 + 1, size[1] - 1))
    return [float(edge) for corner in corners for edge in corner]


def draw_parallax(picture: LinearImage, regions: Sequence[ParallaxRegion]) -> Codes8:
    """Draw a picture, dimmed but for the parts of the scene at another depth than the rest.

    Parameters
    ----------
    picture : LinearImage
    regions : sequence of ParallaxRegion
        In its pixels.

    Returns
    -------
    (H, W, 3) uint8
        sRGB-coded.
    """
    codes = drawing.srgb_codes(picture.in_srgb().rgb)
    drawn = codes // 3
    for region in regions:
        place = rows_columns(region.box)
        drawn[place] = _outlined(codes, region.box)[place]
    return drawn


def _outlined(codes: Codes8, box: Box) -> Codes8:
    """A picture with a line along the inner side of a box."""
    drawn, line = codes.copy(), 2
    drawn[rows_columns(box)] = style.WARNING
    inner = rows_columns(grown(box, -line, (codes.shape[1], codes.shape[0])))
    drawn[inner] = codes[inner]
    return drawn


def draw_plate(fit: PlateFit) -> Codes8:
    """Draw a plate, the share of frames that show each pixel, and its error on one sheet.

    Parameters
    ----------
    fit : PlateFit
        Result of `make_plate`.

    Returns
    -------
    (H, W, 3) uint8
        sRGB-coded, 1800 pixels wide.

    Examples
    --------
    >>> sheet = bm.figures.draw_plate(bm.make_plate(frames))
    """
    plate = fit.plate
    known, std = plate.valid, np.sqrt(plate.variance.mean(axis=-1))
    light = np.where(
        known[..., None], drawing.srgb_codes(plate.rgb), np.array(style.UNKNOWN, np.uint8)
    )
    for region in () if fit.camera is None else fit.camera.parallax:
        light = _outlined(light, region.box)
    top = drawing.round_up(float(np.percentile(std[known], 98)))
    errors = drawing.heat_codes(np.clip(std / top, 0, 1))
    errors[~known] = style.UNKNOWN
    unknown = (style.UNKNOWN, f"not known or clipped {1 - known.mean():.1%}")
    sheet = Canvas()
    sheet.title("plate", f"{size_text(plate.size)} px of {len(fit.gain)} frames")
    sheet.sentences(explain(fit))
    panels = [
        Panel(light, "plate", legend=[unknown]),
        Panel.heat(fit.coverage, 1, "free", "share of frames"),
        Panel(errors, "error", "std of light, 1 is white", [(None, f"0 to {top:g}"), unknown]),
    ]
    sheet.grid(panels, "what the frames say")
    return sheet.pixels()
