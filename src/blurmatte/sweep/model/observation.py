"""PixelBox and Observation: light and noise in a box of image and plate, at any resolution."""

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Self

import numpy as np
import scipy

from blurmatte.checks import Array, Bools, Floats, rows_columns
from blurmatte.radiometry import (
    Compression,
    GuessError,
    LinearImage,
    Transfer,
    smooth_variance,
    whitened,
)
from blurmatte.statistics import CORRELATED_PX, block_squares, cell_means
from blurmatte.streaks.streak import Streak, dilated
from blurmatte.sweep.model.chroma_subsampling import ChromaBlur, File
from blurmatte.sweep.model.color_field import ColorPrior, residuals_of_none
from blurmatte.sweep.model.pixels import Pixels
from blurmatte.sweep.model.priors import MotionPrior, OpacityPrior
from blurmatte.sweep.model.student_t import loss

BACKGROUND_MARGIN_PX = 3  # around a streak, where pixels do not count as background
# Fraction of the background's blocks that is dropped: tolerates other moving objects
TRIMMED_OUTSIDE = 0.3


@dataclass(frozen=True, eq=False)
class PixelBox:
    """Light and noise of image and plate in a box of the picture, at any resolution."""

    # (h, w, 3) float: light
    C: Array
    B: Array
    # (h, w, 3) float: noise
    C_variance: Array
    B_variance: Array
    valid: Bools  # (h, w) bool: where image and plate are valid
    origin: tuple[float, float]  # where the center of pixel (0, 0) is, in pixels of the picture
    scale: float  # width of a pixel here, in pixels of the picture

    @property
    def pixels(self) -> Pixels:
        """Where the pixels are."""
        h, w = self.valid.shape
        return Pixels((h, w), self.origin, self.scale)

    def along(self, axes: Array) -> tuple[Array, Array, Array, Array]:
        """C, B and their variances along axes of color, the columns of a matrix (3, k).

        The noise along different axes is taken to be independent.
        """
        C, B = (np.ascontiguousarray(light @ axes) for light in (self.C, self.B))
        V_C, V_B = (np.ascontiguousarray(V @ axes**2) for V in (self.C_variance, self.B_variance))
        return C, B, V_C, V_B

    def coarser(self, by: int) -> Self:
        """Means over blocks of `by` by `by` pixels; an incomplete last row or column is dropped."""
        pixels = self.pixels.coarser(by)
        return replace(
            self,
            C=means(self.C, by),
            B=means(self.B, by),
            C_variance=means(self.C_variance, by) / by**2,
            B_variance=means(self.B_variance, by) / by**2,
            valid=means(self.valid, by) == 1,
            origin=pixels.origin,
            scale=pixels.scale,
        )


