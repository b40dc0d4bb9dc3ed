"""Scene: what is photographed, and what moves in it during the exposure."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Protocol

import numpy as np
import numpy.typing as npt

from blurmatte.checks import Floats, check_kind, check_light, check_same_size
from blurmatte.color.model import ColorModel
from blurmatte.layer import Layer
from blurmatte.rendering.ball import Ball
from blurmatte.rendering.nearby import Nearby
from blurmatte.rendering.pinhole import Pinhole
from blurmatte.rendering.pose import Change, Pose
from blurmatte.trajectory import Trajectory

Array = npt.NDArray[np.float64]


class Body(Protocol):
    """Something that can be rendered: `Ball`, `Sheet`, `Cube`, `Sprite`, and whatever has these."""

    @property
    def model(self) -> ColorModel | None:
        """The colors it can show: a line or a plane; None if they fill RGB."""

    def reach(self, pose: Pose) -> tuple[float, float]:
        """How far it extends from its center in x and y, pixels."""

    def sharp(self, x: Array, y: Array, pose: Pose) -> tuple[Array, Array]:
        """Coverage (h, w) and premultiplied light (h, w, 3) of the body held still.

        `x` (w,) and `y` (h,) are neighboring pixel centers, from the center of the body.
        """


@dataclass(frozen=True)
class Shadow:
    """A soft shadow that the body casts on the plate, and that moves with it.

    Parameters
    ----------
    offset : (float, float)
        From the body to its shadow, pixels.
    softness : float
        Standard deviation of its blur, pixels.
    strength : (3,) float
        Part of the plate's light that it takes away at its darkest, 0…1 for each channel: the part
        that came from the lamp.

    Raises
    ------
    ValueError
        For a number outside its range.
    """

    offset: tuple[float, float]
    softness: float = 4.0
    strength: tuple[float, float, float] = (0.5, 0.5, 0.5)

    def __post_init__(self) -> None:
        if np.shape(self.offset) != (2,) or not np.all(np.isfinite(self.offset)):
            raise ValueError(f"offset must be two finite numbers of pixels, got {self.offset}")
        if not (np.isfinite(self.softness) and self.softness >= 0):
            raise ValueError(f"softness must be finite and not negative, got {self.softness}")
        strength = np.asarray(self.strength, dtype=float)
        if strength.shape != (3,) or not np.all((strength >= 0) & (strength <= 1)):
            raise ValueError(f"strength must be three numbers 0…1, got {self.strength}")


@dataclass(frozen=True, eq=False)
class Scene:
    """A body that moves along a trajectory in front of a plate during one exposure.

    Parameters
    ----------
    plate : (H, W, 3) float
        Linear light of the scene without the body, and without what occludes it.
    trajectory : Trajectory
        Path of the body's center, pixels. It may leave the picture.
    body : Ball, Sheet, Cube, Sprite or another Body
        What moves.
    change : Change
        How it turns, grows and is deformed meanwhile.
    opacity : float
        Part of the light from behind that it stops, 0…1, and of its own light that it sends.
    defocus : float
        Radius of the circle of confusion of the body, pixels; the plate is in focus.
    shutter_ramp : float
        Part of the exposure that the shutter takes to open, and again to close, 0…0.5. 0 is a
        shutter that is open or closed.
    shadow : Shadow, optional
        What the body casts on the plate.
    occluder : Layer, optional
        Something still that hides body and plate, such as a `wire_fence`: alpha 0 or 1.
    nearby : Nearby, optional
        Light that the body takes from the plate near it, and gives to it.
    pinhole : Pinhole, optional
        A camera that is near: a Ball off its axis is seen as an ellipse, from the side. Without it the
        camera is far away.
    pixel_filter : float
        Width in pixels of the Blackman-Harris window that body and shadow are seen through; 0 for the
        box of one pixel. The plate is given as its own filter left it.

    Raises
    ------
    TypeError, ValueError
        If the plate is not finite linear light, the trajectory is not a Trajectory, a number is
        outside its range, the occluder is half transparent or of another size, or a pinhole camera
        sees anything but a ball without squash that stays in front of it.
    """

    plate: Floats
    trajectory: Trajectory
    body: Body
    change: Change = field(default_factory=Change)
    opacity: float = 1.0
    defocus: float = 0.0
    shutter_ramp: float = 0.0
    shadow: Shadow | None = None
    occluder: Layer | None = None
    nearby: Nearby | None = None
    pinhole: Pinhole | None = None
    pixel_filter: float = 0.0

    def __post_init__(self) -> None:
        check_light("plate", self.plate)
        if not np.all(np.isfinite(self.plate)):
            raise ValueError("plate must be finite")
        if not isinstance(self.trajectory, Trajectory):
            raise TypeError(
                f"trajectory must be a Trajectory, got {type(self.trajectory).__name__}"
            )
        if not 0 < self.opacity <= 1:
            raise ValueError(f"opacity must be above 0 and at most 1, got {self.opacity}")
        for name in ("defocus", "pixel_filter"):
            value = getattr(self, name)
            if not (np.isfinite(value) and value >= 0):
                raise ValueError(f"{name} must be finite and not negative, got {value}")
        if not 0 <= self.shutter_ramp <= 0.5:
            raise ValueError(f"shutter_ramp must lie between 0 and 0.5, got {self.shutter_ramp}")
        if self.occluder is not None:
            check_same_size("occluder", self.occluder.size, "the plate", self.size)
            if not np.isin(self.occluder.alpha, (0, 1)).all():
                raise ValueError("the alpha of an occluder must be 0 or 1 in every pixel")
        if self.pinhole is not None:
            self._check_pinhole(self.pinhole)

    def _check_pinhole(self, pinhole: Pinhole) -> None:
        if not isinstance(self.body, Ball):
            raise TypeError(f"a pinhole camera sees a Ball, got {type(self.body).__name__}")
        if self.change.squash != (1, 1):
            raise ValueError(f"a pinhole camera sees no squash, got {list(self.change.squash)}")
        radius = max(max(self.body.reach(self.change.at(t))) for t in (0, 1))
        if radius >= pinhole.focal:
            raise ValueError(
                f"focal must be larger than the ball's radius, {radius:g} pixels at most, got "
                f"{pinhole.focal:g}: the ball would reach the camera"
            )

    def __repr__(self) -> str:
        width, height = self.size
        return f"Scene({width}x{height}, {self.body!r}, {self.trajectory!r})"

    @property
    def size(self) -> tuple[int, int]:
        """(width, height) in pixels."""
        height, width = self.plate.shape[:2]
        return width, height

    def pose(self, t: float) -> Pose:
        """How the camera sees the body at exposure fraction `t`."""
        pose = self.change.at(t)
        if self.pinhole is None:
            return pose
        return replace(pose, view=self.pinhole.view(self.trajectory.at(t), self.size))

    def part(self, start: float, end: float) -> Scene:
        """The scene from one exposure fraction to another, as an exposure of its own."""
        trajectory, change = self.trajectory.part(start, end), self.change.part(start, end)
        return replace(self, trajectory=trajectory, change=change)

    def exposures(self, count: int, duty: float) -> list[Scene]:
        """The frames of a clip of this scene.

        Parameters
        ----------
        count : int
            How many frames share the time from 0 to 1 equally.
        duty : float
            Part of each frame's time that the shutter is open, 0…1; the rest is a gap that no frame
            sees.

        Raises
        ------
        ValueError
            If `count` < 1 or `duty` is outside (0, 1].
        """
        if count < 1:
            raise ValueError(f"count must be 1 or more, got {count}")
        if not 0 < duty <= 1:
            raise ValueError(f"duty must be above 0 and at most 1, got {duty}")
        return [self.part(n / count, min((n + duty) / count, 1)) for n in range(count)]


def check_scene(name: str, value: object) -> None:
    """Raise TypeError unless it is a Scene."""
    check_kind(name, value, Scene, "use blurmatte.read_shots(file)[0].scene")
