"""How faint can a streak be?

Run: python -m benchmarks.accuracy.alpha_faintness
"""

from functools import cache

import numpy as np
from benchmarks.table import Table, publish_all
from benchmarks.trials import (
    CODE,
    COLUMNS,
    KINDS,
    MEANING,
    ORANGE,
    PLATES,
    Attempt,
    alpha_rows,
    attempt,
    photograph,
)

from blurmatte.rendering import Ball, Camera, Rendering, Scene, render
from blurmatte.trajectory import Trajectory

SIZE = (400, 120)
RADIUS = 5.0  # pixels
OPAQUE = 0.5  # largest alpha of the ball that is made transparent
PEAKS = {"speed": (0.5, 0.25, 0.12, 0.06, 0.03), "opacity": (0.25, 0.06)}
SEEDS = 3


@cache
def rendering(kind: str, by: str, peak: float, seed: int) -> Rendering:
    """A ball whose alpha reaches `peak`: it moves by so many diameters, or lets light through."""
    opacity, passing = (1.0, peak) if by == "speed" else (peak / OPAQUE, OPAQUE)
    rng = np.random.default_rng(seed)
    length, angle = 2 * RADIUS / passing, rng.uniform(-0.15, 0.15)
    middle = np.array(SIZE) / 2 + rng.uniform(-5, 5, 2)
    half = length / 2 * np.array([np.cos(angle), np.sin(angle)])
    path = Trajectory.line(middle - half, middle + half)
    return render(Scene(PLATES[kind](SIZE, seed), path, Ball(RADIUS, ORANGE), opacity=opacity))


def trial(kind: str, color: str, by: str, peak: float, seed: int) -> Attempt:
    truth = rendering(kind, by, peak, seed)
    image, plate = photograph(truth, Camera(code_std=CODE), seed)
    return attempt(image, plate, truth.model if color == "given" else None, truth)


def tables(quick: bool = False) -> list[Table]:
    settings = [
        (kind, color, by, peak)
        for kind in KINDS
        for color in ("given", "found")
        for by, peaks in PEAKS.items()
        for peak in peaks
    ]
    rows = alpha_rows(trial, settings[1:8:5] if quick else settings, quick, SEEDS)
    return [
        Table(
            "alpha_faintness",
            "How faint can a streak be?",
            f"An orange ball of radius {RADIUS:g} in pictures of {SIZE[0]}x{SIZE[1]}, the plate the "
            "median of five frames, 8 bits with noise of 1 code value of 255. Its largest alpha is "
            "`peak alpha`: by speed, through a longer path; by opacity, through transparency, with a "
            f"path of {2 * RADIUS / OPAQUE:g} pixels. color: the true line is given, or "
            f"nothing is. {MEANING.format(seeds=SEEDS)}",
            ("plate", "color", "by", "peak alpha", *COLUMNS),
            rows,
            x="peak alpha",
            lines=("color", "by"),
            y="alpha RMSE",
            panels="plate",
            log=True,
            log_x=True,
        )
    ]


if __name__ == "__main__":
    publish_all(tables)
