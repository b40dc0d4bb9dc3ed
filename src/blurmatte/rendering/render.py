"""Scene → Rendering: a motion-blurred picture whose alpha, color and path are known.

The picture is what an ideal camera records: the average over the exposure of sharp, antialiased
pictures in linear light. In this file α is the exposure fraction, P the premultiplied light and S
the part of the plate's light that the shadow takes: the picture is P + (1 − α − S) · plate.
"""

import os
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from blurmatte.checks import Box, Floats
from blurmatte.color.model import ColorModel
from blurmatte.layer import Layer
from blurmatte.radiometry import LinearImage
from blurmatte.rendering.optics import disc_kernel
from blurmatte.rendering.scene import Scene, Shadow, check_scene
from blurmatte.trajectory import Trajectory

Array = npt.NDArray[np.float64]

_ALPHA_ERROR = 1e-4  # the largest error that averaging over time may leave in α
_ROUNDING = 1e-11  # what a Fourier transform leaves of nothing
_CHUNKS = 4  # sums of substeps; never the number of threads, or bytes would hang on the machine
_SOFT_REACH = 4.0  # standard deviations of a shadow's blur that count


@dataclass(frozen=True, eq=False)
class Rendering:
    """A blurred picture and everything there is to know about it; exact, without noise.

    Parameters
    ----------
    image : LinearImage
        The blurred picture, float64: premultiplied + (1 − alpha − shadow) · plate.
    plate : LinearImage
        The same scene without the body and its shadow.
    layer : Layer
        True alpha and premultiplied light, as far as nothing hides them.
    shadow : (H, W, 3) float
        Part of the plate's light that the body's shadow takes beside the body; 0 without a shadow.
    scene : Scene
        What was rendered.
    """

    image: LinearImage
    plate: LinearImage
    layer: Layer
    shadow: Floats
    scene: Scene

    def __repr__(self) -> str:
        return f"Rendering({self.layer!r}, {self.trajectory!r}, {self.model!r})"

    @property
    def trajectory(self) -> Trajectory:
        """True path of the body's center."""
        return self.scene.trajectory

    @property
    def model(self) -> ColorModel | None:
        """True colors: a line or plane that holds every color of the layer; None if they fill RGB."""
        return self.scene.body.model

    def subframes(self, count: int) -> list[Layer]:
        """The body held still at the middles of `count` equal parts of the exposure."""
        return [_held_still(self.scene, (n + 0.5) / count) for n in range(count)]


def render(scene: Scene, substeps: int | None = None) -> Rendering:
    """The exact picture of a scene, and its truth.

    Parameters
    ----------
    scene : Scene
    substeps : int, optional
        How many sharp pictures are averaged, at the middles of equal parts of the exposure. If not
        given, as many as keep the error of alpha below 1e-4.

    Returns
    -------
    Rendering
        The same to the last bit on any number of threads.

    Raises
    ------
    ValueError
        If `substeps` < 1.
    """
    check_scene("scene", scene)
    if substeps is None:
        substeps = _enough_substeps(scene)
    if substeps < 1:
        raise ValueError(f"substeps must be 1 or more, got {substeps}")
    alpha, premultiplied, shadow = _average(scene, substeps)
    plate: Floats = scene.plate.astype(np.float64)
    if scene.occluder is not None:
        plate = scene.occluder.over(LinearImage(plate)).rgb
        alpha, premultiplied, shadow = _hidden(scene.occluder, alpha, premultiplied, shadow)
    image = premultiplied + (1 - alpha[..., None] - shadow) * plate
    layer = Layer(alpha, premultiplied)
    return Rendering(LinearImage(image), LinearImage(plate), layer, shadow, scene)


def _enough_substeps(scene: Scene) -> int:
    """How many substeps keep the error of α below its bound, whatever the shape.

    At v pixels per exposure the coverage of a pixel is a ramp in time of slope <= v, up and down:
    four kinks. The midpoint rule with n steps misses each by at most v / (8 n²).
    """
    extent = max(np.hypot(*scene.body.reach(scene.change.at(t))) for t in (0, 0.5, 1))
    speed = scene.trajectory.top_speed + scene.change.rate * extent
    return max(1, int(np.ceil(np.sqrt(speed / (1 - scene.shutter_ramp) / (2 * _ALPHA_ERROR)))))


def _average(scene: Scene, substeps: int) -> tuple[Array, Array, Array]:
    """α (H, W), P (H, W, 3) and S (H, W, 3) of the picture."""
    edges = np.linspace(0, 1, substeps + 1)
    weights = np.diff(_opened(edges, scene.shutter_ramp))
    times = (edges[1:] + edges[:-1]) / 2
    chunks = np.array_split(np.arange(substeps), _CHUNKS)
    with ThreadPoolExecutor(min(_CHUNKS, os.cpu_count() or 1)) as pool:
        sums = list(pool.map(lambda part: _sum(scene, times[part], weights[part]), chunks))
    width, height = scene.size
    alpha, light = np.zeros((height, width)), np.zeros((height, width, 3))
    shadow = np.zeros((height, width, 3)) if scene.shadow else np.broadcast_to(0.0, light.shape)
    for (x0, y0, x1, y1), maps in sums:
        here = np.s_[y0:y1, x0:x1]
        alpha[here] += maps[..., 0]
        light[here] += maps[..., 1:4]
        if scene.shadow:
            shadow[here] += maps[..., 4:]
    return np.minimum(alpha, 1), light, shadow  # a covered pixel may round to above 1


