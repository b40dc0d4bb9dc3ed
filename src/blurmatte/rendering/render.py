"""Scene → Rendering: a motion-blurred picture whose alpha, color and path are known.

The picture is that of an ideal camera: the average over the exposure of sharp, antialiased pictures
in linear light. In this file α is the exposure fraction, P the premultiplied light, and S and N are
the fractions of the plate's light removed by the shadow and near the body. The picture is
P + (1 − α − S − N) · plate.

Pixel filters may be wider than the pixel: the four-term Blackman-Harris window. A pixel is the
average of the picture, weighted by the window around the pixel's center. The window is piecewise
constant on cells of a quarter of a pixel, with its exact integral over each cell.
"""

import os
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.lib.stride_tricks import sliding_window_view

from blurmatte.checks import Array, Box, Floats, box_from, enclosing
from blurmatte.color.model import ColorModel
from blurmatte.layer import Layer
from blurmatte.radiometry import LinearImage
from blurmatte.rendering.coverage import disc_kernel
from blurmatte.rendering.pose import Pose, rim_magnification
from blurmatte.rendering.scene import Body, Nearby, Scene, Shadow, check_scene
from blurmatte.trajectory import Trajectory

_SHADOW_REACH = 4.0  # truncation of a shadow's Gaussian blur, standard deviations
MAX_SUBSTEPS = 200_000  # as many as 8 million pixels per exposure need
CELLS_PER_PIXEL = 4  # along each axis

_BLACKMAN_HARRIS = (0.35875, 0.48829, 0.14128, 0.01168)  # Harris, Proc. IEEE 66, 1978


@dataclass(frozen=True, eq=False)
class Rendering:
    """A blurred picture and its ground truth, exact and without noise.

    Parameters
    ----------
    image : LinearImage
        The blurred picture, float64: premultiplied + (1 − alpha − shadow − nearby) · plate.
    plate : LinearImage
        The same scene without the body and its shadow.
    layer : Layer
        True alpha and premultiplied light; 0 behind an occluder.
    shadow : (H, W, 3) float
        Fraction of the plate's light that the body's shadow removes while the body is not in front of
        it; 0 without a shadow.
    scene : Scene
        The rendered scene.
    nearby : (H, W, 3) float
        Fraction of the plate's light that `Scene.nearby` removes (positive) or adds (negative) while
        the body is not in front of it; 0 without `Scene.nearby`.

    Examples
    --------
    >>> difference = truth.layer.over(truth.plate).rgb - truth.image.rgb
    >>> print(f"{np.abs(difference).max():.5f}")
    0.00000
    """

    image: LinearImage
    plate: LinearImage
    layer: Layer
    shadow: Floats
    scene: Scene
    nearby: Floats

    def __repr__(self) -> str:
        return f"Rendering({self.layer!r}, {self.trajectory!r}, {self.model!r})"

    @property
    def trajectory(self) -> Trajectory:
        """True path of the body's center."""
        return self.scene.trajectory

    @property
    def model(self) -> ColorModel | None:
        """True line or plane of all colors of the layer; None if they span RGB."""
        return self.scene.body.model

    def subframes(self, count: int) -> list[Layer]:
        """Sharp layers of the body at the middles of `count` equal parts of the exposure."""
        return [_sharp_frame(self.scene, (n + 0.5) / count) for n in range(count)]


def render(scene: Scene, substeps: int | None = None) -> Rendering:
    """Render a scene exactly, with its ground truth.

    Parameters
    ----------
    scene : Scene
    substeps : int, optional
        Number of sharp pictures to average, at the middles of equal parts of the exposure. By default
        as many as bound the error of alpha by 1e-4.

    Returns
    -------
    Rendering
        Identical to the last bit on any number of threads.

    Raises
    ------
    ValueError
        If `substeps` < 1.

    Examples
    --------
    >>> truth = bm.rendering.render(scene, 100)
    >>> picture = truth.image
    >>> print(f"{truth.layer.alpha.sum():.0f} pixels, π r² is {np.pi * 10**2:.0f}")
    314 pixels, π r² is 314
    """
    check_scene("scene", scene)
    if substeps is None:
        substeps = required_substeps(scene)
    if substeps < 1:
        raise ValueError(f"substeps must be 1 or more, got {substeps}")
    alpha, premultiplied, shadow, nearby = _average(scene, substeps)
    plate: Floats = scene.plate.astype(np.float64)
    if scene.occluder is not None:
        plate = scene.occluder.over(LinearImage(plate)).rgb
        alpha, premultiplied, shadow, nearby = _hidden(
            scene.occluder, alpha, premultiplied, shadow, nearby
        )
    image = premultiplied + (1 - alpha[..., None] - shadow - nearby) * plate
    layer = Layer(alpha, premultiplied)
    return Rendering(LinearImage(image), LinearImage(plate), layer, shadow, scene, nearby)


