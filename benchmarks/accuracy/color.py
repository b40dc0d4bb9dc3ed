"""How far is the color of the streak from the truth?

Renders balls of random paint that move in front of three kinds of plates, takes 8-bit sRGB pictures
of them with noise in the code values (the plate is the median of five), finds the streak and fits
its color; the published formula gets the same pixels. A row of the table is one kind of plate and
one noise. Errors are given twice:

* units: 255 · |o − (o·l) l|, linear light, o the paint's true color and l the estimated direction.
  (o·l) l is the color on the estimated line that is nearest to the truth: brightness is matched,
  for the line does not know it.
* degrees: the angle between o and l.

Both are median / 90 % / worst of the scenes that have an answer; the published formula never refuses,
so it has more of them. `spread` is the root mean square of the error in units of its reported standard
deviation, per direction: 1 is honest, more is boasting.

Run: python benchmarks/accuracy/color.py [--seeds N] [--csv FILE]
"""

import argparse
import csv
import platform
from dataclasses import dataclass, fields, replace
from pathlib import Path

import numpy as np

import blurmatte
from blurmatte.color import ColorModel, fit_color, published_color_line
from blurmatte.color.streak import _streak_pixels
from blurmatte.errors import ColorModelError
from blurmatte.radiometry import SRGB, LinearImage, NoiseModel, with_noise
from blurmatte.rendering import (
    Ball,
    Rendering,
    Scene,
    colorful_plate,
    photograph,
    plain_plate,
    render,
    two_hue_plate,
)
from blurmatte.streaks import find_streaks
from blurmatte.trajectory import Trajectory

SIZE = (320, 240)
SUBSTEPS = 120  # alpha to 2e-4: below the noise
NOISES = (1, 2)  # code values of 255
PLATE_FRAMES = 5


def random_color(rng, low, high):
    """Linear light of a color whose sRGB codes are uniform between two bounds."""
    return SRGB.decode(rng.uniform(low, high, 3))


PLATES = {
    "colorful": lambda rng: colorful_plate(SIZE, rng),
    "two hues": lambda rng: two_hue_plate(
        SIZE, random_color(rng, 0.3, 0.8), random_color(rng, 0.3, 0.8), rng
    ),
    "plain": lambda rng: plain_plate(SIZE, random_color(rng, 0.35, 0.8), rng),
}


@dataclass(frozen=True)
class Outcome:
    """How far both answers are from the truth in one scene; NaN where there is none."""

    units: float
    degrees: float
    normalised: float  # ours in units of its standard deviation, root mean square of two directions
    published_units: float
    published_degrees: float


@dataclass(frozen=True)
class Row:
    """One line of the table."""

    plate: str
    noise: int  # standard deviation, code values of 255
    scenes: int
    refused: int
    units_median: float
    units_90: float
    units_worst: float
    degrees_median: float
    degrees_90: float
    degrees_worst: float
    spread: float
    published_units_median: float
    published_units_90: float
    published_units_worst: float
    published_degrees_median: float
    published_degrees_90: float
    published_degrees_worst: float


def random_scene(kind: str, seed: int) -> tuple[Rendering, np.ndarray]:
    """A scene with a ball that moves by 1 to 8 radii, and its paint."""
    rng = np.random.default_rng(seed)
    color = random_color(rng, 0.25, 1)
    color *= rng.uniform(0.5, 1) / color.max()
    plate, radius, angle = PLATES[kind](rng), rng.uniform(8, 22), rng.uniform(0, np.pi)
    length = min(rng.uniform(1, 8) * radius, 170)
    middle = np.array(SIZE) / 2 + rng.uniform(-15, 15, 2)
    half = length / 2 * np.array([np.cos(angle), 0.8 * np.sin(angle)])
    path = Trajectory.line(tuple(middle - half), tuple(middle + half))
    return render(Scene(plate, path, Ball(radius, color)), SUBSTEPS), color


def pictures(scene: Rendering, noise: int, seed: int) -> tuple[LinearImage, LinearImage]:
    """Eight-bit image, and plate as the median of several pictures; noise measured."""
    rng = np.random.default_rng(seed)
    image, *frames = (
        photograph(light, NoiseModel(), rng, code_std=noise / 255)
        for light in [scene.image.rgb] + PLATE_FRAMES * [scene.plate.rgb]
    )
    rgb = np.median([frame.rgb for frame in frames], axis=0)
    return with_noise(image, replace(frames[0], rgb=rgb, valid=(rgb < 1).all(axis=-1)))


