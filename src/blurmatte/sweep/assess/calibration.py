"""The error of alpha, calibrated against the truth of two renderers.

Fits underestimate their error, for no model is complete. The error of alpha is known for rendered
pictures. In this file s is the claimed error of alpha, the root mean
square over the streak, and

    log (s' / s) = b + Σ_j c_j t_j,    c_j ≥ 0,

is its calibration with the terms t_j of `ErrorTerms`, fitted by quantile regression (pinball loss) on
scenes of which the data file names the provenance, and conformal for each class of file: s' is
multiplied so that twice s' is exceeded by the same fraction of the pictures of each class; each picture
shows a kind of object that was left out of the fit.

Those pictures were solved without a given color, and the errors of some are those of the color that was
fitted. Where the color is given exactly, s' is multiplied by a smaller factor. Errors of a single
solver are multiplied by a factor for each class of files. These factors are conformal too
(benchmarks/given_color.py).

The odds that a hypothesis has the alpha nearest to the truth are exp(−Σ_j c_j t_j) with the terms of
`OddsTerms`, fitted to the same pictures by conditional logistic regression [McFadden 1974].
"""

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from functools import cache
from importlib import resources

import numpy as np

COMPRESSED, UNCOMPRESSED = "compressed", "uncompressed"  # classes of files
_DATA = "calibration.json"


@dataclass(frozen=True)
class ErrorTerms:
    """Causes of an error larger than claimed, each 0 or more; 0 means no evidence for the cause.

    Disagreements are log(1 + d/s) with the root mean square difference d of alpha.
    """

    # Disagreement with the likeliest alpha without a shape, or of the likeliest shape with it
    shapeless: float = 0.0
    one_paint: float = 0.0  # the least disagreement with another hypothesis of one paint
    mean: float = 0.0  # that of the other hypotheses in the mean
    least: float = 0.0  # that of the one that differs least
    correlation: float = 0.0  # log of the variance inflation of the likeliest hypothesis
    color_spread: float = 0.0  # spread of color across its mean, radians
    # Log(1 + σ) of the standard deviation of the color's direction, degrees
    color_angle: float = 0.0
    radius: float = 0.0  # log(1 + σ) of the standard deviation of the radius, percent
    # Log(1 + σ) of the standard deviation of the rim's blur, percent of the radius
    blur: float = 0.0
    residuals: float = 0.0  # log of the residual excess
    noise: float = 0.0  # log of the noise inflation
    without_shape: float = 0.0  # 1 if alpha without a shape is the likeliest hypothesis
    small_claim: float = 0.0  # log of 0.05 over the claim

    def __post_init__(self) -> None:
        wrong = [name for name, value in asdict(self).items() if not value >= 0]
        if wrong:
            raise ValueError(f"terms must be 0 or more, got {wrong[0]} = {getattr(self, wrong[0])}")


@dataclass(frozen=True)
class OddsTerms:
    """What counts against a hypothesis, compared with others about one picture."""

    seen: float = 0.0  # log(1 + s/s₀) of the difference s of scores from the likeliest, nats
    unseen: float = 0.0  # the same of the loss of pixels to which its colors were not fitted
    varied: float = 0.0  # 1 if its colors vary
    curved: float = 0.0  # number of parameters of its path, those of a line apart
    growing: float = 0.0  # 1 if it is a disc that grows
    outline: float = 0.0  # 1 if its shape is no disc
    shapeless: float = 0.0  # 1 if it has no shape


# Subject of each term, a key of `explain.solution`; None if it corrects the claim without a cause.
REASONS = {
    "shapeless": "shape",
    "one_paint": "disagreement",
    "mean": "disagreement",
    "least": "disagreement",
    "correlation": "correlation",
    "color_spread": "colors",
    "color_angle": "color",
    "radius": "size",
    "blur": "blur",
    "residuals": "correlation",
    "noise": "file",
    "without_shape": "no shape",
    "small_claim": None,
}


@dataclass(frozen=True)
class ErrorCalibration:
    """The fitted calibration."""

    intercept: float  # b
    coefficients: Mapping[str, float]  # c of each of the `ErrorTerms`, 0 or more
    class_factors: Mapping[str, float]  # by which the errors of a class of files are multiplied
    provenance: str = ""  # data of the fit
    odds: Mapping[str, float] = field(default_factory=dict)  # c of each of the `OddsTerms`
    exact_color: float = 1.0  # by which errors are multiplied if the color is given exactly
    # By which those of a solver are multiplied: its name and "given" or "fitted" color; class of file
    solver_factors: Mapping[str, Mapping[str, float]] = field(default_factory=dict)

    def factor(self, terms: ErrorTerms, file_class: str, exact_color: bool = False) -> float:
        """Factor of a claimed error."""
        exponent = self.intercept + sum(self._parts(terms).values())
        by_color = self.exact_color if exact_color else 1.0
        return float(by_color * self.class_factors[file_class] * np.exp(exponent))

    def log_odds_against(self, terms: OddsTerms) -> float:
        """Negative log odds of a hypothesis."""
        parts = (self.odds[name] * value for name, value in asdict(terms).items())
        return float(sum(parts))

    def solver_factor(self, solver: str, file_class: str, exact_color: bool) -> float:
        """Factor of the claimed error of a solver, without comparing it with other hypotheses."""
        return self.solver_factors[f"{solver}, {'given' if exact_color else 'fitted'}"][file_class]

    def reasons(self, terms: ErrorTerms) -> list[str]:
        """Subjects of up to three terms that increase the error most, the largest first."""
        parts = sorted(self._parts(terms).items(), key=lambda part: -part[1])
        large = [REASONS[name] for name, part in parts if part > 0.2]  # 22 % of the error
        return list(dict.fromkeys(name for name in large if name is not None))[:3]

    def _parts(self, terms: ErrorTerms) -> dict[str, float]:
        return {name: self.coefficients.get(name, 0.0) * t for name, t in asdict(terms).items()}


@cache
def fitted_calibration() -> ErrorCalibration:
    """The calibration that ships with the package."""
    # Not by the documents of `files`, which lie above; the file is part of the package, and correct.
    text = resources.files(__package__).joinpath(_DATA).read_text(encoding="utf-8")
    return ErrorCalibration(**json.loads(text))
