"""Scene: a body moving in front of a plate during one exposure, and what it does to the plate."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Protocol

import numpy as np

from blurmatte.checks import (
    Array,
    Floats,
    check_kind,
    check_light,
    check_not_negative,
    check_positive,
    check_same_size,
)
from blurmatte.color.model import ColorModel
from blurmatte.layer import Layer
from blurmatte.rendering.pose import Change, Pinhole, Pose
from blurmatte.trajectory import Trajectory


class Body(Protocol):
    """Something that can be rendered: `Ball`, `Sheet`, `Cube`, `Sprite`, or any class with these.

    A body with a true attribute `perspective` can be seen by a pinhole camera.
    """

    @property
    def model(self) -> ColorModel | None:
        """The line or plane of all its colors; None if they span RGB."""

    def reach(self, pose: Pose) -> tuple[float, float]:
        """Extent from the center in x and y, pixels."""

    def sharp(self, x: Array, y: Array, pose: Pose) -> tuple[Array, Array]:
        """Coverage (h, w) and premultiplied light (h, w, 3) of pixels at one moment.

        `x` (w,) and `y` (h,) are consecutive pixel centers relative to the center of the body.
        """


@dataclass(frozen=True)
class Shadow:
    """A soft shadow that the body casts on the plate and that moves with it.

    Parameters
    ----------
    offset : (float, float)
        From the body to its shadow, pixels.
    softness : float
        Standard deviation of its blur, pixels.
    strength : (3,) float
        Fraction of the plate's light that it removes where it is darkest, 0…1 for each channel: the
        fraction that comes from the lamp.

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
        check_not_negative("softness", self.softness)
        strength = np.asarray(self.strength, dtype=float)
        if strength.shape != (3,) or not np.all((strength >= 0) & (strength <= 1)):
            raise ValueError(f"strength must be three numbers 0…1, got {self.strength}")


@dataclass(frozen=True)
class Nearby:
    """A soft contact shadow and light that the body reflects to the plate; both move with it.

    A sphere at distance h from a wall occludes a part of the ambient light at a point of the wall that
    is proportional to h / (h² + d²)^(3/2), where d is the distance of the point from the sphere's
    foot. The light that it reflects there has the same profile. Relative to the foot this is

        g(d) = (1 + d² / h²)^(-3/2).

    Parameters
    ----------
    occlusion : float
        Fraction of the plate's light that the body removes at its foot, 0…1.
    bounce : float
        Fraction that it adds there in a channel in which the body's mean color is 1, 0…1.
    reach : float
        Distance h of the body from the plate in radii of the body, above 0. The effect falls to a
        third at a distance of 1.04 h.

    Raises
    ------
    ValueError
        For a number outside its range.
    """

    occlusion: float = 0.02
    bounce: float = 0.005
    reach: float = 2.0

    def __post_init__(self) -> None:
        for name in ("occlusion", "bounce"):
            if not 0 <= getattr(self, name) <= 1:
                raise ValueError(f"{name} must lie between 0 and 1, got {getattr(self, name)}")
        check_positive("reach", self.reach, "radii")

    def taken(self, color: Array) -> Array:
        """(3,) fraction of the plate's light that a body of mean `color` removes at its foot."""
        return np.asarray(self.occlusion - self.bounce * color)


@dataclass(frozen=True, eq=False)
class Scene:
    """A body that moves along a trajectory in front of a plate during one exposure.

    Parameters
    ----------
    plate : (H, W, 3) float
        Linear light of the scene without the body and the occluder.
    trajectory : Trajectory
        Path of the body's center, pixels. It may leave the picture.
    body : Ball, Sheet, Cube, Sprite or another Body
        The moving object.
    change : Change
        Its rotation, growth and deformation during the exposure.
    opacity : float
        Factor of alpha and of premultiplied light, above 0 and at most 1.
    defocus : float
        Radius of the circle of confusion of the body, pixels; the plate is in focus.
    shutter_ramp : float
        Fraction of the exposure that the shutter takes to open, and again to close, 0…0.5. 0 is an
        ideal shutter.
    shadow : Shadow, optional
        Shadow of the body on the plate.
    occluder : Layer, optional
        Something static in front of body and plate, such as a `wire_fence`: alpha 0 or 1.
    nearby : Nearby, optional
        Light that the body removes from the plate near it, and adds to it.
    pinhole : Pinhole, optional
        Camera with perspective: it sees a Ball off its axis as an ellipse. Without it the camera is far
        away.
    pixel_filter : float
        Width in pixels of the Blackman-Harris window through which body and shadow are seen; 0 for the
        box of one pixel. The plate is taken as already filtered.

    Raises
    ------
    TypeError, ValueError
        If the plate is not finite linear light, the trajectory is not a Trajectory, a number is
        outside its range, the occluder is semitransparent or of another size, or the scene of a pinhole
        camera is anything but a ball without squash that stays in front of the camera.

    Examples
    --------
    >>> over = bm.Trajectory.arc((20, 50), (64, 15), (108, 50))
    >>> scene = bm.rendering.Scene(wall, over, bm.rendering.Ball(8, orange))
    >>> scene.size
    (128, 72)
    >>> picture = bm.rendering.render(scene, 100).image
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
        object.__setattr__(self, "plate", check_light("plate", self.plate))
        if not np.all(np.isfinite(self.plate)):
            raise ValueError("plate must be finite")
        hint = "use blurmatte.Trajectory.line(start, end)"
        check_kind("trajectory", self.trajectory, Trajectory, hint)
        if not 0 < self.opacity <= 1:
            raise ValueError(f"opacity must be above 0 and at most 1, got {self.opacity}")
        for name in ("defocus", "pixel_filter"):
            check_not_negative(name, getattr(self, name))
        if not 0 <= self.shutter_ramp <= 0.5:
            raise ValueError(f"shutter_ramp must lie between 0 and 0.5, got {self.shutter_ramp}")
        if self.occluder is not None:
            check_same_size("occluder", self.occluder.size, "the plate", self.size)
            if not np.isin(self.occluder.alpha, (0, 1)).all():
                raise ValueError("the alpha of an occluder must be 0 or 1 in every pixel")
        if self.pinhole is not None:
            self._check_pinhole(self.pinhole)

    def _check_pinhole(self, pinhole: Pinhole) -> None:
        if not getattr(self.body, "perspective", False):
            raise TypeError(f"a pinhole camera sees a Ball, got {type(self.body).__name__}")
        if any(factor != 1 for factor in self.change.squash):
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
        """Pose of the body at exposure fraction `t`, as the camera sees it."""
        pose = self.change.at(t)
        if self.pinhole is None:
            return pose
        return replace(pose, view=self.pinhole.view(self.trajectory.at(t), self.size))

    def part(self, start: float, end: float) -> Scene:
        """The scene from one exposure fraction to another, as a shorter exposure."""
        trajectory, change = self.trajectory.part(start, end), self.change.part(start, end)
        return replace(self, trajectory=trajectory, change=change)

    def exposures(self, count: int, duty: float) -> list[Scene]:
        """The frames of a clip of this scene.

        Parameters
        ----------
        count : int
            Number of frames that share the time from 0 to 1 equally.
        duty : float
            Fraction of each frame's time during which the shutter is open, above 0 and at most 1.

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
    check_kind(name, value, Scene, "use blurmatte.scenes.read_shots(file)[0].scene")
