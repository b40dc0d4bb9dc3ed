"""A sheet that shows a person what was found: pictures, numbers, and what is known against them.

Pictures are light until `_shown`, which encodes them for the screen. The streak's surroundings are
enlarged by a whole number, every pixel a square, or averaged over squares; all panels alike.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from blurmatte.background import PlateFit
from blurmatte.checks import Bools, Floats, check_same_size
from blurmatte.color import ColorModel
from blurmatte.explain import alpha_peak, doubts, explain
from blurmatte.matting import Quality, Solution
from blurmatte.motion import Motion
from blurmatte.radiometry import SRGB, LinearImage
from blurmatte.streaks import Box

Pixels = npt.NDArray[np.uint8]
Color = tuple[int, int, int]

_WIDTH, _MARGIN, _GAP = 1800, 40, 28
_TEXT_WIDTH = 560  # of the panel of words, at least
_TALLEST = 720, 1320  # of the whole picture; of all the crops together
_MOST_ENLARGED = 24
_COUNT = 6  # panels of the streak
_POSSIBLE = "the color, and the rim of what it is in 95 of 100 cases"
_TITLE, _BODY, _LINE = 21, 17, 24  # letters; from line to line of the body

_GROUND: Color = (24, 25, 28)
_BRIGHT: Color = (236, 236, 232)
_DIM: Color = (160, 162, 166)
_NEUTRAL: Color = (72, 73, 76)
_WARNING: Color = (255, 150, 90)
_UNKNOWN: Color = (236, 64, 190)
_STREAK: Color = (255, 196, 60)
_OTHER: Color = (120, 190, 255)
_FLAGS: dict[Quality, tuple[Color, str]] = {
    Quality.MISFIT: ((255, 122, 40), "misfit"),
    Quality.PLATE_IN_MODEL: ((88, 120, 255), "plate in model"),
    Quality.SATURATED: ((236, 64, 190), "clipped"),
    Quality.SHADOW: ((150, 90, 220), "only darker"),
    Quality.OCCLUDED: ((90, 200, 230), "behind something"),
}
_CIRCLE = np.stack([f(np.linspace(0, 2 * np.pi, 65)) for f in (np.cos, np.sin)], axis=1)
_HEAT = np.array([(18, 22, 48), (30, 92, 130), (70, 176, 150), (240, 228, 120)], float)


@dataclass(frozen=True, eq=False)
class _Panel:
    """A picture with its title, a remark beside it, and what its colors mean."""

    pixels: Pixels
    title: str
    remark: str = ""
    legend: Sequence[tuple[Color | None, str]] = ()  # None: the heat scale


@dataclass(frozen=True)
class _Layout:
    """How the panels are laid out: columns of a width, and a scale; −n makes n x n pixels one."""

    columns: int
    width: int
    height: int
    scale: int

    @classmethod
    def around(cls, size: tuple[int, int], count: int) -> "_Layout":
        """The one that shows `count` pictures of a size largest; three columns if in doubt."""
        best, largest = cls(3, 1, 1, 1), 0.0
        for columns, handicap in ((3, 1.0), (2, 1.5), (6, 1.5), (1, 1.5)):
            width = (_WIDTH - 2 * _MARGIN - (columns - 1) * _GAP) // columns
            height = _TALLEST[1] // -(-count // columns)
            fit = min(width / size[0], height / size[1], _MOST_ENLARGED)
            scale = int(fit) if fit >= 1 else -int(np.ceil(1 / fit))
            largeness = (scale if scale > 0 else -1 / scale) / handicap
            if largeness > largest:
                best, largest = cls(columns, width, height, scale), largeness
        return best

    @property
    def room(self) -> tuple[int, int]:
        """(width, height) of what fits into a column, in the picture's pixels."""
        if self.scale > 0:
            return self.width // self.scale, self.height // self.scale
        return -self.width * self.scale, -self.height * self.scale


