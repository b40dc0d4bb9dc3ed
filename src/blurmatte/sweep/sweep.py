"""Sweep: path, silhouette and color of a streak, found together."""

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from blurmatte.checks import Array, enclosing, rows_columns
from blurmatte.color.model import ColorModel
from blurmatte.radiometry import LinearImage
from blurmatte.statistics import relative_difference
from blurmatte.sweep.model.cast_shadow import CastShadow
from blurmatte.sweep.model.chroma_subsampling import ChromaBlur, File, file_of, image_before
from blurmatte.sweep.model.path import PathFamily, path_spread
from blurmatte.sweep.model.pixels import Pixels
from blurmatte.sweep.model.shape import FlatShape, SweptAlpha
from blurmatte.trajectory import PointSpread, Trajectory

MAX_RESIDUAL_EXCESS = 1.2  # of a sweep that explains its streak; 1 for noise alone
_MAX_RADIUS_ERROR = 0.25  # standard deviation of the radius, of the radius


@dataclass(frozen=True)
class Diagnostics:
    """Evidence for and against a fitted sweep; the defaults are those of a correct model.

    Parameters
    ----------
    rejection : str
        Reason why it is physically impossible, to follow "the fit"; empty if it is possible.
    converged : bool
        The fit ended within its bounds.
    residual_excess : float
        Correlation of residuals over 4 and 8 pixels within the sweep, over that outside; 1 if right.
    outlier_fraction : float
        Fraction of pixels beyond the 99.9 % quantile of noise; 0.001 if right.
    variance_inflation : float
        Variance of block sums of residuals over that of independent pixels; 1 if right.
    noise_inflation : float
        Variance of the noise that the fit needs over the one that was measured; 1 if right.
    radius_error : float
        Standard deviation of the radius, of the radius.
    color_spread : float
        Spread of color across the mean color, radians.
    color_angle_std : float
        Standard deviation of the color's direction, degrees.
    blur_over_radius : float
        Standard deviation of the rim's blur, of the radius.
    signal_to_noise : float
        Change of a pixel in the sweep over its noise, root mean square.
    effective_pixels : float
        Number of pixels in the sweep over the variance inflation.
    chroma_blur : float
        Standard deviation by which the file blurred colors, pixels; 0 if it did not.
    even_opacity_std : float
        Standard deviation of the opacity if letting light through is as usual as being solid.
    prior_probability : float
        That a frame which agrees with its clip differs from the prior by as much; 1 without a prior.
    """

    rejection: str = ""
    converged: bool = True
    residual_excess: float = 1.0
    outlier_fraction: float = 0.0
    variance_inflation: float = 1.0
    noise_inflation: float = 1.0
    radius_error: float = 0.0
    color_spread: float = 0.0
    color_angle_std: float = 0.0
    blur_over_radius: float = 0.0
    signal_to_noise: float = 0.0
    effective_pixels: float = 0.0
    chroma_blur: float = 0.0
    even_opacity_std: float = 0.0
    prior_probability: float = 1.0


