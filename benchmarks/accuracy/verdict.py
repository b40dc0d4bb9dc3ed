"""How often is a wrong answer confident?

Renders random objects in front of random plates, most of which no model of blurmatte describes exactly,
gives image and plate to `solve` and nothing else, and compares the error of alpha with the claimed one.

Run: python -m benchmarks.accuracy.verdict
"""

import colorsys
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from benchmarks.table import Cell, Table, publish_all
from benchmarks.trials import CODE, PLATES, photograph, rows_over_seeds

from blurmatte.errors import BlurmatteWarning, ColorModelError, MotionError
from blurmatte.layer import Layer
from blurmatte.matting import solve
from blurmatte.matting.solution import Solution
from blurmatte.radiometry import LinearImage
from blurmatte.rendering import Ball, Camera, Rendering, Scene, render
from blurmatte.rendering.flat_bodies import Sheet, Sprite
from blurmatte.rendering.lighting import Lamp
from blurmatte.rendering.pose import Change
from blurmatte.rendering.scene import Shadow
from blurmatte.trajectory import Trajectory

SIZE = (384, 288)
# Scenes before it were looked at while the rules were made; of its own one was, a drop in JPEG (17).
FIRST = 67000
SEEDS = 36
NOISE = 2 * CODE
RADII = (6, 40)  # pixels
LENGTHS = (0.5, 12)  # radii
ROOM = 24  # pixels between the object and the border
CURVED = 0.3  # of the scenes; the rest go straight
BEND = 0.3  # of half the length, at most
AWAY, SOFT, DARK = (1, 2.2), (0.15, 0.5), (0.2, 0.6)  # radii; of the plate's light
PAINTS, TEXELS = (4, 8), 8  # patches of many colors; points across each
BLURRED = (0.1, 0.6)  # radii: of the circles of confusion
MOMENTS, SUBSTEPS = 24, 8  # in which the two that cross are rendered one over the other
WRONG = 0.05  # alpha, root mean square over the streak
CONFIDENT = 3  # times the claimed standard deviation
FILES = {
    "PNG": Camera(code_std=NOISE),
    "JPEG": Camera(code_std=NOISE, jpeg_quality=90, chroma="4:2:0"),
}
LAMPS = (Lamp((-1, -1, 1), (1, 1, 0.9)), Lamp((1, 0.5, 1), (0.3, 0.5, 1)))
NOTES = f"""
Pictures of {SIZE[0]}x{SIZE[1]}, 8 bits, noise of {NOISE / CODE:g} code values, plates as the median of
five frames: plain, of two hues, colorful, textured; JPEG: quality 90, 4:2:0. Radius {RADII[0]} to
{RADII[1]} px (squares, sheets, sticks of that size), path {LENGTHS[0]} to {LENGTHS[1]} radii, limited
by the picture, some curved; paint of any hue, or of {PAINTS[0]}x{PAINTS[1]} patches of many colors.
Shadows are displaced by {AWAY[0]} to {AWAY[1]} radii in any direction, blurred by {SOFT[0]} to
{SOFT[1]} radii, and remove {DARK[0]} to {DARK[1]} of the light. Out of focus: circles of confusion of
{BLURRED[0]} to {BLURRED[1]} radii, in front of a sharp plate. `solve` is given image and plate, nothing
else. refused: no answer, with a reason. by shape: answers in which a sweep is the likeliest. RMSE of
alpha where the object was and alpha is known, of all answers; of two balls that cross, the smaller of
the errors for both and for one. wrong: RMSE above {WRONG:g}. confident and wrong: those whose RMSE
exceeds {CONFIDENT} times the claimed one, the part of the color included.
"""


@dataclass(frozen=True)
class Outcome:
    """The result of one scene; rmse and claimed are nan if there is no answer."""

    by_shape: bool
    rmse: float
    claimed: float

    @property
    def refused(self) -> bool:
        """Whether there is no answer."""
        return bool(np.isnan(self.rmse))

    @property
    def wrong(self) -> bool:
        """Whether alpha is far from the truth."""
        return self.rmse > WRONG

    @property
    def confident(self) -> bool:
        """Whether the error is far more than was claimed."""
        return self.rmse > CONFIDENT * self.claimed


@dataclass(frozen=True)
class Draw:
    """The random choices of a scene: radius, half the displacement, paints, the plate."""

    radius: float
    half: np.ndarray
    middle: np.ndarray
    bend: float
    color: np.ndarray
    second: np.ndarray
    plate: np.ndarray
    spin: float
    shadow: Shadow
    defocus: float
    paints: np.ndarray

    @property
    def path(self) -> Trajectory:
        """The path of its center."""
        return bent(self.middle, self.half, self.bend)


