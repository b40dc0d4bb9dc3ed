"""Shaded: alpha of each pixel alone where the object's own shadow may lie on the plate.

In this file C is the image's light, B the plate's, P the object's and S the part of the exposure that a
pixel's plate lay in shadow: C = P + (1 − α − S) B + S B', B' the plate in shadow. A color model alone
cannot tell α from S, for a shadow that only dims looks like a black object. Two things more can:

    the object's light o, constant all over it     C − B = α (o − B) − S B           two unknowns
    the plate in shadow, of another hue            C − B = k l − α B + S (B' − B)    three

The first takes the shadow to be black and S to be what is lost; l is the direction of a line of colors.
Each is a weighted least-squares fit, and its covariance is the error.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from blurmatte.checks import check_same_size
from blurmatte.color import ColorModel
from blurmatte.matting.pixelwise import LEAST_VARIANCE, PixelMaps
from blurmatte.matting.solution import Quality
from blurmatte.radiometry import LinearImage

Array = npt.NDArray[np.float64]

_ROUNDS = 2  # to know by how much the plate shines through
_SIGMAS = 3.0
_CHI2_MISFIT = 16.0
_LEAST = (
    1e-12  # of the normal matrix: keeps what nothing tells finite, with an error beyond all bounds
)


@dataclass(frozen=True, eq=False)
class Shaded:
    """Solve each pixel alone, and the shadow that the object casts on the plate with it.

    Exactly one of two things must be known beside the color.

    Parameters
    ----------
    light : three floats, optional
        The object's light where it is opaque, linear, the same all over it: a matt thing in even light.
    plate : LinearImage, optional
        The plate in the object's shadow, everywhere where the shadow may have been. Where the shadow
        only dims, and does not change the hue, nothing is told, and the error says so.
    max_alpha_std : float
        A pixel whose alpha is less certain than this is marked PLATE_IN_MODEL, > 0.

    Raises
    ------
    ValueError
        If not exactly one of both is given, the light is none, or `max_alpha_std` is not positive.
    """

    light: tuple[float, float, float] | None = None
    plate: LinearImage | None = None
    max_alpha_std: float = 0.3

    def __post_init__(self) -> None:
        if (self.light is None) == (self.plate is None):
            raise ValueError("give the object's light or the plate in shadow: exactly one of both")
        if self.light is not None:
            light = np.asarray(self.light, dtype=float)
            if light.shape != (3,) or not np.all(np.isfinite(light)) or not light.max() > 0:
                raise ValueError(
                    f"light must be three finite numbers, some above 0, got {self.light}"
                )
            object.__setattr__(self, "light", tuple(light.tolist()))
        if not self.max_alpha_std > 0:
            raise ValueError(f"max_alpha_std must be positive, got {self.max_alpha_std}")

    def __repr__(self) -> str:
        known = f"light={self.light}" if self.plate is None else "plate in shadow"
        return f"Shaded({known})"

    def __call__(
        self,
        maps: PixelMaps,
        image: LinearImage,
        plate: LinearImage,
        shaded: LinearImage | None,
        model: ColorModel,
    ) -> Array:
        """Write the answer into maps of the closed form; returns S, (h, w).

        Parameters
        ----------
        maps : PixelMaps
            Changed in place.
        image, plate : LinearImage
            Of the maps' size, noise known.
        shaded : LinearImage or None
            `self.plate`, matched to the image and cut to the same size, noise known.
        model : ColorModel
            Of rank 1.
        """
        C, B = (np.asarray(picture.rgb, float) for picture in (image, plate))
        if shaded is None:
            o = np.asarray(self.light)
            X = np.stack([o - B, -B], axis=-1)
        else:
            check_same_size("the plate in shadow", shaded.size, "the image", image.size)
            l = np.broadcast_to(model.basis[:, 0], B.shape)
            X = np.stack([-B, shaded.rgb - B, l], axis=-1)
        found, covariance, chi2 = _least_squares(X, C - B, image, plate)
        std = np.sqrt(np.maximum(np.diagonal(covariance, axis1=-2, axis2=-1), 0))
        alpha, alpha_std, S = found[..., 0], std[..., 0], found[..., 1]
        if shaded is None:
            P, P_std = alpha[..., None] * o, alpha_std[..., None] * np.abs(o)
        else:
            P, P_std = found[..., 2:] * l, std[..., 2:] * np.abs(l)
        known = image.valid & plate.valid & (True if shaded is None else shaded.valid)
        for target, values in zip(maps, (alpha, alpha_std, P, P_std), strict=False):
            target[known] = values[known]
        self._mark(maps, alpha, alpha_std, _SIGMAS * std[..., 1] < S, chi2, known)
        return np.where(known, S, 0)

    def _mark(
        self,
        maps: PixelMaps,
        alpha: Array,
        alpha_std: Array,
        dark: npt.NDArray[np.bool_],
        chi2: Array,
        known: npt.NDArray[np.bool_],
    ) -> None:
        out = np.abs(alpha - 0.5) > 0.5 + _SIGMAS * alpha_std
        inside = (maps.quality & np.uint8(Quality.OUTSIDE)) == 0
        flags = (
            maps.quality & np.uint8(Quality.OUTSIDE)
            | (alpha_std > self.max_alpha_std) * np.uint8(Quality.PLATE_IN_MODEL)
            | out * np.uint8(Quality.OUT_OF_RANGE)
            | (dark & inside) * np.uint8(Quality.SHADOW)
            | (chi2 > _CHI2_MISFIT) * np.uint8(Quality.MISFIT)
        )
        maps.quality[known] = flags[known]


def _least_squares(
    X: Array, y: Array, image: LinearImage, plate: LinearImage
) -> tuple[Array, Array, Array]:
    """Unknowns (h, w, p) of X (h, w, 3, p) and y (h, w, 3), their covariance, and χ² of the rest."""
    through = np.ones(y.shape[:2])
    for _ in range(_ROUNDS):
        variance = image.variance + through[..., None] ** 2 * plate.variance + LEAST_VARIANCE
        weighted = X / variance[..., None]
        normal = np.swapaxes(weighted, -1, -2) @ X
        covariance = np.linalg.inv(normal + _LEAST * np.eye(X.shape[-1]))
        found = np.einsum("hwpq,hwcq,hwc->hwp", covariance, weighted, y)
        through = 1 - np.clip(found[..., 0] + found[..., 1], 0, 1)
    left = y - np.einsum("hwcp,hwp->hwc", X, found)
    return np.asarray(found), np.asarray(covariance), np.sum(left**2 / variance, axis=-1)