@dataclass(frozen=True, eq=False)
class Sweep:
    """A shape that moved along a path during the exposure.

    Parameters
    ----------
    family : PathFamily
        Kind of the path.
    path : (n,) float
        Its parameters, pixels.
    silhouette : FlatShape
        Kind of the shape.
    shape : (m,) float
        Its parameters; the first is a radius in pixels.
    model : ColorModel
        Its colors, a line or a plane.
    covariance : (n + m, n + m) float
        Of the parameters of path and shape, that of the color included.
    size : (int, int)
        (width, height) of the picture.
    diagnostics : Diagnostics
        Evidence for and against it.
    cast : CastShadow, optional
        The shadow that it cast on the plate, if one was fitted.
    opacity_std : float
        Standard deviation of the opacity of the silhouette: the part of the light behind it that it
        hides.
    assumed_covariance : (n + m, n + m) float, optional
        Of the same parameters by what was assumed: a transfer curve that is not stated, and in gray
        pictures the blur of the rim. None if nothing was, or if it is part of `covariance`.

    Examples
    --------
    >>> print(sweep)
    Sweep(disc on a line, 59.6 px long, radius 10.01 ± 0.02 px, #ffc046, rank 1)
    >>> sweep.trajectory.at(0.5).round(1)
    array([59., 37.])
    >>> print(f"{sweep.radius:.2f} ± {sweep.radius_std:.2f} pixels")
    10.01 ± 0.02 pixels
    >>> sweep.alpha.shape
    (72, 128)
    """

    family: PathFamily
    path: Array
    silhouette: FlatShape
    shape: Array
    model: ColorModel
    covariance: Array
    size: tuple[int, int]
    diagnostics: Diagnostics = field(default_factory=Diagnostics)
    cast: CastShadow | None = None
    opacity_std: float = 0.0
    assumed_covariance: Array | None = None

    def __repr__(self) -> str:
        article = "an" if self.family.name[0] in "aeiou" else "a"
        return (
            f"Sweep({self.silhouette.name} on {article} {self.family.name}, {self.length:.1f} px long, "
            f"radius {self.radius:.2f} ± {self.radius_std:.2f} px, {self.model.in_words})"
        )

    @property
    def in_words(self) -> str:
        """Shape and path, such as "disc with its shadow on a parabola"."""
        shadow = " with its shadow" if self.cast is not None else ""
        return f"{self.silhouette.name}{shadow} on {self.family.in_words}"

    @property
    def rejection(self) -> str:
        """Reason why it does not explain the streak, to follow "the fit"; empty if it does."""
        d = self.diagnostics
        if d.rejection:
            return d.rejection
        if not d.converged:
            return "did not converge"
        if d.radius_error > _MAX_RADIUS_ERROR:
            return f"determines the radius only to {d.radius_error:.0%}"
        if d.residual_excess > MAX_RESIDUAL_EXCESS:
            return (
                f"leaves residuals {d.residual_excess:.3g} times as correlated as noise, at most "
                f"{MAX_RESIDUAL_EXCESS:g} are allowed"
            )
        return ""

    @property
    def trajectory(self) -> Trajectory:
        """Positions of the center. The direction of time is unknown."""
        t = np.linspace(0, 1, 129)
        return Trajectory(self.family.at(self.path, t)[0], t)

    @property
    def length(self) -> float:
        """Length of the path, pixels."""
        return self.trajectory.length

    @property
    def radius(self) -> float:
        """Radius of the disc of the shape's area, in the middle of the exposure, pixels."""
        return self.silhouette.radius(self.shape)

    @property
    def softness(self) -> float:
        """Standard deviation by which the lens blurred the rim, pixels; 0 if it is sharp."""
        return self.silhouette.softness(self.shape)

    @property
    def radius_std(self) -> float:
        """Standard deviation of the radius, pixels."""
        slope, m = self.silhouette.radius_slope(self.shape), len(self.shape)
        return float(np.sqrt(slope @ self.covariance[-m:, -m:] @ slope))

    @property
    def outline(self) -> Array:
        """(129, 2) closed outline in the middle of the exposure, pixels from the center."""
        points = self.silhouette.outline(self.shape, count=128)
        return np.concatenate([points, points[:1]])

    def outline_at(self, t: float) -> Array:
        """(129, 2) closed outline in the picture at exposure fraction t, pixels."""
        when = np.array([t], float)
        (linear,), (center,) = (
            self.silhouette.map_at(self.shape, when),
            self.family.at(self.path, when)[0],
        )
        return np.asarray(self.outline @ linear.T + center)

    def outline_std(self, t: float) -> Array:
        """(129,) standard deviation of `outline_at` across the rim, pixels.

        The error of each parameter moves the rim along its normal; the omitted orders of an outline
        count as one of the size of its last order.
        """
        points = self.outline_at(t)
        following = np.roll(points[:-1], -1, axis=0)
        along = following - np.roll(points[:-1], 1, axis=0)
        at_tip = ~along.any(axis=1)  # of a thin part, which the outline leaves as it came
        along[at_tip] = (following - points[:-1])[at_tip]
        normal = np.stack([along[:, 1], -along[:, 0]], axis=1)
        normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-9)
        std, J = np.sqrt(np.diag(self.covariance)), np.zeros((128, len(self.covariance)))
        values, n = np.concatenate([self.path, self.shape]), len(self.path)
        for k in np.flatnonzero(std > 0):
            moved = values.copy()
            moved[k] += std[k]
            other = replace(self, path=moved[:n], shape=moved[n:]).outline_at(t)
            J[:, k] = ((other - points)[:-1] * normal).sum(axis=1) / std[k]
        variance = np.einsum("pk,kl,pl->p", J, self.covariance, J)
        rim = np.sqrt(np.maximum(variance, 0) + self.silhouette.left_out(self.shape) ** 2)
        return np.concatenate([rim, rim[:1]])

    def psf(self) -> PointSpread:
        """The point spread function: the time that the center spends in each pixel."""
        xy = self.trajectory.xy
        (x0, y0), (x1, y1) = np.floor(xy.min(axis=0) - 2), np.ceil(xy.max(axis=0) + 3)
        pixels = Pixels.of_box((int(x0), int(y0), int(x1), int(y1)))
        n = len(self.path)
        covariance = self.covariance[:n, :n]
        std, J = np.sqrt(np.diag(covariance)), np.zeros((*pixels.shape, n))
        for k in np.flatnonzero(std > 0):
            step = std[k] * np.eye(n)[k]
            ends = (path_spread(self.family, self.path + d, pixels) for d in (step, -step))
            J[..., k] = (next(ends) - next(ends)) / (2 * std[k])
        variance = np.einsum("hwk,kl,hwl->hw", J, covariance, J)
        weight = path_spread(self.family, self.path, pixels)
        return PointSpread(weight, np.sqrt(np.maximum(variance, 0)), (int(x0), int(y0)))

    @property
    def coverage(self) -> Array:
        """(side, side) coverage of the silhouette in the middle of the exposure, its center central."""
        reach = int(np.ceil(self.silhouette.reach(self.shape))) + 1
        side = 2 * reach + 1
        return self.silhouette.coverage(self.shape, Pixels((side, side), (-reach, -reach)))

    @property
    def alpha(self) -> Array:
        """(H, W) fraction of the exposure."""
        return self.alpha_within((0, 0, *self.size))

    @property
    def alpha_std(self) -> Array:
        """(H, W) standard deviation of alpha; errors of neighbors are correlated."""
        return self.within((0, 0, *self.size))[1]

    @property
    def box(self) -> tuple[int, int, int, int]:
        """(x0, y0, x1, y1) of the pixels that it may touch, in the picture."""
        xy, reach = self.trajectory.xy, self.silhouette.reach(self.shape) + 1
        x0, y0 = np.maximum(np.floor(xy.min(axis=0) - reach), 0).astype(int)
        x1, y1 = np.minimum(np.ceil(xy.max(axis=0) + reach) + 1, self.size).astype(int)
        return int(x0), int(y0), max(int(x1), int(x0)), max(int(y1), int(y0))

    def in_picture(self, corner: tuple[int, int], size: tuple[int, int]) -> "Sweep":
        """The sweep of a part of a picture in that picture, of `size`; the part begins at `corner`."""
        path = self.family.shifted(self.path, np.array(corner, float))
        return replace(self, path=path, size=size)

    def enlarged(self, by: float, origin: tuple[float, float], size: tuple[int, int]) -> "Sweep":
        """The sweep of a picture of means over cells of `by` x `by` pixels, in the picture of pixels.

        Parameters
        ----------
        origin : (float, float)
            Center (x, y) of the first cell, in the pixels.
        size : (int, int)
            (width, height) of the picture of pixels.
        """
        of_path, of_shape = self.family.units(by), self.silhouette.units(by)
        assumed = self.assumed_covariance
        units, cast, known = np.concatenate([of_path, of_shape]), self.cast, self.diagnostics
        if cast is not None:
            x, y = cast.offset
            cast = replace(cast, offset=(by * x, by * y), softness=by * cast.softness)
        return replace(
            self,
            path=self.family.shifted(of_path * self.path, np.array(origin)),
            shape=of_shape * self.shape,
            covariance=self.covariance * np.outer(units, units),
            assumed_covariance=None if assumed is None else assumed * np.outer(units, units),
            size=size,
            cast=cast,
            diagnostics=replace(known, chroma_blur=by * known.chroma_blur),
        )

    def within(self, box: tuple[int, int, int, int]) -> tuple[Array, Array]:
        """Alpha and its standard deviation (h, w) in a box (x0, y0, x1, y1) of pixels.

        The omitted orders of an outline count as one of the size of its last order.
        """
        swept = self._swept(box, self.shape)
        J = swept.by_parameters
        variance = np.einsum("hwi,hwi->hw", J @ self.covariance, J)
        if self.opacity_std > 0:
            variance += (self.opacity_std * self.covered_within(box)) ** 2
        left_out = self.silhouette.left_out(self.shape)
        if left_out > 0:
            wider = self.shape.copy()
            wider[self.silhouette.at("radius")] += left_out
            variance += (self._swept(box, wider).alpha - swept.alpha) ** 2
        return swept.alpha, np.sqrt(variance)

    def change_to(self, other: "Sweep") -> Array:
        """(n + m,) change of its parameters that gives it path and radius of another, nearly.

        The direction of time is unknown: it is that in which the paths are closer.
        """
        own, curve = self.family.curve(self.path), other.family.curve(other.path)
        curve = curve + other.silhouette.center(other.shape)
        curve = curve - self.silhouette.center(self.shape)
        if np.sum((curve[::-1] - own) ** 2) < np.sum((curve - own) ** 2):
            curve = curve[::-1]
        of_path = self.family.starts(curve)[0] - self.family.starts(own)[0]
        slope = self.silhouette.radius_slope(self.shape)
        of_shape = slope * (other.radius - self.radius) / (slope @ slope)
        return np.concatenate([of_path, of_shape])

    @property
    def with_assumed_error(self) -> "Sweep":
        """The sweep with the error of what was assumed in its covariance."""
        if self.assumed_covariance is None:
            return self
        whole = self.covariance + self.assumed_covariance
        return replace(self, covariance=whole, assumed_covariance=None)

    def assumed_error(self, box: tuple[int, int, int, int]) -> tuple[Array, float]:
        """Standard deviation (h, w) of alpha in a box, and of its sum, by what was assumed."""
        if self.assumed_covariance is None:
            return np.zeros((box[3] - box[1], box[2] - box[0])), 0.0
        J, covariance = self._swept(box, self.shape).by_parameters, self.assumed_covariance
        total = J.sum(axis=(0, 1))
        variance = np.einsum("hwi,hwi->hw", J @ covariance, J)
        return np.sqrt(np.maximum(variance, 0)), float(np.sqrt(max(total @ covariance @ total, 0)))

    def alpha_within(self, box: tuple[int, int, int, int]) -> Array:
        """Alpha (h, w) in a box (x0, y0, x1, y1) of pixels, as that of `within`."""
        return self._swept(box, self.shape).alpha

    def covered_within(self, box: tuple[int, int, int, int]) -> Array:
        """(h, w) part of the exposure during which it covers each pixel of a box (x0, y0, x1, y1)."""
        solid = replace(self, silhouette=self.silhouette.with_opacity(1.0))
        return solid.alpha_within(box)

    def rms_difference(self, other: "Sweep") -> float:
        """Root mean square difference of the alphas of two sweeps, of the larger alpha's."""
        x0, y0, x1, y1 = box = enclosing([self.box, other.box])
        both = np.zeros((2, y1 - y0, x1 - x0))
        for alpha, sweep in zip(both, (self, other), strict=True):
            alpha[rows_columns(sweep.box, box)] = sweep._alpha_in_box
        return relative_difference(*both)

    @cached_property
    def _alpha_in_box(self) -> Array:
        """(h, w): sweeps are compared with many others."""
        return self.alpha_within(self.box)

    def before_file(
        self, image: LinearImage, plate: LinearImage, box: tuple[int, int, int, int]
    ) -> LinearImage:
        """A box of the image before its file blurred the colors of neighbors.

        The image itself if its file did not, or if the object may have any colors.

        Parameters
        ----------
        image, plate : LinearImage
            Their pixels in the box (x0, y0, x1, y1).
        """
        file = self._file(image)
        if file is None or self.model.rank == 3:
            return image
        return image_before(image, plate, self.alpha_within(box), self.model.basis, file)

    def chroma_blur(self, image: LinearImage) -> float:
        """Pixels by which the image's file blurred colors, a standard deviation; 0 if it did not."""
        file = self._file(image)
        return 0.0 if file is None else file.spread

    def _file(self, image: LinearImage) -> File | None:
        """The file's effect on the image's code values."""
        blur = self.diagnostics.chroma_blur
        return file_of(image) or (ChromaBlur(blur) if blur > 0 else None)

    def in_shadow(self, plate: LinearImage, box: tuple[int, int, int, int]) -> LinearImage:
        """A box of the plate in the shadow that the object casts on it; unchanged without a shadow.

        Parameters
        ----------
        plate : LinearImage
            Its pixels in the box (x0, y0, x1, y1).
        """
        if self.cast is None:
            return plate
        radius = self.silhouette.value("radius", self.shape)
        S = self.cast.missing(self.family, self.path, radius, Pixels.of_box(box))
        shaded = self.cast.on(np.asarray(plate.rgb, float), S, self.alpha_within(box))
        return replace(plate.with_noise(plate.variance), rgb=shaded.astype(plate.rgb.dtype))

    def area_std(self) -> float:
        """Standard deviation of the sum of alpha within the picture, pixels."""
        swept = self._swept(self.box, self.shape)
        total = swept.by_parameters.sum(axis=(0, 1))
        by_opacity = self.opacity_std * float(self.covered_within(self.box).sum())
        return float(np.sqrt(total @ self.covariance @ total + by_opacity**2))

    def _swept(self, box: tuple[int, int, int, int], shape: Array) -> SweptAlpha:
        return self.silhouette.sweep(self.family, self.path, shape, Pixels.of_box(box))
