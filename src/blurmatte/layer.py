"""A layer: the moving object by itself, ready to be put over any background.

`alpha` is the fraction of the exposure, `premultiplied` the light the object sent: alpha times its
color. Straight color exists only on the way out (`Layer.straight`).
"""

from dataclasses import dataclass, replace

import numpy as np

from blurmatte.checks import Floats, check_light, check_map, check_same_size
from blurmatte.radiometry import LinearImage


@dataclass(frozen=True, eq=False)
class Layer:
    """Exposure fraction and premultiplied light of an object.

    Parameters
    ----------
    alpha : (H, W) float
        Fraction of the exposure, 0…1.
    premultiplied : (H, W, 3) float
        Linear light, alpha times the object's color.

    Raises
    ------
    TypeError, ValueError
        For arrays of another kind or shape.
    """

    alpha: Floats
    premultiplied: Floats

    def __post_init__(self) -> None:
        check_light("premultiplied", self.premultiplied)
        check_map("alpha", self.alpha, self.premultiplied.shape[:2])

    def __repr__(self) -> str:
        width, height = self.size
        return f"Layer({width}x{height}, alpha up to {np.nanmax(self.alpha):.2f})"

    @property
    def size(self) -> tuple[int, int]:
        """(width, height) in pixels."""
        height, width = self.alpha.shape
        return width, height

    def over(self, background: LinearImage) -> LinearImage:
        """Put the layer over a background of the same size [GC07 Eq. 3].

        Returns
        -------
        LinearImage
            premultiplied + (1 − alpha) · background, unclipped; its noise is not known. In sRGB: so
            is a camera RAW.

        Raises
        ------
        ValueError
            If the sizes differ.
        """
        check_same_size("the layer", self.size, "the background", background.size)
        background = background.in_srgb()
        through = (1 - self.alpha[..., None]).astype(background.rgb.dtype, copy=False)
        return replace(background, rgb=self.premultiplied + through * background.rgb, noise=None)

    def straight(self) -> Floats:
        """(H, W, 3) linear color of the object itself; 0 where alpha is 0, for nothing is there."""
        alpha = self.alpha[..., None]
        return np.divide(
            self.premultiplied, alpha, out=np.zeros_like(self.premultiplied), where=alpha > 0
        )
