"""Are the reported standard deviations correct?

Run: python -m benchmarks.accuracy.calibration
"""

import warnings
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from benchmarks.table import Cell, Table, publish_all
from benchmarks.trials import (
    CODE,
    ORANGE,
    RADIUS,
    SCENE,
    direction_errors,
    over_seeds,
    photograph,
    rendering,
)

from blurmatte.calibration import with_noise
from blurmatte.checks import Bools
from blurmatte.color import pick_colors
from blurmatte.color.model import ColorModel
from blurmatte.errors import ColorModelError, PlateWarning
from blurmatte.layer import Layer
from blurmatte.matting import solve
from blurmatte.matting.solution import Solution
from blurmatte.metrics import calibration
from blurmatte.radiometry import LinearImage, NoiseModel
from blurmatte.rendering import Ball, Camera, Rendering, render

Errors = tuple[np.ndarray, np.ndarray]  # (n,) estimate − truth, and reported standard deviation

SENSOR = NoiseModel(gain=2e-4, read_std=1e-3)
CAMERAS = {
    "float, code noise 1": (Camera(code_std=CODE, bits=None), 5),
    "8 bits, code noise 0.25": (Camera(code_std=CODE / 4), 5),
    "8 bits, code noise 1": (Camera(code_std=CODE), 5),
    "8 bits, code noise 4": (Camera(code_std=4 * CODE), 5),
    "8 bits, code noise 1, one plate": (Camera(code_std=CODE), 1),
    "8 bits, sensor noise": (Camera(SENSOR), 5),
    "16 bits, sensor noise, one plate": (Camera(SENSOR, bits=16), 1),
    "8 bits, Bayer sensor": (Camera(SENSOR, bayer=True), 5),
    "JPEG 95 4:4:4, code noise 1": (Camera(code_std=CODE, jpeg_quality=95), 5),
    "JPEG 85 4:2:0, code noise 1": (Camera(code_std=CODE, jpeg_quality=85, chroma="4:2:0"), 5),
}
KINDS = ("colorful", "textured", "two hues")
SEEDS = 3
ALL, SPARSE = slice(None), slice(None, None, 7)  # a sample of the pixels outside a streak is enough
PICKS = 6  # sharp pictures in each trial
SECOND = np.array([0.10, 0.30, 0.60])  # paint of a band around the ball
NOTES = f"""
{SCENE} Three plates (colorful tiles, texture, two hues), {SEEDS} seeds each, taken together. z is
(estimate - truth) / reported standard deviation. spread: root mean square of z about its mean; 1 is
correct, more is overconfident. robust: the same from the median of |z|; within 1 and 2: fractions of
|z|, 0.683 and 0.954 for normal errors. Alpha and light: known pixels. "sum of alpha": one value for
each picture, with the reported error of the color where that is found. "color": two directions for
each picture that is not refused, or for each of {PICKS} sharp pictures of the ball in which it is
picked. "noise": measured noise of image and plate and its errors; with a Bayer sensor or JPEG they
contain errors common to both pictures. "two paints": the ball has a blue band, and the true plane is
given; otherwise the true line, unless the color is found.
"""


@dataclass(frozen=True)
class Job:
    """A photographed scene."""

    truth: Rendering
    image: LinearImage
    plate: LinearImage


def trial(camera: str, kind: str, seed: int) -> dict[str, Errors]:
    """The errors of everything that has a standard deviation."""
    how, frames = CAMERAS[camera]
    one_paint, two_paints = rendering(kind, seed), rendering_of_two_paints(kind, seed)
    line, plane = (
        Job(truth, *with_noise(*photograph(truth, how, seed, frames=frames)))
        for truth in (one_paint, two_paints)
    )
    rng = np.random.default_rng([seed, KINDS.index(kind)])
    return {
        **of_line(line),
        **of_plane(plane),
        **of_found_color(line),
        **of_noise(line),
        "color, picked": of_picked_color(one_paint, how, rng),
    }


@cache
def rendering_of_two_paints(kind: str, seed: int) -> Rendering:
    scene = rendering(kind, seed).scene
    return render(replace(scene, body=Ball(RADIUS, ORANGE, second_color=SECOND)))


def solved(job: Job, model: ColorModel | None) -> Solution:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", PlateWarning)
        return solve(job.image, job.plate, model)


