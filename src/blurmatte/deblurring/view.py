"""A picture of an object as data of its straight color.

In this file C is the image, B the plate, α the exposure fraction. The premultiplied light is

    P = C − (1 − α) B,   Var P = Var C + (1 − α)² Var B + (δα (B − o))² + δ²,

with the error δα of the path and the mean color o, and an error δ of the model: the interpolation of an
edge between nodes errs by more than the noise of dark pixels.
"""

from dataclasses import dataclass, replace
from typing import Self

import numpy as np
import scipy

from blurmatte.checks import Array, check_kind, check_same_size, grown
from blurmatte.deblurring.jpeg_coefficients import Coefficients
from blurmatte.deblurring.normal_equations import Nodes, NormalEquations
from blurmatte.deblurring.operator import MAX_STEP_PX, Blur, Poses, moment_count, poses_of
from blurmatte.deblurring.spin import Spin
from blurmatte.radiometry import SRGB, LinearImage, Transfer, check_picture
from blurmatte.sweep.model.observation import PixelBox, light_of, means
from blurmatte.sweep.sweep import Sweep

MODEL_STD = 0.003  # δ, linear light
_LONG_PX = 128.0  # paths with moments a pixel apart
_LARGEST_STEP = 0.02  # for derivatives: pixels, radians, fractions


@dataclass(frozen=True, eq=False)
class StoredCodes:
    """A box of a picture as its JPEG file stores it.

    Parameters
    ----------
    codes : (h, w, 3) float
        Code values 0…1.
    coefficients : Coefficients
    transfer : Transfer
    """

    codes: Array
    coefficients: Coefficients
    transfer: Transfer

    @classmethod
    def of(cls, image: LinearImage) -> "StoredCodes | None":
        """None if the compression of the image is unknown."""
        compression, transfer = image.meta.compression, image.meta.transfer or SRGB
        if compression is None:
            return None
        codes = np.asarray(transfer.encode(np.asarray(image.rgb, float)))
        return cls(codes, Coefficients(compression, image.valid.shape), transfer)


def check_pictures_of(sweep: Sweep, image: LinearImage, plate: LinearImage) -> None:
    """Raise TypeError or ValueError unless it is a sweep in two pictures of one size."""
    check_picture("image", image)
    check_picture("plate", plate)
    check_kind("sweep", sweep, Sweep, "use blurmatte.sweep.fit_sweep(image, plate)")
    check_same_size("the sweep", sweep.size, "the image", image.size)
    check_same_size("the plate", plate.size, "the image", image.size)


