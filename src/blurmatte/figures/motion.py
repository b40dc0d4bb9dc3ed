"""Sheets of a motion over the picture, and of the deblurred object."""

from collections.abc import Sequence

import numpy as np

from blurmatte.checks import Array, Box, Codes8, check_kind, check_same_size, rows_columns
from blurmatte.deblurring.sharp import Sharp
from blurmatte.explain.explain import explain
from blurmatte.figures import drawing, style
from blurmatte.figures.sheet import Canvas, Layout, Panel, size_text
from blurmatte.layer import Layer, box_around, check_layer
from blurmatte.matting.solution import Solution, check_solution
from blurmatte.motion.picture.motion import Motion
from blurmatte.radiometry import LinearImage, check_picture

_STRIP = 8  # sub-frames


def draw_motion(image: LinearImage, solution: Solution, motion: Motion) -> Codes8:
    """Draw a motion over the picture: path, first and last outline, and the errors.

    Without a fitted shape the outline is the disc of the silhouette's area. Ellipses show one standard
    deviation, enlarged for visibility by a factor that the sheet states.

    Parameters
    ----------
    image : LinearImage
        The solved picture.
    solution : Solution
        Its solution.
    motion : Motion
        Result of `measure_motion`.

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
    >>> sheet = bm.figures.draw_motion(image, solution, motion)
    """
    check_picture("image", image)
    check_solution("solution", solution)
    check_kind("motion", motion, Motion, "use blurmatte.measure_motion(solution)")
    check_same_size("image", image.size, "solution", solution.size)
    box = _around(motion)
    return _drawn(image.in_srgb().crop(box), box, motion, image.meta.source)


def draw_path(motion: Motion) -> Codes8:
    """Draw a motion as `draw_motion` does, without its picture."""
    box = _around(motion)
    ground = drawing.light_of_codes(np.array(style.NEUTRAL, np.uint8))
    empty = np.broadcast_to(ground, (box[3] - box[1], box[2] - box[0], 3))
    return _drawn(LinearImage(np.array(empty)), box, motion, "")


def _drawn(part: LinearImage, box: Box, motion: Motion, source: str) -> Codes8:
    """The sheet of a motion over the part of a picture in a box."""
    from PIL import ImageDraw

    picture, scale = drawing.fitted(part, (style.CONTENT_WIDTH, style.MAX_PICTURE_HEIGHT))
    pen, corner = ImageDraw.Draw(picture), np.array(box[:2], float)
    drawing.draw_line(pen, motion.trajectory.xy - corner, scale)
    enlarged = _enlarged(motion, scale)
    for t in (0, 1):
        drawing.draw_line(pen, _outline(motion, t) - corner, scale)
        place = motion.trajectory.at(t) - corner
        drawing.draw_line(
            pen,
            drawing.error_ellipse(place, motion.place_covariance(t), enlarged),
            scale,
            style.STREAK,
        )
    sheet = Canvas()
    sheet.title(source or "blurmatte", repr(motion))
    sheet.picture(np.asarray(picture))
    note = f"Ellipses: one standard deviation of the ends, {enlarged:g} times enlarged."
    sheet.sentences([*explain(motion), note])
    return sheet.pixels()


def _around(motion: Motion) -> Box:
    """Box (x0, y0, x1, y1) around the path with a margin."""
    xy, rim = motion.trajectory.xy, 2 * max(motion.width, 2 * motion.radius)
    low = np.clip(np.floor(xy.min(axis=0) - rim), 0, np.array(motion.size) - 1).astype(int)
    high = np.clip(np.ceil(xy.max(axis=0) + rim) + 1, low + 1, motion.size).astype(int)
    return int(low[0]), int(low[1]), int(high[0]), int(high[1])


def _outline(motion: Motion, t: float) -> Array:
    """Outline of the silhouette, or of the disc of its area if there is no fitted shape."""
    if motion.sweep is not None:
        return motion.outline_at(t)
    return np.asarray(motion.trajectory.at(t) + motion.radius * drawing.unit_circle())


def _enlarged(motion: Motion, scale: float) -> float:
    """Factor at which the ellipses are visible and still smaller than the object."""
    largest = max(float(np.sqrt(np.trace(motion.place_covariance(t)))) for t in (0, 1))
    return drawing.ellipse_enlargement(largest, max(motion.radius, 20 / scale))


def draw_sharp(sharp: Sharp, blurred: Layer, noise_known: bool = True) -> Codes8:
    """Draw an object sharp at moments of the exposure, and its error.

    Parameters
    ----------
    sharp : Sharp
    blurred : Layer
        The same object as the picture shows it.
    noise_known : bool
        False for an object of a layer alone, as from `deblur_solution`: its misfit is not stated.

    Returns
    -------
    (H, W, 3) uint8
        sRGB-coded, 1800 pixels wide.

    Raises
    ------
    ValueError
        If sizes differ, or the object is outside the picture.

    Examples
    --------
    >>> sheet = bm.figures.draw_sharp(sharp, layer)
    """
    check_kind("sharp", sharp, Sharp, "use blurmatte.deblur(image, plate, sweep)")
    check_layer("blurred", blurred)
    check_same_size("the layer", blurred.size, "the sharp object", sharp.size)
    moments = [sharp.at(t) for t in (0.0, 0.5, 1.0)]
    box = box_around(blurred, *moments)
    if box is None:
        raise ValueError("the object is outside the picture: there is nothing to show")
    sheet, size = Canvas(), (box[2] - box[0], box[3] - box[1])
    facts = [f"radius {sharp.sweeps[0].radius:.1f} px", f"{len(sharp.color)} points"]
    facts.append(f"color ± {np.sqrt(np.mean(sharp.node_std**2)):.3f} of white")
    facts += [f"misfit {sharp.misfit:.2f} (1 is noise)"] if noise_known else []
    sheet.title("sharp", f"{size_text(sharp.size)} px; {', '.join(facts)}")
    names = ("when the shutter opens", "in the middle", "when it closes")
    panels = [Panel.layer(blurred.crop(box), "blurred", "over a checkerboard")]
    panels += [Panel.layer(one.crop(box), name) for one, name in zip(moments, names, strict=True)]
    sheet.grid(panels, "the object", _layout(size, len(panels)))
    close = box_around(moments[1]) or box
    part = moments[1].crop(close)
    std = np.sqrt(np.mean(sharp.color_std[rows_columns(close)] ** 2, axis=-1))
    panels = [
        Panel(drawing.srgb_codes(part.straight()), "color", "in the middle of the exposure"),
        Panel.gray(std, drawing.round_up(float(std.max())), "error of the color"),
    ]
    sheet.grid(panels, "the color and its standard deviation", _layout(part.size, 2, [2]))
    panels = [Panel.layer(one.crop(box), "") for one in sharp.subframes(_STRIP)]
    sheet.grid(panels, "sub-frames; the direction of time is unknown", _layout(size, len(panels)))
    return sheet.pixels()


def _layout(size: tuple[int, int], count: int, columns: Sequence[int] = ()) -> Layout:
    """The panels of one of three grids that make a page near 16:10, as large as possible.

    columns: their numbers that may be chosen; if none are given, those that fill all rows.
    """
    height = style.WIDTH * 10 // 16 // 3
    numbers = columns or [n for n in range(count, 0, -1) if count % n == 0]
    layouts = [Layout.best(size, count, n, height) for n in numbers]
    return max(layouts, key=lambda layout: layout.scale)
