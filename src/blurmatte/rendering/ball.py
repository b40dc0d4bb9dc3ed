"""Ball: a shaded sphere, plain, banded or textured, under one or more lamps."""

from dataclasses import dataclass, field
from functools import cached_property
from typing import ClassVar, NamedTuple

import numpy as np

from blurmatte.checks import Array, check_finite, check_light, check_not_negative, check_positive
from blurmatte.color.model import ColorModel
from blurmatte.rendering.coverage import cell_edges, disc_coverage, polygon_coverage, shade
from blurmatte.rendering.lighting import (
    Lamp,
    check_color,
    check_lighting,
    hex_codes,
    lamp_colors,
    lit,
    spanning,
    true_model,
    unit_direction,
)
from blurmatte.rendering.pose import CameraView, Pose, sphere_outline

_SMOOTH_RADIUS_PX = 24  # from which four points sample the shading of a pixel


class SphereArguments(NamedTuple):
    """Arguments of the compiled shading loop: a posed sphere and its n lamps, in linear light."""

    to_ball: Array  # (2, 2) pixels from the center of the outline → unit disc
    pinhole: bool  # perspective; else the next four are not used
    slope: Array  # (2,) of the ray to the center of the sphere, at depth 1
    offset: Array  # (2,) from the center of the sphere to that of the outline, pixels
    focal: float  # pixels
    size: float  # radius at depth 1
    to_body: Array  # (3, 3) space → body
    toward: Array  # (n, 3) unit directions to the lamps
    halfway: Array  # (n, 3) unit vectors halfway between lamp and camera
    lambert: Array  # (n, 3) light of each lamp on paint that faces it
    phong: Array  # (n, 3) light of each highlight
    ambient: Array  # (3,)
    glossy: bool
    shininess: float
    paints: Array  # (2, 3) outside and inside the band
    axis: Array  # (1, 3) of the band, in space
    band: float
    texture: Array  # (h + 2, w + 2, 3) factors of the paint, with a border; 0 × 0 if there is none


