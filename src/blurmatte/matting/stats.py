"""The numbers about a solution, by subject.

A solution's file and its report are written and read by these types; the ranges are those of numbers
that are read. A number is None where it does not apply: without a fit, or of another solver.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np
from annotated_types import Interval

from blurmatte.background.match import UNCHANGED, Match
from blurmatte.checks import MAX_PX, Direction, Floats
from blurmatte.matting.averaging import AlphaEstimate
from blurmatte.matting.calibration import (
    GRADE_LIMITS,
    calibrated_alone,
    claimed_error,
    grade_of,
    graded,
)
from blurmatte.matting.maps import Grade
from blurmatte.matting.summary import Alternative
from blurmatte.radiometry import LinearImage, NoiseModel
from blurmatte.sweep.assess.calibration import ErrorTerms
from blurmatte.sweep.model.cast_shadow import CastShadow
from blurmatte.sweep.sweep import Diagnostics, Sweep

MAX_SUM = 1e12  # of alpha or pixels; other numbers are less
MAX_SECONDS = 1e6  # of an exposure

_Count = Annotated[int, Interval(ge=0, le=MAX_SUM)]
_Size = Annotated[float, Interval(ge=0, le=MAX_SUM)]
_Sum = Annotated[float, Interval(ge=-MAX_SUM, le=MAX_SUM)]
_Fraction = Annotated[float, Interval(ge=0, le=1)]
_Edge = Annotated[int, Interval(ge=0, le=MAX_PX)]
_Box = tuple[_Edge, _Edge, _Edge, _Edge]
_Coordinate = Annotated[float, Interval(ge=-MAX_PX, le=MAX_PX)]
_Point = tuple[_Coordinate, _Coordinate]
_Points = tuple[_Point, ...]
_PerChannel = tuple[float, float, float]


@dataclass(frozen=True)
class MedianNoise:
    """The noise of a picture in which each pixel has an error of its own.

    Parameters
    ----------
    median_std : float
        Median of the standard deviations of its pixels, light; white is 1.
    """

    median_std: _Size

    def variance(self, light: Floats) -> Floats:
        """The variance, as of a `NoiseModel`, the same at any `light` (..., 3)."""
        return np.full(light.shape, self.median_std**2)


def noise_of(picture: LinearImage) -> NoiseModel | MedianNoise:
    """The noise of a picture in a few numbers, of each of its channels."""
    part = 1 / 3 if picture.meta.one_channel else 1.0
    if isinstance(picture.noise, NoiseModel):
        return picture.noise.times(part)
    return MedianNoise(float(np.sqrt(part * np.median(picture.variance))))


@dataclass(frozen=True, kw_only=True)
class MatchSummary:
    """What was done to the plate, and how far it agrees with the image then.

    Parameters
    ----------
    in_words : str
        As `Match.in_words`.
    shift, shift_std : (float, float)
        x, y of the image's center, and their standard deviations, pixels.
    angle : float
        Rotation, radians.
    gain, gain_std, offset : three floats
        Of the plate's light, per channel; white is 1.
    agreement, edge_agreement : float
        Standard deviation of the difference where nothing moved, in units of the noise: everywhere, and
        at the plate's edges. NaN if no pixel is valid.
    """

    in_words: str
    shift: tuple[float, float] = (0.0, 0.0)
    shift_std: tuple[float, float] = (0.0, 0.0)
    angle: float = 0.0
    gain: _PerChannel = (1.0, 1.0, 1.0)
    gain_std: _PerChannel = (0.0, 0.0, 0.0)
    offset: _PerChannel = (0.0, 0.0, 0.0)
    agreement: float
    edge_agreement: float

    @property
    def is_unchanged(self) -> bool:
        """Whether the plate was used as it is."""
        return self.in_words == UNCHANGED

    @classmethod
    def of(cls, match: Match, agreement: float, edge_agreement: float) -> MatchSummary:
        """Of a match, and the agreement that it reaches."""
        rows = match.light_std[0], match.light[1]
        gain_std, offset = ((float(r), float(g), float(b)) for r, g, b in rows)
        return cls(
            in_words=match.in_words,
            shift=match.shift,
            shift_std=match.shift_std,
            angle=match.angle,
            gain=match.gain,
            gain_std=gain_std,
            offset=offset,
            agreement=agreement,
            edge_agreement=edge_agreement,
        )


@dataclass(frozen=True, kw_only=True)
class SweepSummary:
    """The likeliest shape on a path.

    Parameters
    ----------
    silhouette, path : str
        Names of their kinds.
    path_in_words : str
        The kind of the path with its article.
    is_disc : bool
        Whether the silhouette is a disc, which may grow.
    xy : (n,) of (float, float)
        Points of the path, pixels.
    length, radius, radius_std : float
        Of the path; of the disc of the same area, and its standard deviation, pixels.
    softness : float
        Standard deviation of the blur of the rim by the lens, pixels; 0 without.
    opacity, opacity_std : float
        The part of the light behind it that it hides where it is: 1 if it is solid, 0 if it only adds
        light. Of an opaque object at rest, the part of the exposure during which it was there.
    outlines : (2,) of (n,) of (float, float)
        Points of the outline at the beginning and at the end of the exposure, pixels.
    outlines_std : (2,) of (n,) of float
        Their standard deviation across the rim, pixels.
    diagnostics : Diagnostics
        Goodness of the fit.
    shadow : CastShadow or None
        The shadow that it casts, if one was fitted.
    """

    silhouette: str
    path: str
    path_in_words: str = "a curved path"
    is_disc: bool = False
    xy: _Points
    length: _Size
    radius: _Size
    radius_std: _Size
    softness: _Size = 0.0
    opacity: _Fraction = 1.0
    opacity_std: _Size = 0.0
    outlines: tuple[_Points, ...]
    outlines_std: tuple[tuple[_Size, ...], ...] = ()
    diagnostics: Diagnostics
    shadow: CastShadow | None = None

    @classmethod
    def of(cls, sweep: Sweep) -> SweepSummary:
        """Of a fitted sweep; of its points every fourth. Errors are at most the picture's diagonal."""
        most = float(np.hypot(*sweep.size))
        return cls(
            silhouette=sweep.silhouette.name,
            path=sweep.family.name,
            path_in_words=sweep.family.in_words,
            is_disc=sweep.silhouette.is_disc,
            xy=tuple((float(x), float(y)) for x, y in sweep.trajectory.xy[::4]),
            length=sweep.length,
            radius=sweep.radius,
            radius_std=min(sweep.radius_std, most),
            softness=sweep.softness,
            opacity=sweep.silhouette.opacity,
            opacity_std=sweep.opacity_std,
            outlines=tuple(
                tuple((float(x), float(y)) for x, y in sweep.outline_at(t)[::4]) for t in (0, 1)
            ),
            outlines_std=tuple(
                tuple(min(float(std), most) for std in sweep.outline_std(t)[::4]) for t in (0, 1)
            ),
            diagnostics=sweep.diagnostics,
            shadow=sweep.cast,
        )

    def moved(self, x: int, y: int) -> SweepSummary:
        """The same in a picture in which that of the sweep begins at x, y; pixels."""

        def shifted(points: _Points) -> _Points:
            """The points there."""
            return tuple((a + x, b + y) for a, b in points)

        return replace(
            self, xy=shifted(self.xy), outlines=tuple(shifted(one) for one in self.outlines)
        )


