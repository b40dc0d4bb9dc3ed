"""The canvas of a sheet: text and panels in rows, from top to bottom."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from blurmatte.checks import Codes8, Floats
from blurmatte.figures import style
from blurmatte.figures.drawing import Color, checkerboard, heat_codes, rescaled, srgb_codes
from blurmatte.layer import Layer
from blurmatte.radiometry import LinearImage


@dataclass(frozen=True, eq=False)
class Panel:
    """A picture with its title, a remark, and a legend of its colors."""

    pixels: Codes8 | Floats  # (H, W, 3) codes, or linear light
    title: str
    remark: str = ""
    legend: Sequence[tuple[Color | None, str]] = ()  # None: the heat scale

    @classmethod
    def gray(cls, values: Floats, white: float, title: str) -> "Panel":
        """A map (H, W) in gray levels; `white` is shown as white."""
        gray = np.asarray(np.rint(255 * np.clip(values / white, 0, 1)), dtype=np.uint8)
        return cls(gray[..., None].repeat(3, axis=-1), title, f"white = {white:g}")

    @classmethod
    def heat(cls, values: Floats, top: float, title: str, remark: str) -> "Panel":
        """A map (H, W) of values from 0 to `top` in the colors of the heat scale."""
        return cls(
            heat_codes(np.clip(values / top, 0, 1)), title, remark, [(None, f"0 to {top:g}")]
        )

    @classmethod
    def layer(cls, layer: Layer, title: str, remark: str = "") -> "Panel":
        """A layer over a checkerboard."""
        picture = layer.over(LinearImage(checkerboard(layer.alpha.shape)))
        return cls(srgb_codes(picture.rgb), title, remark)


@dataclass(frozen=True)
class Layout:
    """Columns of a grid of panels, pixels per column and row, and one scale for all panels.

    A positive scale enlarges each pixel to a square; −n averages n x n pixels.
    """

    columns: int
    width: int
    height: int
    scale: int

    @classmethod
    def best(
        cls,
        size: tuple[int, int],
        count: int,
        columns: int | None = None,
        grid_height: int = style.MAX_GRID_HEIGHT,
    ) -> "Layout":
        """The layout that shows `count` panels of `size` (width, height) largest.

        Three columns are preferred unless another number shows them 1.5 times as large; `columns`
        fixes the number. Panels are enlarged 24 times at most.
        """
        best, largest = cls(3, 1, 1, 1), 0.0
        options = ((3, 1.0), (2, 1.5), (6, 1.5), (1, 1.5)) if columns is None else ((columns, 1.0),)
        for number, handicap in options:
            width = column_width(number)
            height = grid_height // -(-count // number)
            fit = min(width / size[0], height / size[1], 24)
            scale = int(fit) if fit >= 1 else -int(np.ceil(1 / fit))
            relative = (scale if scale > 0 else -1 / scale) / handicap
            if relative > largest:
                best, largest = cls(number, width, height, scale), relative
        return best

    @property
    def room(self) -> tuple[int, int]:
        """(width, height) of the largest panel that fits, in the panel's own pixels."""
        if self.scale > 0:
            return self.width // self.scale, self.height // self.scale
        return -self.width * self.scale, -self.height * self.scale


def column_width(columns: int) -> int:
    """Width of each of several columns, pixels."""
    return (style.CONTENT_WIDTH - (columns - 1) * style.GAP) // columns


def size_text(size: tuple[int, int]) -> str:
    """A size (width, height) as text."""
    return f"{size[0]} x {size[1]}"


