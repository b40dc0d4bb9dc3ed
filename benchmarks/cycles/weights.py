"""Do the weights of hypotheses agree with how often the likeliest is the nearest to the truth?

Pictures of the parts tune and own are solved, and the alphas of all hypotheses compared with the
truth.
"""

import warnings
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from benchmarks.cycles.own import CAMERAS
from benchmarks.cycles.pictures import OWN, TUNE, Picture, find_pictures
from benchmarks.cycles.workers import run_each
from benchmarks.table import Table

from blurmatte.checks import rows_columns
from blurmatte.errors import BlurmatteError
from blurmatte.matting import solve
from blurmatte.matting.case import Answer, Case
from blurmatte.matting.hypotheses import Averaged, WeightedHypotheses, adds_light
from blurmatte.matting.maps import PixelMaps

_GROUPS = 4  # of equally many pictures, ordered by the weight of the likeliest


@dataclass(frozen=True)
class Weighed:
    """One solved picture.

    Parameters
    ----------
    renderer, camera : str
    weight : float
        The largest one.
    is_nearest : bool
        Whether no other hypothesis has less root mean square error of alpha.
    """

    renderer: str
    camera: str
    weight: float
    is_nearest: bool


@dataclass(frozen=True)
class _Watched(Averaged):
    """The usual solver, which keeps the hypotheses that it weighs."""

    found: list[WeightedHypotheses] = field(default_factory=list, repr=False)

    def answer(self, case: Case, out: PixelMaps | None) -> Answer:
        """As that of `Averaged`."""
        if not adds_light(case):
            self.found.append(WeightedHypotheses.of(case.fitted or case, without_shape=True))
        return super().answer(case, out)


def weigh(root: Path, processes: int) -> Table:
    """The table of all pictures of the two parts."""
    pictures = find_pictures(root, (TUNE, OWN), CAMERAS)
    found = [one for _, one in run_each(_weighed, pictures, processes) if isinstance(one, Weighed)]
    return reliability(found)


def reliability(pictures: Sequence[Weighed]) -> Table:
    """Stated and observed frequency in groups of equally many pictures of a renderer and a camera."""
    rows = []
    for renderer, camera in sorted({(one.renderer, one.camera) for one in pictures}):
        alike = [one for one in pictures if (one.renderer, one.camera) == (renderer, camera)]
        alike.sort(key=lambda one: one.weight)
        for group in np.array_split(np.arange(len(alike)), min(_GROUPS, len(alike))):
            some = [alike[i] for i in group]
            stated = float(np.mean([one.weight for one in some]))
            observed = float(np.mean([one.is_nearest for one in some]))
            std = float(np.sqrt(stated * (1 - stated) / len(some)))
            rows.append((f"{renderer}, {camera}", stated, observed, std, len(some)))
    return Table(
        "hypothesis_weights",
        "Is the likeliest hypothesis as often the nearest to the truth as its weight states?",
        "Pictures of the part tune of Blender Cycles and of blurmatte's own renderer, nothing given, "
        "in four groups by the weight of the likeliest hypothesis. stated: mean of this weight. "
        "observed: fraction of the pictures in which no other hypothesis has an alpha of less root "
        "mean square error. std: standard deviation of that fraction if the weights are right.",
        ("pictures of", "stated", "observed", "std", "pictures"),
        rows,
        x="stated",
        lines="pictures of",
        y="observed",
    )


def _weighed(picture: Picture) -> Weighed | None:
    """None without an answer or with a single hypothesis."""
    solver = _Watched()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        truth = picture.truth()
        try:
            solve(*picture.read(), solver=solver)
        except BlurmatteError:
            return None
    if not solver.found or len(solver.found[-1].weights) < 2:
        return None
    found = solver.found[-1]
    true = truth.layer.alpha[rows_columns(found.box)]
    errors = [np.nanmean((one.alpha - true) ** 2) for one in found.estimates]
    best = int(np.argmax(found.weights))
    is_nearest = bool(errors[best] <= min(errors))
    facts = picture.facts
    return Weighed(facts.renderer, picture.camera, float(found.weights[best]), is_nearest)
