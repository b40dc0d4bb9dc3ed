"""How accurate are distance and speed of a ball in space from one picture of its streak?

Renders balls of a known size that pass a calibrated camera on straight lines in any direction, also
towards it, in front of colorful plates; takes 8-bit sRGB pictures with noise; finds the streak
(`fit_sweep`) and fits the flight through space (`fit_ball`). The disc of the sweep alone
(`measure_ball`) is the comparison.

Run: python -m benchmarks.accuracy.space
"""

from dataclasses import dataclass

import numpy as np
from benchmarks.rendered import render_flight
from benchmarks.table import Cell, Table, publish_all
from benchmarks.trials import CODE, median, rows_over_seeds

from blurmatte.calibration import with_noise
from blurmatte.errors import BlurmatteError
from blurmatte.intrinsics import Intrinsics
from blurmatte.motion import BallMotion, fit_ball, measure_ball
from blurmatte.radiometry import SRGB, LinearImage
from blurmatte.rendering import Camera, colorful_plate
from blurmatte.sweep import fit_sweep

SIZE = (360, 260)
LENS = Intrinsics(700, 700, 179.5, 129.5, np.array([-0.12, 0.03, 1e-3, -5e-4]))
RADIUS, DEPTH = 0.02, 0.7  # meters: 20 pixels
EXPOSURE = 1 / 60
SEEDS = 4
STEPS = 240
NOISES = (1, 2)
AHEAD = (0, 30, 60)  # degrees out of the picture's plane
NOTES = f"""
Balls of random paint and {1000 * RADIUS:g} mm radius, about {DEPTH:g} m away (20 px), that fly straight
for 6 to 10 radii, at an angle (degrees) to the plane of the picture, before colorful plates of
{SIZE[0]}x{SIZE[1]}; 8 bits, noise in code values of 255, the plate the median of five frames; a lens
with known distortion. Errors in %, median and worst: of the distance in the middle, of the speed; and
the angle between true and estimated direction, degrees. spread: root mean square of
(depth - truth) / depth_std, and the same of the speed; 1 is correct. disc speed: median error of the
speed from a disc of one radius, without motion along the line of sight.
"""


@dataclass(frozen=True)
class Errors:
    """Of one flight; NaN where it was refused. Relative errors of depth and speed in %."""

    depth: float = np.nan
    speed: float = np.nan
    degrees: float = np.nan
    depth_z: float = np.nan
    speed_z: float = np.nan
    disc: float = np.nan


def flight(degrees: float, seed: int) -> tuple[LinearImage, np.ndarray, np.ndarray]:
    """The exact picture, the plate, and both ends of the path."""
    rng = np.random.default_rng(seed)
    plate = colorful_plate(SIZE, rng, tile=40)
    color = SRGB.decode(rng.uniform(0.25, 1, 3))
    color *= rng.uniform(0.5, 1) / color.max()
    angle, length = rng.uniform(0, 2 * np.pi), rng.uniform(6, 10) * RADIUS
    tilt = np.radians(degrees) * rng.choice([-1, 1])
    direction = [np.cos(tilt) * np.cos(angle), 0.7 * np.cos(tilt) * np.sin(angle), np.sin(tilt)]
    middle = np.array([*rng.uniform(-0.03, 0.03, 2), DEPTH])
    half = length / 2 * np.array(direction) / np.linalg.norm(direction)
    t = (np.arange(STEPS)[:, None] + 0.5) / STEPS
    X = middle - half + 2 * t * half
    image, _ = render_flight(plate, LENS, X, RADIUS, color)
    return image, plate, np.array([middle - half, middle + half])


def errors_of(motion: BallMotion, ends: np.ndarray, disc: float) -> Errors:
    direction = ends[1] - ends[0]
    length, depth = float(np.linalg.norm(direction)), float(ends[:, 2].mean())
    cosine = abs(motion.displacement @ direction) / np.linalg.norm(motion.displacement) / length
    return Errors(
        100 * (motion.depth / depth - 1),
        100 * (motion.length / length - 1),
        float(np.degrees(np.arccos(min(cosine, 1)))),
        (motion.depth - depth) / motion.depth_std,
        (motion.length - length) / motion.length_std,
        100 * (disc / length - 1),
    )


def trial(degrees: float, noise: int, seed: int) -> Errors:
    light, behind, ends = flight(degrees, seed)
    camera, rng = Camera(code_std=noise * CODE), np.random.default_rng(seed)
    image = camera.photograph(light.rgb, rng)
    frames = [camera.photograph(behind, rng) for _ in range(5)]
    median_plate = np.median([frame.rgb for frame in frames], axis=0)
    image, plate = with_noise(image, LinearImage(median_plate, valid=frames[0].valid))
    try:
        sweep = fit_sweep(image, plate)
        motion = fit_ball(image, plate, LENS, RADIUS, EXPOSURE, sweep=sweep)
    except BlurmatteError:
        return Errors()
    try:
        disc = measure_ball(sweep, LENS, RADIUS, EXPOSURE).length
    except BlurmatteError:
        disc = np.nan
    return errors_of(motion, ends, disc)


def row(group: list[Errors]) -> list[Cell]:
    answered = [e for e in group if np.isfinite(e.depth)]
    cells: list[Cell] = [len(group) - len(answered)]
    for name in ("depth", "speed", "degrees"):
        values = [abs(getattr(e, name)) for e in answered]
        cells += [median(values), max(values, default=None)]
    for name in ("depth_z", "speed_z"):
        z = np.array([getattr(e, name) for e in answered])
        cells.append(float(np.sqrt(np.mean(z**2))) if len(z) else None)
    return [*cells, median([abs(e.disc) for e in answered])]


def tables(quick: bool = False) -> list[Table]:
    settings = [(degrees, noise) for degrees in AHEAD for noise in NOISES]
    settings = settings[:1] if quick else settings
    rows = rows_over_seeds(trial, settings, row, quick, SEEDS)
    errors = [
        f"{what} {part}" for what in ("depth", "speed", "degrees") for part in ("median", "worst")
    ]
    columns = (
        "out of plane",
        "noise",
        "refused",
        *errors,
        "depth spread",
        "speed spread",
        "disc speed",
    )
    question = "How accurate are distance and speed of a ball in space from one picture?"
    return [Table("space", question, NOTES, columns, rows)]


if __name__ == "__main__":
    publish_all(tables)
