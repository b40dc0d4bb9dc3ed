"""How accurate are path, color and alpha of a ball, alone and near another moving object?

Renders balls of one paint in front of random plates, half of them near a moving ball or sheet of
another color, gives image, plate and the ball's streak to `solve`, and compares with the truth.

Run: python -m benchmarks.accuracy.balls
"""

import warnings
from dataclasses import dataclass

import numpy as np
from benchmarks.accuracy.verdict import CURVED, LENGTHS, RADII, SIZE, bent, draw
from benchmarks.table import Cell, Table, publish_all
from benchmarks.trials import CODE, photograph, rows_over_seeds
from scipy.ndimage import distance_transform_edt

from blurmatte.errors import BlurmatteWarning, ColorModelError, MotionError
from blurmatte.matting import solve
from blurmatte.matting.solution import Solution
from blurmatte.metrics import alpha_rmse, alpha_sum_bias, trajectory_iou
from blurmatte.motion.picture.measure import measure_motion
from blurmatte.radiometry import LinearImage
from blurmatte.rendering import Ball, Camera, Rendering, Scene, render
from blurmatte.rendering.flat_bodies import Sheet
from blurmatte.rendering.scene import Body
from blurmatte.streaks import Streak, require_streaks

FIRST = 80000
SEEDS = 125
NOISES = (1, 2)  # code values of 255
COMPANY = ("alone", "near another")
GAP = (2, 30)  # pixels between the two streaks
TRIES = 2000  # of a place for the second
CONVERGED = 0.9  # of TIoU
RADIUS = 0.05  # of the true one
CLOSE = 3 * CODE  # of color, linear light
NOTES = f"""
Pictures of {SIZE[0]}x{SIZE[1]}, 8 bits, noise in code values of 255, plates as the median of five
frames: plain, of two hues, colorful, textured. Balls of one paint of any hue, shaded, radius
{RADII[0]} to {RADII[1]} px; paths of {LENGTHS[0]} to {LENGTHS[1]} radii, limited by the picture,
{CURVED:.0%} of them curved. near another: a ball or a sheet of another color, 0.3 to 1 times as large,
moves at a distance of {GAP[0]} to {GAP[1]} px from the streak. `solve` is given the streak, nothing
else. converged: fraction with a TIoU of {CONVERGED:g} or more and a radius within {RADIUS:.0%}, of all
scenes, refused ones included. RMSE and sum of alpha over the ball's streak where alpha is known, of
scenes with an answer; color: fraction of these within {CLOSE / CODE:g}/255 of the truth in the worst
channel, linear light, brightness matched; sum: fraction within 2 %.
"""


@dataclass(frozen=True)
class Outcome:
    """The result of one scene; nan if there is no answer."""

    converged: bool = False
    rmse: float = np.nan
    sum_bias: float = np.nan
    color: float = np.nan


def trial(company: str, noise: int, seed: int) -> Outcome:
    truth = scene(company, FIRST + seed)
    image, plate = photograph(truth, Camera(code_std=noise * CODE), FIRST + seed)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", BlurmatteWarning)
        try:
            streak = streak_of(truth, image, plate)
            return compared(solve(image, plate, streak=streak), truth)
        except (ColorModelError, MotionError):
            return Outcome()


def scene(company: str, seed: int) -> Rendering:
    """The ball, alone or near another object."""
    drawn = draw(seed)
    ball = Scene(drawn.plate, drawn.path, Ball(drawn.radius, drawn.color))
    truth = render(ball)
    if company == "alone":
        return truth
    other = render(neighbor(truth, seed)).layer
    light = truth.image.rgb + other.premultiplied - other.alpha[..., None] * truth.plate.rgb
    return Rendering(LinearImage(light), truth.plate, truth.layer, truth.shadow, ball, truth.nearby)


def neighbor(truth: Rendering, seed: int) -> Scene:
    """An object of the second color whose streak is near that of the ball without overlap."""
    drawn, rng = draw(seed), np.random.default_rng([seed, 7])
    away = distance_transform_edt(truth.layer.alpha == 0)
    for _ in range(TRIES):
        size = drawn.radius * rng.uniform(0.3, 1)
        half = size * np.exp(rng.uniform(*np.log(LENGTHS))) / 2
        angle, middle = rng.uniform(0, np.pi), rng.uniform(0, SIZE)
        path = bent(middle, half * np.array([np.cos(angle), np.sin(angle)]), 0.0)
        body: Body = Ball(size, drawn.second)
        if rng.uniform() < 0.5:
            body = Sheet(2 * size, size, drawn.second)
        points = path.at(np.linspace(0, 1, 50))
        nearest = np.rint(points).astype(int)
        if (nearest < 0).any() or (nearest >= SIZE).any():
            continue
        # Its corners reach no further than 1.2 sizes.
        gap = away[nearest[:, 1], nearest[:, 0]].min() - 1.2 * size
        if GAP[0] <= gap <= GAP[1]:
            return Scene(drawn.plate, path, body)
    raise ValueError(f"no place near the ball of seed {seed}")


def streak_of(truth: Rendering, image: LinearImage, plate: LinearImage) -> Streak:
    """The streak that holds most of the ball's alpha."""
    alpha = truth.layer.alpha
    return max(require_streaks(image, plate), key=lambda s: float(alpha[s.mask].sum()))


def compared(solution: Solution, truth: Rendering) -> Outcome:
    ball, alpha = truth.scene.body, truth.layer.alpha
    assert isinstance(ball, Ball)
    known = np.where(solution.known, alpha, 0)
    off = ball.color
    if solution.model.rank == 1:
        off = ball.color - (solution.model.pole @ ball.color) * solution.model.pole
    return Outcome(
        is_converged(solution, truth, ball.radius),
        alpha_rmse(solution.alpha, known),
        alpha_sum_bias(solution.alpha, known),
        float(np.abs(off).max()),
    )


def is_converged(solution: Solution, truth: Rendering, radius: float) -> bool:
    motion = measure_motion(solution)
    tiou = trajectory_iou(motion.trajectory, truth.trajectory, radius)
    return tiou >= CONVERGED and abs(motion.radius / radius - 1) <= RADIUS


def row(outcomes: list[Outcome]) -> list[Cell]:
    answers = [o for o in outcomes if np.isfinite(o.rmse)]
    rmse = [o.rmse for o in answers]
    return [
        len(outcomes),
        len(outcomes) - len(answers),
        float(np.mean([o.converged for o in outcomes])),
        *(np.quantile(rmse, (0.5, 0.75, 0.95, 1)).tolist() if rmse else [None] * 4),
        float(np.mean([o.color <= CLOSE for o in answers])) if rmse else None,
        float(np.mean([abs(o.sum_bias) <= 0.02 for o in answers])) if rmse else None,
    ]


def tables(quick: bool = False) -> list[Table]:
    settings = [(company, noise) for company in COMPANY for noise in NOISES]
    settings = settings[-1:] if quick else settings
    rows = rows_over_seeds(trial, settings, row, quick, SEEDS, total=("both", "both"))
    columns = (
        *("company", "noise", "scenes", "refused", "converged"),
        *("alpha RMSE", "75 %", "95 %", "worst", "color", "sum"),
    )
    question = (
        "How accurate are path, color and alpha of a ball, alone and near another moving object?"
    )
    return [Table("balls", question, NOTES, columns, rows)]


if __name__ == "__main__":
    publish_all(tables)
