"""How much does smoothness of alpha reduce its error?

Run: python -m benchmarks.accuracy.together
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache

import numpy as np
from benchmarks.table import Cell, Table, publish_all
from benchmarks.trials import CODE, PLATES, median, over_seeds

from blurmatte.color.model import ColorModel
from blurmatte.errors import ColorModelError
from blurmatte.matting import Pixelwise, Smooth, solve
from blurmatte.metrics import alpha_rmse, calibration, false_alpha
from blurmatte.rendering import Ball, Camera, Rendering, Scene, Shot, render
from blurmatte.rendering.flat_bodies import Sheet, star_sprite
from blurmatte.rendering.pose import Change
from blurmatte.rendering.scene import Body
from blurmatte.trajectory import Trajectory

SIZE = (384, 256)
ORANGE, BLUE = np.array([0.80, 0.35, 0.06]), np.array([0.10, 0.30, 0.60])
STILL, TURNING = Change(), Change(spin=(0.0, 0.0, 2.0))
SPOTS = np.kron(np.random.default_rng(0).uniform(0.05, 0.9, (4, 8, 3)), np.ones((8, 8, 1)))
OBJECTS: dict[str, Callable[[], tuple[Body, Change]]] = {
    "ball": lambda: (Ball(20, ORANGE), STILL),
    "turning stick": lambda: (Sheet(90, 10, ORANGE), TURNING),
    "turning star": lambda: (star_sprite(60, ORANGE), TURNING),
    "growing ball": lambda: (Ball(20, ORANGE), Change(scale=(0.6, 1.4))),
    "two paints": lambda: (Ball(20, ORANGE, second_color=BLUE), Change(spin=(1.0, 0.5, 0.0))),
    "any colors": lambda: (Ball(20, np.ones(3), texture=SPOTS), Change(spin=(0.5, 0.5, 0.0))),
}
FILES = {
    "noise 1": Camera(code_std=CODE),
    "noise 2": Camera(code_std=2 * CODE),
    "noise 2, JPEG 90": Camera(code_std=2 * CODE, jpeg_quality=90, chroma="4:2:0"),
}
KINDS = ("colorful", "textured", "two hues")
SEEDS = 3


NOTES = f"""
Objects that move about 85 pixels on an arc in pictures of {SIZE[0]}x{SIZE[1]}; the plate is the
median of five frames; noise in code values of 255; the true colors are given, or rank 3, and no shape
is used. alone: alpha RMSE over the streak of the closed form; together: of all pixels at once; sum
bias: relative, of all alpha; within 1 and 2: fractions of the streak's pixels whose error is below that
number of reported standard deviations, 0.683 and 0.954 for normal errors; outside: RMS of alpha where
the object never was. Medians over {SEEDS} seeds, or over those that are not refused.
"""


@dataclass(frozen=True)
class Found:
    """Errors of alpha over the streak; None where there is no answer."""

    alone: float
    rmse: float | None
    bias: float
    within1: float
    within2: float
    outside: float


@cache
def rendered(name: str, kind: str, seed: int) -> Rendering:
    rng = np.random.default_rng(seed)
    angle, middle = rng.uniform(0, 2 * np.pi), np.array(SIZE) / 2
    half = 40 * np.array([np.cos(angle), np.sin(angle)])
    aside = 12 * np.array([-half[1], half[0]]) / 40
    path = Trajectory.arc(middle - half, middle + aside, middle + half)
    body, change = OBJECTS[name]()
    return render(Scene(PLATES[kind](SIZE, seed), path, body, change), 240)


def trial(kind: str, name: str, file: str, seed: int) -> Found:
    truth = rendered(name, kind, seed)
    shot = Shot(truth.scene, FILES[file], plate_frames=5, seed=seed)
    image, plate = shot.photograph(truth)
    model = ColorModel.any() if name == "any colors" else truth.model
    true, alone = truth.layer.alpha, float("nan")
    if model.rank < 3:
        alone = alpha_rmse(solve(image, plate, model, Pixelwise()).alpha, true)
    try:
        together = solve(image, plate, model, Smooth())
    except ColorModelError:
        return Found(alone, None, *[float("nan")] * 4)
    alpha = np.where(together.streak, together.alpha, 0)
    z = calibration(alpha, together.alpha_std, true, where=true > 0)
    return Found(
        alone,
        alpha_rmse(alpha, true),
        float(alpha.sum() / true.sum() - 1),  # its rims included, where the object never was
        z.within_1,
        z.within_2,
        false_alpha(alpha, true),
    )


def tables(quick: bool = False) -> list[Table]:
    settings = [(k, name, file) for k in KINDS for name in OBJECTS for file in FILES]
    chosen = settings[:: len(settings) - 1] if quick else settings
    groups = over_seeds(trial, chosen, quick, SEEDS)
    rows: list[tuple[Cell, ...]] = []
    for setting, group in zip(chosen, groups, strict=True):
        answered = [found for found in group if found.rmse is not None]
        names = ("alone", "rmse", "bias", "within1", "within2", "outside")
        cells = [median([getattr(found, name) for found in answered]) for name in names]
        rows.append((*setting, len(group) - len(answered), *cells))
    return [
        Table(
            "together",
            "How much does smoothness of alpha reduce its error?",
            NOTES,
            (
                "plate", "object", "file", "refused",
                "alone", "together", "sum bias", "within 1", "within 2", "outside",
            ),
            rows,
        )
    ]  # fmt: skip


if __name__ == "__main__":
    publish_all(tables)
