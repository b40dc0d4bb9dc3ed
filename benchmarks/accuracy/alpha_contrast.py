"""How does the error of alpha grow as the plate's hue approaches the object's color?

Run: python -m benchmarks.accuracy.alpha_contrast
"""

from functools import cache

import numpy as np
from benchmarks.table import Table, publish_all
from benchmarks.trials import (
    CODE,
    COLUMNS,
    MEANING,
    ORANGE,
    RADIUS,
    SCENE,
    SIZE,
    Attempt,
    alpha_rows,
    attempt,
    ball_path,
    photograph,
)

from blurmatte.rendering import Ball, Camera, Rendering, Scene, render
from blurmatte.rendering.plates import plain_plate

ANGLES = (5, 7, 10, 15, 20, 30, 45, 60)  # degrees
SEEDS = 3
BRIGHTNESS = 0.6  # length of the plate's color, linear light, where it is brightest
NOISES = (1, 4)  # code values of 255
TOWARDS = {"blue": (0.1, 0.3, 0.9), "green": (0.02, 0.90, 0.20)}


@cache
def rendering(towards: str, angle: float, seed: int) -> Rendering:
    """The ball before a plain plate whose hue lies `angle` degrees from the ball's."""
    along = ORANGE / np.linalg.norm(ORANGE)
    across = np.array(TOWARDS[towards]) - along @ np.array(TOWARDS[towards]) * along
    across /= np.linalg.norm(across)
    color = np.cos(np.radians(angle)) * along + np.sin(np.radians(angle)) * across
    plate = plain_plate(SIZE, BRIGHTNESS * color, seed)
    return render(Scene(plate, ball_path(seed), Ball(RADIUS, ORANGE)))


def trial(towards: str, noise: float, angle: float, seed: int) -> Attempt:
    truth = rendering(towards, angle, seed)
    image, plate = photograph(truth, Camera(code_std=noise * CODE), seed)
    return attempt(image, plate, truth.model, truth)


def tables(quick: bool = False) -> list[Table]:
    settings = [(hue, noise, angle) for hue in TOWARDS for noise in NOISES for angle in ANGLES]
    rows = alpha_rows(trial, settings[::31] if quick else settings, quick, SEEDS)
    return [
        Table(
            "alpha_contrast",
            "How does the error of alpha grow as the plate's hue approaches the object's color?",
            f"{SCENE} The plate has one hue, at an angle (contrast, degrees) from the ball's color "
            "towards blue or green. 8 bits with noise in code values of 255; the true line is given. "
            f"In theory the error is proportional to 1 / sin(contrast). {MEANING.format(seeds=SEEDS)}",
            ("towards", "noise", "contrast", *COLUMNS),
            rows,
            x="contrast",
            x_unit="degrees",
            lines=("towards", "noise"),
            y="alpha RMSE",
            log=True,
            log_x=True,
        )
    ]


if __name__ == "__main__":
    publish_all(tables)
