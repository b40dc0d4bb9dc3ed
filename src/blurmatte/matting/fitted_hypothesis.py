"""Fitted hypotheses: a shape on a path, and alpha without a shape, as they are averaged."""

from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from typing import ClassVar, Self

import numpy as np

from blurmatte.checks import Array, Bools, Box, rows_columns
from blurmatte.color.model import ColorModel
from blurmatte.color.shadows import darker_pixels
from blurmatte.matting.averaging import AlphaEstimate
from blurmatte.matting.calibration import rms_difference
from blurmatte.matting.maps import PixelMaps, Quality, has_flag
from blurmatte.matting.object_light import light_given
from blurmatte.matting.special_pixels import NearPictures
from blurmatte.matting.summary import Alternative
from blurmatte.radiometry import LinearImage
from blurmatte.radiometry.image import VARIANCE_FLOOR
from blurmatte.statistics import MEDIAN_3
from blurmatte.sweep.assess.model_selection import Evidence
from blurmatte.sweep.assess.occlusion import mean_of_neighbors, occluded
from blurmatte.sweep.fitting_size import FittingSize
from blurmatte.sweep.model.silhouette import OPAQUE
from blurmatte.sweep.sweep import Sweep

_COLORS = "one paint", "two paints", "any colors"  # of rank 1, 2, 3
_IMPOSSIBLE_COST = 1e9  # nats, more than evidence ever differs by


@dataclass(frozen=True, eq=False)
class FittedHypothesis(ABC):
    """A hypothesis with its evidence, alpha and colors."""

    evidence: Evidence
    colors: ColorModel  # of the object

    has_shape: ClassVar[bool]

    @property
    def made_impossible(self) -> Self:
        """The same with evidence that leaves it no weight."""
        cost = self.evidence.cost + _IMPOSSIBLE_COST
        return replace(self, evidence=replace(self.evidence, cost=cost))

    @property
    @abstractmethod
    def name(self) -> str:
        """Such as "disc on a parabola, one paint"."""

    @property
    def radius(self) -> float | None:
        """Pixels; None without a shape."""
        return None

    @abstractmethod
    def within(self, box: Box) -> AlphaEstimate:
        """Its alpha in a box; errors that no calibration knows are left out."""

    @abstractmethod
    def enlarged(self, size: FittingSize) -> "FittedHypothesis":
        """Of one about cells the same about the picture."""

    def behind(self, plate: LinearImage, box: Box) -> LinearImage:
        """The plate in a box, as it is behind the object."""
        return plate

    @abstractmethod
    def write(
        self, maps: PixelMaps, average: AlphaEstimate, pictures: NearPictures, box: Box
    ) -> None:
        """Write an average in which it has the largest weight, and its light.

        pictures: in the box.
        """

    def alternative(
        self,
        weight: float,
        estimate: AlphaEstimate,
        result: AlphaEstimate,
        pictures: tuple[LinearImage, LinearImage],
        box: Box,
    ) -> Alternative:
        """Compare it with the result.

        estimate, result: its alpha in the box, and that of the result.
        pictures: image and plate in the box, noise known.
        """
        image, plate = pictures[0], self.behind(pictures[1], box)
        mean = _mean_color(estimate, self.colors, image, plate)
        r, g, b = mean.tolist()
        return Alternative(
            self.name,
            (r, g, b),
            replace(self.colors, mean=mean).color,
            float(weight),
            _alpha_factor(estimate, result),
            rms_difference(result, estimate),
            self.radius,
        )


