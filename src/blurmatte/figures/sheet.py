"""The canvas of a sheet: words and panels, one below the other."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from blurmatte.figures.panels import (
    BRIGHT,
    DIM,
    GAP,
    GROUND,
    HEAT,
    MARGIN,
    WIDTH,
    Color,
    Layout,
    Panel,
    Pixels,
    heat,
    resized,
    room_beside,
)

TITLE, BODY, _LINE = 21, 17, 24  # letters; from line to line of the body


class Sheet:
    """A canvas that grows downwards as things are put on it; `y` is how far it is full."""

    def __init__(self) -> None:
        from PIL import Image, ImageDraw

        self._picture = Image.new("RGB", (WIDTH, 6000), GROUND)
        self._pen = ImageDraw.Draw(self._picture)
        self.y = MARGIN

    def pixels(self) -> Pixels:
        """What was drawn, cut to its height."""
        return np.array(self._picture.crop((0, 0, WIDTH, self.y + MARGIN - GAP)))

    def title(self, name: str, remark: str) -> None:
        """The first line."""
        width = WIDTH - 2 * MARGIN
        self.y += self.words(MARGIN, self.y, width, name, 28, BRIGHT) + 4
        self.y += self.words(MARGIN, self.y, width, remark, BODY, DIM) + GAP // 2

    def banner(self, text: str, color: Color) -> None:
        """Text on a bar of a color, over the whole width: what must not be overlooked."""
        pad, width = 10, WIDTH - 2 * MARGIN
        lines = _wrapped(_drawable(text), width - 2 * pad, self._font(TITLE))
        bottom = self.y + 2 * pad + len(lines) * round(TITLE * 1.4)
        self._pen.rectangle((MARGIN, self.y, WIDTH - MARGIN - 1, bottom - 1), color)
        self.words(MARGIN + pad, self.y + pad, width - 2 * pad, text, TITLE, GROUND)
        self.y = bottom + GAP // 2

    def picture(self, pixels: Pixels) -> None:
        """One, over the whole width or less."""
        self.paste(pixels, MARGIN, self.y)
        self.y += pixels.shape[0] + GAP

    def sentences(self, lines: Sequence[str]) -> None:
        """One below the other, over the whole width."""
        for line in lines:
            self.y += self.words(MARGIN, self.y, WIDTH - 2 * MARGIN, line, BODY, BRIGHT)
        self.y += GAP // 2

    def grid(self, panels: Sequence[Panel], layout: Layout, what: str) -> None:
        """All panels at one scale."""
        scale = layout.scale
        told = f"{scale}x enlarged" if scale > 1 else f"{-scale}x reduced" if scale < 0 else "1:1"
        self.y = self.heading(MARGIN, self.y, f"{what}, {told}")
        for first in range(0, len(panels), layout.columns):
            self._row(panels[first : first + layout.columns], layout.width, scale)

    def beside(self, panels: Sequence[Panel], what: str) -> None:
        """Panels that are as large as they shall be, all in one row."""
        self.y = self.heading(MARGIN, self.y, what)
        self._row(panels, room_beside(len(panels)), 1)

    def _row(self, panels: Sequence[Panel], column: int, scale: int) -> None:
        places = [MARGIN + i * (column + GAP) for i in range(len(panels))]
        captions = [self._caption(x, column, p) for x, p in zip(places, panels, strict=True)]
        self.y += max(captions)
        bottoms = []
        for x, panel in zip(places, panels, strict=True):
            pixels = resized(panel.pixels, scale)
            self.paste(pixels, x, self.y)
            y = self.y + pixels.shape[0] + 8
            bottoms.append(self._legend(x, y, column, panel.legend))
        self.y = max(bottoms) + GAP // 2

    def _caption(self, x: int, width: int, panel: Panel) -> int:
        """Title and remark, on one line if they fit; returns their height."""
        self._pen.text((x, self.y), panel.title, BRIGHT, self._font(TITLE))
        after = int(self._font(TITLE).getlength(panel.title)) + 14
        if after + self._font(BODY).getlength(panel.remark) <= width:
            self._pen.text((x + after, self.y + 4), panel.remark, DIM, self._font(BODY))
            return 34
        return 30 + self.words(x, self.y + 28, width, panel.remark, BODY, DIM)

    def _legend(
        self, left: int, y: int, width: int, entries: Sequence[tuple[Color | None, str]]
    ) -> int:
        """Colors and what they mean, as many to a line as fit; returns where they end."""
        x = left
        for color, text in entries:
            swatch = 120 if color is None else 14
            needed = swatch + 10 + int(self._font(BODY).getlength(text)) + 22
            if x > left and x + needed - 22 > left + width:
                x, y = left, y + _LINE
            if color is None:
                ramp = heat(np.linspace(0, len(HEAT) - 1, swatch)[None].repeat(14, axis=0))
                self.paste(ramp, x, y + 4)
            else:
                self._pen.rectangle((x, y + 4, x + 13, y + 17), color)
            self._pen.text((x + swatch + 10, y), text, DIM, self._font(BODY))
            x += needed
        return y + _LINE if entries else y

    def heading(self, x: int, y: int, text: str) -> int:
        """Small capitals above something; returns where they end."""
        self._pen.text((x, y), text.upper(), DIM, self._font(14))
        return y + 28

    def words(self, x: int, y: int, width: int, text: str, size: int, color: Color) -> int:
        """Text in lines that are no wider than `width`; returns its height."""
        font, line_height = self._font(size), round(size * 1.4)
        lines = _wrapped(_drawable(text), width, font)
        for number, line in enumerate(lines):
            self._pen.text((x, y + number * line_height), line, color, font)
        return len(lines) * line_height

    def paste(self, pixels: Pixels, x: int, y: int) -> None:
        """Pixels with their upper left corner there."""
        from PIL import Image

        self._picture.paste(Image.fromarray(np.ascontiguousarray(pixels)), (x, y))

    @staticmethod
    def _font(size: int) -> Any:
        from PIL import ImageFont

        return ImageFont.load_default(size)


def _drawable(text: str) -> str:
    """Letters that the font has."""
    text = text.replace("²", "^2")
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
