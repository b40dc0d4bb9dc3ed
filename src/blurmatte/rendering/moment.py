"""A scene at one moment: sharp layer, shadow and light nearby, and the box of pixels they touch."""

import numpy as np
import numpy.typing as npt

from blurmatte.checks import Box
from blurmatte.rendering.nearby import Nearby, proximity
from blurmatte.rendering.optics import disc_kernel
from blurmatte.rendering.pixel_filter import filter_margin, filtered_body
from blurmatte.rendering.scene import Scene, Shadow

Array = npt.NDArray[np.float64]

_ROUNDING = 1e-11  # what a Fourier transform leaves of nothing
_SOFT_REACH = 4.0  # standard deviations of a shadow's blur that count


def sharp_layer(
    scene: Scene, t: float, box: Box, offset: tuple[float, float] = (0, 0)
) -> tuple[Array, Array]:
    """α (h, w) and P (h, w, 3) within a box, of the body held still, moved by `offset`."""
    blur = int(np.ceil(scene.defocus))
    x0, y0, x1, y1 = box
    cx, cy = scene.trajectory.at(t) + offset
    x, y = np.arange(x0 - blur, x1 + blur) - cx, np.arange(y0 - blur, y1 + blur) - cy
    if scene.pixel_filter:
        alpha, light = filtered_body(scene.body, x, y, scene.pose(t), scene.pixel_filter)
    else:
        alpha, light = scene.body.sharp(x, y, scene.pose(t))
    if blur:
        alpha, light = (_out_of_focus(a, scene.defocus) for a in (alpha, light))
    return scene.opacity * alpha, scene.opacity * light


def _out_of_focus(values: Array, radius: float) -> Array:
    """Averaged over a disc, and smaller by its reach on each side."""
    from scipy.signal import fftconvolve

    disc = disc_kernel(radius)
    disc = disc.reshape(disc.shape + (1,) * (values.ndim - 2))
    soft = fftconvolve(values, disc, mode="valid", axes=(0, 1))
    return np.where(soft > _ROUNDING, soft, 0)


def darkness(scene: Scene, shadow: Shadow, t: float, box: Box) -> Array:
    """(h, w) how dark the shadow is in a box, 0…1."""
    from scipy.ndimage import gaussian_filter

    wide = int(np.ceil(_SOFT_REACH * shadow.softness))
    x0, y0, x1, y1 = box
    silhouette, _ = sharp_layer(
        scene, t, (x0 - wide, y0 - wide, x1 + wide, y1 + wide), shadow.offset
    )
    dark = gaussian_filter(silhouette, shadow.softness, truncate=_SOFT_REACH)
    return np.asarray(dark[wide : wide + y1 - y0, wide : wide + x1 - x0])


def touched_box(scene: Scene, t: float) -> Box:
    """Pixels of the picture that the body or its shadow may touch at a time; may be empty."""
    center, reach = scene.trajectory.at(t), scene.body.reach(scene.pose(t))
    spread = np.asarray(reach) + np.ceil(scene.defocus) + filter_margin(scene.pixel_filter)
    boxes = [_touched(center, spread, scene.size)]
    if scene.shadow is not None:
        spread = spread + _SOFT_REACH * scene.shadow.softness
        boxes.append(_touched(center + scene.shadow.offset, spread, scene.size))
    return box_around(boxes)


def mean_proximity(scene: Scene, nearby: Nearby, times: Array, weights: Array) -> Array:
    """(H, W) weighted sum of `proximity` over some times."""
    width, height = scene.size
    total = np.zeros((height, width))
    for t, weight in zip(times, weights, strict=True):
        total += weight * proximity_at(scene, nearby, t, (0, 0, width, height))
    return total


def proximity_at(scene: Scene, nearby: Nearby, t: float, box: Box) -> Array:
    """(h, w) `proximity` of the body in a box."""
    distance = nearby.reach * max(scene.body.reach(scene.pose(t)))
    return proximity(scene.trajectory.at(t), distance, box)


def _touched(center: Array, spread: Array, size: tuple[int, int]) -> Box:
    first = np.maximum(np.ceil(center - spread - 0.5), 0).astype(int)
    end = np.minimum(np.floor(center + spread + 0.5) + 1, size).astype(int)
    return int(first[0]), int(first[1]), int(end[0]), int(end[1])


def box_around(boxes: list[Box]) -> Box:
    """The box around some boxes, those that are empty left out."""
    full = [box for box in boxes if box[0] < box[2] and box[1] < box[3]]
    if not full:
        return 0, 0, 0, 0
    x0, y0, x1, y1 = np.transpose(full)
    return int(x0.min()), int(y0.min()), int(x1.max()), int(y1.max())