@dataclass(frozen=True, eq=False, kw_only=True)
class View(PixelBox):
    """The pixels of a box of a picture, and how the object moved in it.

    Parameters
    ----------
    sweep : Sweep
    alpha_std : (h, w) float
        Error of alpha from that of the sweep.
    stored : StoredCodes or None
        The image as its JPEG file stores it, if the file's compression is known.
    spin : Spin, optional
        Of a ball that turns in space.
    shared_weight : bool
        One weight of all channels: a third of the work, and enough for a path.
    """

    sweep: Sweep
    alpha_std: Array
    stored: StoredCodes | None = None
    spin: Spin | None = None
    shared_weight: bool = False

    @classmethod
    def of(
        cls,
        image: LinearImage,
        plate: LinearImage,
        sweep: Sweep,
        spin: Spin | None = None,
        margin: int = 0,
    ) -> "View":
        """The box of a sweep, and a margin (pixels), in two pictures whose noise is known."""
        box = grown(sweep.box, margin, sweep.size)
        image, plate = image.crop(box), sweep.in_shadow(plate.crop(box), box)
        stored = StoredCodes.of(image)
        image = sweep.before_file(image, plate, box)
        return cls(
            *light_of(image, plate),
            (float(box[0]), float(box[1])),
            1.0,
            sweep=sweep,
            alpha_std=sweep.within(box)[1],
            stored=stored,
            spin=spin,
        )

    def coarser(self, by: int) -> Self:
        """Means over blocks of by × by pixels; an incomplete last row or column is dropped."""
        return replace(super().coarser(by), alpha_std=means(self.alpha_std, by))

    def for_path(self) -> "View":
        """The view with one weight of all channels, in a file of its components."""
        T = np.eye(3) if self.stored is None else self.stored.coefficients.equally_noisy.T
        C, B, V_C, V_B = self.along(T)
        return replace(self, C=C, B=B, C_variance=V_C, B_variance=V_B, shared_weight=True)

    @property
    def parameters(self) -> Array:
        """(k,) of path and shape, and of the spin."""
        spin = [] if self.spin is None else [self.spin.rotation, self.spin.shading]
        return np.concatenate([self.sweep.path, self.sweep.shape, *spin])

    @property
    def covariance(self) -> Array:
        """(k, k) of the parameters."""
        if self.spin is None:
            return self.sweep.covariance
        return np.asarray(
            scipy.linalg.block_diag(self.sweep.covariance, self.spin.covariance), float
        )

    @property
    def steps(self) -> Array:
        """(k,) small changes of the parameters for derivatives; 0 for those that are fixed."""
        return np.asarray(np.minimum(np.sqrt(np.diag(self.covariance)), _LARGEST_STEP))

    def moved(self, parameters: Array, covariance: Array | None = None) -> "View":
        """The same pixels, other parameters, and their covariance (k, k) if it is another."""
        covariance = self.covariance if covariance is None else covariance
        n, m, sweep, spin = len(self.sweep.path), len(self.sweep.covariance), self.sweep, self.spin
        path, shape, of_spin = np.split(parameters, [n, m])
        sweep = replace(sweep, path=path, shape=shape, covariance=covariance[:m, :m])
        if spin is not None:
            rotation, shading = of_spin[:3], of_spin[3:]
            spin = replace(spin, rotation=rotation, shading=shading, covariance=covariance[m:, m:])
        return replace(self, sweep=sweep, spin=spin)

    def with_error_of_alpha(self) -> "View":
        """The view with the error of alpha of its sweep, which has moved."""
        (h, w), (x, y) = self.pixels.shape, self.pixels.origin
        box = int(x), int(y), int(x) + w, int(y) + h
        return replace(self, alpha_std=self.sweep.within(box)[1])

    def moment_count(self, step: float | None = None) -> int:
        """Number of moments at most `step` pixels apart: by default half a one, one on long paths."""
        if step is None:  # the error of alpha is in proportion to step² / length
            length = 0.0 if self.spin else self.sweep.length / self.pixels.scale
            step = float(np.clip(np.sqrt(length / _LONG_PX), MAX_STEP_PX, 1.0))
        return moment_count(self.sweep, step=step * self.pixels.scale, spin=self.spin)

    def poses(self, count: int) -> Poses:
        """Those at a number of moments."""
        return poses_of(self.sweep, spin=self.spin, count=count)

    def blur(self, lattice: Nodes, count: int | None = None) -> Blur:
        """The operator (h w, n) of the view, of a number of moments."""
        count = self.moment_count() if count is None else count
        return lattice.blur(self.sweep, self.pixels, self.poses(count))

    def light(self, alpha: Array) -> Array:
        """(h w, 3) premultiplied light P for an alpha (h w,)."""
        return self.C.reshape(-1, 3) - self.through(alpha)

    def through(self, alpha: Array) -> Array:
        """(h w, 3) light of the plate that an object with an alpha (h w,) leaves."""
        return (1 - alpha)[:, None] * self.B.reshape(-1, 3)

    def variance(self, alpha: Array) -> Array:
        """(h w, 3) variance of P for an alpha (h w,)."""
        mean = self.light(alpha).sum(axis=0) / max(float(alpha.sum()), 1e-9)
        B, V_C, V_B = (x.reshape(-1, 3) for x in (self.B, self.C_variance, self.B_variance))
        error = self.alpha_std.reshape(-1, 1) * (B - mean)
        return np.asarray(V_C + (1 - alpha)[:, None] ** 2 * V_B + error**2 + MODEL_STD**2)

    def weight(self, alpha: Array, around: bool = False) -> Array:
        """(h w, 3) inverse variance of P; (h w, 1), of the mean, if it is shared or for a spin.

        0 outside the streak, unless the pixels around it are data of its motion.
        """
        variance = self.variance(alpha)
        if self.shared_weight or self.spin is not None:  # one factor instead of three
            variance = variance.mean(axis=1, keepdims=True)
        return np.where((self.valid.ravel() & (around | (alpha > 0)))[:, None], 1 / variance, 0)

    def equations(self, blur: Blur, lattice: Nodes, weight: Array) -> NormalEquations:
        """Normal equations of the straight color."""
        return NormalEquations.of(blur.A, self.light(blur.alpha), weight, lattice)