def draw(seed: int) -> Draw:
    """The same for all kinds of objects."""
    rng = np.random.default_rng([seed, 5])
    radius = np.exp(rng.uniform(*np.log(RADII)))
    length = radius * np.exp(rng.uniform(*np.log(LENGTHS)))
    angle, middle = rng.uniform(0, np.pi), np.array(SIZE) / 2 + rng.uniform(-9, 9, 2)
    half = length / 2 * np.array([np.cos(angle), np.sin(angle)])
    room = np.array(SIZE) / 2 - radius - ROOM
    half *= min(1.0, *(room / np.maximum(np.abs(half), 1e-9)))
    hue = rng.uniform()
    color, second = (
        np.array(colorsys.hsv_to_rgb(h % 1, rng.uniform(0.6, 0.95), rng.uniform(0.4, 0.8)))
        for h in (hue, hue + rng.uniform(0.25, 0.5))
    )
    kind = sorted(PLATES)[rng.integers(len(PLATES))]
    plate = PLATES[kind](SIZE, int(rng.integers(2**31)))
    bend = rng.uniform(-BEND, BEND) if rng.uniform() < CURVED else 0.0
    spin = rng.uniform(-1.5, 1.5)
    aside, away = rng.uniform(0, 2 * np.pi), rng.uniform(*AWAY) * radius
    shadow = Shadow(
        (away * np.cos(aside), away * np.sin(aside)),
        rng.uniform(*SOFT) * radius,
        (rng.uniform(*DARK),) * 3,
    )
    defocus = rng.uniform(*BLURRED) * radius
    paints = rng.uniform(0.05, 0.9, (*PAINTS, 3))
    return Draw(radius, half, middle, bend, color, second, plate, spin, shadow, defocus, paints)


def bent(middle: np.ndarray, half: np.ndarray, bend: float) -> Trajectory:
    """A parabola through both ends, `bend` halves of its chord high."""
    t = np.linspace(0, 1, 2 if bend == 0 else 65)
    across = bend * np.array([-half[1], half[0]])
    return Trajectory(
        middle + np.outer(2 * t - 1, half) + np.outer(1 - (2 * t - 1) ** 2, across), t
    )


@dataclass(frozen=True, eq=False)
class Case:
    """A picture, and the alphas that are right: of all that moved, or of one of two things."""

    truth: Rendering
    alphas: tuple[np.ndarray, ...]


def single(scene: Scene) -> Case:
    truth = render(scene)
    return Case(truth, (truth.layer.alpha,))


def sheet(long: float, wide: float, turn: float = 0.0) -> Callable[[Draw], Case]:
    """A maker of rectangles, sides in radii, that turn by as much times their spin."""

    def made(drawn: Draw) -> Case:
        body = Sheet(long * drawn.radius, wide * drawn.radius, drawn.color)
        turned = Change(turned=(0, 0, 2 * drawn.spin), spin=(0, 0, turn * drawn.spin))
        return single(Scene(drawn.plate, drawn.path, body, turned))

    return made


def ball(drawn: Draw) -> Case:
    return single(Scene(drawn.plate, drawn.path, Ball(drawn.radius, drawn.color)))


def glossy(drawn: Draw) -> Case:
    body = Ball(drawn.radius, drawn.color, highlight=0.6)
    return single(Scene(drawn.plate, drawn.path, body))


def in_two_lamps(drawn: Draw) -> Case:
    body = Ball(drawn.radius, drawn.color, lamps=LAMPS)
    return single(Scene(drawn.plate, drawn.path, body))


def of_two_paints(drawn: Draw) -> Case:
    body = Ball(drawn.radius, drawn.color, second_color=drawn.second)
    return single(Scene(drawn.plate, drawn.path, body))


def of_many_colors(drawn: Draw) -> Case:
    texture = np.kron(drawn.paints, np.ones((TEXELS, TEXELS, 1)))
    body = Ball(drawn.radius, np.ones(3), texture=texture)
    turning = Change(spin=(drawn.spin / 3, 0.3, 0))
    return single(Scene(drawn.plate, drawn.path, body, turning))