@dataclass(frozen=True, eq=False)
class OnPath(FittedHypothesis):
    """A shape on a path."""

    sweep: Sweep

    has_shape = True

    @classmethod
    def of(cls, sweep: Sweep, evidence: Evidence) -> "OnPath":
        """With the colors of a sweep."""
        return cls(evidence, sweep.model, sweep)

    @property
    def name(self) -> str:
        """Shape, path and colors."""
        return f"{self.sweep.in_words}, {_COLORS[self.colors.rank - 1]}"

    @property
    def radius(self) -> float:
        """Of the disc of the same area, pixels."""
        return self.sweep.radius

    @property
    def opacity_error(self) -> float:
        """Relative standard deviation of the opacity, which calibrations do not know."""
        return self.sweep.opacity_std / self.sweep.silhouette.opacity

    @property
    def even_opacity_error(self) -> float:
        """The same if letting light through is as usual as being solid."""
        return self.sweep.diagnostics.even_opacity_std / self.sweep.silhouette.opacity

    def within(self, box: Box) -> AlphaEstimate:
        """Without the errors of opacity and of an assumed transfer curve."""
        sweep = replace(self.sweep, opacity_std=0.0)
        return AlphaEstimate(*sweep.within(box), sweep.area_std())

    def enlarged(self, size: FittingSize) -> "OnPath":
        """With the parameters in pixels."""
        return replace(self, sweep=self.sweep.enlarged(size.cell, size.origin, size.size))

    def behind(self, plate: LinearImage, box: Box) -> LinearImage:
        """In the shadow that the object casts."""
        return self.sweep.in_shadow(plate, box)

    def write(
        self, maps: PixelMaps, average: AlphaEstimate, pictures: NearPictures, box: Box
    ) -> None:
        """Occluded pixels keep their alpha and have no light.

        Patches that the sweep does not fit (a hole, a highlight) are marked MISFIT, by the light before
        chroma subsampling. Pixels outside the object that are only darker than the plate are marked
        SHADOW. The maps are of the closed form with the sweep's color.
        """
        maps = maps.within(box)
        alpha, alpha_std = (np.asarray(x, float) for x in (average.alpha, average.alpha_std))
        sweep, (image, plate, mixed) = self.sweep, pictures
        lit = mixed.with_edge_variance(plate)
        plate = self.behind(lit, box)
        P, P_std, chi2 = light_given(alpha, alpha_std, sweep.model, image, plate)
        before = sweep.before_file(image, plate, box)
        if before is not image:  # only for the test of fit: its light has more noise
            _, _, chi2 = light_given(alpha, alpha_std, sweep.model, before, plate)
        saturated = has_flag(maps.quality, Quality.SATURATED) & (~image.valid | (alpha < OPAQUE))
        hidden = has_flag(maps.quality, Quality.OCCLUDED)
        inside = (alpha > 0) | ~has_flag(maps.quality, Quality.OUTSIDE)
        # Codecs leave more noise where something moves, so χ² is relative to its typical value.
        parts = (alpha == 0) & ~inside, alpha > 0
        chi2 = np.where(saturated, 1, chi2 / max(_typical(chi2[p & ~saturated]) for p in parts))
        if not hidden.any():
            hidden = _occluded(alpha, P, image, plate)
        P[hidden], P_std[hidden & (alpha > 0)] = 0, np.inf
        # Three times the mean χ² over a patch of nine: noise in two of them never exceeds it.
        odd = ~hidden & (mean_of_neighbors(np.where(hidden, 1, chi2)) > 3.0)
        for target, values in zip(maps, (alpha, alpha_std, P, P_std), strict=False):
            target[inside] = values[inside]
        flags = saturated * np.uint8(Quality.SATURATED) | (inside & odd) * np.uint8(Quality.MISFIT)
        flags |= (hidden & (alpha > 0)) * np.uint8(Quality.OCCLUDED)
        shaded = odd | np.any(plate.rgb < 0.98 * lit.rgb, axis=-1)  # the object's own shadow
        shaded &= inside & (alpha == 0) & darker_pixels(image, lit)
        flags |= shaded * np.uint8(Quality.SHADOW)
        maps.quality[inside] = flags[inside]


