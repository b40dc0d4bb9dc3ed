"""A motion drawn over its picture."""

import numpy as np
import numpy.typing as npt

from blurmatte.checks import Box, check_kind, check_same_size
from blurmatte.explain import explain
from blurmatte.figures.panels import (
    CIRCLE,
    MARGIN,
    STREAK,
    TALLEST,
    WIDTH,
    Pixels,
    draw_line,
    enlargement,
    error_ellipse,
    fitted,
)
from blurmatte.figures.sheet import Sheet
from blurmatte.matting import Solution
from blurmatte.matting.solution import check_solution
from blurmatte.motion.picture.motion import Motion
from blurmatte.radiometry import LinearImage, check_picture

Array = npt.NDArray[np.float64]


def draw_motion(image: LinearImage, solution: Solution, motion: Motion) -> Pixels:
    """Draw a motion over the picture: path, first and last outline, and the errors.

    Of a streak without a shape only the path is drawn, with the disc of the silhouette's area at both
    ends. Ellipses of one standard deviation are enlarged so that they can be seen; it says how much.

    Parameters
    ----------
    image : LinearImage
        What was solved.
    solution : Solution
        What was measured.
    motion : Motion
        What `measure_motion` found.

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
    picture, scale = fitted(image.in_srgb().crop(box), (WIDTH - 2 * MARGIN, TALLEST[0]))
    pen = ImageDraw.Draw(picture)
    draw_line(pen, motion.trajectory.xy - corner, scale)
    enlarged = _enlarged(motion, scale)
    for t in (0, 1):
        draw_line(pen, _outline(motion, t) - corner, scale)
        place = motion.trajectory.at(t) - corner
        draw_line(pen, error_ellipse(place, motion.place_covariance(t), enlarged), scale, STREAK)
    sheet = Sheet()
    sheet.title(image.meta.source or "blurmatte", repr(motion))
    sheet.picture(np.asarray(picture))
    told = f"Ellipses: one standard deviation of the ends, {enlarged:g} times enlarged."
    sheet.sentences([*explain(motion), told])
    return sheet.pixels()


def _around(motion: Motion) -> tuple[Box, Array]:
    """(x0, y0, x1, y1) around all of its way with something beside it, and its corner (x, y)."""
    xy, rim = motion.trajectory.xy, 2 * max(motion.width, 2 * motion.radius)
    low = np.clip(np.floor(xy.min(axis=0) - rim), 0, np.array(motion.size) - 1).astype(int)
    high = np.clip(np.ceil(xy.max(axis=0) + rim) + 1, low + 1, motion.size).astype(int)
    return (int(low[0]), int(low[1]), int(high[0]), int(high[1])), low.astype(float)


def _outline(motion: Motion, t: float) -> Array:
    """Around the silhouette, or the disc of its area where that is not known."""
    if motion.sweep is not None:
        return motion.outline_at(t)
    return np.asarray(motion.trajectory.at(t) + motion.radius * CIRCLE)


def _enlarged(motion: Motion, scale: float) -> float:
    """So that the ellipses are large enough to see, but smaller than the object."""
    largest = max(float(np.sqrt(np.trace(motion.place_covariance(t)))) for t in (0, 1))
    return enlargement(largest, max(motion.radius, 20 / scale))