def draw_overview(image: LinearImage, plate: LinearImage, solution: Solution) -> Pixels:
    """Draw what a solution says on one sheet.

    Parameters
    ----------
    image, plate : LinearImage
        What was solved.
    solution : Solution
        What was found.

    Returns
    -------
    (H, W, 3) uint8
        sRGB-coded, 1800 pixels wide.

    Raises
    ------
    ValueError
        If the sizes differ.
    """
    check_same_size("image", image.size, "plate", plate.size)
    check_same_size("image", image.size, "solution", solution.size)
    image, plate = image.in_srgb(), plate.in_srgb()
    layout = _layout(solution)
    panels = _panels(image, plate, solution, _surroundings(solution, layout))
    sheet = _Sheet()
    names = [picture.meta.source for picture in (image, plate) if picture.meta.source]
    sheet.title(" over ".join(names) or "blurmatte", f"{_by(solution.size)} px, {solution.solver}")
    sheet.head(_whole(image, solution), solution)
    sheet.grid(panels, layout, "the streak")
    return sheet.pixels()


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
    from PIL import ImageDraw

    check_same_size("image", image.size, "solution", solution.size)
    place, corner = _around_motion(motion)
    crop = image.in_srgb().crop(place)
    picture, scale = _fitted(crop, (_WIDTH - 2 * _MARGIN, _TALLEST[0]))
    pen = ImageDraw.Draw(picture)
    _draw_line(pen, motion.trajectory.xy - corner, scale)
    enlarged = _enlarged_errors(motion, scale)
    for t in (0, 1):
        _draw_line(pen, _outline(motion, t) - corner, scale)
        _draw_line(pen, _error_ellipse(motion, t, enlarged) - corner, scale, _STREAK)
    sheet = _Sheet()
    sheet.title(image.meta.source or "blurmatte", repr(motion))
    sheet.picture(np.asarray(picture))
    told = f"Ellipses: one standard deviation of the ends, {enlarged:g} times enlarged."
    sheet.sentences([*explain(motion), told])
    return sheet.pixels()


def _around_motion(motion: Motion) -> tuple[Box, npt.NDArray[np.float64]]:
    """(x0, y0, x1, y1) around all of its way with something beside it, and its corner (x, y)."""
    xy, rim = motion.trajectory.xy, 2 * max(motion.width, 2 * motion.radius)
    low = np.clip(np.floor(xy.min(axis=0) - rim), 0, np.array(motion.size) - 1).astype(int)
    high = np.clip(np.ceil(xy.max(axis=0) + rim) + 1, low + 1, motion.size).astype(int)
    return (int(low[0]), int(low[1]), int(high[0]), int(high[1])), low.astype(float)


def _outline(motion: Motion, t: float) -> npt.NDArray[np.float64]:
    """Around the silhouette, or the disc of its area where that is not known."""
    if motion.sweep is not None:
        return motion.outline_at(t)
    return np.asarray(motion.trajectory.at(t) + motion.radius * _CIRCLE)


def _error_ellipse(motion: Motion, t: float, enlarged: float) -> npt.NDArray[np.float64]:
    """(65, 2) one standard deviation around the center, so many times enlarged."""
    values, axes = np.linalg.eigh(motion.place_covariance(t))
    half_axes = enlarged * np.sqrt(np.maximum(values, 0))
    return np.asarray(motion.trajectory.at(t) + _CIRCLE * half_axes @ axes.T)


def _enlarged_errors(motion: Motion, scale: float) -> float:
    """1, 10, 100 … so that the ellipses are large enough to see, but smaller than the object."""
    largest = max(float(np.sqrt(np.trace(motion.place_covariance(t)))) for t in (0, 1))
    room = max(motion.radius, 20 / scale) / max(largest, 1e-6)
    return float(10.0 ** max(0, np.floor(np.log10(room))))


def draw_plate(fit: PlateFit) -> Pixels:
    """Draw a plate, how often each pixel was free, and its error, on one sheet.

    Parameters
    ----------
    fit : PlateFit
        What `make_plate` made.

    Returns
    -------
    (H, W, 3) uint8
        sRGB-coded, 1800 pixels wide.
    """
    plate = fit.plate
    known, std = plate.valid, np.sqrt(plate.variance.mean(axis=-1))
    light = np.where(known[..., None], _shown(plate.rgb), np.array(_UNKNOWN, np.uint8))
    top = _round_up(float(np.percentile(std[known], 98)))
    errors = _heat(np.clip(std / top, 0, 1) * (len(_HEAT) - 1))
    errors[~known] = _UNKNOWN
    unknown = (_UNKNOWN, f"not known or clipped {1 - known.mean():.1%}")
    sheet = _Sheet()
    sheet.title("plate", f"{_by(plate.size)} px of {len(fit.gain)} frames")
    sheet.sentences(explain(fit))
    panels = [
        _Panel(light, "plate", legend=[unknown]),
        _Panel(
            _heat(fit.coverage * (len(_HEAT) - 1)), "free", "share of frames", [(None, "0 to 1")]
        ),
        _Panel(errors, "error", "std of light, 1 is white", [(None, f"0 to {top:g}"), unknown]),
    ]
    sheet.grid(panels, _Layout.around(plate.size, len(panels)), "what the frames say")
    return sheet.pixels()