def required_substeps(scene: Scene) -> int:
    """Number of substeps that bounds the error of α by 1e-4 for any shape.

    At v pixels per exposure the coverage of a pixel is a trapezoid in time with slopes up to v, which
    has four kinks. The error of the midpoint rule with n steps is at most v / (8 n²) per kink.
    """
    max_alpha_error = 1e-4
    poses = [scene.pose(t) for t in (0, 0.5, 1)]
    extent = max(np.hypot(*scene.body.reach(pose)) for pose in poses)
    speed = scene.trajectory.top_speed + scene.change.rate * extent
    speed *= max(rim_magnification(pose.view, extent) if pose.view else 1 for pose in poses)
    if scene.pixel_filter:
        speed *= max(1, filter_peak(scene.pixel_filter))
    count = np.ceil(np.sqrt(speed / (1 - scene.shutter_ramp) / (2 * max_alpha_error)))
    if not count <= MAX_SUBSTEPS:
        raise ValueError(f"a speed of {speed:.3g} pixels per exposure is too fast to be rendered")
    return max(1, int(count))


def _average(scene: Scene, substeps: int) -> tuple[Array, Array, Array, Array]:
    """α (H, W), P, S and N (H, W, 3) of the whole picture."""
    edges = np.linspace(0, 1, substeps + 1)
    weights = np.diff(_exposed(edges, scene.shutter_ramp))
    times = (edges[1:] + edges[:-1]) / 2
    count = 4  # partial sums; independent of the number of threads, for identical rounding
    chunks = np.array_split(np.arange(substeps), count)
    with ThreadPoolExecutor(min(count, os.cpu_count() or 1)) as pool:
        sums = list(pool.map(lambda part: _sum(scene, times[part], weights[part]), chunks))
    width, height = scene.size
    total = np.zeros((height, width, _channels(scene)))
    for (x0, y0, x1, y1), maps in sums:
        total[y0:y1, x0:x1] += maps
    alpha = np.minimum(total[..., 0], 1)  # a covered pixel may round to above 1
    light = np.ascontiguousarray(total[..., 1:4])
    shadow = nearby = np.broadcast_to(0.0, light.shape)
    if scene.shadow is not None:
        shadow = np.ascontiguousarray(total[..., 4:7])
    if scene.nearby is not None:
        near = _mean_proximity(scene, scene.nearby, times, weights) - total[..., 7]
        nearby = near[..., None] * scene.nearby.taken(_mean_color(alpha, light))
    return alpha, light, shadow, nearby


def _channels(scene: Scene) -> int:
    """Number of maps of `_sum`: α, P; S and the proximity hidden by α, if they are needed."""
    return 4 if scene.shadow is None and scene.nearby is None else 8


def _mean_color(alpha: Array, light: Array) -> Array:
    """(3,) mean color of the body; black if it is outside the picture."""
    area = alpha.sum()
    return np.asarray(light.sum(axis=(0, 1)) / area if area > 0 else np.zeros(3))


def _exposed(t: Array, ramp: float) -> Array:
    """Fraction of all light that a trapezoidal shutter admits until exposure fractions `t`."""
    if ramp == 0:
        return t
    opening, closing = np.minimum(t, ramp), np.maximum(t - (1 - ramp), 0)
    light = opening**2 / (2 * ramp) + np.maximum(t - ramp, 0) - closing**2 / (2 * ramp)
    return np.asarray(light / (1 - ramp))


