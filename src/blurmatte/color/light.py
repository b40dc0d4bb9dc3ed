"""Where light of an object's color shows, whatever alpha is: without arms, strings and shadows.

In this file C is the image's linear light, B the plate's, (H, W, 3) both, l (3,) the unit direction of
the object's color, and p (H, W) how much light along it there is.
C = p l + (1 − α) B is solved for p, whatever α is, by the direction in the plane of l and B that is
perpendicular to B:

    m = (l − (l·b) b) / (1 − (l·b)²),   b = B / |B|,   p = m·C.

A shadow, and whatever has the plate's hue there, has p = 0.
"""

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from blurmatte.checks import Bools
from blurmatte.color.model import ColorModel
from blurmatte.radiometry import LinearImage
from blurmatte.streaks import Streak

Floats = npt.NDArray[np.float32]

_NEARLY_PARALLEL = 1e-4  # 1 − (l·b)²: the plate has the object's color
_TINY = 1e-14
_ASIDE = 0.3  # of the light along a color: other lamps and shades change it by less


def light_reader(
    image: LinearImage, plate: LinearImage, model: ColorModel
) -> tuple[Floats, Floats]:
    """What reads light of a color off images like this one.

    Parameters
    ----------
    image, plate : LinearImage
        Of known noise.
    model : ColorModel
        Of rank 1.

    Returns
    -------
    m : (H, W, 3) float32
        p = m·C.
    weight : (H, W) float32
        1 / Var p; 0 where the plate is not known.
    """
    l = model.basis[:, 0].astype(np.float32)
    B = np.asarray(plate.rgb, np.float32)
    b = B / np.maximum(np.linalg.norm(B, axis=-1, keepdims=True), 1e-6)
    along = b @ l
    across2 = np.maximum(1 - along**2, _NEARLY_PARALLEL)
    m = (l - along[..., None] * b) / across2[..., None]
    noise = np.asarray(image.variance + plate.variance, np.float32)
    weight = np.where(plate.valid, 1 / np.maximum((m**2 * noise).sum(axis=-1), _TINY), 0)
    return m, weight.astype(np.float32)


def energy(p: Floats, weight: Floats, mask: Bools) -> float:
    """Σ p² without that of noise.

    Light alone would prefer large faint places, where the plate fits badly, and light over noise
    those where noise is small.
    """
    weight = np.maximum(weight[mask], _TINY)
    return float(np.sum(p[mask] ** 2 - (weight > _TINY) / weight))


def most_of_color(
    streaks: Sequence[Streak], image: LinearImage, plate: LinearImage, model: ColorModel
) -> Streak:
    """The streak in which most light of a model of rank 1 shows; the first for other models.

    What has quite another color has light along it, too, but also where neither plate nor object have
    any: r = n·C, n ∝ l × B; and p may be negative. Streaks that brought more such light come last.
    """
    if len(streaks) == 1 or model.rank > 1:
        return streaks[0]
    m, weight = light_reader(image, plate, model)
    n = np.cross(model.basis[:, 0], plate.rgb)
    n /= np.maximum(np.linalg.norm(n, axis=-1, keepdims=True), 1e-6)
    p, r = (np.einsum("hwc,hwc->hw", a, image.rgb) for a in (m, n))
    of_color = np.abs(r) < _ASIDE * p
    known = image.valid & (weight > 0)
    r_weight = 1 / np.maximum((n**2 * (image.variance + plate.variance)).sum(axis=-1), _TINY)

    def light(streak: Streak) -> tuple[bool, float]:
        use = streak.mask & known
        of_it = energy(p, weight, use & of_color)
        of_others = energy(r, r_weight, use) + energy(p, weight, use & (p < 0))
        return of_it > of_others, of_it

    return max(streaks, key=light)
