"""Fit the calibration of alpha's error to the part learn of both renderers.

Pictures are solved, and the terms, the claim and the true error of each are kept in a journal of lines,
so that an interrupted run can be resumed. The fit is a quantile regression with coefficients of 0 or
more, one linear program; then a factor for each class of files is the conformal one [Romano, Patterson
& Candès 2019] with which twice the calibrated error is exceeded by one picture of twenty. Kinds
that are left out of the fit in turn show its error on unseen objects.
"""

import json
import warnings
from collections.abc import Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from benchmarks.cycles.errors import errors_of
from benchmarks.cycles.own import CAMERAS
from benchmarks.cycles.pictures import LEARN, OWN, Picture, find_pictures
from benchmarks.cycles.workers import run_each, with_progress
from benchmarks.table import Table

from blurmatte.errors import BlurmatteError
from blurmatte.matting import solve
from blurmatte.sweep.assess import calibration
from blurmatte.sweep.assess.calibration import COMPRESSED, UNCOMPRESSED, ErrorTerms

Array = npt.NDArray[np.float64]

JOURNAL = "calibration.jsonl"
CALIBRATION = Path(calibration.__file__).with_name("calibration.json")
QUANTILE = 0.6  # of the errors that the calibrated one exceeds
_EXCEEDED = 0.05  # fraction of the pictures whose error is more than twice the calibrated one
_MIN_ERROR = 1e-4  # of alpha: less is the truth's own sampling noise
_SPARSITY = 1e-3  # cost of a coefficient, so that terms of no use are 0
_TERMS = tuple(field.name for field in fields(ErrorTerms))


@dataclass(frozen=True)
class Sample:
    """One solved picture.

    Parameters
    ----------
    part, scene, camera, kind : str
    compressed : bool
        Whether its file is.
    terms : dict of str to float
        `ErrorTerms`.
    claim, error : float
        Root mean square error of alpha over the streak, claimed and true.
    """

    part: str
    scene: str
    camera: str
    kind: str
    compressed: bool
    terms: dict[str, float]
    claim: float
    error: float


def calibrate(root: Path, limit: int | None, processes: int, path: Path = CALIBRATION) -> Path:
    """Gather what is missing, and write a calibration, by default the package's; its path."""
    samples = gather(root, CAMERAS, limit, processes)
    parts = {part: sum(one.part == part for one in samples) for part in (LEARN, OWN)}
    provenance = (
        f"{parts[LEARN]} pictures of Blender Cycles, part learn of the second truth, and "
        f"{parts[OWN]} of blurmatte's own renderer; PNG and phone JPEG; "
        "benchmarks/cycles/calibrate.py"
    )
    known = json.loads(path.read_text(encoding="utf-8")) if path.is_file() else {}
    found = {**known, **fit(samples, provenance)}  # other factors are those of given_color.py
    path.write_text(json.dumps(found, indent=2) + "\n", encoding="utf-8")
    return path


def gather(root: Path, cameras: Sequence[str], limit: int | None, processes: int) -> list[Sample]:
    """Solve the pictures of learn and own that the journal lacks; all samples."""
    path = root / JOURNAL
    known = read_samples(path)
    done = {(one.part, one.scene, one.camera) for one in known}
    pictures = find_pictures(root, (LEARN, OWN), cameras)[:limit]
    missing = [p for p in pictures if (p.part, p.scene, p.camera) not in done]
    results = (result for _, result in run_each(_sample, missing, processes))
    for sample in with_progress(
        results, len(missing), "pictures", lambda one: isinstance(one, Sample)
    ):
        if isinstance(sample, Sample):
            known.append(sample)
            with path.open("a", encoding="utf-8") as journal:
                journal.write(json.dumps(vars(sample)) + "\n")
    return known


def read_samples(path: Path) -> list[Sample]:
    """Those of a journal; none if there is no file."""
    if not path.is_file():
        return []
    lines = path.read_text(encoding="utf-8").splitlines()
    return [Sample(**json.loads(line)) for line in lines]