def angle_units(model: ColorModel, color: np.ndarray) -> tuple[float, float]:
    """Error of a line in units of 0…255 and in degrees."""
    along = model.pole @ color
    across = float(np.linalg.norm(color - along * model.pole))
    return 255 * across, float(np.degrees(np.arctan2(across, along)))


def normalised_error(model: ColorModel, color: np.ndarray) -> float:
    tangent = np.linalg.svd(model.pole[:, None])[0][:, 1:]
    error = tangent.T @ color / (model.pole @ color)
    covariance = tangent.T @ model.covariance @ tangent
    return float(np.sqrt(error @ np.linalg.solve(covariance, error) / 2))


def run(kind: str, noise: int, seed: int) -> Outcome:
    scene, color = random_scene(kind, seed)
    image, plate = pictures(scene, noise, seed)
    found = find_streaks(image, plate)
    if not found:
        return Outcome(*(5 * [np.nan]))
    pixels = _streak_pixels(image, plate, found[0])
    published = angle_units(published_color_line(pixels.C, pixels.B), color)
    try:
        model = fit_color(image, plate, found[0])
    except ColorModelError:
        return Outcome(np.nan, np.nan, np.nan, *published)
    return Outcome(*angle_units(model, color), normalised_error(model, color), *published)


def quantiles(values: list[float]) -> tuple[float, float, float]:
    known = np.array(values)[np.isfinite(values)]
    if len(known) == 0:
        return np.nan, np.nan, np.nan
    return tuple(np.quantile(known, [0.5, 0.9, 1]).tolist())


def summary(kind: str, noise: int, outcomes: list[Outcome]) -> Row:
    columns = {f.name: [getattr(o, f.name) for o in outcomes] for f in fields(Outcome)}
    normalised = np.array(columns["normalised"])
    answered = np.isfinite(normalised)
    spread = np.sqrt(np.mean(normalised[answered] ** 2)) if answered.any() else np.nan
    return Row(
        kind, noise, len(outcomes), int(np.sum(~answered)),
        *quantiles(columns["units"]), *quantiles(columns["degrees"]), float(spread),
        *quantiles(columns["published_units"]), *quantiles(columns["published_degrees"]),
    )  # fmt: skip


def line(row: Row) -> str:
    def triple(name: str, digits: int) -> str:
        values = (getattr(row, f"{name}_{part}") for part in ("median", "90", "worst"))
        return " / ".join(f"{v:.{digits}f}" if np.isfinite(v) else "-" for v in values)

    spread = f"{row.spread:.2f}" if np.isfinite(row.spread) else "-"
    return (
        f"{row.plate:9} {row.noise:5} {row.refused:4} of {row.scenes:<3} "
        f"{triple('units', 2):>20} {triple('degrees', 2):>20} {spread:>7}   "
        f"{triple('published_units', 0):>15} {triple('published_degrees', 0):>15}"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=20, metavar="N", help="scenes in each row")
    parser.add_argument("--csv", type=Path, metavar="FILE", help="write the table to a file too")
    arguments = parser.parse_args()
    if arguments.seeds < 1:
        parser.error(f"--seeds must be 1 or more, got {arguments.seeds}")

    versions = {
        "blurmatte": blurmatte.__version__,
        "python": platform.python_version(),
        "numpy": np.__version__,
    }
    print(", ".join(f"{name} {version}" for name, version in versions.items()))
    print(f"{'':28} {'fit_color':^49}   {'published_color_line':^31}")
    print(
        f"{'plate':9} {'noise':>5} {'refused':>10}  {'units':^20} {'degrees':^20} {'spread':>7}   "
        f"{'units':^15} {'degrees':^15}"
    )
    rows = []
    for kind in PLATES:
        for noise in NOISES:
            outcomes = [run(kind, noise, seed) for seed in range(arguments.seeds)]
            rows.append(summary(kind, noise, outcomes))
            print(line(rows[-1]), flush=True)
    if arguments.csv:
        with open(arguments.csv, "w", newline="") as file:
            writer = csv.writer(file)
            writer.writerow([*versions, *(f.name for f in fields(Row))])
            for row in rows:
                writer.writerow([*versions.values(), *(getattr(row, f.name) for f in fields(Row))])


if __name__ == "__main__":
    main()
