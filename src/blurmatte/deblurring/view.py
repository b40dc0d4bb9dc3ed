"""A picture of an object as data of its straight color.

In this file C is the image, B the plate, α the exposure fraction. The premultiplied light is

    P = C − (1 − α) B,   Var P = Var C + (1 − α)² Var B + (δα (B − o))² + δ²,

with the error δα of the path and the mean color o, and an error δ of the model: the interpolation of an
edge between nodes errs by more than the noise of dark pixels.
"""

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from blurmatte.checks import Bools
from blurmatte.deblurring.jpeg_coefficients import Coefficients
from blurmatte.deblurring.lattice import Lattice
from blurmatte.deblurring.normal_equations import NormalEquations
from blurmatte.deblurring.operator import MAX_STEP_PX, Sparse, blur_operator, poses_of
from blurmatte.radiometry import SRGB, LinearImage, Transfer, smooth_variance
from blurmatte.sweep.model.pixels import Pixels
from blurmatte.sweep.sweep import Sweep

Array = npt.NDArray[np.float64]

MODEL_STD = 0.003  # δ, linear light


@dataclass(frozen=True, eq=False)
class StoredCodes:
    """A box of a picture as its JPEG file stores it.

    Parameters
    ----------
    codes : (h, w, 3) float
        Code values 0…255.
    plate_seen : (h w, 3) float
        Light of the plate after the image's file.
    coefficients : Coefficients
    transfer : Transfer
    """

    codes: Array
    plate_seen: Array
    coefficients: Coefficients
    transfer: Transfer

    @classmethod
    def of(cls, image: LinearImage, plate: LinearImage) -> "StoredCodes | None":
        """None if the compression of the image is unknown."""
        compression, transfer = image.meta.compression, image.meta.transfer or SRGB
        if compression is None:
            return None
        coefficients = Coefficients(compression, image.valid.shape)
        codes, behind = (255 * transfer.encode(np.asarray(p.rgb, float)) for p in (image, plate))
        seen = transfer.decode(coefficients.seen(behind) / 255).reshape(-1, 3)
        return cls(codes, seen, coefficients, transfer)

    def codes_of(self, light: Array) -> Array:
        """Code values 0…255 of light."""
        return np.asarray(255 * self.transfer.encode(np.maximum(light, 0)))


@dataclass(frozen=True, eq=False)
class View:
    """The pixels of a box of a picture, and how the object moved in it.

    Parameters
    ----------
    sweep : Sweep
    pixels : Pixels
    C, B : (h w, 3) float
        Image and plate, linear light.
    C_variance, B_variance : (h w, 3) float
        Of their noise.
    valid : (h w,) bool
    alpha_std : (h w,) float
        Error of alpha from that of the sweep.
    stored : StoredCodes or None
        The image as its JPEG file stores it, if the file's compression is known.
    """

    sweep: Sweep
    pixels: Pixels
    C: Array
    B: Array
    C_variance: Array
    B_variance: Array
    valid: Bools
    alpha_std: Array
    stored: StoredCodes | None = None

    @classmethod
    def of(cls, image: LinearImage, plate: LinearImage, sweep: Sweep) -> "View":
        """The box of a sweep in two pictures whose noise is known."""
        box = sweep.box
        image, plate = image.crop(box), sweep.in_shadow(plate.crop(box), box)
        stored = StoredCodes.of(image, plate)
        image = sweep.before_file(image, plate, box)
        flat = (-1, 3)
        return cls(
            sweep,
            Pixels.of_box(box),
            np.asarray(image.rgb, float).reshape(flat),
            np.asarray(plate.rgb, float).reshape(flat),
            smooth_variance(image).reshape(flat),
            smooth_variance(plate).reshape(flat),
            (image.valid & plate.valid).ravel(),
            sweep.within(box)[1].ravel(),
            stored,
        )

    def with_sweep(self, sweep: Sweep) -> "View":
        """The same pixels, another motion."""
        return replace(self, sweep=sweep)

    def blur(self, lattice: Lattice, step: float = MAX_STEP_PX) -> Sparse:
        """The operator (h w, n), see `operator`, of moments at most `step` pixels apart."""
        return blur_operator(self.sweep, lattice, self.pixels, poses_of(self.sweep, step=step))

    def light(self, alpha: Array) -> Array:
        """(h w, 3) premultiplied light P for an alpha (h w,)."""
        return self.C - (1 - alpha)[:, None] * self.B

    def variance(self, alpha: Array) -> Array:
        """(h w, 3) variance of P for an alpha (h w,)."""
        mean = self.light(alpha).sum(axis=0) / max(float(alpha.sum()), 1e-9)
        through, error = (1 - alpha)[:, None] ** 2, self.alpha_std[:, None] * (self.B - mean)
        return np.asarray(self.C_variance + through * self.B_variance + error**2 + MODEL_STD**2)

    def weight(self, alpha: Array) -> Array:
        """(h w, 3) inverse variance of P, 0 outside the streak."""
        return np.where((self.valid & (alpha > 0))[:, None], 1 / self.variance(alpha), 0)

    def equations(self, A: Sparse, lattice: Lattice, weight: Array) -> NormalEquations:
        """Normal equations of the straight color."""
        alpha = np.asarray(A.sum(axis=1)).ravel()
        return NormalEquations.of(A, self.light(alpha), weight, lattice)
