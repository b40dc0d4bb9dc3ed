"""Projection of light on a color, independent of alpha and insensitive to shadows.

In this file C is the image's linear light, B the plate's, (H, W, 3) both, l (3,) the unit direction of
the object's color, and p (H, W) the amount of light along l. C = p l + (1 − α) B is solved for p for
any α by the vector in the plane of l and B that is perpendicular to B:

    m = (l − (l·b) b) / (1 − (l·b)²),   b = B / |B|,   p = m·C.

Shadows, and objects of the plate's hue, have p = 0.
"""

from collections.abc import Sequence

import numpy as np

from blurmatte.checks import Bools, Floats32
from blurmatte.color.model import ColorModel
from blurmatte.radiometry import LinearImage
from blurmatte.streaks import Streak

_VARIANCE_FLOOR = 1e-14  # light²: guards a division


def projection_vectors(plate: LinearImage, model: ColorModel) -> Floats32:
    """The vectors m (H, W, 3) that project an image on a color, p = m·C; the model has rank 1."""
    l, B = model.basis[:, 0].astype(np.float32), np.asarray(plate.rgb, np.float32)
    b = B / np.maximum(np.linalg.norm(B, axis=-1, keepdims=True), 1e-6)
    along = b @ l
    across2 = np.maximum(1 - along**2, 1e-4)  # the plate may have the object's color
    return np.asarray((l - along[..., None] * b) / across2[..., None], np.float32)


def projection_weights(image: LinearImage, plate: LinearImage, m: Floats32) -> Floats32:
    """Weights (H, W) of p: 1 / Var p, 0 where the plate is not valid. The noise is known."""
    noise = np.asarray(image.variance + plate.variance, np.float32)
    precision = 1 / np.maximum((m**2 * noise).sum(axis=-1), _VARIANCE_FLOOR)
    return np.where(plate.valid, precision, np.float32(0))


def projected_energy(p: Floats32, weight: Floats32, mask: Bools) -> float:
    """Σ p² over a mask minus the expectation of noise, light².

    Σ p would prefer large faint areas, where the plate fits poorly; Σ p² / Var p areas of low noise.
    """
    weight = np.maximum(weight[mask], _VARIANCE_FLOOR)
    return float(np.sum(p[mask] ** 2 - (weight > _VARIANCE_FLOOR) / weight))


def streak_of_color(
    streaks: Sequence[Streak], image: LinearImage, plate: LinearImage, model: ColorModel
) -> Streak:
    """The streak with the largest energy along a model's color; the first for models of rank 2 or 3.

    An object of another color also has p ≠ 0, but p may be negative, and it has a component r = n·C,
    n ∝ l × B, which the model's color and the plate lack. Streaks in which that energy exceeds the
    energy of the color come last. Those that may be noise are chosen only if all may: where color and
    plate have nearly one hue, the energy of the color is small in every streak.
    """
    streaks = [streak for streak in streaks if streak.significant] or streaks
    if len(streaks) == 1 or model.rank > 1:
        return streaks[0]
    m = projection_vectors(plate, model)
    weight = projection_weights(image, plate, m)
    n = np.cross(model.basis[:, 0], plate.rgb)
    n /= np.maximum(np.linalg.norm(n, axis=-1, keepdims=True), 1e-6)
    p, r = (np.einsum("hwc,hwc->hw", a, image.rgb) for a in (m, n))
    of_color = np.abs(r) < 0.3 * p  # hues vary by less with shading and illuminants
    known = image.valid & (weight > 0)
    r_weight = 1 / np.maximum((n**2 * (image.variance + plate.variance)).sum(-1), _VARIANCE_FLOOR)

    def rank(streak: Streak) -> tuple[bool, float]:
        """Whether light of the color predominates, and its energy."""
        use = streak.mask & known
        own = projected_energy(p, weight, use & of_color)
        other = projected_energy(r, r_weight, use) + projected_energy(p, weight, use & (p < 0))
        return own > other, own

    return max(streaks, key=rank)
