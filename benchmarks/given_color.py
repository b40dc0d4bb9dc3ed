"""Factors of errors where the true color is given, and of those of a single solver.

Solves the scenes of benchmarks/accuracy/verdict.py with their true color and without, by all hypotheses
and by each solver. A factor is half the conformal 95 % quantile of true over claimed error, so that
twice the claimed error is exceeded by one picture of twenty. Those of single solvers are at least 1,
for standard errors of pixels are honest, and with a fitted color at least those with a given one. That
of the true color is for both classes of files together.

Run: python -m benchmarks.given_color [--seeds N], and copy the numbers to calibration.json.
"""

import argparse
import json
import warnings

import numpy as np
from benchmarks.accuracy.verdict import FILES, KINDS, draw, root_mean_square
from benchmarks.trials import photograph

import blurmatte as bm
from blurmatte.sweep.assess.calibration import COMPRESSED, UNCOMPRESSED, fitted_calibration

FIRST_SEED = 91_000
EXCEEDED = 0.05  # fraction of the pictures whose error is more than twice the claimed one
WITHOUT_TRUE_COLOR = "two balls that cross", "ball of many colors", "sheet of many colors"
SOLVERS = {"Smooth": bm.Smooth(), "Pixelwise": bm.Pixelwise()}


def ratio(solution: bm.Solution, alpha: np.ndarray) -> float:
    """True over calibrated error of all hypotheses, or over the claimed one of a solver."""
    known = solution.streak & solution.known
    stats = solution.stats
    claim = stats.claimed_error if stats.error_terms is None else stats.alpha_error
    return root_mean_square((solution.alpha - alpha)[known]) / claim


def ratios(seeds: int) -> dict[tuple[str, str], list[float]]:
    """By solver and color, and class of files."""
    found: dict[tuple[str, str], list[float]] = {}
    kinds = [kind for kind in KINDS if kind not in WITHOUT_TRUE_COLOR]
    pictures = [(k, f, FIRST_SEED + s) for s in range(seeds) for k in kinds for f in FILES]
    for kind, file, seed in pictures:
        truth = KINDS[kind](draw(seed)).truth
        image, plate = photograph(truth, FILES[file], seed)
        file_class = COMPRESSED if FILES[file].jpeg_quality else UNCOMPRESSED
        asked = [("exact_color", truth.model, None)]
        asked += [(f"{name}, given", truth.model, one) for name, one in SOLVERS.items()]
        asked += [(f"{name}, fitted", None, one) for name, one in SOLVERS.items()]
        for name, model, solver in asked:
            try:
                solution = bm.solve(image, plate, model, solver)
            except bm.BlurmatteError:
                continue
            found.setdefault((name, file_class), []).append(ratio(solution, truth.layer.alpha))
    return found


def half_quantile(many: list[float]) -> float:
    """Half the conformal quantile: the largest of less than twenty."""
    level = min((1 - EXCEEDED) * (len(many) + 1) / len(many), 1.0)
    return float(np.quantile(many, level, method="higher")) / 2


def factors(found: dict[tuple[str, str], list[float]]) -> dict[str, object]:
    """The entries of calibration.json."""
    exact = [r for (name, _), many in found.items() if name == "exact_color" for r in many]
    known, solvers = fitted_calibration().exact_color, dict[str, dict[str, float]]()
    for (name, file_class), many in found.items():
        if name != "exact_color":
            least = solvers.get(name.replace("fitted", "given"), {}).get(file_class, 1.0)
            half = max(half_quantile(many), least)
            solvers.setdefault(name, {})[file_class] = round(half, 2)
    return {"exact_color": round(known * half_quantile(exact), 2), "solver_factors": solvers}


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.given_color", description=__doc__)
    parser.add_argument("--seeds", type=int, default=2)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", bm.errors.BlurmatteWarning)
        print(json.dumps(factors(ratios(parser.parse_args().seeds)), indent=2))


if __name__ == "__main__":
    main()