@dataclass(frozen=True, eq=False)
class Shapeless(FittedHypothesis):
    """Alpha by `Smooth` with some colors, and the maps of its box."""

    maps: PixelMaps
    box: Box
    sum_std: float
    scale_std: float

    has_shape = False

    @property
    def name(self) -> str:
        """Its colors."""
        return f"no shape, {_COLORS[self.colors.rank - 1]}"

    def within(self, box: Box) -> AlphaEstimate:
        """Alpha is 0 outside its own box."""
        inside = ~has_flag(self.maps.quality, Quality.OUTSIDE)
        both = [max(a, b) for a, b in zip(self.box[:2], box[:2], strict=True)]
        both += [min(a, b) for a, b in zip(self.box[2:], box[2:], strict=True)]
        alpha, std = np.zeros((2, box[3] - box[1], box[2] - box[0]))
        for values, source in ((alpha, self.maps.alpha), (std, self.maps.alpha_std)):
            own = np.where(inside, source, 0)[rows_columns(both, self.box)]
            values[rows_columns(both, box)] = own
        return AlphaEstimate(alpha, std, self.sum_std, self.scale_std)

    def enlarged(self, size: FittingSize) -> "Shapeless":
        """With maps that are constant over each cell."""
        alpha, std, P, P_std, quality = self.maps
        alpha, std, P, P_std = (size.repeated(m, self.box) for m in (alpha, std, P, P_std))
        maps = PixelMaps(alpha, std, P, P_std, size.repeated(quality, self.box))
        return replace(self, box=size.enlarged_box(self.box), maps=maps)

    def write(
        self, maps: PixelMaps, average: AlphaEstimate, pictures: NearPictures, box: Box
    ) -> None:
        """Where the object may be it is no longer OUTSIDE."""
        maps.write(self.box, self.maps)
        near, image, plate = maps.within(box), *pictures[:2]
        alpha, std = average.alpha, average.alpha_std
        P, P_std, _ = light_given(alpha, std, self.colors, image, plate)
        for target, values in zip(near, (alpha, std, P, P_std), strict=False):
            target[...] = values
        near.quality[alpha > 0] &= ~np.uint8(Quality.OUTSIDE)


def _mean_color(
    estimate: AlphaEstimate, model: ColorModel, image: LinearImage, plate: LinearImage
) -> Array:
    """(3,) light of an object divided by its alpha; 0 if no light is known."""
    known = np.isfinite(estimate.alpha) & np.isfinite(estimate.alpha_std)
    alpha, std = (np.where(known, x, 0) for x in (estimate.alpha, estimate.alpha_std))
    P, P_std, _ = light_given(alpha, std, model, image, plate)
    use = (alpha > 0) & np.isfinite(P_std).all(axis=-1)
    total = max(float(alpha[use].sum()), 1e-9)
    return np.asarray(np.maximum(P[use].sum(axis=0) / total, 0))


def _alpha_factor(estimate: AlphaEstimate, result: AlphaEstimate) -> float:
    """Sum of alpha over that of the result, where both are known."""
    both = np.isfinite(estimate.alpha) & np.isfinite(estimate.alpha_std)
    both &= np.isfinite(result.alpha) & np.isfinite(result.alpha_std)
    total = float(np.sum(np.asarray(result.alpha)[both]))
    own = float(np.sum(np.asarray(estimate.alpha)[both]))
    return max(own / total, 0.0) if total > 0 else 1.0


def _occluded(alpha: Array, P: Array, image: LinearImage, plate: LinearImage) -> Bools:
    """Where a static object is in front of an object of light P."""
    use = image.valid & plate.valid
    weight = (alpha * use)[..., None]
    light = np.sum(weight * P, axis=(0, 1)) / max(float(np.sum(weight * alpha[..., None])), 1e-12)
    variance = np.maximum(image.variance + plate.variance, VARIANCE_FLOOR)
    C, B = (np.asarray(picture.rgb, float) for picture in (image, plate))
    return occluded(alpha, light, C, B, np.asarray(variance, float), use)


def _typical(chi2: Array) -> float:
    """Scale of reduced χ² from its median, 1 or more; no noise model describes JPEG files."""
    return max(float(np.median(chi2)) * 3 / MEDIAN_3, 1.0) if chi2.size else 1.0