@dataclass(frozen=True, eq=False)
class Ball:
    """A sphere: ambient + Lambert, with a highlight of each lamp if it is glossy.

    Directions are (x, y, z) with x right, y down and z towards the camera, of any length. The paint
    turns with the ball, the lamps do not. A deformation stretches the picture of the ball. A pinhole
    camera sees an ellipse.

    Parameters
    ----------
    radius : float
        Pixels.
    color : (3,) float
        Linear light of the paint under a white lamp at normal incidence; white if not given.
    ambient : float
        Fraction of ambient light, 0…1, of the lamps' mean color; 1 gives a flat disc.
    lamps : tuple of Lamp
        One or more.
    highlight : float
        Peak linear light of the highlight of a white lamp; 0 for a matte ball.
    shininess : float
        Exponent of the highlight (Blinn–Phong): larger values give a smaller, sharper highlight.
    second_color : (3,) float, optional
        Paint of a band around the ball.
    band : float
        Half the width of that band, in radii, 0…1.
    axis : (3,) float
        Pole of that band.
    texture : (h, w, 3) float, optional
        Factors of `color` over the whole ball, instead of a band: rows from the top (−y) down,
        columns once around it, the middle one towards the camera when unposed. Bilinear; details
        finer than a pixel are sampled, not averaged.

    Raises
    ------
    TypeError, ValueError
        For a number outside its range, no lamps, or both a second color and a texture.

    Examples
    --------
    >>> striped = bm.rendering.Ball(16, orange, second_color=np.array([0.1, 0.2, 0.7]), band=0.4)
    >>> scene = bm.rendering.Scene(wall, bm.Trajectory.line((40, 36), (88, 36)), striped)
    >>> picture = bm.rendering.render(scene, 40).image
    """

    perspective: ClassVar[bool] = True  # a pinhole camera can render it, see `Scene.pinhole`

    radius: float
    color: Array = field(default_factory=lambda: np.ones(3))
    ambient: float = 0.35
    lamps: tuple[Lamp, ...] = (Lamp(),)
    highlight: float = 0.0
    shininess: float = 30.0
    second_color: Array | None = None
    band: float = 0.35
    axis: tuple[float, float, float] = (0.3, 1.0, 0.25)
    texture: Array | None = None

    def __post_init__(self) -> None:
        check_positive("radius", self.radius, "pixels")
        check_lighting(self.lamps, self.ambient)
        if not 0 <= self.band <= 1:
            raise ValueError(f"band must lie between 0 and 1, got {self.band}")
        check_not_negative("highlight", self.highlight)
        if not (np.isfinite(self.shininess) and self.shininess >= 1):
            raise ValueError(f"shininess must be 1 or more, got {self.shininess}")
        unit_direction("axis", self.axis)
        self._check_paint()

    def _check_paint(self) -> None:
        object.__setattr__(self, "color", check_color("color", self.color))
        if self.second_color is not None:
            second = check_color("second_color", self.second_color)
            object.__setattr__(self, "second_color", second)
        if self.texture is not None:
            if self.second_color is not None:
                raise ValueError("a ball has a second_color or a texture, got both")
            object.__setattr__(self, "texture", _check_texture(self.texture))

    def __repr__(self) -> str:
        gloss = f", highlight {self.highlight:g}" if self.highlight else ""
        return f"Ball(radius {self.radius:g}, {hex_codes(self.model)}{gloss})"

    @property
    def model(self) -> ColorModel | None:
        """The line or plane of all its colors; None if they span RGB."""
        paints = self._paints
        if self.texture is not None:
            paints = spanning(self.texture) * self.color
        colors = lit(paints, self.lamps, self.ambient)
        if self.highlight:
            colors = np.vstack([colors, self.highlight * lamp_colors(self.lamps)])
        return true_model(colors)

    @cached_property
    def _paints(self) -> Array:
        """(2, 3) paint outside and inside the band."""
        second = self.color if self.second_color is None else self.second_color
        return np.array([self.color, second])

    @cached_property
    def _bordered_texture(self) -> Array:
        """(h + 2, w + 2, 3) the texture with a border that continues it, or 0 × 0 without one."""
        if self.texture is None:
            return np.empty((0, 0, 3))
        around = np.pad(self.texture, [(0, 0), (1, 1), (0, 0)], mode="wrap")
        return np.pad(around, [(1, 1), (0, 0), (0, 0)], mode="edge")

    def reach(self, pose: Pose) -> tuple[float, float]:
        """Extent from the center in x and y, pixels."""
        center, stretch = self._outline(pose)
        x, y = np.abs(center) + self.radius * np.linalg.norm(stretch, axis=1)
        return float(x), float(y)

    def sharp(self, x: Array, y: Array, pose: Pose) -> tuple[Array, Array]:
        """Coverage (h, w) and premultiplied light (h, w, 3) of pixels; see `Body.sharp`."""
        (center_x, center_y), stretch = self._outline(pose)
        cells = 4  # per pixel and axis, for the light; the coverage of each cell is exact
        x_edges, y_edges = cell_edges(x - center_x, cells), cell_edges(y - center_y, cells)
        area = self._coverage(x_edges, y_edges, stretch)
        coverage, light = np.empty((len(y), len(x))), np.zeros((len(y), len(x), 3))
        smooth = self._is_smooth(stretch)
        shade(self._arguments(pose), area, x_edges, y_edges, smooth, coverage, light)
        return coverage, light

    def _outline(self, pose: Pose) -> tuple[Array, Array]:
        """Center (2,) of the outline relative to the ball's, and map (2, 2) from the unposed ball."""
        if pose.view is None:
            return np.zeros(2), pose.stretch
        center, axes = sphere_outline(pose.view, self.radius * pose.stretch[0, 0])
        return center, axes / self.radius

    def _coverage(self, x: Array, y: Array, stretch: Array) -> Array:
        """(h, w) covered area of each cell, of a disc or of an ellipse as a polygon."""
        metric = stretch.T @ stretch
        scale = np.sqrt(metric[0, 0])
        if np.all(np.abs(metric - scale**2 * np.eye(2)) <= 1e-12 * scale**2):
            return disc_coverage(x, y, self.radius * scale)
        # A polygon of a circle's area deviates from it by up to r (π / n)² / 3, at the corners.
        max_deviation = 1e-5  # pixels
        longest = self.radius * np.linalg.norm(stretch, 2)
        n = int(np.ceil(np.pi * np.sqrt(longest / (3 * max_deviation))))
        r = self.radius * np.sqrt(2 * np.pi / n / np.sin(2 * np.pi / n))
        turn = 2 * np.pi * np.arange(n) / n
        return polygon_coverage(x, y, r * np.stack([np.cos(turn), np.sin(turn)], 1) @ stretch.T)

    def _is_smooth(self, stretch: Array) -> bool:
        """True if four points sample the light of a pixel about as well as sixteen.

        The shading, the highlight (which falls to 0.6 within radius / √shininess) and the texture must
        vary slowly on the scale of a pixel.
        """
        if (
            self.second_color is not None
            or self.radius * np.linalg.norm(stretch) < _SMOOTH_RADIUS_PX
        ):
            return False  # no radius is larger than that
        radius = self.radius * np.linalg.norm(stretch, -2)
        highlight = radius / np.sqrt(self.shininess) if self.highlight else np.inf
        texel = np.inf if self.texture is None else np.pi * radius / self.texture.shape[0]
        return bool(radius >= _SMOOTH_RADIUS_PX and highlight >= 4 and texel >= 1)

    def _arguments(self, pose: Pose) -> SphereArguments:
        colors = lamp_colors(self.lamps)
        center, stretch = self._outline(pose)
        view = pose.view or CameraView((0.0, 0.0), np.inf)
        return SphereArguments(
            to_ball=np.asarray(np.linalg.inv(stretch) / self.radius, dtype=float),
            pinhole=pose.view is not None,
            slope=np.array(view.slope),
            offset=center,
            focal=float(view.focal),
            size=self.radius * pose.stretch[0, 0] / view.focal,
            to_body=np.ascontiguousarray(pose.rotation.T),
            toward=np.array([lamp.toward for lamp in self.lamps]),
            halfway=np.array([lamp.halfway for lamp in self.lamps]),
            ambient=self.ambient * colors.mean(axis=0),
            lambert=(1 - self.ambient) * colors,
            phong=self.highlight * colors,
            glossy=self.highlight > 0,
            shininess=float(self.shininess),
            paints=self._paints,
            axis=(pose.rotation @ unit_direction("axis", self.axis))[None],
            band=0.0 if self.second_color is None else float(self.band),
            texture=self._bordered_texture,
        )


def _check_texture(given: Array) -> Array:
    texture = check_light("texture", given)
    check_finite("texture", texture)
    if texture.min() < 0 or not texture.any():
        raise ValueError(f"texture must not be negative nor all 0, its least is {texture.min()}")
    return np.array(texture, dtype=float, order="C")
