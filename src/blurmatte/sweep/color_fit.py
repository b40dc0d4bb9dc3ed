"""The color of a streak from its shape, its hues, and what is feasible."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from blurmatte.calibration import with_noise
from blurmatte.color.model import ColorModel, fuse_colors, perpendicular
from blurmatte.color.streak import check_chroma_resolution, check_color_fit, fit_color_from_hues
from blurmatte.errors import ColorModelError, MotionError
from blurmatte.radiometry import LinearImage
from blurmatte.radiometry.image import VARIANCE_FLOOR
from blurmatte.streaks import Streak, require_streaks
from blurmatte.sweep.fit_sweep import fit_sweep, likeliest_streak
from blurmatte.sweep.sweep import Sweep


def fit_color(
    image: LinearImage | Sequence[LinearImage],
    plate: LinearImage,
    streak: Streak | None = None,
    max_brightness: float = np.inf,
) -> ColorModel:
    """Find the object's colors from its streak alone (in place of [GC07 §3.1]).

    The color of the sweep that explains the streak (`fit_sweep`), which models the time spent on each
    pixel and uses the hues of the plate as well. If none explains it, the color from hues and
    feasibility if they determine one.

    Parameters
    ----------
    image : LinearImage or sequence of LinearImage
        Several frames of one object determine its color better; frames that do not determine it are
        ignored.
    plate : LinearImage
        The same size; noise that is not known is measured.
    streak : Streak, optional
        Where the object moved; if not given, it is chosen as by `solve`. Of one image only.
    max_brightness : float
        Upper bound of the object's largest channel, linear light, 1 = sensor white; used if no shape
        explains the streak.

    Returns
    -------
    ColorModel
        Rank 1, or 2 if only two paints, highlights or two lights explain the streak, or 3 if only
        any colors do; with the covariance of its direction and the error by each kind of evidence.

    Raises
    ------
    ValueError
        If the sizes differ, or a streak is given with several images.
    ColorModelError
        If the streak does not determine the color, no single line explains it, or a JPEG
        has too little color for a small streak. The message names a remedy.
    MotionError
        If no streak was given and nothing moved.

    Examples
    --------
    >>> print(bm.fit_color(image, plate, streak))
    ColorModel(#ffc046, rank 1, ±0.036°)
    """
    if not isinstance(image, LinearImage):
        if streak is not None:
            raise ValueError("a streak is that of one image; with several, leave it out")
        return _fit_together(image, plate, max_brightness)
    check_color_fit(image, plate, streak, max_brightness)
    image, plate = with_noise(image, plate)
    if streak is None:
        streak = likeliest_streak(image, plate, require_streaks(image, plate))
    check_chroma_resolution(image, streak)
    sweep = fit_sweep(image, plate, streak)
    return color_of(sweep, image, plate, streak, max_brightness)


def _fit_together(
    images: Sequence[LinearImage], plate: LinearImage, max_brightness: float
) -> ColorModel:
    """One color for several frames; the last error if there is none."""
    if not images:
        raise ValueError("images must be one or more, got none")
    models, refusal = [], None
    for image in images:
        try:
            models.append(fit_color(image, plate, None, max_brightness))
        except (ColorModelError, MotionError) as error:
            refusal = error
    models = [model for model in models if model.rank == 1] or models[:1]
    if not models:
        assert refusal is not None
        raise refusal
    return fuse_colors(models)


def color_of(
    sweep: Sweep,
    image: LinearImage,
    plate: LinearImage,
    streak: Streak,
    max_brightness: float = np.inf,
) -> ColorModel:
    """The sweep's color if it explains the streak, else that of the hues if they determine one."""
    if sweep.rejection:
        try:
            return fit_color_from_hues(image, plate, streak, max_brightness)
        except ColorModelError:
            return sweep.model
    if sweep.model.rank > 1:
        return sweep.model
    hues = _hue_std(sweep.model, image, plate, streak)
    return replace(sweep.model, evidence={**sweep.model.evidence, "hue variation": hues})


def _hue_std(model: ColorModel, image: LinearImage, plate: LinearImage, streak: Streak) -> float:
    """Standard deviation of the color from the hues of the plate alone, degrees; infinite if open.

    With alpha free in each pixel the residual is r = n · C, n ∝ l × B: a rotation of l by t changes
    it by t · (B × C) / |l × B|. The information of these residuals, less its expectation for noise
    alone.
    """
    y, x = np.nonzero(streak.mask & image.valid & plate.valid)
    C, B, V_C, V_B = (
        np.asarray(a[y, x], dtype=float)
        for a in (image.rgb, plate.rgb, image.variance, plate.variance)
    )
    l = model.pole
    T = perpendicular(l)
    normal = np.cross(l, B)
    length2 = np.sum(normal**2, axis=1) + 1e-12
    r_variance = np.sum((V_C + V_B) * normal**2, axis=1) / length2 + VARIANCE_FLOOR
    slope = np.cross(B, C) @ T
    by_noise = [np.sum(V_C * np.cross(t, B) ** 2 + V_B * np.cross(C, t) ** 2, axis=1) for t in T.T]
    weight = 1 / (length2 * r_variance)
    information = (slope * weight[:, None]).T @ slope
    information -= np.diag([np.sum(weight * f) for f in by_noise])
    scatter = np.sqrt(2 * np.sum((weight[:, None] * np.stack(by_noise, axis=1)) ** 2, axis=0))
    smallest = float(np.linalg.eigvalsh(information)[0])
    return float(np.degrees(smallest**-0.5)) if smallest > 3 * scatter.max() else float("inf")
