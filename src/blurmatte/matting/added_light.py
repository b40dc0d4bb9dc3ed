"""The answer of an object that hides nothing: the light that it added to the plate, and alpha 0.

In this file C is the image's light, B the plate's, and χ the part of the exposure during which the
object was at a pixel. An opacity of 0 ± s gives alpha the error s χ, and with it the light C − B the
error s χ B.
"""

import numpy as np

from blurmatte.checks import rows_columns
from blurmatte.matting.calibration import MIN_ALPHA, grade_of
from blurmatte.matting.case import Answer, Case, Solver
from blurmatte.matting.maps import Grade, PixelMaps, Quality
from blurmatte.matting.stats import SolutionStats, SweepSummary
from blurmatte.streaks import dilated

_MARGIN_PX = 4  # around the streak: light that is too faint for its mask


def adds_light(case: Case) -> bool:
    """Whether the likeliest object of a case hides nothing."""
    found = case.hypotheses
    return found is not None and found.best.silhouette.opacity == 0


def answer_of_light(case: Case, out: PixelMaps | None, solver: Solver) -> Answer:
    """Light and errors of an object that hides nothing.

    The light of a clipped pixel is the least that it may be, and its error as large.

    out: arrays to write to.
    """
    assert case.hypotheses is not None
    sweep, size = case.hypotheses.best, case.image.size
    maps = PixelMaps.zeros(*size[::-1], case.image.rgb.dtype) if out is None else out
    for values in maps[:4]:
        values[...] = 0
    maps.quality[...] = case.flags | np.uint8(Quality.OUTSIDE)
    box = case.box_with([sweep])
    place, near = rows_columns(box), maps.within(box)
    image, plate = case.image.crop(box), case.plate.crop(box)
    chi = sweep.covered_within(box)
    inside = dilated(case.streak.mask, _MARGIN_PX)[place] | (chi > MIN_ALPHA)
    error = sweep.opacity_std * chi
    light = image.rgb - plate.rgb
    std = np.sqrt(image.variance + plate.variance + (plate.rgb * error[..., None]) ** 2)
    known = (image.valid & plate.valid)[..., None]
    std = np.where(known, std, np.maximum(std, np.abs(light)))
    near.quality[inside] &= ~np.uint8(Quality.OUTSIDE)
    for target, values in zip(near[1:4], (error, light, std), strict=True):
        target[inside] = values[inside]
    of_streak = error[inside & (chi > MIN_ALPHA)]
    alpha_error = float(np.sqrt(np.mean(of_streak**2))) if of_streak.size else 0.0
    grade, untried = grade_of(alpha_error, 0.0), case.hypotheses.untried
    because = () if grade is Grade.CONFIRMED else ("opacity",)
    if untried:
        because = ("time", *because)
        grade = Grade.PLAUSIBLE if grade is Grade.CONFIRMED else grade
    stats = SolutionStats(
        sum_alpha_std=float(error.sum()),
        alpha_scale_std=0.0,
        sweep=SweepSummary.of(sweep),
        claimed_error=alpha_error,
        grade_reasons=because,
        grade=grade,
        alpha_error=alpha_error,
        untried=untried,
    )
    return Answer(
        maps,
        sweep.model,
        maps.solved,
        stats,
        solver,
        locates=True,
        assumes="",
        separates_shadow=True,
    )