def of_line(job: Job) -> dict[str, Errors]:
    """One paint, the true line given. The light of all channels has one error, so one speaks."""
    solution, layer = solved(job, job.truth.model), job.truth.layer
    inside = (layer.alpha > 0) & solution.known
    outside = (layer.alpha == 0) & solution.known
    return {
        "alpha": of_alpha(solution, layer, inside),
        "alpha outside the streak": of_alpha(solution, layer, outside, SPARSE),
        "light": of_light(solution, layer, inside, 0),
        "sum of alpha": of_sum(solution, layer),
    }


def of_plane(job: Job) -> dict[str, Errors]:
    """Two paints, the true plane given."""
    solution, layer = solved(job, job.truth.model), job.truth.layer
    inside = (layer.alpha > 0) & solution.known
    light = {
        f"light {name}, two paints": of_light(solution, layer, inside, channel)
        for channel, name in enumerate("RGB")
    }
    return {"alpha, two paints": of_alpha(solution, layer, inside), **light}


def of_found_color(job: Job) -> dict[str, Errors]:
    """One paint, its color found in the streak; nothing if that is refused."""
    try:
        solution = solved(job, None)
    except ColorModelError:
        return {}
    layer = job.truth.layer
    return {
        "color, found": direction_errors(solution.model, ORANGE),
        "alpha, color found": of_alpha(solution, layer, (layer.alpha > 0) & solution.known),
        "sum of alpha, color found": of_sum(solution, layer),
    }


def of_noise(job: Job) -> dict[str, Errors]:
    pairs = {"image": (job.image, job.truth.image), "plate": (job.plate, job.truth.plate)}
    return {
        f"noise of the {name}": (
            (seen.rgb - exact.rgb).ravel()[SPARSE],
            np.sqrt(seen.variance).ravel()[SPARSE],
        )
        for name, (seen, exact) in pairs.items()
    }


def of_picked_color(truth: Rendering, how: Camera, rng: np.random.Generator) -> Errors:
    """Picked in the middle of the ball, in several sharp pictures of it."""
    sharp = truth.subframes(1)[0].over(truth.plate).rgb
    x, y = truth.trajectory.at(0.5)
    errors = []
    for _ in range(PICKS):
        samples = pick_colors(how.photograph(sharp, rng), x, y, radius=RADIUS / 2)
        errors.append(direction_errors(ColorModel.from_samples(samples), ORANGE))
    return joined(errors)


def of_alpha(solution: Solution, layer: Layer, where: Bools, some: slice = ALL) -> Errors:
    error = solution.alpha - layer.alpha
    return error[where][some], solution.alpha_std[where][some]


def of_light(solution: Solution, layer: Layer, where: Bools, channel: int) -> Errors:
    error = solution.premultiplied - layer.premultiplied
    return error[where][:, channel], solution.premultiplied_std[where][:, channel]


def of_sum(solution: Solution, layer: Layer) -> Errors:
    stats, summed = solution.stats, solution.streak & solution.known
    std = stats.sum_alpha_std
    return np.array([stats.sum_alpha - layer.alpha[summed].sum()]), np.array([std])


def joined(errors: list[Errors]) -> Errors:
    difference, std = (np.concatenate(part) for part in zip(*errors, strict=True))
    return difference, std


def cells(errors: list[Errors]) -> list[Cell]:
    difference, std = joined(errors)
    z = calibration(difference, std, np.zeros_like(difference))
    return [z.count, z.mean, z.spread, z.robust_spread, z.within_1, z.within_2]


def tables(quick: bool = False) -> list[Table]:
    settings = [(camera, kind) for camera in CAMERAS for kind in KINDS]
    settings = settings[6:7] if quick else settings
    groups = over_seeds(trial, settings, quick, SEEDS)
    pooled: dict[tuple[str, str], list[Errors]] = {}
    for (camera, _), group in zip(settings, groups, strict=True):
        for answer in group:
            for what, errors in answer.items():
                pooled.setdefault((what, camera), []).append(errors)
    order = list(dict.fromkeys(what for what, _ in pooled))
    rows = [(*key, *cells(pooled[key])) for key in sorted(pooled, key=lambda k: order.index(k[0]))]
    columns = ("estimate", "camera", "count", "mean", "spread", "robust", "within 1", "within 2")
    question = "Are the reported standard deviations correct?"
    return [Table("calibration", question, NOTES, columns, rows)]


if __name__ == "__main__":
    publish_all(tables)
