"""How much must the hue of the plate vary to determine the color?

Run: python -m benchmarks.accuracy.color_hue_spread
"""

from functools import cache

import numpy as np
from benchmarks.accuracy.color import Outcome, outcome, refused, spread
from benchmarks.table import Cell, Table, publish_all
from benchmarks.trials import ORANGE, RADIUS, SCENE, SIZE, ball_path, median, rows_over_seeds

from blurmatte.rendering import Ball, Rendering, Scene, render
from blurmatte.rendering.plates import striped_plate

SPREADS = (0, 1, 2, 3, 5, 10, 20, 30)  # degrees, root mean square
NOISES = (0.5, 2)  # code values of 255
SEEDS = 3
STRIPE = 9.0  # pixels: several behind the streak
GRAY = 0.33 * np.ones(3)
LEAST_TURN = np.radians(40)  # of the plate's hues from the direction in which the ball's lies


def plate_of(hue_spread: float, seed: int) -> np.ndarray:
    """Stripes of two hues to both sides of gray, each `hue_spread` degrees from it."""
    rng = np.random.default_rng(seed)
    gray = GRAY / np.linalg.norm(GRAY)
    towards = ORANGE - gray @ ORANGE * gray
    towards /= np.linalg.norm(towards)
    turn = rng.uniform(LEAST_TURN, np.pi - LEAST_TURN)
    across = np.cos(turn) * towards + np.sin(turn) * np.cross(gray, towards)
    half = np.radians(hue_spread)
    hues = [np.cos(half) * gray + side * np.sin(half) * across for side in (1, -1)]
    colors = [np.linalg.norm(GRAY) * hue for hue in hues]
    return striped_plate(SIZE, colors, STRIPE, rng.uniform(0, np.pi))


@cache
def rendering(hue_spread: float, seed: int) -> Rendering:
    return render(Scene(plate_of(hue_spread, seed), ball_path(seed), Ball(RADIUS, ORANGE)))


def trial(noise: float, hue_spread: float, seed: int) -> Outcome:
    return outcome(rendering(hue_spread, seed), ORANGE, noise, seed)


def cells(group: list[Outcome]) -> list[Cell]:
    answers = np.array([[*o.ours, o.published[1]] for o in group])
    return [refused(group), *(median(column) for column in answers.T), spread(group)]


def tables(quick: bool = False) -> list[Table]:
    settings = [(noise, hue_spread) for noise in NOISES for hue_spread in SPREADS]
    settings = settings[7:8] if quick else settings
    return [
        Table(
            "color_hue_spread",
            "How much must the hue of the plate vary to determine the color?",
            f"{SCENE} The plate has stripes of {STRIPE:g} pixels in two hues on both sides of gray; "
            "hue spread is their angle to it, degrees. 8 bits, noise in code values of 255. "
            f"Medians of {SEEDS} seeds, or of those that are not refused; units, degrees and spread as "
            "in the table of colors.",
            ("noise", "hue spread", "refused", "units", "degrees", "published degrees", "spread"),
            rows_over_seeds(trial, settings, cells, quick, SEEDS),
            x="hue spread",
            x_unit="degrees",
            lines="noise",
            y="degrees",
            log=True,
        )
    ]


if __name__ == "__main__":
    publish_all(tables)
