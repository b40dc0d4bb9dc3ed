"""Do the weights of hypotheses agree with how often the likeliest is the nearest to the truth?

Pictures of the parts tune and own are solved, and the alphas of all hypotheses compared with the
truth. The odds of the weights are fitted in the same way to the parts learn and own, by conditional
logistic regression [McFadden 1974].
"""

import json
import warnings
from collections.abc import Sequence
from dataclasses import astuple, dataclass, field, fields
from itertools import compress
from pathlib import Path

import numpy as np
import scipy
from benchmarks.cycles.calibrate import CALIBRATION, Array
from benchmarks.cycles.own import CAMERAS
from benchmarks.cycles.pictures import LEARN, OWN, TUNE, Picture, find_pictures
from benchmarks.cycles.workers import run_each, with_progress
from benchmarks.table import Table

from blurmatte.checks import rows_columns
from blurmatte.errors import BlurmatteError
from blurmatte.matting import solve
from blurmatte.matting.case import Answer, Case
from blurmatte.matting.hypotheses import Averaged, WeightedHypotheses
from blurmatte.matting.maps import PixelMaps
from blurmatte.sweep.assess.calibration import OddsTerms
from blurmatte.sweep.assess.model_selection import leaves_only_noise, odds_terms

_GROUPS = 4  # of equally many pictures, ordered by the weight of the likeliest
_ALIKE = 1.1  # ratio of the errors of two hypotheses of which neither is nearer to the truth
_RIDGE = 0.01  # of the coefficients, against the log likelihood of a picture


@dataclass(frozen=True)
class Weighed:
    """One solved picture.

    Parameters
    ----------
    renderer, camera : str
    terms : (n,) list of OddsTerms
        Of the possible hypotheses; empty where only noise remains, for no odds are used there.
    weights : (n,) float
    errors : (n,) float
        Root mean square errors of their alpha.
    """

    renderer: str
    camera: str
    terms: Sequence[OddsTerms]
    weights: Array
    errors: Array

    @property
    def weight(self) -> float:
        """The largest one."""
        return float(self.weights.max())

    @property
    def is_nearest(self) -> bool:
        """Whether no other hypothesis has less error than that of the largest weight."""
        return bool(self.errors[int(np.argmax(self.weights))] <= self.errors.min())


@dataclass(frozen=True)
class _Watched(Averaged):
    """The usual solver, which keeps the hypotheses that it weighs."""

    found: list[WeightedHypotheses] = field(default_factory=list, repr=False)

    def answer(self, case: Case, out: PixelMaps | None) -> Answer:
        """As that of `Averaged`."""
        known = case.hypotheses
        if known is None or known.best.silhouette.opacity > 0:
            self.found.append(WeightedHypotheses.of(case.fitted or case, without_shape=True))
        return super().answer(case, out)


def weigh(root: Path, processes: int) -> Table:
    """The table of all pictures of the parts tune and own."""
    return reliability(_gather(root, (TUNE, OWN), processes))


def write_odds(root: Path, processes: int) -> Path:
    """Fit the odds to the parts learn and own, and write the package's calibration; its path."""
    found = fit_odds(_gather(root, (LEARN, OWN), processes))
    known = json.loads(CALIBRATION.read_text(encoding="utf-8"))
    CALIBRATION.write_text(json.dumps({**known, "odds": found}, indent=2) + "\n", encoding="utf-8")
    return CALIBRATION


def fit_odds(pictures: Sequence[Weighed]) -> dict[str, float]:
    """Coefficients of the `OddsTerms` for which the nearest hypotheses are the most probable."""
    names = [one.name for one in fields(OddsTerms)]
    pictures = [one for one in pictures if one.terms]
    terms = [np.array([astuple(one) for one in picture.terms]) for picture in pictures]
    nearest = [one.errors <= _ALIKE * one.errors.min() for one in pictures]

    def loss(c: Array) -> tuple[float, Array]:
        """Negative log likelihood of a picture with the ridge, and its gradient."""
        value, gradient = 0.0, np.zeros(len(c))
        for X, near in zip(terms, nearest, strict=True):
            p = scipy.special.softmax(-X @ c)
            value -= float(np.log(p[near].sum()))
            gradient += (p[near] / p[near].sum()) @ X[near] - p @ X
        mean = value / len(terms) + _RIDGE * float(c @ c)
        return mean, gradient / len(terms) + 2 * _RIDGE * c

    found = scipy.optimize.minimize(loss, np.zeros(len(names)), jac=True).x
    return {name: round(float(c), 2) for name, c in zip(names, found, strict=True)}


def _gather(root: Path, parts: Sequence[str], processes: int) -> list[Weighed]:
    pictures = find_pictures(root, parts, CAMERAS)
    results = (result for _, result in run_each(_weighed, pictures, processes))
    shown = with_progress(results, len(pictures), "pictures", lambda one: isinstance(one, Weighed))
    return [one for one in shown if isinstance(one, Weighed)]


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
    errors = [float(np.sqrt(np.nanmean((one.alpha - true) ** 2))) for one in found.estimates]
    evidence = [one.evidence for one in compress(found.all, found.possible)]
    facts, which = picture.facts, np.array(found.possible)
    return Weighed(
        facts.renderer,
        picture.camera,
        [] if leaves_only_noise(evidence) else odds_terms(evidence),
        found.weights[which],
        np.array(errors)[which],
    )
