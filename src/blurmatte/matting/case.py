"""Case: pictures, streak, colors and hypotheses of one solve; Solver: what makes an Answer of them.

Except for `Pixelwise`, only a box around the streak is solved. Outside it alpha is 0 and OUTSIDE.

A streak's mask grows by hysteresis, and has a margin for pixels below the threshold.
"""

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar, Literal

import numpy as np
import scipy

from blurmatte.background import Match
from blurmatte.checks import Array, Bools, Box, Codes8, enclosing, rows_columns
from blurmatte.color.model import ColorModel
from blurmatte.color.shadows import MARGIN_PX
from blurmatte.matting.evidence import information_of, pixels_of, sum_inflation
from blurmatte.matting.maps import PixelMaps, Quality
from blurmatte.matting.special_pixels import NearPictures, mixed_plate
from blurmatte.matting.stats import SolutionStats
from blurmatte.radiometry import LinearImage
from blurmatte.radiometry.image import with_inflated
from blurmatte.streaks import Streak
from blurmatte.sweep.assess.model_selection import Hypotheses
from blurmatte.sweep.fitting_size import MAX_FITTED_WIDTH_PX, FittingSize
from blurmatte.sweep.hypotheses import HYPOTHESES, Hypothesis
from blurmatte.sweep.model.priors import OpacityPrior
from blurmatte.sweep.sweep import Sweep

# Settings of the growth.
_MARGIN_PX = 4.0  # added after growth; also to the reach of growth, half the width
_RELATIVE_MARGIN = 0.15  # half widths of the streak, added after growth
_RELATIVE_WINDOW = 0.05  # half widths: Gaussian over which evidence is averaged
_MIN_STDS = 4.0  # by which the averaged alpha must exceed 0


@dataclass(frozen=True, eq=False)
class Pictures:
    """Image and matched plate, noise known; the image is not valid where it is occluded.

    Whole pictures; a `PixelBox` is a box of them, at any resolution.
    """

    image: LinearImage
    plate: LinearImage
    match: Match
    hidden: Bools
    measured: bool = False  #: whether the noise was unknown, and measured from their difference


@dataclass(frozen=True, eq=False)
class Case:
    """Pictures, streak, colors and sweeps of one solve.

    Examples
    --------
    >>> class Box(bm.matting.Solver):
    ...     def answer(self, case, out):
    ...         print(case.image.size, case.streak.box)
    ...         return bm.Pixelwise().answer(case, out)
    >>> answer = bm.solve(image, plate, solution.model, Box())
    (128, 72) (20, 15, 101, 57)
    """

    pictures: Pictures
    found: Streak  #: where image and given plate differ
    model: ColorModel
    hypotheses: Hypotheses | None  #: None if the solver needs no sweep
    #: Whose hypotheses these are, of means over cells; None if they were fitted to these pictures
    fitted: "Case | None" = None
    cells: FittingSize | None = None  #: of which the pixels are means

    @property
    def is_exact(self) -> bool:
        """Whether the given colors have no error."""
        return not self.model.covariance.any()

    @property
    def is_compressed(self) -> bool:
        """Whether the image's file is compressed, or its chroma subsampled."""
        meta = self.pictures.image.meta
        return meta.sharing is not None or meta.subsampled

    @cached_property
    def image(self) -> LinearImage:
        """With the noise found by the sweep, which codecs hide; see `Diagnostics.noise_inflation`."""
        return _with_inflated_noise(self.pictures.image, self.hypotheses)

    @cached_property
    def plate(self) -> LinearImage:
        """As `image`; if sweeps were fitted, the plate in the light that the object changed."""
        plate = self.pictures.plate if self.hypotheses is None else self.hypotheses.plate
        return _with_inflated_noise(plate, self.hypotheses)

    @property
    def streak(self) -> Streak:
        """Where image and that plate differ."""
        return self.found if self.hypotheses is None else self.hypotheses.streak

    @property
    def compared(self) -> tuple[LinearImage, LinearImage, Streak]:
        """Image, matched plate, and where they differ, of the size that was fitted."""
        one = self.fitted or self
        return one.pictures.image, one.pictures.plate, one.found

    @cached_property
    def grown_streak(self) -> Streak:
        """The streak with its faint rims if it was detected; a given streak as it is."""
        if np.isnan(self.streak.evidence):
            return self.streak
        return grown_mask(self.streak, self.image, self.plate, self.model)

    def within(self, box: Box) -> NearPictures:
        """Image and plate in a box, and where the plate's edges are uncertain."""
        inside = self.streak.mask[rows_columns(box)]
        image, plate = self.image.crop(box), self.plate.crop(box)
        return image, plate, mixed_plate(image, plate, image.valid & plate.valid & ~inside)

    def box_with(self, sweeps: Sequence[Sweep]) -> Box:
        """A box around streak and sweeps, with a margin."""
        return enclosing([self.streak.around(MARGIN_PX), *(sweep.box for sweep in sweeps)])

    @property
    def flags(self) -> Codes8:
        """(H, W) quality that does not depend on the solver."""
        hidden = self.pictures.hidden
        saturated = ~(self.image.valid & self.plate.valid) & ~hidden
        return np.asarray(
            saturated * np.uint8(Quality.SATURATED)
            | ~self.streak.mask * np.uint8(Quality.OUTSIDE)
            | hidden * np.uint8(Quality.OCCLUDED),
            np.uint8,
        )