class Canvas:
    """A canvas that is filled from top to bottom; `y` is the first free row."""

    def __init__(self) -> None:
        from PIL import Image, ImageDraw

        self._picture = Image.new("RGB", (style.WIDTH, 6000), style.GROUND)
        self._pen = ImageDraw.Draw(self._picture)
        self.y = style.MARGIN

    def pixels(self) -> Codes8:
        """(H, W, 3) sRGB codes of the sheet, cropped to its content."""
        height = self.y + style.MARGIN - style.GAP
        return np.array(self._picture.crop((0, 0, style.WIDTH, height)))

    def title(self, name: str, remark: str) -> None:
        """Add the title of the sheet."""
        x, width = style.MARGIN, style.CONTENT_WIDTH
        self.y += self.text(x, self.y, width, name, 28, style.BRIGHT) + 4
        self.y = self.line(x, self.y, remark, style.DIM) + style.GAP // 2

    def banner(self, text: str, color: Color) -> None:
        """Add a warning on a colored bar over the whole width."""
        pad, width, size = 10, style.CONTENT_WIDTH, style.TITLE_SIZE
        lines = _wrapped(_drawable(text), width - 2 * pad, self._font(size))
        bottom = self.y + 2 * pad + len(lines) * round(size * 1.4)
        self._pen.rectangle(
            (style.MARGIN, self.y, style.WIDTH - style.MARGIN - 1, bottom - 1), color
        )
        self.text(style.MARGIN + pad, self.y + pad, width - 2 * pad, text, size, style.GROUND)
        self.y = bottom + style.GAP // 2

    def picture(self, pixels: Codes8, legend: Sequence[tuple[Color, str]] = ()) -> None:
        """Add a picture of at most the whole width, and a legend of its colors."""
        self.paste(pixels, style.MARGIN, self.y)
        width, bottom = style.CONTENT_WIDTH, self.y + pixels.shape[0] + 8
        self.y = self._legend(style.MARGIN, bottom, width, legend) + style.GAP - 8

    def sentences(self, lines: Sequence[str]) -> None:
        """Add sentences over the whole width, each on a new line."""
        for line in lines:
            self.y = self.line(style.MARGIN, self.y, line)
        self.y += style.GAP // 2

    def grid(self, panels: Sequence[Panel], name: str, layout: Layout | None = None) -> None:
        """Add a grid of panels of one size, all at the scale of the layout, by default the best."""
        height, width = panels[0].pixels.shape[:2]
        layout = layout or Layout.best((width, height), len(panels))
        scale = layout.scale
        size = f"{scale}x enlarged" if scale > 1 else f"{-scale}x reduced" if scale < 0 else "1:1"
        self.y = self.heading(style.MARGIN, self.y, f"{name}, {size}")
        for first in range(0, len(panels), layout.columns):
            self._row(panels[first : first + layout.columns], layout.width, scale)

    def row(self, panels: Sequence[Panel], name: str) -> None:
        """Add panels in one row, at their own size."""
        self.y = self.heading(style.MARGIN, self.y, name)
        self._row(panels, column_width(len(panels)), 1)

    def _row(self, panels: Sequence[Panel], column: int, scale: int) -> None:
        lefts = [style.MARGIN + i * (column + style.GAP) for i in range(len(panels))]
        self.y += max(self._caption(x, column, p) for x, p in zip(lefts, panels, strict=True))
        bottoms = []
        for x, panel in zip(lefts, panels, strict=True):
            pixels = rescaled(panel.pixels, scale)
            self.paste(pixels, x, self.y)
            y = self.y + pixels.shape[0] + 8
            bottoms.append(self._legend(x, y, column, panel.legend))
        self.y = max(bottoms) + style.GAP // 2

    def _caption(self, x: int, width: int, panel: Panel) -> int:
        """Draw title and remark, on one line if they fit; returns their height."""
        title, body = self._font(style.TITLE_SIZE), self._font(style.BODY_SIZE)
        self._pen.text((x, self.y), panel.title, style.BRIGHT, title)
        after = int(title.getlength(panel.title)) + 14
        if after + body.getlength(panel.remark) <= width:
            self._pen.text((x + after, self.y + 4), panel.remark, style.DIM, body)
            return 34
        y = self.y + 28
        return 30 + self.text(x, y, width, panel.remark, style.BODY_SIZE, style.DIM)

    def _legend(
        self, left: int, y: int, width: int, entries: Sequence[tuple[Color | None, str]]
    ) -> int:
        """Draw colors and their meaning, as many to a line as fit; returns the bottom."""
        x, font = left, self._font(style.BODY_SIZE)
        for color, text in entries:
            swatch = 120 if color is None else 14
            needed = swatch + 10 + int(font.getlength(text)) + 22
            if x > left and x + needed - 22 > left + width:
                x, y = left, y + style.LINE_HEIGHT
            if color is None:
                values = np.linspace(0, 3, swatch) / 3  # exact at the four stops
                ramp = heat_codes(values[None].repeat(14, axis=0))
                self.paste(ramp, x, y + 4)
            else:
                self._pen.rectangle((x, y + 4, x + 13, y + 17), color)
            self._pen.text((x + swatch + 10, y), text, style.DIM, font)
            x += needed
        return y + style.LINE_HEIGHT if entries else y

    def heading(self, x: int, y: int, text: str) -> int:
        """Draw a heading in capitals; returns its bottom."""
        self._pen.text((x, y), text.upper(), style.DIM, self._font(14))
        return y + 28

    def text(self, x: int, y: int, width: int, text: str, size: int, color: Color) -> int:
        """Draw text in lines no wider than `width`; returns its height."""
        font, line_height = self._font(size), round(size * 1.4)
        lines = _wrapped(_drawable(text), width, font)
        for number, line in enumerate(lines):
            self._pen.text((x, y + number * line_height), line, color, font)
        return len(lines) * line_height

    def line(self, x: int, y: int, text: str, color: Color = style.BRIGHT) -> int:
        """Draw body text from x to the right margin; returns its bottom."""
        return y + self.text(x, y, style.WIDTH - style.MARGIN - x, text, style.BODY_SIZE, color)

    def paste(self, pixels: Codes8, x: int, y: int) -> None:
        """Draw pixels with their upper left corner at (x, y)."""
        from PIL import Image

        self._picture.paste(Image.fromarray(np.ascontiguousarray(pixels)), (x, y))

    @staticmethod
    def _font(size: int) -> Any:
        from PIL import ImageFont

        return ImageFont.load_default(size)


def _drawable(text: str) -> str:
    """Replace letters that the font lacks."""
    text = text.replace("²", "^2")
    return "".join(c if c.isascii() or c in "±°·…" else "?" for c in text)


def _wrapped(text: str, width: float, font: Any) -> list[str]:
    """Lines no wider than `width`, broken between words, or within a word that is too long."""
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
