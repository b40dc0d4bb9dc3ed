"""Numbers that changes of names and structure must not change, to one part in a billion.

Solves rendered scenes of every kind, as PNG and as JPEG, and the real pairs if they are available, and
stores the results as numbers in tests/golden/golden.json. A change that is meant to change results
records them again and states the reason.

Processors differ in the order of sums. Kernels, BLAS and NumPy therefore use the instructions that all
x86-64 processors with AVX2 have, so that the numbers hold on each of them.

Run: python -m benchmarks.golden [--record]
"""

import argparse
import json
import os
import platform
import subprocess
import sys
import warnings
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from benchmarks.accuracy.verdict import FILES, KINDS, draw
from benchmarks.table import ROOT
from benchmarks.trials import photograph

import blurmatte as bm

GOLDEN = ROOT / "tests" / "golden" / "golden.json"
TOLERANCE = 1e-9  # relative to the largest number of a scene's entry
COMMON_INSTRUCTIONS = {
    "NUMBA_CPU_NAME": "x86-64-v3",
    "NUMBA_CPU_FEATURES": "+avx2,+bmi,+bmi2,+f16c,+fma,+lzcnt,+movbe,+popcnt",
    "OPENBLAS_CORETYPE": "Haswell",
    "OPENBLAS_NUM_THREADS": "1",
    "NPY_DISABLE_CPU_FEATURES": "X86_V4 AVX512_ICL AVX512_SPR",
}  # environment of a process; its libraries read it when they are imported
FIRST_SEED, SEEDS = 91_000, 2
PROJECTIONS = 3  # of a map on fields of random signs
REAL_PAIRS = {
    "floorball1": "floorball_plate",
    "floorball2": "floorball_plate",
    "pen": "pen_plate",
    "volleyball": "volleyball_plate",
}


def scenes() -> dict[str, tuple[str, str, int]]:
    """Kind, file and seed of every rendered scene, by name."""
    return {
        f"{kind}, {file}, {seed}": (kind, file, FIRST_SEED + seed)
        for kind in KINDS
        for file in FILES
        for seed in range(SEEDS)
    }


def entry_of_scene(kind: str, file: str, seed: int) -> dict[str, Any]:
    """What `solve` makes of a rendered scene."""
    case = KINDS[kind](draw(seed))
    return entry(*photograph(case.truth, FILES[file], seed))


def entry(image: bm.LinearImage, plate: bm.LinearImage) -> dict[str, Any]:
    """What `solve` makes of two pictures, as plain numbers; or the sentence by which it refuses."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", bm.errors.BlurmatteWarning)
        try:
            solution = bm.solve(image, plate)
        except bm.BlurmatteError as error:
            return {"refusal": str(error)}
    sweep = solution.sweep
    known = np.isfinite(solution.alpha) & np.isfinite(solution.alpha_std)
    numbers: dict[str, Any] = {
        "solver": solution.solver,
        "grade": str(solution.grade),
        "alpha": projected(np.where(known, solution.alpha, 0)),
        "alpha_std": projected(np.where(known, solution.alpha_std, 0)),
        "quality": np.bincount(solution.quality.ravel(), minlength=256).tolist(),
        "color": solution.model.basis.tolist(),
    }
    if sweep is not None:
        diagnostics = asdict(sweep.diagnostics)
        numbers |= {
            "path": sweep.path.tolist(),
            "shape": sweep.shape.tolist(),
            "std": np.sqrt(np.diag(sweep.covariance)).tolist(),
            "diagnostics": diagnostics,
        }
    return numbers


def projected(values: np.ndarray) -> list[float]:
    """The sum of a map, and its products with fields of random signs."""
    signs = np.random.default_rng(0).choice((-1.0, 1.0), (PROJECTIONS, *values.shape))
    return [float(values.sum()), *(float((values * one).sum()) for one in signs)]


def differences(known: Any, found: Any, scale: float = 1.0, where: str = "") -> list[str]:
    """Where two entries differ by more than the tolerance."""
    if isinstance(known, dict) and isinstance(found, dict):
        keys = sorted(set(known) | set(found))
        return [
            line
            for key in keys
            for line in differences(known.get(key), found.get(key), scale, f"{where}/{key}")
        ]
    if isinstance(known, list) and isinstance(found, list) and len(known) == len(found):
        largest = max((abs(x) for x in known if isinstance(x, float)), default=1.0)
        pairs = zip(known, found, strict=True)
        return [
            line
            for i, (a, b) in enumerate(pairs)
            for line in differences(a, b, max(largest, 1.0), f"{where}[{i}]")
        ]
    if isinstance(known, float) and isinstance(found, float):
        same = abs(known - found) <= TOLERANCE * max(scale, abs(known)) or known == found
        return [] if same or np.isnan([known, found]).all() else [f"{where}: {known} -> {found}"]
    return [] if known == found else [f"{where}: {known!r} -> {found!r}"]


def real_entries(folder: Path) -> dict[str, dict[str, Any]]:
    """Of the real pairs in a folder; of none if it does not exist."""
    if not folder.exists():
        return {}
    return {
        image: entry(
            *(bm.read(folder / f"{name}.png", transfer=bm.SRGB) for name in (image, plate))
        )
        for image, plate in REAL_PAIRS.items()
    }


def machine() -> dict[str, str]:
    """What rounding depends on."""
    return {"python": platform.python_version(), "numpy": np.__version__, "cpu": platform.machine()}


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.golden", description=__doc__)
    parser.add_argument("--record", action="store_true", help="replace the numbers")
    parser.add_argument("--real", type=Path, default=ROOT / "../shared/data/real")
    options = parser.parse_args()
    if any(os.environ.get(name) != value for name, value in COMMON_INSTRUCTIONS.items()):
        command = sys.executable, "-m", "benchmarks.golden", *sys.argv[1:]
        return subprocess.run(command, env={**os.environ, **COMMON_INSTRUCTIONS}).returncode
    from concurrent.futures import ProcessPoolExecutor

    names = scenes()
    with ProcessPoolExecutor() as pool:
        jobs = {name: pool.submit(entry_of_scene, *scene) for name, scene in names.items()}
        found = {name: job.result() for name, job in jobs.items()} | real_entries(options.real)
    found = json.loads(json.dumps(found))
    if options.record:
        GOLDEN.parent.mkdir(exist_ok=True)
        GOLDEN.write_text(json.dumps({"machine": machine(), "scenes": found}, indent=1) + "\n")
        return 0
    known = json.loads(GOLDEN.read_text())["scenes"]
    changed = [
        line
        for name in known
        if name in found
        for line in differences(known[name], found[name], where=name)
    ]
    print("\n".join(changed) or f"{len(found)} scenes are as they were")
    return int(bool(changed))


if __name__ == "__main__":
    sys.exit(main())
