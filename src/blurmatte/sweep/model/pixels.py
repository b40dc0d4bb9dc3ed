"""Pixels: where the pixels of a part of the picture are, at any resolution."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Pixels:
    """Pixels of a box of the picture, or blocks of them: the place of a `PixelBox`, without light."""

    shape: tuple[int, int]  # (height, width) of the box, in these pixels
    # Where the center of pixel (0, 0) is (x, y), in pixels of the picture
    origin: tuple[float, float] = (0.0, 0.0)
    scale: float = 1.0  # width of a pixel here, in pixels of the picture

    @classmethod
    def of_box(cls, box: tuple[int, int, int, int]) -> "Pixels":
        """The picture's pixels in a box (x0, y0, x1, y1)."""
        x0, y0, x1, y1 = box
        return cls((y1 - y0, x1 - x0), (float(x0), float(y0)))

    def coarser(self, by: int) -> "Pixels":
        """Blocks of `by` by `by` pixels; an incomplete last row or column is dropped."""
        (h, w), (x, y), middle = self.shape, self.origin, (by - 1) / 2 * self.scale
        return Pixels((h // by, w // by), (x + middle, y + middle), self.scale * by)
