"""A rival: a sweep that is not believed, but would explain most of what pixels explain otherwise.

If no silhouette tells alpha for sure, hues must tell the color, and pixels alpha. Highlights of the
plate's color, or a plate near the object's, can make them wrong without a trace. A sweep that agrees
about the color, and does not about alpha, says so. In a patch that a believed sweep does not explain,
it is a rival too: a hole there and a second paint may look the same.
"""

import numpy as np

from blurmatte.checks import Bools
from blurmatte.color import ColorModel
from blurmatte.matting.pixelwise import PixelMaps
from blurmatte.radiometry import LinearImage
from blurmatte.sweep import Sweep

_SIGMAS = 4.0  # of both: in trials colors of right sweeps were up to 3 apart, of wrong ones 7 on


def is_rival(sweep: Sweep, model: ColorModel) -> bool:
    """Whether a sweep of one paint is plausible, and of the color that hues tell."""
    if not sweep.stats["plausible"] or sweep.model.rank != 1 or model.rank != 1:
        return False
    apart = sweep.model.pole - model.pole
    values, directions = np.linalg.eigh(model.covariance + sweep.model.covariance)
    z2 = (apart @ directions[:, 1:]) ** 2 / np.maximum(values[1:], 1e-18)
    return bool(z2.sum() <= _SIGMAS**2)


def widen(
    maps: PixelMaps,
    sweep: Sweep,
    plate: LinearImage,
    inside: Bools,
    box: tuple[int, int, int, int],
) -> tuple[float, float]:
    """Widen errors of what pixels say by what a sweep says.

    The answer is one of two that are as likely: if the other is true it is wrong by all of their
    difference, so that half of its square is their variance.

    Parameters
    ----------
    maps : PixelMaps
        What pixels say; errors are changed in place.
    sweep : Sweep
    plate : LinearImage
    inside : (h, w) bool
        Of which pixels of the box.
    box : (int, int, int, int)

    Returns
    -------
    (float, float)
        Root mean square of the difference of alpha, and the standard deviation that its sum adds to
        that of the sum of alpha.
    """
    near = maps.within(box)
    inside = inside & np.isfinite(near.alpha_std)
    off = np.where(inside, sweep.within(box)[0] - near.alpha, 0)
    apart = np.abs(off) / np.sqrt(2)
    light = near.premultiplied_std
    np.hypot(near.alpha_std, apart, out=near.alpha_std, casting="same_kind")
    np.hypot(light, apart[..., None] * plate.crop(box).rgb, out=light, casting="same_kind")
    usual = np.sqrt(np.mean(off[inside] ** 2)) if inside.any() else 0.0
    return float(usual), float(abs(off.sum()) / np.sqrt(2))
