"""Scene → Rendering: a motion-blurred picture whose alpha, color and path are known.

The picture is what an ideal camera records: the average over the exposure of sharp, antialiased
pictures in linear light. In this file α is the exposure fraction, P the premultiplied light.
"""

from dataclasses import dataclass
from typing import Protocol

import numpy as np
import numpy.typing as npt

from blurmatte.checks import Floats, check_light
from blurmatte.color.model import ColorModel
from blurmatte.layer import Layer
from blurmatte.radiometry import LinearImage
from blurmatte.trajectory import Trajectory

Array = npt.NDArray[np.float64]

_ALPHA_ERROR = 1e-4  # the largest error that averaging over time may leave in α


class Body(Protocol):
    """Something that can be rendered: `Ball`, `Sheet`, and whatever has these three."""

    @property
    def model(self) -> ColorModel:
        """The colors it can show."""

    @property
    def reach(self) -> tuple[float, float]:
        """How far it extends from its center in x and y, pixels."""

    def sharp(self, x: Array, y: Array) -> tuple[Array, Array]:
        """Coverage (h, w) and premultiplied light (h, w, 3) of the body at rest.

        `x` (w,) and `y` (h,) are neighboring pixel centers, from the center of the body.
        """


@dataclass(frozen=True, eq=False)
class Scene:
    """A body that moves along a trajectory in front of a plate during one exposure.

    Parameters
    ----------
    plate : (H, W, 3) float
        Linear light of the scene without the body.
    trajectory : Trajectory
        Path of the body's center, pixels. It may leave the picture.
    body : Ball, Sheet or another Body
        What moves.

    Raises
    ------
    TypeError, ValueError
        If the plate is not linear light, or not finite, or the trajectory is not a Trajectory.
    """

    plate: Floats
    trajectory: Trajectory
    body: Body

    def __post_init__(self) -> None:
        check_light("plate", self.plate)
        if not np.all(np.isfinite(self.plate)):
            raise ValueError("plate must be finite")
        if not isinstance(self.trajectory, Trajectory):
            raise TypeError(
                f"trajectory must be a Trajectory, got {type(self.trajectory).__name__}"
            )

    def __repr__(self) -> str:
        height, width = self.plate.shape[:2]
        return f"Scene({width}x{height}, {self.body!r}, {self.trajectory!r})"


@dataclass(frozen=True, eq=False)
class Rendering:
    """A blurred picture and everything there is to know about it; exact, without noise.

    Parameters
    ----------
    image : LinearImage
        The blurred picture, float64: premultiplied + (1 − alpha) · plate.
    plate : LinearImage
        The same scene without the body.
    layer : Layer
        True alpha and premultiplied light.
    trajectory : Trajectory
        True path of the center.
    model : ColorModel
        True colors: a line or a plane that holds every color of the layer.
    """

    image: LinearImage
    plate: LinearImage
    layer: Layer
    trajectory: Trajectory
    model: ColorModel

    def __repr__(self) -> str:
        return f"Rendering({self.layer!r}, {self.trajectory!r}, {self.model!r})"


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

    Raises
    ------
    ValueError
        If `substeps` < 1.
    """
    if substeps is None:
        substeps = _enough_substeps(scene.trajectory)
    if substeps < 1:
        raise ValueError(f"substeps must be 1 or more, got {substeps}")
    plate = LinearImage(scene.plate.astype(np.float64))
    alpha, premultiplied = np.zeros(plate.rgb.shape[:2]), np.zeros(plate.rgb.shape)
    for center in scene.trajectory.at((np.arange(substeps) + 0.5) / substeps):
        columns, rows = (
            _pixels_near(middle, reach, count)
            for middle, reach, count in zip(center, scene.body.reach, plate.size, strict=True)
        )
        if len(columns) and len(rows):
            here = np.s_[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
            coverage, light = scene.body.sharp(columns - center[0], rows - center[1])
            alpha[here] += coverage
            premultiplied[here] += light
    alpha = np.minimum(alpha / substeps, 1)  # a covered pixel may round to above 1
    layer = Layer(alpha, premultiplied / substeps)
    return Rendering(layer.over(plate), plate, layer, scene.trajectory, scene.body.model)


def _enough_substeps(trajectory: Trajectory) -> int:
    """How many substeps keep the error of α below its bound, whatever the shape.

    At v pixels per exposure the coverage of a pixel is a ramp in time of slope <= v, up and down:
    four kinks. The midpoint rule with n steps misses each by at most v / (8 n²).
    """
    return max(1, int(np.ceil(np.sqrt(trajectory.top_speed / (2 * _ALPHA_ERROR)))))


def _pixels_near(center: float, reach: float, count: int) -> npt.NDArray[np.intp]:
    """Pixels of 0…count−1 along one axis that a body may touch, as consecutive indices."""
    first = max(int(np.ceil(center - reach - 0.5)), 0)
    last = min(int(np.floor(center + reach + 0.5)), count - 1)
    return np.arange(first, last + 1)
