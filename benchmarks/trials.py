"""Common parts of the accuracy benchmarks: a ball in front of several plates, solved and compared.

A trial is a setting and a seed. The same seeds are used for every setting of a table, so that its
curves show the setting and not the draw.
"""

import os
import warnings
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import cache
from itertools import repeat
from multiprocessing import get_context, parent_process
from threading import Thread
from typing import Any, TypeVar

import numpy as np
from benchmarks.table import Cell

from blurmatte.color.model import ColorModel
from blurmatte.errors import ColorModelError, MotionError, PlateWarning
from blurmatte.matting import solve
from blurmatte.matting.solution import Solution
from blurmatte.metrics import alpha_rmse, alpha_sum_bias, calibration, false_alpha
from blurmatte.radiometry import LinearImage
from blurmatte.rendering import Ball, Camera, Rendering, Scene, Shot, colorful_plate, render
from blurmatte.rendering.plates import plain_plate, textured_plate, two_hue_plate
from blurmatte.rendering.shot import Drift
from blurmatte.trajectory import Trajectory

T = TypeVar("T")

SIZE = (256, 192)
SEEDS = 5
RADIUS, LENGTH = 10.0, 40.0  # pixels: alpha up to 0.5
ORANGE = np.array([0.80, 0.35, 0.06])
CODE = 1 / 255
STEADY = Drift()
PLATES = {
    "colorful": lambda size, seed: colorful_plate(size, seed, tile=40),
    "textured": textured_plate,
    "two hues": lambda size, seed: two_hue_plate(
        size, (0.45, 0.40, 0.36), (0.10, 0.22, 0.40), seed
    ),
    "plain": lambda size, seed: plain_plate(size, (0.30, 0.33, 0.36), seed),
}
KINDS = ("colorful", "textured", "plain")
SCENE = (
    f"An orange ball of radius {RADIUS:g} moves {LENGTH:g} pixels, alpha up to "
    f"{2 * RADIUS / LENGTH:g}, in pictures of {SIZE[0]}x{SIZE[1]}; the plate is the median of five "
    "frames."
)
COLUMNS = ("refused", "warned", "known", "alpha RMSE", "sum bias", "false alpha", "spread")
MEANING = (
    "Medians over {seeds} seeds, or over those that have an answer. refused: number without an answer, "
    "because color or streak were not found. warned: number with a warning about the plate. known: "
    "fraction of the true alpha in pixels with an answer. alpha RMSE, sum bias (relative): of the raw "
    "estimate where it is known. false alpha: RMS of the layer's alpha where the object never was. "
    "spread: RMS of (alpha - truth) / alpha_std; 1 is correct, more is overconfident."
)


def ball_path(seed: int) -> Trajectory:
    """A straight path of `LENGTH` pixels about the middle, in a random direction."""
    rng = np.random.default_rng(seed)
    angle, middle = rng.uniform(0, np.pi), np.array(SIZE) / 2 + rng.uniform(-10, 10, 2)
    half = LENGTH / 2 * np.array([np.cos(angle), np.sin(angle)])
    return Trajectory.line(middle - half, middle + half)


@cache
def rendering(kind: str, seed: int) -> Rendering:
    """The ball before a plate of a kind in `PLATES`."""
    return render(Scene(PLATES[kind](SIZE, seed), ball_path(seed), Ball(RADIUS, ORANGE)))


def photograph(
    truth: Rendering, camera: Camera, seed: int, drift: Drift = STEADY, frames: int = 5
) -> tuple[LinearImage, LinearImage]:
    """Image and plate, the plate as the median of several frames."""
    return Shot(truth.scene, camera, drift, frames, seed).photograph(truth)


@dataclass(frozen=True)
class AlphaErrors:
    """How far a solution's alpha is from the truth; the meaning is that of `MEANING`."""

    known: float
    rmse: float
    sum_bias: float
    false_alpha: float
    spread: float


@dataclass(frozen=True)
class Attempt:
    """What became of one trial: errors is None if blurmatte refused."""

    errors: AlphaErrors | None
    warned: bool


