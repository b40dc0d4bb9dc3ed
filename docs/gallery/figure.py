"""Pictures in a grid, each with a title: the layout of every page of the gallery."""

import sys
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw, ImageFont

import blurmatte as bm

_GAP, _LINE, _PAPER, _INK = 10, 30, (255, 255, 255), (40, 40, 40)


def shown(light: np.ndarray) -> np.ndarray:
    """Linear light as sRGB codes."""
    return np.rint(255 * bm.SRGB.encode(np.clip(light, 0, 1))).astype(np.uint8)


def gray(values: np.ndarray, white: float) -> np.ndarray:
    """A map such as alpha as gray, not encoded."""
    codes = np.rint(255 * np.clip(values / white, 0, 1)).astype(np.uint8)
    return codes[..., None].repeat(3, axis=-1)


def color_of(solution: bm.Solution, max_std: float | None = None) -> np.ndarray:
    """The color map where alpha exceeds three standard errors; [GC07]: "meaningless outside".

    `max_std`: largest standard error of a color that is shown, white is 1.
    """
    alpha = solution.layer.alpha
    sure = alpha > 3 * solution.alpha_std
    if max_std is not None:
        sure &= solution.premultiplied_std.max(axis=-1) < max_std * alpha
    return np.where(sure[..., None], shown(solution.layer.straight()), np.uint8(128))


def save(page: str, pictures: list[tuple[str, np.ndarray]], columns: int) -> Image.Image:
    """Print the pictures of a page, all of one size, into the folder named on the command line.

    Without one, the folder is that of this file: a notebook has other words on its command line.
    """
    folder = Path(sys.argv[1]) if len(sys.argv) == 2 else Path(__file__).parent
    height, width = pictures[0][1].shape[:2]
    rows = -(-len(pictures) // columns)
    size = columns * (width + _GAP) + _GAP, rows * (height + _LINE + _GAP) + _GAP
    sheet = Image.new("RGB", size, _PAPER)
    pen, font = ImageDraw.Draw(sheet), ImageFont.load_default(17)
    for number, (title, pixels) in enumerate(pictures):
        x = _GAP + number % columns * (width + _GAP)
        y = _GAP + number // columns * (height + _LINE + _GAP)
        pen.text((x, y), title, _INK, font)
        sheet.paste(Image.fromarray(pixels), (x, y + _LINE))
    target = folder / f"{page}.jpg"
    bm.write(target, np.array(sheet))
    print(target.name)
    return sheet
