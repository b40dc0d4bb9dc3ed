"""How far is the color of the hues alone from the truth?

Renders balls of random paint that move in front of three kinds of plates, takes 8-bit sRGB pictures
of them with noise in the code values (the plate is the median of five), finds the streak and fits
its color; the published formula gets the same pixels.

Run: python -m benchmarks.accuracy.color
"""

from dataclasses import dataclass

import numpy as np
from benchmarks.table import Cell, Table, publish_all
from benchmarks.trials import CODE, direction_errors, over_seeds, photograph

from blurmatte.calibration import with_noise
from blurmatte.color import published_color_line
from blurmatte.color.streak import _streak_pixels, fit_color_from_hues
from blurmatte.errors import ColorModelError
from blurmatte.metrics import calibration, color_distance
from blurmatte.radiometry import SRGB
from blurmatte.rendering import Ball, Camera, Rendering, Scene, colorful_plate, render
from blurmatte.rendering.plates import plain_plate, two_hue_plate
from blurmatte.streaks import find_streaks
from blurmatte.trajectory import Trajectory

SIZE = (320, 240)
SUBSTEPS = 120  # alpha to 2e-4: below the noise
NOISES = (1, 2)  # code values of 255
SEEDS = 20
KINDS = ("colorful", "two hues", "plain")
ERRORS = tuple(
    f"{unit} {part}" for unit in ("units", "degrees") for part in ("median", "90 %", "worst")
)
NOTES = f"""
Balls of random paint that move by 1 to 8 radii before three kinds of plates, in pictures of
{SIZE[0]}x{SIZE[1]}, 8 bits, noise in code values of 255; the plate is the median of five frames. The
published formula gets the same pixels and never refuses. units: 255 |o - (o.l) l|, linear light, o
the true color of the paint and l the estimated direction; brightness is matched, since a line does not
determine it. degrees: the angle between o and l. Median, 90 % and worst of the scenes with an answer.
spread: root mean square of the error over its reported standard deviation, for each direction; 1 is
correct, more is overconfident.
"""


@dataclass(frozen=True)
class Outcome:
    """What ours and the published formula gave in one scene; ours is NaN where it refused."""

    ours: tuple[float, float]  # units, degrees
    z: tuple[float, float]  # ours over its standard deviation, in two directions
    published: tuple[float, float]


NOTHING = (np.nan, np.nan)


def random_color(rng: np.random.Generator, low: float, high: float) -> np.ndarray:
    """Linear light of a color whose sRGB codes are uniform between two bounds."""
    return SRGB.decode(rng.uniform(low, high, 3))


def random_plate(kind: str, rng: np.random.Generator) -> np.ndarray:
    if kind == "colorful":
        return colorful_plate(SIZE, rng)
    if kind == "two hues":
        first, second = random_color(rng, 0.3, 0.8), random_color(rng, 0.3, 0.8)
        return two_hue_plate(SIZE, first, second, rng)
    return plain_plate(SIZE, random_color(rng, 0.35, 0.8), rng)


def random_scene(kind: str, seed: int) -> tuple[Rendering, np.ndarray]:
    """A scene with a ball that moves by 1 to 8 radii, and its paint."""
    rng = np.random.default_rng(seed)
    color = random_color(rng, 0.25, 1)
    color *= rng.uniform(0.5, 1) / color.max()
    plate, radius, angle = random_plate(kind, rng), rng.uniform(8, 22), rng.uniform(0, np.pi)
    length = min(rng.uniform(1, 8) * radius, 170)
    middle = np.array(SIZE) / 2 + rng.uniform(-15, 15, 2)
    half = length / 2 * np.array([np.cos(angle), 0.8 * np.sin(angle)])
    path = Trajectory.line(middle - half, middle + half)
    return render(Scene(plate, path, Ball(radius, color)), SUBSTEPS), color


def outcome(truth: Rendering, color: np.ndarray, noise: float, seed: int) -> Outcome:
    """Photograph, find the streak, and compare both colors with the truth."""
    image, plate = with_noise(*photograph(truth, Camera(code_std=noise * CODE), seed))
    found = find_streaks(image, plate)
    if not found:
        return Outcome(NOTHING, NOTHING, NOTHING)
    pixels = _streak_pixels(image, plate, found[0])
    published = color_distance(published_color_line(pixels.C, pixels.B).basis, color)
    theirs = published.units, published.degrees
    try:
        model = fit_color_from_hues(image, plate, found[0])
    except ColorModelError:
        return Outcome(NOTHING, NOTHING, theirs)
    error, std = direction_errors(model, color)
    ours = color_distance(model.basis, color)
    return Outcome((ours.units, ours.degrees), tuple(error / std), theirs)


def trial(kind: str, noise: int, seed: int) -> Outcome:
    truth, color = random_scene(kind, seed)
    return outcome(truth, color, noise, seed)


def quantiles(errors: list[tuple[float, float]]) -> list[Cell]:
    """Median, 90 % and worst of units, then of degrees."""
    known = np.array([e for e in errors if np.isfinite(e).all()])
    if len(known) == 0:
        return [None] * 6
    return np.quantile(known, [0.5, 0.9, 1], axis=0).T.ravel().tolist()


def spread(outcomes: list[Outcome]) -> float | None:
    z = np.array([o.z for o in outcomes])
    answered = np.isfinite(z)
    if not answered.any():
        return None
    c = calibration(z, np.ones_like(z), np.zeros_like(z), where=answered)
    return float(np.hypot(c.mean, c.spread))


def refused(outcomes: list[Outcome]) -> int:
    return sum(bool(np.isnan(o.ours[0])) for o in outcomes)


def tables(quick: bool = False) -> list[Table]:
    settings = [(kind, noise) for kind in KINDS for noise in NOISES]
    settings = settings[:1] if quick else settings
    rows: list[tuple[Cell, ...]] = []
    for setting, group in zip(settings, over_seeds(trial, settings, quick, SEEDS), strict=True):
        ours, theirs = quantiles([o.ours for o in group]), quantiles([o.published for o in group])
        rows.append((*setting, len(group), refused(group), *ours, spread(group), *theirs))
    published = tuple(f"published {name}" for name in ERRORS)
    columns = ("plate", "noise", "scenes", "refused", *ERRORS, "spread", *published)
    question = "How far is the color of the hues alone from the truth?"
    return [Table("color", question, NOTES, columns, rows)]


if __name__ == "__main__":
    publish_all(tables)
