"""The sheet of a motion: path, outlines and errors over the picture."""

import numpy as np

from blurmatte.checks import Array, Box, Codes8, check_kind, check_same_size
from blurmatte.explain.explain import explain
from blurmatte.figures.drawing import (
    Palette,
    draw_line,
    ellipse_enlargement,
    error_ellipse,
    fitted,
    unit_circle,
)
from blurmatte.figures.sheet import Page, Sheet
from blurmatte.matting.solution import Solution, check_solution
from blurmatte.motion.picture.motion import Motion
from blurmatte.radiometry import LinearImage, check_picture


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
    """
    check_picture("image", image)
    check_solution("solution", solution)
    check_kind("motion", motion, Motion, "use blurmatte.measure_motion(solution)")
    from PIL import ImageDraw

    check_same_size("image", image.size, "solution", solution.size)
    box, corner = _around(motion)
    picture, scale = fitted(
        image.in_srgb().crop(box), (Page.width - 2 * Page.margin, Page.picture_height)
    )
    pen = ImageDraw.Draw(picture)
    draw_line(pen, motion.trajectory.xy - corner, scale)
    enlarged = _enlarged(motion, scale)
    for t in (0, 1):
        draw_line(pen, _outline(motion, t) - corner, scale)
        place = motion.trajectory.at(t) - corner
        draw_line(
            pen, error_ellipse(place, motion.place_covariance(t), enlarged), scale, Palette.streak
        )
    sheet = Sheet()
    sheet.title(image.meta.source or "blurmatte", repr(motion))
    sheet.picture(np.asarray(picture))
    note = f"Ellipses: one standard deviation of the ends, {enlarged:g} times enlarged."
    sheet.sentences([*explain(motion), note])
    return sheet.pixels()


def _around(motion: Motion) -> tuple[Box, Array]:
    """Box (x0, y0, x1, y1) around the path with a margin, and its corner (x, y)."""
    xy, rim = motion.trajectory.xy, 2 * max(motion.width, 2 * motion.radius)
    low = np.clip(np.floor(xy.min(axis=0) - rim), 0, np.array(motion.size) - 1).astype(int)
    high = np.clip(np.ceil(xy.max(axis=0) + rim) + 1, low + 1, motion.size).astype(int)
    return (int(low[0]), int(low[1]), int(high[0]), int(high[1])), low.astype(float)


def _outline(motion: Motion, t: float) -> Array:
    """Outline of the silhouette, or of the disc of its area if there is no fitted shape."""
    if motion.sweep is not None:
        return motion.outline_at(t)
    return np.asarray(motion.trajectory.at(t) + motion.radius * unit_circle())


def _enlarged(motion: Motion, scale: float) -> float:
    """Factor at which the ellipses are visible and still smaller than the object."""
    largest = max(float(np.sqrt(np.trace(motion.place_covariance(t)))) for t in (0, 1))
    return ellipse_enlargement(largest, max(motion.radius, 20 / scale))
