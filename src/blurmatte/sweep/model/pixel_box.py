"""PixelBox: light and noise of image and plate in a box of the picture."""

from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from blurmatte.checks import Array, Bools, Floats
from blurmatte.radiometry import LinearImage, smooth_variance
from blurmatte.statistics import cell_means
from blurmatte.sweep.model.pixels import Pixels


@dataclass(frozen=True, eq=False)
class PixelBox:
    """Light and noise of image and plate in a box of the picture, at any resolution."""

    # (h, w, 3) float: light
    C: Array
    B: Array
    # (h, w, 3) float: noise
    C_variance: Array
    B_variance: Array
    valid: Bools  # (h, w) bool: where image and plate are valid
    origin: tuple[float, float]  # where the center of pixel (0, 0) is, in pixels of the picture
    scale: float  # width of a pixel here, in pixels of the picture

    @property
    def pixels(self) -> Pixels:
        """Where the pixels are."""
        h, w = self.valid.shape
        return Pixels((h, w), self.origin, self.scale)

    def along(self, axes: Array) -> tuple[Array, Array, Array, Array]:
        """C, B and their variances along axes of color, the columns of a matrix (3, k).

        The noise along different axes is taken to be independent.
        """
        C, B = (np.ascontiguousarray(light @ axes) for light in (self.C, self.B))
        V_C, V_B = (np.ascontiguousarray(V @ axes**2) for V in (self.C_variance, self.B_variance))
        return C, B, V_C, V_B

    def coarser(self, by: int) -> Self:
        """Means over blocks of `by` by `by` pixels; an incomplete last row or column is dropped."""
        pixels = self.pixels.coarser(by)
        return replace(
            self,
            C=means(self.C, by),
            B=means(self.B, by),
            C_variance=means(self.C_variance, by) / by**2,
            B_variance=means(self.B_variance, by) / by**2,
            valid=means(self.valid, by) == 1,
            origin=pixels.origin,
            scale=pixels.scale,
        )


def light_of(image: LinearImage, plate: LinearImage) -> tuple[Array, Array, Array, Array, Bools]:
    """C, B, their variances, and where both are valid, of two pictures whose noise is known."""
    C, B = (np.ascontiguousarray(picture.rgb, dtype=float) for picture in (image, plate))
    return C, B, smooth_variance(image), smooth_variance(plate), image.valid & plate.valid


def means(values: Floats | Bools, by: int) -> Array:
    """Means of a map (h, w, ...) over blocks of `by` by `by` pixels."""
    return np.asarray(cell_means(np.asarray(values, float), by))
