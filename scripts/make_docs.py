"""Draw docs/overview.png: the sheet that `blurmatte solve` makes of examples/colorful, smaller.

Run it from anywhere: python scripts/make_docs.py
"""

from pathlib import Path

import numpy as np
from PIL import Image

import blurmatte as bm

ROOT = Path(__file__).parent.parent
WIDTH = 900


def reduced(sheet: np.ndarray) -> np.ndarray:
    """(H, 900, 3) uint8 of an sRGB-coded sheet; light is averaged, not code values."""
    height, width = sheet.shape[:2]
    smaller = bm.compositing.cover(
        bm.decode(sheet, bm.SRGB), (WIDTH, round(height * WIDTH / width))
    )
    return np.rint(255 * bm.SRGB.encode(np.clip(smaller.rgb, 0, 1))).astype(np.uint8)


def main() -> None:
    """Solve, draw, reduce, write."""
    image, plate = (bm.read(ROOT / f"examples/colorful/{name}.png") for name in ("image", "plate"))
    sheet = bm.figures.draw_overview(image, plate, bm.solve(image, plate))
    Image.fromarray(reduced(sheet)).save(ROOT / "docs" / "overview.png", optimize=True)


if __name__ == "__main__":
    main()
