"""How close is the error of the measured motion to the Cramér–Rao bound?

Renders balls in front of colorful tiles, solves with nothing given, measures the motion, and compares
its errors with the bound.

The bound does not depend on the estimator. In a pixel the image is C = k l + (1 − α) B + noise and
the plate is b = B + noise. The parameters are the two ends of the path and the radius, which give α.
Nuisance parameters are the light k of every pixel (any shading), the direction l of the color (two
angles) and every pixel of the plate. Known are the noise, the straight path at constant speed and the
disc. After elimination of k and B, the signal of a change dα is the part of B dα perpendicular to l, in
units of the noise s² = σ_C² + (1 − α)² σ_B²; a rotation of l has the signal k dl. The derivatives of α
are differences of discs rendered at the true position. Rounding to code values counts as noise of 1/12.

Run: python -m benchmarks.accuracy.motion
"""

import warnings
from dataclasses import dataclass

import numpy as np
from benchmarks.accuracy.color import random_color
from benchmarks.table import Cell, Table, publish_all
from benchmarks.trials import CODE, over_seeds, photograph

from blurmatte.errors import BlurmatteError, BlurmatteWarning
from blurmatte.matting import solve
from blurmatte.metrics import trajectory_iou
from blurmatte.motion import Motion
from blurmatte.motion.picture.measure import measure_motion
from blurmatte.radiometry import SRGB
from blurmatte.rendering import Ball, Camera, Rendering, Scene, colorful_plate, render
from blurmatte.rendering.coverage import disc_coverage
from blurmatte.trajectory import Trajectory

NOISES = (1, 2)  # code values of 255
RADII = ((6, 12), (12, 24), (24, 40))  # pixels
LENGTHS = (1, 15)  # radii
SEEDS = 12
MOST_LENGTH = 300.0  # pixels: larger pictures give nothing new and take long
STEP = 0.05  # pixels, for derivatives of the bound
CONVERGED = 0.9  # of TIoU
MEDIAN_SIZE = 0.6745  # of a normal error, in standard deviations
NAMES = ("x", "y", "length", "angle", "radius")
NOTES = f"""
Balls of random paint, shaded, before colorful tiles; straight paths of {LENGTHS[0]} to
{LENGTHS[1]} radii, at most {MOST_LENGTH:g} px, in all directions; 8 bits, one picture of the plate
with the same noise, in code values of 255; nothing given. converged: fraction of the scenes with a
TIoU of {CONVERGED:g} or more; the other columns are of these. straight: fraction in which the path was
found to be straight at constant speed. ratio: root mean square of the error over the Cramer-Rao bound
of its scene, given the noise, a straight path and a disc, but neither color nor shading; direction
errors are multiplied by half the length. typical ratio: the same of center and length, from medians,
which single failures do not change. spread: root mean square of the error over the reported standard
deviation; 1 is correct. bias: mean error in these units, the largest in absolute value of center,
length and radius; its standard error is about 1 over the root of the number of scenes. bound: median,
pixels.
"""


@dataclass(frozen=True)
class Outcome:
    """Errors of `NAMES` in pixels (the angle times half the length), those claimed, and the bound."""

    error: np.ndarray
    std: np.ndarray
    bound: np.ndarray
    tiou: float
    straight: bool


def random_scene(low: float, high: float, seed: int) -> Rendering:
    """A ball that goes straight, in a picture that is large enough."""
    rng = np.random.default_rng([seed, int(low)])
    radius = np.exp(rng.uniform(np.log(low), np.log(high)))
    length = min(radius * np.exp(rng.uniform(*np.log(LENGTHS))), MOST_LENGTH)
    angle = rng.uniform(0, 2 * np.pi)
    displacement = length * np.array([np.cos(angle), np.sin(angle)])
    room = np.ceil(np.abs(displacement) + 6 * radius + 30).astype(int)
    start = (room - displacement) / 2 + rng.uniform(-3, 3, 2)
    color = random_color(rng, 0.25, 1)
    color *= rng.uniform(0.5, 1) / color.max()
    plate = colorful_plate((int(room[0]), int(room[1])), rng, tile=40)
    return render(Scene(plate, Trajectory.line(start, start + displacement), Ball(radius, color)))


def trial(noise: int, low: int, high: int, seed: int) -> Outcome:
    truth = random_scene(low, high, seed)
    image, plate = photograph(truth, Camera(code_std=noise * CODE), 100 * noise + seed, frames=1)
    true, bound = true_values(truth), bounds(truth, noise)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", BlurmatteWarning)
        try:
            motion = measure_motion(solve(image, plate))
        except BlurmatteError:
            return Outcome(*np.full((2, len(NAMES)), np.nan), bound, 0.0, False)
    return compared(motion, truth, true, bound)


def compared(motion: Motion, truth: Rendering, true: np.ndarray, bound: np.ndarray) -> Outcome:
    ball = truth.scene.body
    assert isinstance(ball, Ball)
    error = np.array([*motion.center, motion.length, motion.angle, motion.radius]) - true
    error[3] = (error[3] + np.pi / 2) % np.pi - np.pi / 2
    std = np.array([*motion.center_std, motion.length_std, motion.angle_std, motion.radius_std])
    half = np.array([1, 1, 1, true[2] / 2, 1])
    tiou = trajectory_iou(motion.trajectory, truth.trajectory, ball.radius)
    return Outcome(error * half, std * half, bound, tiou, motion.path == "line")