def attempt(
    image: LinearImage, plate: LinearImage, model: ColorModel | None, truth: Rendering
) -> Attempt:
    """Solve with the given colors, or with those found in the streak; compare alpha."""
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always", PlateWarning)
        try:
            errors = alpha_errors(solve(image, plate, model), truth)
        except (ColorModelError, MotionError):
            errors = None
    return Attempt(errors, any(issubclass(one.category, PlateWarning) for one in said))


def alpha_errors(solution: Solution, truth: Rendering) -> AlphaErrors | None:
    """Errors where alpha is known; None if that is nowhere in the streak."""
    true = truth.layer.alpha
    looked_at = np.where(solution.known, true, 0)
    if not looked_at.any():
        return None
    shown = true[solution.known & solution.streak].sum()
    z = calibration(solution.alpha, solution.alpha_std, true, where=looked_at > 0)
    return AlphaErrors(
        float(shown / true.sum()),
        alpha_rmse(solution.alpha, looked_at),
        alpha_sum_bias(solution.alpha, looked_at),
        false_alpha(solution.layer.alpha, true),
        z.spread,
    )


def alpha_rows(
    trial: Callable[..., Attempt],
    settings: Sequence[tuple[Any, ...]],
    quick: bool,
    seeds: int = SEEDS,
) -> list[tuple[Cell, ...]]:
    """One row for each setting: its cells, then `COLUMNS` over the seeds.

    `trial` is called with the cells of a setting and a seed.
    """
    return rows_over_seeds(trial, settings, _cells, quick, seeds)


def rows_over_seeds(
    trial: Callable[..., T],
    settings: Sequence[tuple[Any, ...]],
    cells: Callable[[list[T]], Sequence[Cell]],
    quick: bool,
    seeds: int = SEEDS,
    total: tuple[Cell, ...] = (),
) -> list[tuple[Cell, ...]]:
    """One row for each setting, and one over all that begins with `total` if that is given."""
    groups = over_seeds(trial, settings, quick, seeds)
    if total:
        settings, groups = [*settings, total], [*groups, [one for group in groups for one in group]]
    return [(*setting, *cells(group)) for setting, group in zip(settings, groups, strict=True)]


def over_seeds(
    trial: Callable[..., T], settings: Sequence[tuple[Any, ...]], quick: bool, seeds: int = SEEDS
) -> list[list[T]]:
    """What the trials of each setting gave; on all processors, unless it is a quick run of one seed."""
    if quick:
        return [[trial(*setting, 0)] for setting in settings]
    cases = [(*setting, seed) for seed in range(seeds) for setting in settings]
    # Workers use a processor each; threads of linear algebra would only slow them down.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    with ProcessPoolExecutor(os.cpu_count(), get_context("spawn"), _end_with_parent) as pool:
        results = list(pool.map(_call, repeat(trial), cases, chunksize=4))
    return [results[i :: len(settings)] for i in range(len(settings))]


def _end_with_parent() -> None:
    """Watch the parent: a worker whose parent was killed would wait for its next task forever."""

    def watch() -> None:
        parent = parent_process()
        if parent is not None:
            parent.join()
            os._exit(1)

    Thread(target=watch, daemon=True).start()


def _call(trial: Callable[..., T], case: tuple[Any, ...]) -> T:
    return trial(*case)


def median(values: Sequence[float]) -> float | None:
    """The median of those that are numbers; None if none is."""
    known = [v for v in values if np.isfinite(v)]
    return float(np.median(known)) if known else None


def _cells(attempts: list[Attempt]) -> list[Cell]:
    answered = [a.errors for a in attempts if a.errors is not None]
    names = ("known", "rmse", "sum_bias", "false_alpha", "spread")
    return [
        len(attempts) - len(answered),
        sum(a.warned for a in attempts),
        *(median([getattr(e, name) for e in answered]) for name in names),
    ]


def direction_errors(model: ColorModel, color: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(2,) each: by how much the true color leaves a line, along the axes of its covariance; stds.

    Radians, for brightness matched.
    """
    tangent = np.linalg.svd(model.pole[:, None])[0][:, 1:]
    variances, axes = np.linalg.eigh(tangent.T @ model.covariance @ tangent)
    error = axes.T @ tangent.T @ color / (model.pole @ color)
    return error, np.sqrt(np.maximum(variances, 0))