def _opened(t: Array, ramp: float) -> Array:
    """Part of all light that came in until exposure fractions `t`, through a trapezoid shutter."""
    if ramp == 0:
        return t
    opening, closing = np.minimum(t, ramp), np.maximum(t - (1 - ramp), 0)
    light = opening**2 / (2 * ramp) + np.maximum(t - ramp, 0) - closing**2 / (2 * ramp)
    return np.asarray(light / (1 - ramp))


def _sum(scene: Scene, times: Array, weights: Array) -> tuple[Box, Array]:
    """Weighted sum (h, w, 4 or 7) of α, P and S at some times, in the box that holds them all."""
    boxes = [_box(scene, t) for t in times]
    box = _around(boxes)
    total = np.zeros((box[3] - box[1], box[2] - box[0], 7 if scene.shadow else 4))
    for t, weight, (x0, y0, x1, y1) in zip(times, weights, boxes, strict=True):
        if x0 < x1 and y0 < y1:
            alpha, light = _sharp(scene, t, (x0, y0, x1, y1))
            part = total[y0 - box[1] : y1 - box[1], x0 - box[0] : x1 - box[0]]
            part[..., 0] += weight * alpha
            part[..., 1:4] += weight * light
            if scene.shadow:
                dark = _darkness(scene, scene.shadow, t, (x0, y0, x1, y1)) * (1 - alpha)
                part[..., 4:] += weight * dark[..., None] * scene.shadow.strength
    return box, total


def _sharp(
    scene: Scene, t: float, box: Box, offset: tuple[float, float] = (0, 0)
) -> tuple[Array, Array]:
    """α (h, w) and P (h, w, 3) within a box, of the body held still, moved by `offset`."""
    blur = int(np.ceil(scene.defocus))
    x0, y0, x1, y1 = box
    cx, cy = scene.trajectory.at(t) + offset
    x, y = np.arange(x0 - blur, x1 + blur) - cx, np.arange(y0 - blur, y1 + blur) - cy
    alpha, light = scene.body.sharp(x, y, scene.change.at(t))
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


def _darkness(scene: Scene, shadow: Shadow, t: float, box: Box) -> Array:
    """(h, w) how dark the shadow is in a box, 0…1."""
    from scipy.ndimage import gaussian_filter

    wide = int(np.ceil(_SOFT_REACH * shadow.softness))
    x0, y0, x1, y1 = box
    silhouette, _ = _sharp(scene, t, (x0 - wide, y0 - wide, x1 + wide, y1 + wide), shadow.offset)
    dark = gaussian_filter(silhouette, shadow.softness, truncate=_SOFT_REACH)
    return np.asarray(dark[wide : wide + y1 - y0, wide : wide + x1 - x0])


def _box(scene: Scene, t: float) -> Box:
    """Pixels of the picture that the body or its shadow may touch at a time; may be empty."""
    center, reach = scene.trajectory.at(t), scene.body.reach(scene.change.at(t))
    spread = np.asarray(reach) + np.ceil(scene.defocus)
    boxes = [_touched(center, spread, scene.size)]
    if scene.shadow is not None:
        spread = spread + _SOFT_REACH * scene.shadow.softness
        boxes.append(_touched(center + scene.shadow.offset, spread, scene.size))
    return _around(boxes)


def _touched(center: Array, spread: Array, size: tuple[int, int]) -> Box:
    first = np.maximum(np.ceil(center - spread - 0.5), 0).astype(int)
    end = np.minimum(np.floor(center + spread + 0.5) + 1, size).astype(int)
    return int(first[0]), int(first[1]), int(end[0]), int(end[1])


def _around(boxes: list[Box]) -> Box:
    """The box around some boxes, those that are empty left out."""
    full = [box for box in boxes if box[0] < box[2] and box[1] < box[3]]
    if not full:
        return 0, 0, 0, 0
    x0, y0, x1, y1 = np.transpose(full)
    return int(x0.min()), int(y0.min()), int(x1.max()), int(y1.max())


def _held_still(scene: Scene, t: float) -> Layer:
    """The whole picture's layer at one moment."""
    width, height = scene.size
    x0, y0, x1, y1 = _box(scene, t)
    alpha, light = np.zeros((height, width)), np.zeros((height, width, 3))
    if x0 < x1 and y0 < y1:
        alpha[y0:y1, x0:x1], light[y0:y1, x0:x1] = _sharp(scene, t, (x0, y0, x1, y1))
    if scene.occluder is not None:
        alpha, light = _hidden(scene.occluder, alpha, light)
    return Layer(np.minimum(alpha, 1), light)


def _hidden(occluder: Layer, *maps: Array) -> list[Array]:
    """The maps, 0 where the occluder is."""
    seen = occluder.alpha == 0
    return [m * (seen if m.ndim == 2 else seen[..., None]) for m in maps]