def flag(drawn: Draw) -> Case:
    """A sheet of many colors."""
    size = np.maximum((drawn.radius * np.array([1.0, 2.4])).astype(int), 1)
    rows, columns = (np.arange(n) * k // n for n, k in zip(size, PAINTS, strict=True))
    body = Sprite(Layer(np.ones(size), drawn.paints[rows][:, columns]))
    turned = Change(turned=(0, 0, 2 * drawn.spin))
    return single(Scene(drawn.plate, drawn.path, body, turned))


def shadowing(drawn: Draw) -> Case:
    body = Ball(drawn.radius, drawn.color)
    return single(Scene(drawn.plate, drawn.path, body, shadow=drawn.shadow))


def out_of_focus(drawn: Draw) -> Case:
    body = Ball(drawn.radius, drawn.color)
    return single(Scene(drawn.plate, drawn.path, body, defocus=drawn.defocus))


def deforming(drawn: Draw) -> Case:
    """A drop that becomes longer while it moves."""
    squash = Change(squash=(1, 1 + abs(drawn.spin)), squash_angle=drawn.spin)
    body = Ball(drawn.radius / 1.5, drawn.color)
    return single(Scene(drawn.plate, drawn.path, body, squash))


def crossing(drawn: Draw) -> Case:
    """Two balls whose paths cross; the first is in front where they overlap."""
    aside = 0.7 * np.array([-drawn.half[1], drawn.half[0]])
    first, second = (
        Scene(drawn.plate, bent(drawn.middle, half, 0.0), Ball(drawn.radius, color))
        for half, color in ((drawn.half, drawn.color), (aside, drawn.second))
    )
    alphas = np.zeros((3, *drawn.plate.shape[:2]))
    light = np.zeros(drawn.plate.shape)
    for part in pairwise(np.linspace(0, 1, MOMENTS + 1)):
        front, behind = (render(one.part(*part), SUBSTEPS).layer for one in (first, second))
        seen = 1 - front.alpha
        both = front.alpha + seen * behind.alpha
        alphas += np.stack([both, front.alpha, seen * behind.alpha]) / MOMENTS
        light += (front.premultiplied + seen[..., None] * behind.premultiplied) / MOMENTS
    image = light + (1 - alphas[0][..., None]) * drawn.plate
    layer = Layer(alphas[0], light)
    truth = Rendering(
        LinearImage(image), LinearImage(drawn.plate), layer, 0 * light, first, 0 * light
    )
    return Case(truth, tuple(alphas))


KINDS: dict[str, Callable[[Draw], Case]] = {
    "ball": ball,
    "glossy ball": glossy,
    "ball in two lamps": in_two_lamps,
    "ball of two paints": of_two_paints,
    "ball of many colors": of_many_colors,
    "ball and its shadow": shadowing,
    "ball out of focus": out_of_focus,
    "drop that deforms": deforming,
    "square": sheet(1.7, 1.7),
    "sheet": sheet(2.4, 1.0),
    "sheet of many colors": flag,
    "turning sheet": sheet(2.4, 1.0, 1),
    "turning stick": sheet(3.0, 0.4, 2),
    "two balls that cross": crossing,
}


def trial(kind: str, file: str, seed: int) -> Outcome:
    case = KINDS[kind](draw(FIRST + seed))
    image, plate = photograph(case.truth, FILES[file], FIRST + seed)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", BlurmatteWarning)
        try:
            return compared(solve(image, plate), case)
        except (ColorModelError, MotionError):
            return Outcome(False, np.nan, np.nan)


def compared(solution: Solution, case: Case) -> Outcome:
    """The error of alpha where it is known, and the claimed error there."""
    known = (case.truth.layer.alpha > 0) & solution.known
    std = np.hypot(solution.alpha_std, solution.stats.alpha_scale_std * solution.alpha)
    rmse = min(root_mean_square((solution.alpha - alpha)[known]) for alpha in case.alphas)
    return Outcome(solution.sweep is not None, rmse, root_mean_square(std[known]))


def root_mean_square(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values.astype(float) ** 2)))


def row(outcomes: list[Outcome]) -> list[Cell]:
    answers = [o for o in outcomes if not o.refused]
    rmse = [o.rmse for o in answers]
    spread = np.quantile(rmse, (0.5, 0.75, 0.9, 1)).tolist() if rmse else [None] * 4
    return [
        len(outcomes),
        len(outcomes) - len(answers),
        sum(o.by_shape for o in answers),
        *spread,
        sum(o.wrong for o in answers),
        sum(o.wrong and o.confident for o in answers),
    ]


def tables(quick: bool = False) -> list[Table]:
    settings = [(kind, file) for kind in KINDS for file in FILES]
    settings = settings[:1] if quick else settings
    rows = rows_over_seeds(trial, settings, row, quick, SEEDS, total=("all", "both"))
    columns = (
        *("object", "file", "scenes", "refused", "by shape", "median", "75 %", "90 %", "worst"),
        *("wrong", "confident and wrong"),
    )
    question = "How often is a wrong answer confident?"
    return [Table("verdict", question, NOTES, columns, rows)]


if __name__ == "__main__":
    publish_all(tables)
