"""Panels of a sheet: light as a screen shows it, maps, and how large all of it is drawn.

Pictures are light until `shown`, which encodes them for the screen. Panels are enlarged by a whole
number, every pixel a square, or averaged over squares; all of a sheet alike.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from blurmatte.checks import Floats
from blurmatte.radiometry import SRGB, LinearImage

Pixels = npt.NDArray[np.uint8]
Color = tuple[int, int, int]

WIDTH, MARGIN, GAP = 1800, 40, 28
TALLEST = 720, 1320  # of the whole picture; of all the crops together
MOST_ENLARGED = 24

GROUND: Color = (24, 25, 28)
BRIGHT: Color = (236, 236, 232)
DIM: Color = (160, 162, 166)
NEUTRAL: Color = (72, 73, 76)
WARNING: Color = (255, 150, 90)
UNKNOWN: Color = (236, 64, 190)
STREAK: Color = (255, 196, 60)
OTHER: Color = (120, 190, 255)
CIRCLE = np.stack([f(np.linspace(0, 2 * np.pi, 65)) for f in (np.cos, np.sin)], axis=1)
HEAT = np.array([(18, 22, 48), (30, 92, 130), (70, 176, 150), (240, 228, 120)], float)


@dataclass(frozen=True, eq=False)
class Panel:
    """A picture with its title, a remark beside it, and what its colors mean."""

    pixels: Pixels
    title: str
    remark: str = ""
    legend: Sequence[tuple[Color | None, str]] = ()  # None: the heat scale


@dataclass(frozen=True)
class Layout:
    """How the panels are laid out: columns of a width, and a scale; −n makes n x n pixels one."""

    columns: int
    width: int
    height: int
    scale: int

    @classmethod
    def around(cls, size: tuple[int, int], count: int, given: int | None = None) -> "Layout":
        """The one that shows `count` pictures of a size largest; three columns if in doubt, or those
        that are given.
        """
        best, largest = cls(3, 1, 1, 1), 0.0
        wishes = ((3, 1.0), (2, 1.5), (6, 1.5), (1, 1.5)) if given is None else ((given, 1.0),)
        for columns, handicap in wishes:
            width = room_beside(columns)
            height = TALLEST[1] // -(-count // columns)
            fit = min(width / size[0], height / size[1], MOST_ENLARGED)
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


def room_beside(columns: int) -> int:
    """How wide each of several columns is, pixels."""
    return (WIDTH - 2 * MARGIN - (columns - 1) * GAP) // columns


def shown(light: Floats) -> Pixels:
    """Light as sRGB codes, clipped."""
    return np.asarray(np.rint(255 * SRGB.encode(np.clip(light, 0, 1))), dtype=np.uint8)


def shown_alpha(alpha: Floats, white: float) -> Pixels:
    """Alpha as gray, not encoded; `white` is white."""
    gray = np.asarray(np.rint(255 * np.clip(alpha / white, 0, 1)), dtype=np.uint8)
    return gray[..., None].repeat(3, axis=-1)


def heat(position: Floats) -> Pixels:
    """Colors of the heat scale, at places from 0 to the number of its last stop."""
    stops = np.arange(len(HEAT))
    return np.stack([np.interp(position, stops, c) for c in HEAT.T], axis=-1).astype(np.uint8)


def round_up(value: float) -> float:
    """Two digits, and never zero."""
    if not (np.isfinite(value) and value > 0):
        return 1.0
    step = 10.0 ** (np.floor(np.log10(value)) - 1)
    return float(f"{np.ceil(value / step - 1e-9) * step:.2g}")


def checkerboard(shape: tuple[int, ...]) -> Floats:
    """Linear light that shows what is transparent over it."""
    tile = max(2, min(shape) // 12)
    y, x = np.ogrid[: shape[0], : shape[1]]
    light = np.where((y // tile + x // tile) % 2, 0.2, 0.16).astype(np.float32)
    return np.asarray(light[..., None].repeat(3, axis=-1))


def fitted(image: LinearImage, room: tuple[int, int]) -> tuple[Any, float]:
    """The picture as large as there is room (width, height) for, and how many times enlarged."""
    from PIL import Image

    width, height = image.size
    scale = min(room[0] / width, room[1] / height, MOST_ENLARGED)
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
    return Image.fromarray(shown(np.stack(bands, axis=-1))), scale


def draw_line(pen: Any, xy: Any, scale: float, color: Color = BRIGHT) -> None:
    """Points (x, y) of a picture that is enlarged `scale` times, joined."""
    points = [((x + 0.5) * scale, (y + 0.5) * scale) for x, y in xy]
    pen.line(points, fill=color, width=2, joint="curve")


def by(size: tuple[int, int]) -> str:
    """A size in words."""
    return f"{size[0]} x {size[1]}"


def resized(pixels: Pixels, scale: int) -> Pixels:
    """Pixels `scale` times as large; −n: averages over n x n of them."""
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
    return shown(total / count[..., None])


def error_ellipse(place: Floats, covariance: Floats, enlarged: float) -> Floats:
    """(65, 2) points one standard deviation around a place (x, y), so many times enlarged."""
    values, axes = np.linalg.eigh(covariance)
    half_axes = enlarged * np.sqrt(np.maximum(values, 0))
    return np.asarray(place + CIRCLE * half_axes @ axes.T)


def enlargement(std: float, room: float) -> float:
    """1, 10, 100 …: the most that keeps so large a standard deviation within the room."""
    return float(10.0 ** max(0, np.floor(np.log10(room / max(std, 1e-6)))))