def _sum(scene: Scene, times: Array, weights: Array) -> tuple[Box, Array]:
    """Weighted sum (h, w, `_channels`) of the maps at some times, and its box."""
    boxes = [_touched_box(scene, t) for t in times]
    box = _box_around(boxes)
    total = np.zeros((box[3] - box[1], box[2] - box[0], _channels(scene)))
    for t, weight, (x0, y0, x1, y1) in zip(times, weights, boxes, strict=True):
        if x0 < x1 and y0 < y1:
            alpha, light = _sharp_layer(scene, t, (x0, y0, x1, y1))
            part = total[y0 - box[1] : y1 - box[1], x0 - box[0] : x1 - box[0]]
            part[..., 0] += weight * alpha
            part[..., 1:4] += weight * light
            if scene.shadow:
                dark = _shadow_density(scene, scene.shadow, t, (x0, y0, x1, y1)) * (1 - alpha)
                part[..., 4:7] += weight * dark[..., None] * scene.shadow.strength
            if scene.nearby:
                near = _proximity(scene, scene.nearby, t, (x0, y0, x1, y1))
                part[..., 7] += weight * alpha * near
    return box, total


def _sharp_layer(
    scene: Scene, t: float, box: Box, offset: tuple[float, float] = (0, 0)
) -> tuple[Array, Array]:
    """α (h, w) and P (h, w, 3) within a box at time `t`, of the body displaced by `offset`."""
    blur = int(np.ceil(scene.defocus))
    x0, y0, x1, y1 = box
    cx, cy = scene.trajectory.at(t) + offset
    x, y = np.arange(x0 - blur, x1 + blur) - cx, np.arange(y0 - blur, y1 + blur) - cy
    if scene.pixel_filter:
        alpha, light = filtered_body(scene.body, x, y, scene.pose(t), scene.pixel_filter)
    else:
        alpha, light = scene.body.sharp(x, y, scene.pose(t))
    if blur:
        alpha, light = (_defocused(a, scene.defocus) for a in (alpha, light))
    return scene.opacity * alpha, scene.opacity * light


def filtered_body(body: Body, x: Array, y: Array, pose: Pose, width: float) -> tuple[Array, Array]:
    """Coverage (h, w) and premultiplied light (h, w, 3) of a body through a window of `width` pixels.

    Same as `Body.sharp`, whose window is the box of one pixel.
    """
    cells_x, cells_y = (filter_cells(centers, width) for centers in (x, y))
    coverage, light = body.sharp(cells_x, cells_y, pose.magnified(CELLS_PER_PIXEL))
    return filtered(coverage, width), filtered(light, width)


def _defocused(values: Array, radius: float) -> Array:
    """Average over a disc; the result is smaller by the disc's radius on each side."""
    disc = disc_kernel(radius)
    disc = disc.reshape(disc.shape + (1,) * (values.ndim - 2))
    soft = scipy.signal.fftconvolve(values, disc, mode="valid", axes=(0, 1))
    return np.where(soft > 1e-11, soft, 0)  # rounding errors of the Fourier transform


def _shadow_density(scene: Scene, shadow: Shadow, t: float, box: Box) -> Array:
    """(h, w) density of the shadow in a box, 0…1."""
    wide = int(np.ceil(_SHADOW_REACH * shadow.softness))
    x0, y0, x1, y1 = box
    silhouette, _ = _sharp_layer(
        scene, t, (x0 - wide, y0 - wide, x1 + wide, y1 + wide), shadow.offset
    )
    dark = scipy.ndimage.gaussian_filter(silhouette, shadow.softness, truncate=_SHADOW_REACH)
    return np.asarray(dark[wide : wide + y1 - y0, wide : wide + x1 - x0])


def _touched_box(scene: Scene, t: float) -> Box:
    """Box of the pixels that the body or its shadow may touch at time `t`; may be empty."""
    center, reach = scene.trajectory.at(t), scene.body.reach(scene.pose(t))
    spread = np.asarray(reach) + np.ceil(scene.defocus) + filter_margin(scene.pixel_filter)
    boxes = [_touched(center, spread, scene.size)]
    if scene.shadow is not None:
        spread = spread + _SHADOW_REACH * scene.shadow.softness
        boxes.append(_touched(center + scene.shadow.offset, spread, scene.size))
    return _box_around(boxes)