@dataclass(frozen=True)
class SmoothSummary:
    """The prior that was chosen, and the convergence.

    Parameters
    ----------
    order : int
        Of the differences that are small: 1 or 2.
    scale : float
        Of such a difference between pixels.
    steps : int
        Of the last fit.
    converged : bool
        Whether it ended before the largest number of steps.
    """

    order: int
    scale: float
    steps: int
    converged: bool


@dataclass(frozen=True, kw_only=True)
class SolutionStats:
    """The numbers about a solution.

    Parameters
    ----------
    pixels, pixels_known, pixels_misfit : int or None
        Of the streak: all, those of known alpha, those flagged `MISFIT`.
    sum_alpha, sum_alpha_std : float or None
        Over the streak's pixels of known alpha, pixels; its standard deviation, that of the common
        factor included.
    alpha_scale_std : float or None
        Relative standard deviation of a factor common to all of alpha.
    streak_box : (x0, y0, x1, y1) or None
        What was solved, pixels.
    other_boxes : tuple of (x0, y0, x1, y1)
        What else moved, pixels.
    insignificant_others : int
        Number of regions that differ from the plate, but may be noise or compression.
    image_noise, plate_noise : NoiseModel, MedianNoise or None
        Of the pictures that were solved.
    match : MatchSummary or None
        What was done to the plate.
    may_be_shadow : bool
        Whether all of the streak was only darker than the plate.
    rough_guess : float or None
        Standard deviation of the light of a guessed plate, white is 1, if the scene is so rough that it
        is as large as the change by a soft shadow.
    exposure_time : float or None
        Seconds; None if the image's file does not state it.
    readout : "down", "up", "left" or "right"
        Direction in the image in which the sensor is read out.
    sweep : SweepSummary or None
        The first of the shapes on paths; None if none was fitted.
    smooth : SmoothSummary or None
        Of the solver `Smooth`.
    sum_shadow : float or None
        Of the solver `Shaded`: the shadow, summed like alpha.
    weights : tuple of float or None
        Probabilities of the hypotheses that were averaged, 0…1: shapes on paths, the one first
        whose alpha is expected to be the nearest to the truth, then alpha without a shape.
    shape_log_odds : (float, float) or None
        Log odds of a disc against an outline, -inf without a disc, and of a shape against none.
    alternatives : tuple of Alternative or None
        Of these hypotheses the answer's own, and those that matter or disagree.
    claimed_error : float or None
        Root mean square error of alpha over the streak before the calibration; None if no alpha is
        known.
    error_terms : ErrorTerms or None
        Causes of a larger error, from which the calibration of an average follows.
    grade_reasons : tuple of str
        What contributes most to the errors, the largest first; keys of docs/cli.md.
    grade : Grade or None
        None if the error was not calibrated.
    alpha_error : float or None
        Calibrated root mean square error of alpha over the streak.
    untried : tuple of str
        Explanations that were not fitted, because the time was over.

    Examples
    --------
    >>> numbers = solution.stats
    >>> print(f"{numbers.sum_alpha:.0f} ± {numbers.sum_alpha_std:.0f} pixels")
    314 ± 3 pixels
    >>> print(f"alpha within {numbers.alpha_error:.3f}")
    alpha within 0.004
    >>> numbers.grade_reasons
    ('shape', 'disagreement')
    """

    pixels: _Count | None = None
    pixels_known: _Count | None = None
    pixels_misfit: _Count | None = None
    sum_alpha: _Sum | None = None
    sum_alpha_std: _Size | None = None
    alpha_scale_std: _Size | None = None
    streak_box: _Box | None = None
    other_boxes: tuple[_Box, ...] = ()
    insignificant_others: _Count = 0
    image_noise: NoiseModel | MedianNoise | None = None
    plate_noise: NoiseModel | MedianNoise | None = None
    match: MatchSummary | None = None
    may_be_shadow: bool = False
    rough_guess: _Size | None = None
    exposure_time: Annotated[float, Interval(ge=0, le=MAX_SECONDS)] | None = None
    readout: Direction = "down"
    sweep: SweepSummary | None = None
    smooth: SmoothSummary | None = None
    sum_shadow: float | None = None
    weights: tuple[_Fraction, ...] | None = None
    shape_log_odds: tuple[float, float] | None = None
    alternatives: tuple[Alternative, ...] | None = None
    claimed_error: _Size | None = None
    error_terms: ErrorTerms | None = None
    grade_reasons: tuple[str, ...] = ()
    grade: Grade | None = None
    alpha_error: _Size | None = None
    untried: tuple[str, ...] = ()

    @property
    def has_shape(self) -> bool:
        """Whether the answer, or of averaged hypotheses the likeliest, is a shape on a path."""
        shapeless = self.alternatives is not None and self.alternatives[0].radius is None
        return self.sweep is not None and not shapeless

    @property
    def only_adds_light(self) -> bool:
        """Whether the answer is an object that hides nothing of the light behind it."""
        return self.has_shape and self.sweep is not None and self.sweep.opacity == 0

    @property
    def is_gray(self) -> bool:
        """Whether the pictures are gray: the object's color has no hue."""
        return "gray" in self.grade_reasons

    @property
    def leaves_region(self) -> bool:
        """Whether the fitted shape reaches beyond the region in which the plate is a guess."""
        return "region" in self.grade_reasons

    def moved(self, x: int, y: int) -> SolutionStats:
        """The same in a picture in which that of the solution begins at x, y; pixels."""

        def shifted(box: _Box) -> _Box:
            """The box there."""
            return box[0] + x, box[1] + y, box[2] + x, box[3] + y

        return replace(
            self,
            streak_box=None if self.streak_box is None else shifted(self.streak_box),
            other_boxes=tuple(map(shifted, self.other_boxes)),
            sweep=None if self.sweep is None else self.sweep.moved(x, y),
        )

    def with_match(self, match: Match) -> SolutionStats:
        """The same with the match of a plate that was matched before it was given to `solve`."""
        if self.match is None:
            return self
        agreements = self.match.agreement, self.match.edge_agreement
        return replace(self, match=MatchSummary.of(match, *agreements))

    def with_errors_times(self, factor: float, sum_alpha: float) -> SolutionStats:
        """The same with errors multiplied, and the grade that belongs to them and a sum of alpha.

        The factor is 1 or more: the grade may become worse, whatever it rests on, and never better.
        """
        errors = self.alpha_error, self.sum_alpha_std, self.alpha_scale_std
        error, sum_std, scale_std = (None if std is None else factor * std for std in errors)
        grade = self.grade
        if grade is not None and error is not None and sum_std is not None:
            grade = min(grade, grade_of(error, sum_std / sum_alpha))
        return replace(
            self, alpha_error=error, sum_alpha_std=sum_std, alpha_scale_std=scale_std, grade=grade
        )

    def graded_alone(
        self, estimate: AlphaEstimate, solver: str, compressed: bool, exact_color: bool
    ) -> SolutionStats:
        """The same with the grade and the error of a solver that has no other hypotheses.

        estimate: of the solver, not calibrated; the others as for `calibrated_alone`.
        """
        claim = claimed_error(estimate)
        grade, error = graded(calibrated_alone(estimate, solver, compressed, exact_color))
        causes = {
            "noise": claim > GRADE_LIMITS[Grade.CONFIRMED][0],
            "file": compressed,
            "color": not exact_color,
        }
        because = tuple(name for name, holds in causes.items() if holds)
        return replace(
            self, claimed_error=claim, grade_reasons=because, grade=grade, alpha_error=error
        )

    def assumed(self, reason: str) -> SolutionStats:
        """The same of a solution that rests on an assumption; it is the first reason of the grade."""
        reasons = (reason, *self.grade_reasons)
        return replace(self, grade=Grade.ASSUMED, grade_reasons=reasons)
