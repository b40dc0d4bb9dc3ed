"""Sweep: path, silhouette and color of a streak, found together."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from blurmatte.color.model import ColorModel
from blurmatte.radiometry import LinearImage
from blurmatte.sweep.cast import CastShadow
from blurmatte.sweep.chroma import Blur, File, file_of, image_before
from blurmatte.sweep.data import nothing_in
from blurmatte.sweep.path import PathFamily
from blurmatte.sweep.silhouette import Silhouette, Swept
from blurmatte.trajectory import Trajectory

Array = npt.NDArray[np.float64]

_POINTS = 129


@dataclass(frozen=True, eq=False)
class Sweep:
    """A shape that went along a path during the exposure.

    Parameters
    ----------
    family : PathFamily
        Of what kind the path is.
    path : (n,) float
        Its parameters, pixels.
    silhouette : Silhouette
        Of what kind the shape is.
    shape : (m,) float
        Its parameters; the first is a radius in pixels.
    model : ColorModel
        Its colors, a line or a plane.
    covariance : (n + m, n + m) float
        Of the parameters of path and shape, that of the color included.
    size : (int, int)
        (width, height) of the picture.
    stats : mapping
        How the fit went: `misfit` is how much more the residuals within the streak hang together
        than those beside it, 1 if the sweep explains all there is; `objection` why it is none whatever
        it leaves, in words, and then `misfit` is infinite, or empty; `contested` whether another
        explains it as well with quite another alpha, and then `misfit` is infinite; `doubtful` is the
        share of the streak's pixels that it does not explain; `astray` by which part of alpha light
        that changes little from place to place would have it otherwise, 0 if the color was known;
        `unsure` the same unless it may have any colors, and what another answer that explains it as
        well says of alpha: errors have that part too;
        `plausible` whether it can be, and explains most; `texture`, if it may have any colors, to
        which part of alpha the plate's texture confirms it, else infinite; where that does nearly
        everywhere `misfit` is 1, however fine its paint is; `changes` by which part of its size its
        shape seems to change while it goes, 0 if that explains no more than it costs; `rim` the
        standard deviation, pixels, by which its rim, or the color of it, is blurred, 0 if not. If the
        file did that, alpha is sharp;
        `highlight`, if one was told with it, its `offset` from the center and its `softness`, the
        standard deviation of a spot, in pixels, and the `paint` that it is on, as sRGB, else None;
        `louder` how many times the variance that was measured noise has there, for codecs hide it in
        what stands still.
    cast : CastShadow, optional
        The shadow that it cast on the plate, if that was told with it.
    """

    family: PathFamily
    path: Array
    silhouette: Silhouette
    shape: Array
    model: ColorModel
    covariance: Array
    size: tuple[int, int]
    stats: Mapping[str, Any] = field(default_factory=dict)
    cast: CastShadow | None = None

    def __repr__(self) -> str:
        return (
            f"Sweep({self.silhouette.name} on a {self.family.name}, {self.length:.1f} px long, "
            f"radius {self.radius:.2f} ± {self.radius_std:.2f} px, {' + '.join(self.model.hex)})"
        )

    @property
    def misfit(self) -> float:
        """How much more than noise is left within the streak; infinite for what cannot be."""
        return float(self.stats["misfit"])

    def complaint(self, max_misfit: float) -> str:
        """What speaks against it, if its misfit is more than that."""
        if self.stats.get("contested", False):
            return (
                "two shapes, each gone its own way and with an alpha of its own, explain the streak "
                "alike"
            )
        if np.isinf(self.misfit):
            return f"the best {self.stats.get('objection') or 'is hardly known'}"
        return (
            f"the best leaves {self.misfit:.1f} times as much as noise, {max_misfit:g} is the most"
        )

    @property
    def trajectory(self) -> Trajectory:
        """Where the center was. The direction of time is not known."""
        t = np.linspace(0, 1, _POINTS)
        return Trajectory(self.family.at(self.path, t)[0], t)

    @property
    def length(self) -> float:
        """Length of the path, pixels."""
        return self.trajectory.length

    @property
    def radius(self) -> float:
        """Radius of the shape, or of the disc of the same area, pixels."""
        return self.silhouette.radius(self.shape)

    @property
    def softness(self) -> float:
        """Standard deviation by which the lens blurred the rim, pixels; 0 if it is sharp."""
        return self.silhouette.softness(self.shape)

    @property
    def radius_std(self) -> float:
        """Standard deviation of the radius, pixels."""
        step = 1e-5 * self.shape[0]
        radius, m = self.silhouette.radius, len(self.shape)
        slope = [
            (radius(self.shape + d) - radius(self.shape - d)) / (2 * step) for d in step * np.eye(m)
        ]
        return float(np.sqrt(slope @ self.covariance[-m:, -m:] @ slope))

    @property
    def outline(self) -> Array:
        """(129, 2) points once around the shape, seen from its center; the last is the first."""
        points = self.silhouette.outline(self.shape, _POINTS - 1)
        return np.concatenate([points, points[:1]])

    def outline_at(self, t: float) -> Array:
        """(129, 2) points once around the object in the picture at exposure fraction t, pixels."""
        angle = self.silhouette.turn(self.shape) * (t - 0.5)
        turned = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
        return np.asarray(self.outline @ turned.T + self.family.at(self.path, np.array([t]))[0])

    @property
    def alpha(self) -> Array:
        """(H, W) fraction of the exposure."""
        return self.within((0, 0, *self.size))[0]

    @property
    def alpha_std(self) -> Array:
        """(H, W) standard deviation of alpha, neighbors much alike."""
        return self.within((0, 0, *self.size))[1]

    @property
    def box(self) -> tuple[int, int, int, int]:
        """(x0, y0, x1, y1) of the pixels that it may touch, in the picture."""
        xy, reach = self.trajectory.xy, self.silhouette.reach(self.shape) + 1
        x0, y0 = np.maximum(np.floor(xy.min(axis=0) - reach), 0).astype(int)
        x1, y1 = np.minimum(np.ceil(xy.max(axis=0) + reach) + 1, self.size).astype(int)
        return int(x0), int(y0), max(int(x1), int(x0)), max(int(y1), int(y0))

    def within(self, box: tuple[int, int, int, int]) -> tuple[Array, Array]:
        """Alpha and its standard deviation (h, w) in a box (x0, y0, x1, y1) of pixels.

        The bulges that an outline cannot have are taken to be as large as the last that it has.
        """
        swept = self._swept(box, self.shape)
        J = swept.by_parameters
        variance = np.einsum("hwi,ij,hwj->hw", J, self.covariance, J)
        left_out = self.silhouette.left_out(self.shape)
        if left_out > 0:
            wider = np.concatenate([[self.shape[0] + left_out], self.shape[1:]])
            variance += (self._swept(box, wider).alpha - swept.alpha) ** 2
        variance += (self.stats.get("unsure", 0.0) * swept.alpha) ** 2
        return swept.alpha, np.sqrt(variance)

    def before_bleeding(
        self, image: LinearImage, plate: LinearImage, box: tuple[int, int, int, int]
    ) -> LinearImage:
        """What is in a box of the image, as it was before its file let colors run together.

        The image itself if its file did not, or if the object may have any colors.

        Parameters
        ----------
        image, plate : LinearImage
            What is in the box (x0, y0, x1, y1).
        """
        file = self._file(image)
        if file is None or self.model.rank == 3:
            return image
        return image_before(image, plate, self.within(box)[0], self.model.basis, file)

    def runs_by(self, image: LinearImage) -> float:
        """Pixels by which the image's file let colors run, a standard deviation; 0 if it did not."""
        file = self._file(image)
        return 0.0 if file is None else file.std

    def _file(self, image: LinearImage) -> File | None:
        """What became of the image's code values."""
        told, blur = file_of(image), self.stats["rim"]
        return told or (None if blur == 0 or self.silhouette.soft else Blur(blur))

    def in_shadow(self, plate: LinearImage, box: tuple[int, int, int, int]) -> LinearImage:
        """What is in a box of the plate, in the shadow that the object casts on it; itself without.

        Parameters
        ----------
        plate : LinearImage
            What is in the box (x0, y0, x1, y1).
        """
        if self.cast is None:
            return plate
        S = self.cast.missing(self.family, self.path, self.shape[0], nothing_in(box, self.size))
        shaded = self.cast.on(np.asarray(plate.rgb, float), S, self.within(box)[0])
        return replace(plate.with_noise(plate.variance), rgb=shaded.astype(plate.rgb.dtype))

    def area_std(self) -> float:
        """Standard deviation of the sum of alpha within the picture, pixels."""
        total = self._swept(self.box, self.shape).by_parameters.sum(axis=(0, 1))
        return float(np.sqrt(total @ self.covariance @ total))

    def _swept(self, box: tuple[int, int, int, int], shape: Array) -> Swept:
        return self.silhouette.sweep(self.family, self.path, shape, nothing_in(box, self.size))
