"""Errors of estimated colors and light. All light is linear, 1 = sensor white."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from blurmatte.checks import (
    Array,
    Floats,
    as_array,
    box_of,
    check_light,
    check_same_size,
    rows_columns,
)
from blurmatte.layer import Layer
from blurmatte.metrics.alpha import check_all_finite, check_finite_layer, picture_size, streak_of
from blurmatte.radiometry import SRGB, LinearImage, check_picture


@dataclass(frozen=True)
class ColorDistance:
    """Distance of true colors from the estimated line or plane.

    Parameters
    ----------
    units : float
        Largest distance of a true color, linear light in units of 0…255.
    degrees : float
        Largest angle between a mixture of the true colors and the estimated ones, 0…90.
    """

    units: float
    degrees: float


def color_distance(estimated: npt.ArrayLike, true: npt.ArrayLike) -> ColorDistance:
    """Distance of true colors from a color, a line or a plane of colors, brightness matched.

    Let Q be an orthonormal basis of the estimated colors. QQᵀo is the nearest of them to a true color
    o; brightness is not compared, as a line or plane holds all shades. `units` is 255 · |o − QQᵀo|,
    which is proportional to the brightness of o. `degrees` is the angle between o and the line or
    plane. For several true colors it is the largest over all their mixtures, also those with negative
    light: between two planes it is the larger of their two principal angles, and between a plane and a
    line 90 degrees.

    Parameters
    ----------
    estimated : (3,) or (3, rank) float
        A straight color, or columns that span the estimated colors, as in `ColorModel.basis`; rank
        1 or 2. They need not be orthonormal.
    true : (3,) or (n, 3) float
        One or more colors of the object, linear light.

    Returns
    -------
    ColorDistance
        Zeros are perfect.

    Raises
    ------
    ValueError
        For other shapes, numbers that are not finite, black, and two columns of one hue.
    """
    Q = _estimated_span(np.asarray(as_array("estimated", estimated), dtype=float))
    o = _true_colors(np.asarray(as_array("true", true), dtype=float))
    off = o - o @ Q @ Q.T
    units = 255 * float(np.linalg.norm(off, axis=1).max())
    T = _span(o)
    sine = float(np.linalg.norm(T - Q @ Q.T @ T, ord=2))  # of the largest angle to a vector of T
    return ColorDistance(units, float(np.degrees(np.arcsin(min(sine, 1.0)))))


def premultiplied_rmse(estimated: Floats, true: Layer) -> float:
    """Root mean square error of premultiplied light, over the pixels of the streak and channels.

    Parameters
    ----------
    estimated : (H, W, 3) float
        Linear light, alpha times the object's color.
    true : Layer

    Returns
    -------
    float
        Light; 0 is perfect.

    Raises
    ------
    TypeError, ValueError
        If `estimated` is not (H, W, 3) float, the sizes differ, a number is not finite, or `true`
        holds no streak.
    """
    estimated = check_light("estimated", estimated)
    check_all_finite("estimated", estimated)
    check_finite_layer("true", true)
    check_same_size("estimated", picture_size(estimated), "true", true.size)
    streak = streak_of(true.alpha)
    error = estimated[streak].astype(float) - true.premultiplied[streak]
    return float(np.sqrt(np.mean(error**2)))


def recomposite_psnr(estimated: Layer, true: Layer, background: LinearImage) -> float:
    """Peak signal-to-noise ratio of the estimated layer over another picture.

    Both layers are put over the background, clipped to 0…1, coded as sRGB (white is 1; not rounded),
    and compared within the bounding box of the streak. Outside, both show the background, which would
    raise the ratio by the size of the picture; errors there are measured by `false_alpha`.

    Parameters
    ----------
    estimated, true : Layer
    background : LinearImage
        Not the plate: over the plate the errors of alpha and of light cancel.

    Returns
    -------
    float
        Decibel; infinite if both look the same.

    Raises
    ------
    TypeError, ValueError
        If the sizes differ, a number is not finite, or `true` holds no streak.
    """
    for name, layer in (("estimated", estimated), ("true", true)):
        check_finite_layer(name, layer)
    check_picture("background", background)
    check_same_size("estimated", estimated.size, "true", true.size)
    box = rows_columns(box_of(streak_of(true.alpha)))
    seen, wanted = (_coded(layer.over(background).rgb[box]) for layer in (estimated, true))
    error = float(np.mean((seen - wanted) ** 2))
    return -10 * float(np.log10(error)) if error > 0 else np.inf


def _span(colors: Array) -> Array:
    """(3, rank) orthonormal columns that span the rows of (n, 3)."""
    _, size, directions = np.linalg.svd(colors, full_matrices=False)
    return np.asarray(directions[size > 1e-6 * size[0]].T)  # of float32


def _estimated_span(estimated: Array) -> Array:
    """(3, rank) orthonormal columns that span the estimated colors."""
    columns = estimated.reshape(3, 1) if estimated.shape == (3,) else estimated
    if columns.ndim != 2 or columns.shape not in ((3, 1), (3, 2)):
        raise ValueError(
            f"estimated must have the shape (3,), (3, 1) or (3, 2), got {estimated.shape}"
        )
    check_all_finite("estimated", columns)
    Q = _span(columns.T)
    if Q.shape[1] < columns.shape[1]:
        raise ValueError(
            f"estimated must hold {columns.shape[1]} independent colors, got {Q.shape[1]}"
        )
    return Q


def _true_colors(true: Array) -> Array:
    """(n, 3) the colors as rows."""
    colors = true[None] if true.ndim == 1 else true
    if colors.ndim != 2 or colors.shape[1] != 3 or len(colors) == 0:
        raise ValueError(f"true must have the shape (3,) or (n, 3), got {true.shape}")
    check_all_finite("true", colors)
    black = int(np.sum(~colors.any(axis=1)))
    if black:
        raise ValueError(f"true must hold colors that are not black, got {black} black ones")
    return colors


def _coded(light: Floats) -> Array:
    return np.asarray(SRGB.encode(np.clip(light.astype(float), 0, 1)))