def _mean_proximity(scene: Scene, nearby: Nearby, times: Array, weights: Array) -> Array:
    """(H, W) weighted sum of `_proximity` over some times."""
    width, height = scene.size
    total = np.zeros((height, width))
    for t, weight in zip(times, weights, strict=True):
        total += weight * _proximity(scene, nearby, t, (0, 0, width, height))
    return total


def _proximity(scene: Scene, nearby: Nearby, t: float, box: Box) -> Array:
    """(h, w) profile g of `Nearby` in a box at time `t`."""
    distance = nearby.reach * max(scene.body.reach(scene.pose(t)))
    center, (x0, y0, x1, y1) = scene.trajectory.at(t), box
    x, y = (np.arange(x0, x1) - center[0]) / distance, (np.arange(y0, y1) - center[1]) / distance
    s = 1 + x**2 + y[:, None] ** 2
    return np.asarray(1 / (s * np.sqrt(s)))


def _touched(center: Array, spread: Array, size: tuple[int, int]) -> Box:
    return box_from(np.ceil(center - spread - 0.5), np.floor(center + spread + 0.5) + 1, size)


def _box_around(boxes: list[Box]) -> Box:
    """The box around all boxes that are not empty."""
    full = [box for box in boxes if box[0] < box[2] and box[1] < box[3]]
    return enclosing(full) if full else (0, 0, 0, 0)


def _sharp_frame(scene: Scene, t: float) -> Layer:
    """Layer of the whole picture at time `t`."""
    width, height = scene.size
    x0, y0, x1, y1 = _touched_box(scene, t)
    alpha, light = np.zeros((height, width)), np.zeros((height, width, 3))
    if x0 < x1 and y0 < y1:
        alpha[y0:y1, x0:x1], light[y0:y1, x0:x1] = _sharp_layer(scene, t, (x0, y0, x1, y1))
    if scene.occluder is not None:
        alpha, light = _hidden(scene.occluder, alpha, light)
    return Layer(np.minimum(alpha, 1), light)


def _hidden(occluder: Layer, *maps: Array) -> list[Array]:
    """Set the maps to 0 where the occluder is."""
    seen = occluder.alpha == 0
    return [m * (seen if m.ndim == 2 else seen[..., None]) for m in maps]


def filter_margin(width: float) -> int:
    """Pixels on each side of a pixel that a window of `width` pixels covers."""
    return int(np.ceil(max(width / 2 - 0.5, 0)))


def filter_peak(width: float) -> float:
    """Largest weight of the window relative to that of a box of one pixel."""
    return 1 / (_BLACKMAN_HARRIS[0] * width)


def filter_weights(width: float) -> Array:
    """Weights of the cells of one pixel and its margins along one axis; the sum is 1."""
    cells = (2 * filter_margin(width) + 1) * CELLS_PER_PIXEL
    s = np.clip((np.arange(cells + 1) - cells / 2) / CELLS_PER_PIXEL / width, -0.5, 0.5)
    mean, *amplitudes = _BLACKMAN_HARRIS
    integral = mean * s
    for k, amplitude in enumerate(amplitudes, 1):
        integral += amplitude * np.sin(2 * np.pi * k * s) / (2 * np.pi * k)
    return np.asarray(np.diff(integral) / mean)


def filter_cells(centers: Array, width: float) -> Array:
    """Centers of the cells of consecutive pixels and their margins, in cell widths."""
    margin = filter_margin(width)
    padded = np.arange(centers[0] - margin, centers[-1] + margin + 0.5)
    steps = np.arange(len(padded) * CELLS_PER_PIXEL) / CELLS_PER_PIXEL
    return np.asarray(CELLS_PER_PIXEL * (padded[0] - 0.5 + steps) + 0.5)


def filtered(values: Array, width: float) -> Array:
    """Average values (h, w, ...) on the cells of `filter_cells` to pixels."""
    weights = filter_weights(width)
    for axis in (0, 1):
        windows = sliding_window_view(values, len(weights), axis)  # the window is the last axis
        every = np.s_[::CELLS_PER_PIXEL] if axis == 0 else np.s_[:, ::CELLS_PER_PIXEL]
        values = windows[every] @ weights
    return values
