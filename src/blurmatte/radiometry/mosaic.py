"""From what a sensor with one color in each pixel saw to three colors in each.

Linear interpolation: the colors that a pixel did not see are weighted means of the neighbors that did,
the nearest twice as much as those across the corner. It is linear in the light and the same everywhere:
C = P + (1 − α) B holds after it as before. Methods that look for edges draw finer ones, but choose
the neighbors by the data: image and plate are then interpolated differently where the object was. In
trials (a ball before tiles, before fine texture; each pixel alone) alpha erred by 0.032 and 0.024 with
this one, by 0.038 to 0.088 with the VNG, PPG, AHD, DCB, DHT and AAHD of LibRaw.
"""

from typing import Any

import numpy as np
import numpy.typing as npt

from blurmatte.checks import Floats

Pattern = npt.NDArray[np.integer[Any]]


def demosaic(mosaic: Floats, pattern: Pattern) -> Floats:
    """Interpolate the colors that each pixel did not see.

    Parameters
    ----------
    mosaic : (H, W) float
        Light of the one color that each pixel saw; 2 x 2 pixels or more.
    pattern : (h, w) int
        Which that is: 0 red, 1 green, 2 blue; repeated to the right and downwards. Among any 3 x 3
        pixels there are all three colors, as in Bayer and X-Trans patterns.

    Returns
    -------
    (H, W, 3) float
        The dtype of `mosaic`.
    """
    rgb = np.empty((*mosaic.shape, 3), mosaic.dtype)
    for c in range(3):
        seen = tiled((pattern == c).astype(mosaic.dtype), mosaic.shape)
        rgb[..., c] = np.where(seen, mosaic, _spread(mosaic * seen) / _spread(seen))
    return rgb


def sees_all_colors(pattern: Pattern) -> bool:
    """Whether there are all three colors among any 3 x 3 pixels."""
    seen = (np.tile(pattern == c, (3, 3)).astype(float) for c in range(3))
    return all(bool(_spread(color).min() > 0) for color in seen)


def variance_shares(pattern: Pattern) -> npt.NDArray[np.float64]:
    """(3,) mean noise variance of a color after `demosaic`, if that of a pixel that saw it is 1.

    Neighbors then err alike: sums and means over several pixels err more than this tells.
    """
    height, width = pattern.shape
    shares = np.empty(3)
    for c in range(3):
        seen = np.tile((pattern == c).astype(float), (3, 3))  # of which the middle knows no border
        variance = np.where(seen, 1, _spread(seen, 4) / _spread(seen) ** 2)
        shares[c] = variance[height : 2 * height, width : 2 * width].mean()
    return shares


def tiled(tile: npt.NDArray[Any], shape: tuple[int, ...]) -> npt.NDArray[Any]:
    """The tile, repeated to the right and downwards and cut to (H, W)."""
    counts = [-(-whole // part) for whole, part in zip(shape, tile.shape, strict=True)]
    return np.tile(tile, counts)[: shape[0], : shape[1]]


def _spread(values: Floats, weight: float = 2) -> Floats:
    """Sums over 3 x 3: corners count once, those beside the middle `weight` times, it `weight`²."""
    w = values.dtype.type(weight)
    # "reflect" repeats no pixel, so beyond the border a Bayer pattern goes on as it should.
    x = np.pad(values, 1, mode="reflect")
    x = x[:-2] + w * x[1:-1] + x[2:]
    return np.asarray(x[:, :-2] + w * x[:, 1:-1] + x[:, 2:])
