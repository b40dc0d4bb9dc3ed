"""Methods that are scored: blurmatte's solve, its first candidate, and other methods.

Each is a function of a `Case`, image and plate with the truth for those that are given it, and
returns a Solution, or a Layer if it claims no errors. Raising a BlurmatteError is a rejection.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from benchmarks.accuracy import against_other_methods as against
from benchmarks.accuracy.against_other_methods import Case

from blurmatte.background import Matching
from blurmatte.background.fit_match import match_plate
from blurmatte.calibration import with_noise
from blurmatte.layer import Layer
from blurmatte.matting import Quality, Smooth, SolutionStats, solve
from blurmatte.matting.solution import Solution
from blurmatte.radiometry import LinearImage
from blurmatte.streaks import Streak, require_streaks
from blurmatte.sweep import Sweep
from blurmatte.sweep.assess.diagnostics import sweep_of
from blurmatte.sweep.fit.multistart import Multistart
from blurmatte.sweep.fit.ranking import Candidate
from blurmatte.sweep.model.color_field import ColorPrior

OURS = "blurmatte"
NOTHING_MORE = "plate"
_OTHERS = ("key, tuned", "pm cf, best", "published")  # names in against_other_methods


@dataclass(frozen=True)
class Method:
    """A method by its name.

    Parameters
    ----------
    name : str
    given : str
        What it gets besides the image.
    answer : callable
        Case to Solution or Layer.
    """

    name: str
    given: str
    answer: Callable[[Case], Solution | Layer]


def methods() -> dict[str, Method]:
    """All methods by name, in the order of the tables."""
    known = {method.name: method for method in against.methods()}
    others = [
        Method(name, known[name].given, partial(_with_matched_plate, known[name].layer))
        for name in _OTHERS
    ]
    ours = [
        Method(OURS, NOTHING_MORE, lambda case: solve(case.image, case.plate)),
        Method("blurmatte, true color", "plate, true color", _with_true_color),
        Method("first disc", NOTHING_MORE, lambda case: _first_disc(case).solution),
        Method("first disc, smooth", NOTHING_MORE, _smooth_with_first_color),
    ]
    return {method.name: method for method in (*ours, *others)}


@dataclass(frozen=True, eq=False)
class _FirstDisc:
    """The best disc of one paint, the simplest hypothesis."""

    image: LinearImage
    plate: LinearImage
    streak: Streak
    sweep: Sweep

    @property
    def solution(self) -> Solution:
        """Alpha of the disc, and the light that it leaves: C − (1 − α) B."""
        alpha, alpha_std = self.sweep.alpha, self.sweep.alpha_std
        through, off = 1 - alpha[..., None], alpha_std[..., None]
        light = self.image.rgb - through * self.plate.rgb
        variance = self.image.variance + through**2 * self.plate.variance
        outside = alpha == 0
        stats = SolutionStats(
            sum_alpha=float(alpha.sum()),
            sum_alpha_std=self.sweep.area_std(),
            alpha_scale_std=0.0,  # part of the disc's covariance
        )
        return Solution(
            alpha,
            alpha_std,
            np.where(outside[..., None], 0.0, light),
            np.sqrt(variance + (self.plate.rgb * off) ** 2),
            outside * np.uint8(Quality.OUTSIDE),
            self.sweep.model,
            "first disc",
            stats,
            self.sweep,
        )


def _first_disc(case: Case) -> _FirstDisc:
    """Of the strongest streak."""
    image, plate = with_noise(case.image, match_plate(case.plate, case.image))
    streak = require_streaks(image, plate)[0]
    one_paint, _ = Multistart.of(streak, image, plate, ColorPrior(np.eye(3))).best()
    return _FirstDisc(image, plate, streak, sweep_of(Candidate(one_paint[0]), image))


def _smooth_with_first_color(case: Case) -> Solution:
    disc = _first_disc(case)
    return solve(
        disc.image,
        disc.plate,
        disc.sweep.model,
        Smooth(),
        streak=disc.streak,
        matching=Matching.NONE,
    )


def _with_true_color(case: Case) -> Solution:
    return solve(case.image, case.plate, case.model)


def _with_matched_plate(layer: Callable[[Case], Layer], case: Case) -> Layer:
    """Of another method, which gets the plate as blurmatte matches it to the image."""
    return layer(replace(case, plate=match_plate(case.plate, case.image)))