@dataclass(frozen=True, eq=False)
class Answer:
    """What a solver found.

    Parameters
    ----------
    maps : PixelMaps
        Alpha and light of the whole picture.
    model : ColorModel
        Colors of the object.
    streak : Streak
        Where alpha was estimated.
    stats : SolutionStats
        What the solver knows about its answer; without a grade if its errors are not calibrated.
    chosen : Solver or None
        The solver of the largest weight, of one that averages several.
    error_factor : float
        By which the calibrated error exceeds the claimed one of the likeliest shape, 1 or more.
    between : (n, n) float, optional
        Covariance of the parameters of the likeliest shape between the shapes that were averaged.
    errors_like : "Pixelwise" or "Smooth"
        Of stats without a grade, the solver whose calibration the errors get.
    assumes : str
        What it assumes, a reason of the grade in docs/cli.md; the grade is then assumed. Empty if
        nothing; "solver" if its errors are not calibrated.
    locates : bool
        Whether a shape says where the object is, so that its shadow is no part of it.
    separates_shadow : bool
        Whether the solver estimates the shadow itself.

    Examples
    --------
    >>> class Nothing(bm.matting.Solver):
    ...     def answer(self, case, out):
    ...         maps = bm.matting.PixelMaps.zeros(*case.streak.mask.shape) if out is None else out
    ...         return bm.matting.Answer(maps, case.model, case.streak, bm.matting.SolutionStats())
    >>> answer = bm.solve(image, plate, solution.model, Nothing())
    >>> float(answer.alpha.max())
    0.0
    """

    maps: PixelMaps
    model: ColorModel
    streak: Streak
    stats: SolutionStats
    chosen: "Solver | None" = None
    error_factor: float = 1.0
    between: Array | None = None
    errors_like: Literal["Pixelwise", "Smooth"] = "Pixelwise"
    assumes: str = "solver"
    locates: bool = False
    separates_shadow: bool = False


class Solver(ABC):
    """Estimates alpha and light of a case. `solve` takes any subclass.

    Examples
    --------
    >>> class Half(bm.matting.Solver):
    ...     def answer(self, case, out):
    ...         answer = bm.Pixelwise().answer(case, out)
    ...         answer.maps.alpha[...] /= 2
    ...         return answer
    >>> half = bm.solve(image, plate, solution.model, Half())
    >>> whole = bm.solve(image, plate, solution.model, bm.Pixelwise())
    >>> print(f"{half.alpha.max() / whole.alpha.max():.2f}")
    0.50
    """

    needs_sweep: ClassVar[bool] = False  #: whether sweeps are fitted where the colors are known
    takes_gray: ClassVar[bool] = False  #: whether it needs no hues
    hypotheses: tuple[Hypothesis, ...] = HYPOTHESES  #: the shapes on paths that are fitted
    seconds: float = math.inf  #: CPU time after which no further shape is fitted
    opacity: OpacityPrior = OpacityPrior.USUAL  #: of the shapes
    #: Pixels: wider streaks are fitted on cells
    fitted_width: ClassVar[float] = MAX_FITTED_WIDTH_PX

    def colors(self, model: ColorModel | None) -> ColorModel | None:
        """The colors to solve with, if some were given or the solver knows its own."""
        return model

    def matched(self, match: Match) -> "Solver":
        """The same with what it knows of the plate matched to the image."""
        return self

    def without_plate_changes(self) -> "Solver":
        """The same for an object that does not change the light of the plate."""
        return self

    @property
    def refusal_in_clips(self) -> str:
        """Why it cannot solve the frames of a clip, and the remedy; empty if it can."""
        return ""

    @abstractmethod
    def answer(self, case: Case, out: PixelMaps | None) -> Answer:
        """Solve a case.

        out: arrays to write the maps to.
        """


def _with_inflated_noise(picture: LinearImage, hypotheses: Hypotheses | None) -> LinearImage:
    """The picture with the noise inflation of the best sweep."""
    factor = 1.0 if hypotheses is None else hypotheses.best.diagnostics.noise_inflation
    return picture if factor == 1 else with_inflated(picture, factor)


def grown_mask(streak: Streak, image: LinearImage, plate: LinearImage, model: ColorModel) -> Streak:
    """The streak with connected pixels in which the object's colors are significant, and a margin.

    Rims fainter than noise, or over a plate of nearly the object's color, are not part of a detected
    streak. Growth is limited to half the streak's width.
    """
    y, x = streak.rows_columns
    half_width = float(scipy.ndimage.distance_transform_edt(np.pad(streak.mask[y, x], 1)).max())
    reach = _MARGIN_PX + half_width
    box = streak.around(int(reach) + 1)
    place = rows_columns(box)
    inside = streak.mask[place]
    distance = np.asarray(scipy.ndimage.distance_transform_edt(~inside))
    near = distance <= reach
    if model.rank < 3:
        nothing = np.zeros(near.shape)
        pixels = pixels_of(image.crop(box), plate.crop(box), model, near)
        evidence = information_of(pixels, nothing)
        inflation = sum_inflation(pixels, nothing)
        window = max(_RELATIVE_WINDOW * half_width, 1.0)
        information, pull = (scipy.ndimage.gaussian_filter(e, window) for e in evidence)
        averaged = 4 * np.pi * window**2 / inflation  # effective number of independent pixels
        significant = pull * np.sqrt(averaged) > _MIN_STDS * np.sqrt(information + 1e-9)
        inside = scipy.ndimage.binary_propagation(inside, mask=inside | (near & significant))
        distance = np.asarray(scipy.ndimage.distance_transform_edt(~inside))
    mask = np.zeros(streak.mask.shape, bool)
    mask[place] = distance <= _MARGIN_PX + _RELATIVE_MARGIN * half_width
    return replace(streak, mask=mask)
