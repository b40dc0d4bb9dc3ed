"""Ball: a shaded sphere, plain, banded or painted all over, under one or more lamps."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from blurmatte.checks import check_finite, check_light
from blurmatte.color.model import ColorModel
from blurmatte.rendering.coverage import cell_edges, disc_coverage, polygon_coverage
from blurmatte.rendering.lamp import Lamp, check_lighting, lamp_colors, lit, unit_direction
from blurmatte.rendering.paint import check_color, spanning, true_model
from blurmatte.rendering.pinhole import sphere_outline
from blurmatte.rendering.pose import Pose, View

if TYPE_CHECKING:
    from blurmatte.rendering.kernel import Sphere

Array = npt.NDArray[np.float64]

_CELLS = 4  # points across a pixel where light is sampled; coverage is exact, by cells
_RIM_ERROR = 1e-5  # how far the polygon that stands for an ellipse may leave it, pixels
_NO_TEXTURE = np.empty((0, 0, 3))
_FROM_FAR_AWAY = View((0.0, 0.0), np.inf)

# What is so large, in pixels, that four points within a pixel are about as good as sixteen.
_SMOOTH_RADIUS = 24.0
_SMOOTH_HIGHLIGHT = 4.0  # radius / √shininess: where a highlight has fallen to 0.6
_SMOOTH_TEXEL = 1.0


@dataclass(frozen=True, eq=False)
class Ball:
    """A sphere: ambient + Lambert, and a highlight of each lamp if it is glossy.

    Directions are (x, y, z) with x right, y down and z towards the camera, of any length. The paint
    turns with the ball, the lamps stay. Deformed, it looks like its picture drawn out. A pinhole camera
    sees it as an ellipse.

    Parameters
    ----------
    radius : float
        Pixels.
    color : (3,) float
        Linear light of the paint where a white lamp shines on it squarely; white if not given.
    ambient : float
        Part of the light that comes from everywhere, 0…1, of the lamps' mean color; 1 shows a flat
        disc.
    lamps : tuple of Lamp
        One or more.
    highlight : float
        Linear light of the highlight of a white lamp at its brightest; 0 for a dull ball.
    shininess : float
        Exponent of the highlight (Blinn–Phong): larger is smaller and sharper.
    second_color : (3,) float, optional
        Paint of a band around the ball.
    band : float
        Half the width of that band, in radii, 0…1.
    axis : (3,) float
        Pole of that band.
    texture : (h, w, 3) float, optional
        What `color` is multiplied by, all over the ball instead of a band: rows from the top (−y)
        down, columns once around it, the middle one towards the camera at rest. Bilinear; details
        finer than a pixel are sampled, not averaged.

    Raises
    ------
    TypeError, ValueError
        For a number outside its range, no lamps, or both a second color and a texture.
    """

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
        if not (np.isfinite(self.radius) and self.radius > 0):
            raise ValueError(f"radius must be a positive number of pixels, got {self.radius}")
        check_lighting(self.lamps, self.ambient)
        if not 0 <= self.band <= 1:
            raise ValueError(f"band must lie between 0 and 1, got {self.band}")
        if not (np.isfinite(self.highlight) and self.highlight >= 0):
            raise ValueError(f"highlight must be finite and not negative, got {self.highlight}")
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
        model = self.model
        colors = "all colors" if model is None else " + ".join(model.hex)
        gloss = f", highlight {self.highlight:g}" if self.highlight else ""
        return f"Ball(radius {self.radius:g}, {colors}{gloss})"

    @property
    def model(self) -> ColorModel | None:
        """The line or plane of all that it can show; None if that fills RGB."""
        paints = self._paints
        if self.texture is not None:
            paints = spanning(self.texture) * self.color
        colors = lit(paints, self.lamps, self.ambient)
        if self.highlight:
            colors = np.vstack([colors, self.highlight * lamp_colors(self.lamps)])
        return true_model(colors)

    @property
    def _paints(self) -> Array:
        """(2, 3) outside the band and within it."""
        second = self.color if self.second_color is None else self.second_color
        return np.array([self.color, second])

    def reach(self, pose: Pose) -> tuple[float, float]:
        """How far it extends from its center in x and y, pixels."""
        center, stretch = self._outline(pose)
        x, y = np.abs(center) + self.radius * np.linalg.norm(stretch, axis=1)
        return float(x), float(y)

    def sharp(self, x: Array, y: Array, pose: Pose) -> tuple[Array, Array]:
        """Coverage (h, w) and premultiplied light (h, w, 3) of pixels, at one moment.

        `x` (w,) and `y` (h,) are neighboring pixel centers, from the center of the ball.
        """
        from blurmatte.rendering import kernel  # numba takes half a second to import

        (center_x, center_y), stretch = self._outline(pose)
        x_edges, y_edges = cell_edges(x - center_x, _CELLS), cell_edges(y - center_y, _CELLS)
        area = self._coverage(x_edges, y_edges, stretch)
        coverage, light = np.empty((len(y), len(x))), np.zeros((len(y), len(x), 3))
        smooth = self._is_smooth(stretch)
        kernel.shade(self._sphere(pose), area, x_edges, y_edges, smooth, coverage, light)
        return coverage, light

    def _outline(self, pose: Pose) -> tuple[Array, Array]:
        """Center (2,) of the outline, from that of the ball, and map (2, 2) from the ball at rest."""
        if pose.view is None:
            return np.zeros(2), pose.stretch
        center, axes = sphere_outline(pose.view, self.radius * pose.stretch[0, 0])
        return center, axes / self.radius

    def _coverage(self, x: Array, y: Array, stretch: Array) -> Array:
        """(h, w) area of each cell that the ball covers: a disc, or an ellipse drawn as polygon."""
        metric = stretch.T @ stretch
        scale = np.sqrt(metric[0, 0])
        if np.allclose(metric, scale**2 * np.eye(2), rtol=0, atol=1e-12 * scale**2):
            return disc_coverage(x, y, self.radius * scale)
        # A polygon of a circle's area leaves it by up to r (π / n)² / 3, at the corners.
        longest = self.radius * np.linalg.norm(stretch, 2)
        n = int(np.ceil(np.pi * np.sqrt(longest / (3 * _RIM_ERROR))))
        r = self.radius * np.sqrt(2 * np.pi / n / np.sin(2 * np.pi / n))
        turn = 2 * np.pi * np.arange(n) / n
        return polygon_coverage(x, y, r * np.stack([np.cos(turn), np.sin(turn)], 1) @ stretch.T)

    def _is_smooth(self, stretch: Array) -> bool:
        """Whether four points are enough to tell the light of a pixel: nothing in it is sharp."""
        radius = self.radius * np.linalg.norm(stretch, -2)  # where it is smallest
        highlight = radius / np.sqrt(self.shininess) if self.highlight else np.inf
        texel = np.inf if self.texture is None else np.pi * radius / self.texture.shape[0]
        return bool(
            radius >= _SMOOTH_RADIUS
            and highlight >= _SMOOTH_HIGHLIGHT
            and texel >= _SMOOTH_TEXEL
            and self.second_color is None
        )

    def _sphere(self, pose: Pose) -> Sphere:
        """What the compiled loop wants to know."""
        from blurmatte.rendering.kernel import Sphere

        colors = lamp_colors(self.lamps)
        center, stretch = self._outline(pose)
        view = pose.view or _FROM_FAR_AWAY
        return Sphere(
            to_ball=np.linalg.inv(stretch) / self.radius,
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
            texture=_NO_TEXTURE if self.texture is None else self.texture,
        )


def _check_texture(texture: Array) -> Array:
    check_light("texture", texture)
    check_finite("texture", texture)
    if texture.min() < 0 or not texture.any():
        raise ValueError(f"texture must not be negative nor all 0, its least is {texture.min()}")
    return np.array(texture, dtype=float, order="C")