@dataclass(frozen=True, eq=False, kw_only=True)
class Observation(PixelBox):
    """Image and plate within a box, and what is known of what moved there."""

    weight: Array  # (h, w) float: of a pixel: 1, less far from the streak, 0 where it is not valid
    streak: Bools  # (h, w) bool: where something moved
    near: Bools  # (h, w) bool: where the object may have been
    size: tuple[float, float]  # (width, height) of the picture, in its pixels
    # What is known of the object's colors, and the axes of color space for its field
    color: ColorPrior = field(default_factory=lambda: ColorPrior(np.eye(3)))
    grain: float = 4.0  # pixels of the picture within which the object's color hardly changes
    noise_inflation: float = 1.0  # variance of the noise here over the variance that was measured
    # (h, w, 3) float: light by which the image's file may have changed a pixel's color
    chroma_error: Array | None = None
    # Of the image's file, of which these are the pixels; see `Meta.sharing`
    compression: Compression | None = None
    prior: MotionPrior | None = None  # of the object, from other frames
    opacity: OpacityPrior = OpacityPrior.USUAL  # of the object
    camera_stretch: tuple[float, float] = (0.0, 0.0)  # of every shape, as `Silhouette` has it
    # The image is the light that an object added, before a black plate: the scale of alpha is arbitrary
    light_alone: bool = False
    # (h, w) float, 0 to 1: `valid_fraction` of blocks; None for pixels of the picture
    block_valid_fraction: Array | None = None
    guess_error: GuessError | None = None  # in whose `whitening` light is here; None: linear RGB

    @property
    def valid_fraction(self) -> Array:
        """(h, w) fraction of the picture's pixels in each pixel here that are valid, 0 to 1.

        A block is `valid` if it is 1.
        """
        fraction = self.block_valid_fraction
        return self.valid.astype(float) if fraction is None else fraction

    @property
    def pitch(self) -> float:
        """`grain` in the pixels here, at least two."""
        return max(self.grain / self.scale, 2.0)

    @property
    def is_known_disc(self) -> bool:
        """Whether other frames know that the silhouette is a disc."""
        return self.prior is not None and self.prior.is_disc

    @property
    def channels(self) -> int:
        """How many are independent: 1 of gray pictures."""
        return self.color.channels

    def rgb(self, light: Array) -> Array:
        """Linear RGB (..., 3) of light as it is here."""
        error = self.guess_error
        return light if error is None else light @ np.linalg.inv(error.whitening)

    def of_rgb(self, light: Array) -> Array:
        """The inverse of `rgb`."""
        error = self.guess_error
        return light if error is None else np.ascontiguousarray(light @ error.whitening)

    @cached_property
    def light(self) -> tuple[Array, Array, Array, Array]:
        """Image, plate, and the variances of both, (h, w, 3) each, along the axes of color."""
        axes = self.color.axes
        C, B, V_C, V_B = self.along(axes)
        if self.chroma_error is not None:
            V_C += (self.chroma_error @ axes) ** 2
        return C, B, V_C, V_B

    @cached_property
    def of_none(self) -> tuple[Array, float]:
        """Residuals (3, h, w) without an object, and their loss."""
        e = residuals_of_none(self.light)
        return e, float(np.sum(self.weight * loss((e**2).sum(axis=0), self.channels)))

    @property
    def of_one_paint(self) -> "Observation":
        """The same for an object of which only the brightness varies."""
        return replace(self, color=self.color.of_one_paint)

    def along_colors(self, alpha: Array) -> "Observation":
        """The same with axes along mean color and largest spread of this alpha, if none are known."""
        if self.light_alone:
            alpha = alpha / max(float(alpha.max()), 1e-12)
        shown = alpha > 0.02  # fainter pixels do not show the color
        weight, covered = self.weight[shown], alpha[shown]
        total = float((weight * covered**2).sum())
        if self.color.rank < 3 or total == 0:
            return self
        light = self.C[shown] - (1 - covered)[:, None] * self.B[shown]
        mean = (weight * covered) @ light / total
        away = light - covered[:, None] * mean
        moments = away.T @ (weight[:, None] * away) / total
        known = self.color
        along = ColorPrior.along(mean, moments)
        color = replace(along, varied=known.varied, channels=known.channels)
        return replace(self, color=color)

    def file(self, transfer: Transfer, blur: float) -> File:
        """The image's file: its own compression if known, else a blur of so many pixels."""
        if self.compression is None:
            return ChromaBlur(blur / self.scale)
        variance = self.C_variance / self.noise_inflation
        return self.compression.in_noise(self.rgb(self.C), variance, transfer)

    def with_light(self, C: Array) -> "Observation":
        """The same with other light of the image, linear RGB."""
        return replace(self, C=np.ascontiguousarray(self.of_rgb(C)))

    def raised(self, by: float) -> "Observation":
        """The same with the variance of noise multiplied by a factor."""
        C_variance, B_variance, prior = by * self.C_variance, by * self.B_variance, self.prior
        if prior is not None:
            prior = replace(prior, weight=max(prior.weight / by, 1.0))
        return replace(
            self,
            prior=prior,
            C_variance=C_variance,
            B_variance=B_variance,
            noise_inflation=by * self.noise_inflation,
        )

    def correlated_noise(self) -> float:
        """Variance of block sums of C − B outside the streak over that of independent noise.

        At least 1. Compression correlates noise; changes of light far from the object have the same
        effect.
        """
        outside = ~dilated(self.streak, BACKGROUND_MARGIN_PX) & self.valid & (self.weight > 0)
        e = (self.C - self.B) / np.sqrt(self.C_variance + self.B_variance)
        squares = [
            block_squares(e, outside, size).sum(axis=1) / self.channels for size in CORRELATED_PX
        ]
        kept = 1 - TRIMMED_OUTSIDE
        trimmed = [np.sort(s)[: int(kept * len(s)) + 1] for s in squares if len(s)]
        return max(1.0, *(float(s.mean()) for s in trimmed), 1.0)

    def coarse_enough(self, radius: float, pixels: float) -> "Observation":
        """The same on the largest blocks of which a radius (pixels of the picture) has so many."""
        return self.coarser(max(1, int(radius / (pixels * self.scale))))

    def coarser(self, by: int) -> Self:
        """Means over blocks of `by` by `by` pixels; an incomplete last row or column is dropped."""
        if by == 1:
            return self
        coarse = super().coarser(by)
        return replace(
            coarse,
            weight=np.where(coarse.valid, means(self.weight, by), 0),
            streak=means(self.streak, by) > 0,
            near=means(self.near, by) > 0,
            chroma_error=None if self.chroma_error is None else means(self.chroma_error, by),
            compression=None,
            block_valid_fraction=means(self.valid_fraction, by),
        )


def light_of(image: LinearImage, plate: LinearImage) -> tuple[Array, Array, Array, Array, Bools]:
    """C, B, their variances, and where both are valid, of two pictures whose noise is known."""
    C, B = (np.ascontiguousarray(picture.rgb, dtype=float) for picture in (image, plate))
    return C, B, smooth_variance(image), smooth_variance(plate), image.valid & plate.valid


def means(values: Floats | Bools, by: int) -> Array:
    """Means of a map (h, w, ...) over blocks of `by` by `by` pixels."""
    return np.asarray(cell_means(np.asarray(values, float), by))


def observation_around(
    streak: Streak,
    margin: int,
    image: LinearImage,
    plate: LinearImage,
    color: ColorPrior,
) -> Observation:
    """A streak and a margin around it, pixels, of two pictures whose noise is known.

    Of gray pictures the object has one paint.
    """
    box, size = streak.around(margin), image.size
    image, plate = image.crop(box), plate.crop(box)
    mask, file = streak.mask[rows_columns(box)], image.meta.sharing
    light = light_of(*whitened(image, plate))
    valid, change = light[-1], np.subtract(image.rgb, plate.rgb, dtype=float)
    # The effect of a second blur of chroma, where the change has been blurred once
    error = None if file is None else np.subtract(*ChromaBlur(file.spread).chroma(change))
    if plate.meta.guess_error is not None:
        W = plate.meta.guess_error.whitening
        color, error = color.in_light(W), None if error is None else error @ W
    near = (scipy.ndimage.distance_transform_edt(~mask) <= margin) | ~valid
    return Observation(
        *light,
        (float(box[0]), float(box[1])),
        1.0,
        weight=np.where(valid, np.where(near, 1, 0.1), 0),  # pixels far from the streak are many
        streak=mask,
        near=near,
        size=size,
        color=color.of_gray if image.meta.one_channel else color,
        chroma_error=error,
        compression=file,
        guess_error=plate.meta.guess_error,
    )
