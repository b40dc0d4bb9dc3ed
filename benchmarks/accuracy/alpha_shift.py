"""How large is the error of alpha if the plate is shifted against the image?

Run: python -m benchmarks.accuracy.alpha_shift
"""

import numpy as np
from benchmarks.table import Table, publish_all
from benchmarks.trials import (
    CODE,
    COLUMNS,
    KINDS,
    MEANING,
    SCENE,
    Attempt,
    alpha_rows,
    attempt,
    photograph,
    rendering,
)

from blurmatte.rendering import Camera
from blurmatte.rendering.shot import Drift

SHIFTS = (0, 0.1, 0.25, 0.5, 1, 2)  # pixels
SEEDS = 3


def trial(kind: str, color: str, shift: float, seed: int) -> Attempt:
    truth = rendering(kind, seed)
    angle = np.random.default_rng(seed).uniform(0, 2 * np.pi)
    drift = Drift((shift * np.cos(angle), shift * np.sin(angle)))
    image, plate = photograph(truth, Camera(code_std=CODE), seed, drift)
    return attempt(image, plate, truth.model if color == "given" else None, truth)


def tables(quick: bool = False) -> list[Table]:
    settings = [(k, color, s) for k in KINDS for color in ("given", "found") for s in SHIFTS]
    rows = alpha_rows(trial, settings[::35] if quick else settings, quick, SEEDS)
    return [
        Table(
            "alpha_shift",
            "How large is the error of alpha if the plate is shifted against the image?",
            f"{SCENE} The plate is shifted by a number of pixels in a random direction. 8 bits "
            "with noise of 1 code value of 255; color: the true line is given, or nothing is. "
            f"{MEANING.format(seeds=SEEDS)}",
            ("plate", "color", "shift", *COLUMNS),
            rows,
            x="shift",
            x_unit="pixels",
            lines="color",
            y="alpha RMSE",
            panels="plate",
        )
    ]


if __name__ == "__main__":
    publish_all(tables)
