"""Discs of single frames of a clip: fits of one shape, without other hypotheses."""

from dataclasses import dataclass, replace

import numpy as np

from blurmatte.checks import Array
from blurmatte.color.model import ColorModel
from blurmatte.radiometry import LinearImage
from blurmatte.statistics import DECISIVE_LOG_BAYES_FACTOR
from blurmatte.streaks import Streak
from blurmatte.sweep.assess.diagnostics import sweep_of
from blurmatte.sweep.fit.codec_loss import before_loss
from blurmatte.sweep.fit.levenberg_marquardt import ROUGH_TOLERANCE, minimize
from blurmatte.sweep.fit.multistart import (
    MAX_STEPS,
    Multistart,
    fitted_to_hue,
    with_principal_axes,
    with_varied_colors,
)
from blurmatte.sweep.fit.pattern import fit_pattern, has_pattern, may_have_pattern
from blurmatte.sweep.fit.ranking import Candidate, hue_inflation, noise_inflation
from blurmatte.sweep.hypotheses import best_discs, quick_search
from blurmatte.sweep.model.color_field import ColorPrior
from blurmatte.sweep.model.priors import MotionPrior
from blurmatte.sweep.model.silhouette import as_silhouette
from blurmatte.sweep.model.state import State
from blurmatte.sweep.model.student_t import VARIANCE
from blurmatte.sweep.see_through import opacity_of
from blurmatte.sweep.sweep import Sweep


@dataclass(frozen=True, eq=False)
class DiscColors:
    """A disc in a frame of a clip, and what the frame says of its colors."""

    sweep: Sweep
    mean: ColorModel  # the line of the mean color
    axes: Array  # (3, 3) float: columns along the mean color, the largest spread, and the smallest
    # Log Bayes factors of two paints against one, and of any colors against two
    log_odds: tuple[float, float]

    @property
    def normals(self) -> Array:
        """(3, n) perpendicular to the line or plane of colors that this frame decides for alone."""
        two, more = (odds > DECISIVE_LOG_BAYES_FACTOR for odds in self.log_odds)
        return self.axes[:, 3 if more else 2 :] if two else self.mean.normals

    @property
    def plane(self) -> ColorModel:
        """Of two paints: the information on its turn about the mean is twice the log Bayes factor."""
        first, second, _ = self.axes.T
        about_mean = 1 / (2 * max(self.log_odds[0], 0.5))  # radians²; a line has any angle
        covariance = about_mean * np.outer(second, second)
        covariance += np.radians(self.mean.angle_std) ** 2 * np.outer(first, first)
        mean = self.mean
        return ColorModel(self.axes[:, :2], covariance, to_srgb=mean.to_srgb, mean=mean.mean)


def fit_disc(
    image: LinearImage, plate: LinearImage, streak: Streak, model: ColorModel | None = None
) -> Sweep:
    """A disc on a parabola: the quick part of `fit_sweep`, for the frames of a clip.

    The noise is known. Without a model the object has one paint. The result need not explain the
    streak, see `Sweep.rejection`. It is corrected for what a clip's codec removed of its change
    (`codec_loss`), not for colors that the file blurred.
    """
    return _quick_disc(image, plate, streak, model)[2]


def fit_disc_colors(image: LinearImage, plate: LinearImage, streak: Streak) -> DiscColors:
    """As `fit_disc` without a model, or a disc of varied colors if that is decisively likelier.

    Correlated noise looks like a field of colors. Costs are compared with the noise raised to that
    which varied colors leave in the hue of blocks, so that a field that is no stronger gains nothing.
    """
    disc, search, sweep = _quick_disc(image, plate, streak)
    varied = with_varied_colors(disc)
    for _ in range(2):  # the second time with axes along the colors of the first
        varied = minimize(with_principal_axes(varied), search.bounds, MAX_STEPS)
    noisy = varied.observation.raised(hue_inflation(varied))

    def cost(state: State, paints: int) -> float:
        """Of a shape whose colors vary along so many axes, in that noise."""
        color = replace(noisy.color, varied=paints)
        return with_principal_axes(state.relit(replace(noisy, color=color))).cost

    two, mean = cost(varied, 2), sweep.model
    odds = cost(disc, 1) - two, two - cost(varied, 3)
    if odds[0] > DECISIVE_LOG_BAYES_FACTOR:
        mean = sweep_of(Candidate(varied.relit(varied.observation.of_one_paint)), image).model
        sweep = sweep_of(Candidate(varied), image)
    return DiscColors(sweep, mean, varied.observation.color.axes, odds)


def fit_stretch(
    image: LinearImage,
    plate: LinearImage,
    streak: Streak,
    model: ColorModel,
    start: Sweep | None,
    prior: MotionPrior,
) -> tuple[Array, Array]:
    """The stretch (2,) of the disc that explains a streak if it may be an ellipse, and its covariance.

    The stretch is that of the parameters of `Silhouette`; the noise is known.
    """
    search = Multistart.of(streak, image, plate, ColorPrior.of(model))
    search, one_paint, _ = best_discs(search.with_prior(prior), start)
    disc = one_paint[0]
    ellipse = disc.of_kind(replace(as_silhouette(disc.silhouette), order=2))
    ellipse = minimize(ellipse, search.bounds, MAX_STEPS, ROUGH_TOLERANCE)
    covariance = ellipse.variance_inflation * VARIANCE * ellipse.inverse_curvature_of("stretch")
    return ellipse.shape[ellipse.silhouette.at("stretch")], covariance


def _quick_disc(
    image: LinearImage, plate: LinearImage, streak: Streak, model: ColorModel | None = None
) -> tuple[State, Multistart, Sweep]:
    """The disc of a quick search with the noise that it estimates, the search, and the sweep."""
    color = ColorPrior.of(model) if model is not None else ColorPrior.of(None).of_one_paint
    search = quick_search(streak, image, plate, color)
    disc = search.soft()
    inflation = noise_inflation(disc)
    if inflation > 1:
        disc = search.with_noise_inflated(inflation).soft()
    if has_pattern(disc) or _may_be_painted(disc, model, image):
        patterned = fit_pattern(disc, search.bounds)
        state = patterned.state.relit(disc.observation)
        return disc, search, before_loss(sweep_of(patterned, image), state, image)
    by_hue = fitted_to_hue(disc, search.bounds)
    sweep = before_loss(sweep_of(Candidate(by_hue), image), by_hue, image)
    if image.meta.sharing is not None or by_hue is disc:
        return disc, search, sweep
    # Codecs of clips quantize chroma where something moves: residuals of hue alone correlate then.
    known = sweep_of(Candidate(disc), image).diagnostics
    return disc, search, replace(sweep, diagnostics=known)


def _may_be_painted(disc: State, model: ColorModel | None, image: LinearImage) -> bool:
    """Whether a disc may have a pattern: of colors that vary, in an image whose file shows them all.

    One that the plate is seen through has the pattern of the plate.
    """
    is_varied = model is not None and model.rank > 1 and image.meta.sharing is None
    return is_varied and may_have_pattern(disc) and opacity_of(disc).value == 1
