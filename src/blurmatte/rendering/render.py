"""Scene → Rendering: a motion-blurred picture whose alpha, color and path are known.

The picture is what an ideal camera records: the average over the exposure of sharp, antialiased
pictures in linear light. In this file α is the exposure fraction, P the premultiplied light, S and N
the parts of the plate's light that are taken by the shadow and near the body: the picture is
P + (1 − α − S − N) · plate.
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
from blurmatte.rendering.moment import (
    box_around,
    darkness,
    mean_proximity,
    proximity_at,
    sharp_layer,
    touched_box,
)
from blurmatte.rendering.pinhole import rim_magnification
from blurmatte.rendering.pixel_filter import filter_peak
from blurmatte.rendering.scene import Scene, check_scene
from blurmatte.trajectory import Trajectory

Array = npt.NDArray[np.float64]

_ALPHA_ERROR = 1e-4  # the largest error that averaging over time may leave in α
_CHUNKS = 4  # sums of substeps; never the number of threads, or bytes would hang on the machine


@dataclass(frozen=True, eq=False)
class Rendering:
    """A blurred picture and everything there is to know about it; exact, without noise.

    Parameters
    ----------
    image : LinearImage
        The blurred picture, float64: premultiplied + (1 − alpha − shadow − nearby) · plate.
    plate : LinearImage
        The same scene without the body and its shadow.
    layer : Layer
        True alpha and premultiplied light, as far as nothing hides them.
    shadow : (H, W, 3) float
        Part of the plate's light that the body's shadow takes beside the body; 0 without a shadow.
    scene : Scene
        What was rendered.
    nearby : (H, W, 3) float
        Part of the plate's light that `Scene.nearby` takes (positive) or gives (negative) while the
        body is not in front of it; 0 without `Scene.nearby`.
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


def _enough_substeps(scene: Scene) -> int:
    """How many substeps keep the error of α below its bound, whatever the shape.

    At v pixels per exposure the coverage of a pixel is a ramp in time of slope <= v, up and down:
    four kinks. The midpoint rule with n steps misses each by at most v / (8 n²).
    """
    poses = [scene.pose(t) for t in (0, 0.5, 1)]
    extent = max(np.hypot(*scene.body.reach(pose)) for pose in poses)
    speed = scene.trajectory.top_speed + scene.change.rate * extent
    speed *= max(rim_magnification(pose.view, extent) if pose.view else 1 for pose in poses)
    if scene.pixel_filter:
        speed *= max(1, filter_peak(scene.pixel_filter))
    return max(1, int(np.ceil(np.sqrt(speed / (1 - scene.shutter_ramp) / (2 * _ALPHA_ERROR)))))


def _average(scene: Scene, substeps: int) -> tuple[Array, Array, Array, Array]:
    """α (H, W), P, S and N (H, W, 3) of the picture."""
    edges = np.linspace(0, 1, substeps + 1)
    weights = np.diff(_opened(edges, scene.shutter_ramp))
    times = (edges[1:] + edges[:-1]) / 2
    chunks = np.array_split(np.arange(substeps), _CHUNKS)
    with ThreadPoolExecutor(min(_CHUNKS, os.cpu_count() or 1)) as pool:
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
        near = mean_proximity(scene, scene.nearby, times, weights) - total[..., 7]
        nearby = near[..., None] * scene.nearby.taken(_mean_color(alpha, light))
    return alpha, light, shadow, nearby


def _channels(scene: Scene) -> int:
    """Of the maps of `_sum`: α, P; S and what α hides of the proximity, if they are needed."""
    return 4 if scene.shadow is None and scene.nearby is None else 8


def _mean_color(alpha: Array, light: Array) -> Array:
    """(3,) color of the body; black if it is nowhere in the picture."""
    area = alpha.sum()
    return np.asarray(light.sum(axis=(0, 1)) / area if area > 0 else np.zeros(3))


def _opened(t: Array, ramp: float) -> Array:
    """Part of all light that came in until exposure fractions `t`, through a trapezoid shutter."""
    if ramp == 0:
        return t
    opening, closing = np.minimum(t, ramp), np.maximum(t - (1 - ramp), 0)
    light = opening**2 / (2 * ramp) + np.maximum(t - ramp, 0) - closing**2 / (2 * ramp)
    return np.asarray(light / (1 - ramp))


def _sum(scene: Scene, times: Array, weights: Array) -> tuple[Box, Array]:
    """Weighted sum (h, w, `_channels`) of maps at some times, in the box that holds them all."""
    boxes = [touched_box(scene, t) for t in times]
    box = box_around(boxes)
    total = np.zeros((box[3] - box[1], box[2] - box[0], _channels(scene)))
    for t, weight, (x0, y0, x1, y1) in zip(times, weights, boxes, strict=True):
        if x0 < x1 and y0 < y1:
            alpha, light = sharp_layer(scene, t, (x0, y0, x1, y1))
            part = total[y0 - box[1] : y1 - box[1], x0 - box[0] : x1 - box[0]]
            part[..., 0] += weight * alpha
            part[..., 1:4] += weight * light
            if scene.shadow:
                dark = darkness(scene, scene.shadow, t, (x0, y0, x1, y1)) * (1 - alpha)
                part[..., 4:7] += weight * dark[..., None] * scene.shadow.strength
            if scene.nearby:
                near = proximity_at(scene, scene.nearby, t, (x0, y0, x1, y1))
                part[..., 7] += weight * alpha * near
    return box, total


def _held_still(scene: Scene, t: float) -> Layer:
    """The whole picture's layer at one moment."""
    width, height = scene.size
    x0, y0, x1, y1 = touched_box(scene, t)
    alpha, light = np.zeros((height, width)), np.zeros((height, width, 3))
    if x0 < x1 and y0 < y1:
        alpha[y0:y1, x0:x1], light[y0:y1, x0:x1] = sharp_layer(scene, t, (x0, y0, x1, y1))
    if scene.occluder is not None:
        alpha, light = _hidden(scene.occluder, alpha, light)
    return Layer(np.minimum(alpha, 1), light)


def _hidden(occluder: Layer, *maps: Array) -> list[Array]:
    """The maps, 0 where the occluder is."""
    seen = occluder.alpha == 0
    return [m * (seen if m.ndim == 2 else seen[..., None]) for m in maps]