def _panels(
    image: LinearImage, plate: LinearImage, solution: Solution, place: tuple[slice, slice]
) -> list[_Panel]:
    part = _cut(solution, place)
    layer = part.layer
    peak = _round_up(min(alpha_peak(part), 1))
    background = replace(image, rgb=_checkerboard(part.alpha.shape), valid=part.streak, noise=None)
    return [
        _Panel(_shown(image.rgb[place]), "image"),
        _Panel(_shown(plate.rgb[place]), "plate"),
        _Panel(_shown_alpha(layer.alpha, peak), "alpha", f"white = {peak:g}"),
        _Panel(_shown_color(part), "color", "where alpha is above 3 sigma"),
        _error_panel(part),
        _Panel(_shown(layer.over(background).rgb), "layer", "over a checkerboard"),
    ]


def _surroundings(solution: Solution, layout: _Layout) -> tuple[slice, slice]:
    """The streak's box and as much around it as the layout has room for, within reason."""
    sides, around = _spans(solution), []
    longest = max(last - first for first, last in sides)
    for (first, last), room, whole in zip(
        sides, layout.room[::-1], solution.size[::-1], strict=True
    ):
        most = max(8, longest // 3, (last - first) // 2)
        rim = max(0, min(most, (room - (last - first)) // 2))
        count = min(last - first + 2 * rim, whole)
        start = min(max(first - rim, 0), whole - count)  # what the border takes, the far side gets
        around.append(slice(start, start + count))
    return around[0], around[1]


def _layout(solution: Solution) -> _Layout:
    """With a rim of an eighth around the streak, or a narrow one where that enlarges more."""
    (top, bottom), (left, right) = _spans(solution)
    width, height = solution.size
    layouts = []
    for rim in (max(4, max(right - left, bottom - top) // 8), 4):
        size = min(right - left + 2 * rim, width), min(bottom - top + 2 * rim, height)
        layouts.append(_Layout.around(size, _COUNT))
    return max(layouts, key=lambda layout: layout.scale)


def _spans(solution: Solution) -> tuple[tuple[int, int], tuple[int, int]]:
    """First row and one past the last, and the same of the columns, of the streak."""
    if not solution.streak.any():
        return (0, solution.size[1]), (0, solution.size[0])
    y, x = (np.flatnonzero(solution.streak.any(axis=axis)) for axis in (1, 0))
    return (int(y[0]), int(y[-1]) + 1), (int(x[0]), int(x[-1]) + 1)


def _cut(solution: Solution, place: tuple[slice, slice]) -> Solution:
    names = ("alpha", "alpha_std", "premultiplied", "premultiplied_std", "quality")
    return replace(solution, **{name: getattr(solution, name)[place] for name in names})


def _colors(solution: Solution) -> tuple[Floats, Floats, str]:
    """The ends of a swatch, linear light, and what to call what lies between."""
    model = solution.model
    if model.rank == 3:
        layer = solution.layer
        mean = layer.premultiplied.sum(axis=(0, 1)) / max(float(layer.alpha.sum()), 1e-9)
        mean = np.clip(mean, 0, 1)
        return mean, mean, "any colors, on average this"
    colors = model.srgb
    sure = f"   ± {model.angle_std:.2g}°" if model.evidence else ""
    first, last = (0 * colors[0], colors[0]) if model.rank == 1 else (colors[0], colors[1])
    return first, last, "  to  ".join(model.hex) + sure


def _possible(model: ColorModel) -> list[Pixels]:
    """A row of swatches of the colors still possible, for each color of the model."""
    colors = np.stack([other.srgb for other in model.possible], axis=1)
    return [_shown(row[None]).repeat(24, axis=0).repeat(48, axis=1) for row in colors]


def _shown(light: Floats) -> Pixels:
    return np.asarray(np.rint(255 * SRGB.encode(np.clip(light, 0, 1))), dtype=np.uint8)


def _shown_alpha(alpha: Floats, white: float) -> Pixels:
    gray = np.asarray(np.rint(255 * np.clip(alpha / white, 0, 1)), dtype=np.uint8)
    return gray[..., None].repeat(3, axis=-1)


def _shown_color(part: Solution) -> Pixels:
    sure = sure_pixels(part)
    return np.where(sure[..., None], _shown(part.layer.straight()), np.array(_NEUTRAL, np.uint8))


def sure_pixels(solution: Solution) -> Bools:
    """(H, W) True where alpha is known to be there: in the streak, above three sigma."""
    sure = solution.streak & solution.known & (solution.alpha > 3 * solution.alpha_std)
    return np.asarray(sure & (solution.alpha > 0))


def _error_panel(part: Solution) -> _Panel:
    inside = part.streak & part.known
    std = part.alpha_std[inside]
    top = _round_up(float(np.percentile(std, 98))) if std.size else 1.0
    with np.errstate(invalid="ignore"):
        position = np.clip(np.nan_to_num(part.alpha_std / top, nan=1.0), 0, 1) * (len(_HEAT) - 1)
    pixels = _heat(position)
    legend: list[tuple[Color | None, str]] = [(None, f"0 to {top:g}")]
    for flag, (color, name) in _FLAGS.items():
        flagged = part.streak & ((part.quality & flag) != 0)
        pixels[flagged] = color
        share = float(np.mean(flagged[part.streak])) if part.streak.any() else 0.0
        if share >= 0.0005:
            legend.append((color, f"{name} {share:.1%}"))
    pixels = np.where(part.streak[..., None], pixels, (pixels * 0.45).astype(np.uint8))
    return _Panel(pixels, "error", "std of alpha; dim outside the streak", legend)


def _heat(position: Floats) -> Pixels:
    stops = np.arange(len(_HEAT))
    return np.stack([np.interp(position, stops, c) for c in _HEAT.T], axis=-1).astype(np.uint8)


def _round_up(value: float) -> float:
    """Two digits, and never zero."""
    if not (np.isfinite(value) and value > 0):
        return 1.0
    step = 10.0 ** (np.floor(np.log10(value)) - 1)
    return float(f"{np.ceil(value / step - 1e-9) * step:.2g}")


def _checkerboard(shape: tuple[int, ...]) -> Floats:
    tile = max(2, min(shape) // 12)
    y, x = np.ogrid[: shape[0], : shape[1]]
    light = np.where((y // tile + x // tile) % 2, 0.2, 0.16).astype(np.float32)
    return np.asarray(light[..., None].repeat(3, axis=-1))


def _whole(image: LinearImage, solution: Solution) -> _Panel:
    """The whole picture, with a box around everything that moved."""
    from PIL import ImageDraw

    room = _WIDTH - 2 * _MARGIN - _GAP - _TEXT_WIDTH
    picture, scale = _fitted(image, (room, _TALLEST[0]))
    size = picture.size
    pen = ImageDraw.Draw(picture)
    for box in solution.stats.get("other_boxes", ()):
        pen.rectangle(_scaled(box, scale, size), outline=_OTHER, width=1)
    _draw_sweep(pen, solution, scale)
    (y0, y1), (x0, x1) = _spans(solution)
    pen.rectangle(_scaled((x0, y0, x1, y1), scale, size), outline=_STREAK, width=3)
    return _Panel(np.asarray(picture), "")


def _fitted(image: LinearImage, room: tuple[int, int]) -> tuple[Any, float]:
    """The picture as large as there is room for, and how many times enlarged it is."""
    from PIL import Image

    width, height = image.size
    scale = min(room[0] / width, room[1] / height, _MOST_ENLARGED)
    size = max(round(width * scale), 1), max(round(height * scale), 1)
    method = Image.Resampling.BOX if not 1 < scale < 3 else Image.Resampling.BICUBIC
    bands = [
        np.asarray(
            Image.fromarray(np.ascontiguousarray(image.rgb[..., c], np.float32)).resize(
                size, method
            )
        )
        for c in range(3)
    ]
    return Image.fromarray(_shown(np.stack(bands, axis=-1))), scale


def _draw_sweep(pen: Any, solution: Solution, scale: float) -> None:
    """Path of the center, and the silhouette at both ends of it."""
    sweep = solution.stats.get("sweep")
    if sweep is None:
        return
    _draw_line(pen, sweep["xy"], scale)
    for outline in sweep["outlines"]:
        _draw_line(pen, [*outline, outline[0]], scale)


def _draw_line(pen: Any, xy: Any, scale: float, color: Color = _BRIGHT) -> None:
    """Points (x, y) of the picture, joined."""
    points = [((x + 0.5) * scale, (y + 0.5) * scale) for x, y in xy]
    pen.line(points, fill=color, width=2, joint="curve")


def _scaled(box: Box, scale: float, size: tuple[int, int]) -> list[float]:
    """Corners of the frame around a box, within the picture."""
    x0, y0, x1, y1 = (round(scale * edge) for edge in box)
    corners = (max(x0 - 2, 0), max(y0 - 2, 0)), (min(x1 + 1, size[0] - 1), min(y1 + 1, size[1] - 1))
    return [float(edge) for corner in corners for edge in corner]


def _by(size: tuple[int, int]) -> str:
    return f"{size[0]} x {size[1]}"


def _resized(pixels: Pixels, scale: int) -> Pixels:
    if scale > 0:
        return pixels.repeat(scale, axis=0).repeat(scale, axis=1)
    n = -scale
    rows, columns = (np.arange(0, side, n) for side in pixels.shape[:2])
    # Averages of the light, not of its code values.
    light = SRGB.table(256).astype(np.float32)[pixels]
    total = np.add.reduceat(np.add.reduceat(light, rows, axis=0), columns, axis=1)
    count = np.outer(
        *(np.diff([*at, side]) for at, side in zip((rows, columns), pixels.shape, strict=False))
    )
    return _shown(total / count[..., None])


class _Sheet:
    """A canvas that grows downwards as things are put on it."""

    def __init__(self) -> None:
        from PIL import Image, ImageDraw

        self._picture = Image.new("RGB", (_WIDTH, 6000), _GROUND)
        self._pen = ImageDraw.Draw(self._picture)
        self._y = _MARGIN

    def pixels(self) -> Pixels:
        """What was drawn, cut to its height."""
        return np.array(self._picture.crop((0, 0, _WIDTH, self._y + _MARGIN - _GAP)))

    def title(self, name: str, remark: str) -> None:
        """The first line."""
        width = _WIDTH - 2 * _MARGIN
        self._y += self._words(_MARGIN, self._y, width, name, 28, _BRIGHT) + 4
        self._y += self._words(_MARGIN, self._y, width, remark, _BODY, _DIM) + _GAP // 2

    def head(self, whole: _Panel, solution: Solution) -> None:
        """The whole picture, and the words beside it."""
        self._paste(whole.pixels, _MARGIN, self._y)
        x = _MARGIN + whole.pixels.shape[1] + _GAP + 8
        y = self._model(x, self._y, solution)
        y = self._heading(x, y + 14, "what was found")
        doubtful = doubts(solution)
        for fact in explain(solution):
            color = _WARNING if fact in doubtful else _BRIGHT
            y += self._words(x, y, _WIDTH - _MARGIN - x, fact, _BODY, color) + 5
        self._y = max(y, self._y + whole.pixels.shape[0]) + _GAP

    def _model(self, x: int, top: int, solution: Solution) -> int:
        """Swatches of the color model and its evidence; returns where they end."""
        model = solution.model
        y = self._heading(x, top, "color of the object")
        width = min(_WIDTH - _MARGIN - x, 520)
        mix = np.linspace(0, 1, width)[None, :, None]
        first, last, name = _colors(solution)
        self._paste(_shown((1 - mix) * first + mix * last).repeat(56, axis=0), x, y)
        y += 64
        if len({other.hex for other in model.possible}) > 1:
            for row in _possible(model):
                self._paste(row, x, y)
                y += row.shape[0] + 4
            y += self._words(x, y, width, _POSSIBLE, _BODY, _DIM) + 8
        y += self._words(x, y, width, name, _TITLE, _BRIGHT) + 6
        for sentence in explain(model):
            y += self._words(x, y, _WIDTH - _MARGIN - x, sentence, _BODY, _DIM) + 3
        return y

    def picture(self, pixels: Pixels) -> None:
        """One, over the whole width or less."""
        self._paste(pixels, _MARGIN, self._y)
        self._y += pixels.shape[0] + _GAP

    def sentences(self, lines: Sequence[str]) -> None:
        """One below the other, over the whole width."""
        for line in lines:
            self._y += self._words(_MARGIN, self._y, _WIDTH - 2 * _MARGIN, line, _BODY, _BRIGHT)
        self._y += _GAP // 2

    def grid(self, panels: Sequence[_Panel], layout: _Layout, what: str) -> None:
        """All panels at one scale."""
        scale = layout.scale
        told = f"{scale}x enlarged" if scale > 1 else f"{-scale}x reduced" if scale < 0 else "1:1"
        self._y = self._heading(_MARGIN, self._y, f"{what}, {told}")
        for first in range(0, len(panels), layout.columns):
            self._row(panels[first : first + layout.columns], layout.width, scale)

    def _row(self, panels: Sequence[_Panel], column: int, scale: int) -> None:
        places = [_MARGIN + i * (column + _GAP) for i in range(len(panels))]
        captions = [self._caption(x, column, p) for x, p in zip(places, panels, strict=True)]
        self._y += max(captions)
        bottoms = []
        for x, panel in zip(places, panels, strict=True):
            pixels = _resized(panel.pixels, scale)
            self._paste(pixels, x, self._y)
            y = self._y + pixels.shape[0] + 8
            bottoms.append(self._legend(x, y, column, panel.legend))
        self._y = max(bottoms) + _GAP // 2

    def _caption(self, x: int, width: int, panel: _Panel) -> int:
        """Title and remark, on one line if they fit; returns their height."""
        self._pen.text((x, self._y), panel.title, _BRIGHT, self._font(_TITLE))
        after = int(self._font(_TITLE).getlength(panel.title)) + 14
        if after + self._font(_BODY).getlength(panel.remark) <= width:
            self._pen.text((x + after, self._y + 4), panel.remark, _DIM, self._font(_BODY))
            return 34
        return 30 + self._words(x, self._y + 28, width, panel.remark, _BODY, _DIM)

    def _legend(
        self, left: int, y: int, width: int, entries: Sequence[tuple[Color | None, str]]
    ) -> int:
        """Colors and what they mean, as many to a line as fit; returns where they end."""
        x = left
        for color, text in entries:
            swatch = 120 if color is None else 14
            needed = swatch + 10 + int(self._font(_BODY).getlength(text)) + 22
            if x > left and x + needed - 22 > left + width:
                x, y = left, y + _LINE
            if color is None:
                ramp = _heat(np.linspace(0, len(_HEAT) - 1, swatch)[None].repeat(14, axis=0))
                self._paste(ramp, x, y + 4)
            else:
                self._pen.rectangle((x, y + 4, x + 13, y + 17), color)
            self._pen.text((x + swatch + 10, y), text, _DIM, self._font(_BODY))
            x += needed
        return y + _LINE if entries else y

    def _heading(self, x: int, y: int, text: str) -> int:
        self._pen.text((x, y), text.upper(), _DIM, self._font(14))
        return y + 28

    def _words(self, x: int, y: int, width: int, text: str, size: int, color: Color) -> int:
        """Text in lines that are no wider than `width`; returns its height."""
        font, line_height = self._font(size), round(size * 1.4)
        lines = _wrapped(_drawable(text), width, font)
        for number, line in enumerate(lines):
            self._pen.text((x, y + number * line_height), line, color, font)
        return len(lines) * line_height

    def _paste(self, pixels: Pixels, x: int, y: int) -> None:
        from PIL import Image

        self._picture.paste(Image.fromarray(np.ascontiguousarray(pixels)), (x, y))

    @staticmethod
    def _font(size: int) -> Any:
        from PIL import ImageFont

        return ImageFont.load_default(size)


def _drawable(text: str) -> str:
    """Letters that the font has."""
    return "".join(c if c.isascii() or c in "±°·…" else "?" for c in text)


def _wrapped(text: str, width: float, font: Any) -> list[str]:
    """Lines no wider than `width`, broken between words, or within one that is too long itself."""
    lines = [""]
    for word in text.split(" "):
        longer = f"{lines[-1]} {word}" if lines[-1] else word
        if font.getlength(longer) <= width:
            lines[-1] = longer
            continue
        lines.append("")
        for letter in word:
            if font.getlength(lines[-1] + letter) > width:
                lines.append("")
            lines[-1] += letter
    return [line for line in lines if line] or [""]