def true_values(truth: Rendering) -> np.ndarray:
    ball, (a, b) = truth.scene.body, truth.trajectory.xy
    assert isinstance(ball, Ball)
    return values(np.array([*a, *b, ball.radius]))


def values(p: np.ndarray) -> np.ndarray:
    """`NAMES` of two ends and a radius."""
    a, b = p[:2], p[2:4]
    dx, dy = b - a
    return np.array([*(a + b) / 2, np.hypot(dx, dy), np.arctan2(dy, dx), p[4]])


def bounds(truth: Rendering, noise: float) -> np.ndarray:
    """(5,) least standard deviations of `NAMES`, pixels."""
    ball, (a, b) = truth.scene.body, truth.trajectory.xy
    assert isinstance(ball, Ball)
    p, size = np.array([*a, *b, ball.radius]), truth.image.size
    steps = STEP * np.eye(5)
    count = int(np.ceil(4 * truth.trajectory.length))
    by_path = [(drawn(p + d, size, count) - drawn(p - d, size, count)) / (2 * STEP) for d in steps]
    alpha, k = truth.layer.alpha, truth.layer.premultiplied @ ball.color / (ball.color @ ball.color)
    N = np.linalg.svd(ball.color[:, None])[0][:, 1:]
    V = variance(truth.image.rgb, noise)
    V = V + (1 - alpha[..., None]) ** 2 * variance(truth.plate.rgb, noise)
    NVN = np.einsum("ci,hwc,cj->hwij", N, V, N)
    seen = truth.plate.rgb @ N  # of B, across the color
    columns = [change[..., None] * seen for change in by_path]
    columns += [-k[..., None] * np.linalg.norm(ball.color) * axis for axis in np.eye(2)]
    J = np.stack(columns, axis=-1)  # (h, w, 2, 7)
    information = np.einsum("hwia,hwib->ab", J, np.linalg.solve(NVN, J))
    covariance = np.linalg.inv(information)[:5, :5]
    by_p = np.stack([(values(p + d) - values(p - d)) / (2 * STEP) for d in steps], axis=1)
    std = np.sqrt(np.diag(by_p @ covariance @ by_p.T))
    std[3] *= values(p)[2] / 2
    return np.asarray(std)


def variance(light: np.ndarray, noise: float) -> np.ndarray:
    """Of light whose code values have noise and are rounded."""
    return np.asarray(SRGB.slope(light) ** 2 * (noise**2 + 1 / 12) * CODE**2)


def drawn(p: np.ndarray, size: tuple[int, int], count: int) -> np.ndarray:
    """(H, W) alpha of a disc on a line: the mean of exact areas within pixels at `count` moments."""
    a, b, radius = p[:2], p[2:4], p[4]
    alpha = np.zeros((size[1], size[0]))
    for t in (np.arange(count) + 0.5) / count:
        x, y = a + t * (b - a)
        x0, y0 = (int(np.floor(v - radius)) - 1 for v in (x, y))
        n = int(np.ceil(2 * radius)) + 4
        edges = np.arange(n + 1) - 0.5
        area = disc_coverage(x0 + edges - x, y0 + edges - y, radius)
        alpha[y0 : y0 + n, x0 : x0 + n] += area
    return alpha / count


def row(outcomes: list[Outcome]) -> list[Cell]:
    good = [o for o in outcomes if o.tiou >= CONVERGED]
    share = len(good) / len(outcomes)
    if not good:
        return [len(outcomes), share, *[None] * 15]
    error, std, bound = (np.array([getattr(o, n) for o in good]) for n in ("error", "std", "bound"))
    ratio, z = error / bound, error / std
    bias = z[:, [0, 1, 2, 4]].mean(axis=0)
    pooled = [(0, 1), (2,), (3,), (4,)]
    return [
        len(outcomes),
        share,
        float(np.mean([o.straight for o in good])),
        *(float(np.sqrt(np.mean(ratio[:, c] ** 2))) for c in pooled),
        float(np.median(np.abs(ratio[:, :3])) / MEDIAN_SIZE),
        *(float(np.sqrt(np.mean(z[:, c] ** 2))) for c in pooled),
        float(bias[np.argmax(np.abs(bias))]),
        float(min(o.tiou for o in good)),
        float(np.mean([o.tiou for o in good])),
        float(np.median(bound[:, :2])),
        float(np.median(bound[:, 4])),
    ]


def tables(quick: bool = False) -> list[Table]:
    settings = [(noise, *radii) for noise in NOISES for radii in RADII]
    settings = settings[:1] if quick else settings
    groups = over_seeds(trial, settings, quick, SEEDS)
    rows: list[tuple[Cell, ...]] = []
    for (noise, low, high), group in zip(settings, groups, strict=True):
        rows.append((noise, f"{low} to {high}", *row(group)))
    rows.append(("all", "all", *row([o for group in groups for o in group])))
    of = ("center", "length", "direction", "radius")
    columns = (
        *("noise", "radius", "scenes", "converged", "straight"),
        *(f"{name} ratio" for name in of),
        "typical ratio",
        *(f"{name} spread" for name in of),
        *("bias", "least TIoU", "mean TIoU", "center bound", "radius bound"),
    )
    question = "How close is the error of the measured motion to the Cramer-Rao bound?"
    return [Table("motion", question, NOTES, columns, rows)]


if __name__ == "__main__":
    publish_all(tables)