def fit(samples: Sequence[Sample], provenance: str) -> dict[str, Any]:
    """The content of calibration.json."""
    intercept, coefficients = _regression(samples)
    ratios = _left_out_ratios(samples)
    compressed = np.array([one.compressed for one in samples])
    factors = {
        name: float(np.exp(np.quantile(ratios[which], 1 - _EXCEEDED))) / 2
        for name, which in ((COMPRESSED, compressed), (UNCOMPRESSED, ~compressed))
        if which.any()
    }
    return {
        "intercept": round(intercept, 4),
        "coefficients": {
            name: round(float(c), 4) for name, c in zip(_TERMS, coefficients, strict=True)
        },
        "class_factors": {name: round(factor, 4) for name, factor in factors.items()},
        "provenance": provenance,
    }


def by_kind(samples: Sequence[Sample]) -> Table:
    """Errors over calibrated errors of each kind, from the fit to all other kinds."""
    factors = fit(samples, "")["class_factors"]
    names = [COMPRESSED if one.compressed else UNCOMPRESSED for one in samples]
    calibrated = np.exp(_left_out_ratios(samples)) / [factors[name] for name in names]
    claimed = np.exp(_log_ratios(samples))
    errors, kinds = (np.array([getattr(one, x) for one in samples]) for x in ("error", "kind"))
    rows = [
        (
            str(kind),
            int(np.count_nonzero(own)),
            float(np.median(errors[own])),
            float(np.median(claimed[own])),
            float(np.mean(claimed[own] <= 2)),
            float(np.median(calibrated[own])),
            float(np.mean(calibrated[own] <= 2)),
            float(calibrated[own].max()),
        )
        for kind in sorted(set(kinds))
        for own in (kinds == kind,)
    ]
    return Table(
        "calibration_by_kind",
        "Does the calibrated error hold for kinds of objects that were not in its fit?",
        "Error of alpha over claimed and calibrated error, root mean squares over the streak. Each "
        "kind is evaluated with a fit to all other kinds.",
        (
            "kind",
            "pictures",
            "error",
            "error / claimed",
            "claimed ≤ 2",
            "error / calibrated",
            "calibrated ≤ 2",
            "worst",
        ),
        rows,
    )


def _sample(picture: Picture) -> Sample | None:
    """None without an answer, or if the answer is light alone, whose error is not calibrated."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        truth = picture.truth()
        image, plate = picture.read()
        try:
            solution = solve(image, plate)
        except BlurmatteError:
            return None
        errors = errors_of(solution, truth, picture.answers(truth), picture.facts)
    if errors.alpha_rmse is None or solution.stats.error_terms is None:
        return None
    return Sample(
        picture.part,
        picture.scene,
        picture.camera,
        picture.facts.kind,
        image.meta.sharing is not None,
        asdict(solution.stats.error_terms),
        float(solution.stats.claimed_error),
        float(errors.alpha_rmse),
    )


def _design(samples: Sequence[Sample]) -> Array:
    return np.array([[one.terms[name] for name in _TERMS] for one in samples])


def _log_ratios(samples: Sequence[Sample]) -> Array:
    return np.array([np.log(max(one.error, _MIN_ERROR) / one.claim) for one in samples])


def _left_out_ratios(samples: Sequence[Sample]) -> Array:
    """(n,) log errors over the calibrated ones, from fits without the kind of each."""
    kinds, ratios = np.array([one.kind for one in samples]), _log_ratios(samples)
    for kind in set(kinds):
        intercept, coefficients = _regression([one for one in samples if one.kind != kind])
        own = kinds == kind
        ratios[own] -= (
            intercept + _design([one for one in samples if one.kind == kind]) @ coefficients
        )
    return ratios


def _regression(samples: Sequence[Sample]) -> tuple[float, Array]:
    """Intercept and coefficients (n,) of the quantile regression, by a linear program."""
    from scipy.optimize import linprog

    X, y = _design(samples), _log_ratios(samples)
    n, p = X.shape
    ones = np.ones((n, 1))
    costs = np.concatenate(
        [[0, 0], np.full(p, _SPARSITY), np.full(n, QUANTILE), np.full(n, 1 - QUANTILE)]
    )
    equations = np.concatenate([ones, -ones, X, np.eye(n), -np.eye(n)], axis=1)
    found = linprog(costs, A_eq=equations, b_eq=y, bounds=(0, None), method="highs").x
    return float(found[0] - found[1]), np.asarray(found[2 : 2 + p])
