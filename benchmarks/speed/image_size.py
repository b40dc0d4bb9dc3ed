"""Does the cost of solve grow linearly with the size of the picture?

Run: python -m benchmarks.speed.image_size
"""

import tracemalloc
from collections.abc import Callable
from functools import partial

import numpy as np
from benchmarks.speed.timing import interleaved
from benchmarks.table import Cell, Table, publish_all

from blurmatte.calibration import with_noise
from blurmatte.color.model import ColorModel
from blurmatte.matting import PixelMaps, Pixelwise, Smooth, solve
from blurmatte.matting.solution import Solution
from blurmatte.radiometry import SRGB, LinearImage, decode

MEGAPIXELS = (0.1, 0.3, 1, 3, 10, 33)
QUICK_MEGAPIXELS = (0.1, 1)
LARGEST_STREAK = 10  # megapixels of the picture in which the streak is solved together
UNIT = 1  # megapixels: the size that others are compared with
ROUNDS = 2
ASPECT = 3 / 2
PATCHES = 24  # across the picture: its plate has the same content at every size
COLOR = np.array([0.80, 0.35, 0.06])
MODEL = ColorModel.from_samples(COLOR, std=0)
STREAK = (0.30, 0.10)  # half axes of the streak, of the picture's width and height: 9 % of it
PEAK = 0.5
NOISE = 1.0  # code values of 255


def pictures(megapixels: float) -> tuple[LinearImage, LinearImage]:
    """Image and plate, 8 bits with noise: patches of color, and an ellipse of alpha before them."""
    rng = np.random.default_rng(0)
    height = round(np.sqrt(1e6 * megapixels / ASPECT))
    width = round(ASPECT * height)
    y, x = (np.linspace(-1, 1, n, dtype=np.float32) for n in (height, width))
    here = [((n + 1) / 2 * (PATCHES - 1e-3)).astype(int) for n in (y, x)]
    colors = rng.uniform(0.05, 0.6, (PATCHES, PATCHES, 3)).astype(np.float32)
    plate = colors[np.ix_(*here)]
    far = (x / (2 * STREAK[0])) ** 2 + (y[:, None] / (2 * STREAK[1])) ** 2
    alpha = PEAK * np.sqrt(np.maximum(1 - far, 0))[..., None]
    image = alpha * COLOR.astype(np.float32) + (1 - alpha) * plate
    return with_code_noise(image, rng), with_code_noise(plate, rng)


def with_code_noise(light: np.ndarray, rng: np.random.Generator) -> LinearImage:
    codes = 255 * SRGB.encode(light) + NOISE * rng.standard_normal(light.shape, np.float32)
    return decode(np.clip(np.rint(codes), 0, 254).astype(np.uint8), SRGB)


def kernel(image: LinearImage, plate: LinearImage) -> Callable[[], PixelMaps]:
    """The closed form alone, into fresh arrays."""
    image, plate = with_noise(image, plate)
    return partial(Pixelwise(), image.rgb, plate.rgb, MODEL, image.noise, plate.noise)


def whole(image: LinearImage, plate: LinearImage) -> Callable[[], Solution]:
    """All of solve: noise, streaks, closed form."""
    return partial(solve, image, plate, MODEL, Pixelwise())


def together(image: LinearImage, plate: LinearImage) -> Callable[[], Solution]:
    """The same, and the streak's pixels all at once."""
    return partial(solve, image, plate, MODEL, Smooth())


def peak_bytes(job: Callable[[], object]) -> int:
    """The most that a job holds at a time beyond its arguments."""
    tracemalloc.start()
    job()
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    return peak


def tables(quick: bool = False) -> list[Table]:
    sizes = QUICK_MEGAPIXELS if quick else MEGAPIXELS
    jobs: dict[tuple[str, float], Callable[[], object]] = {}
    for megapixels in sizes:
        pair = pictures(megapixels)
        jobs[("solve", megapixels)] = whole(*pair)
        if megapixels <= LARGEST_STREAK:
            jobs[("smooth", megapixels)] = together(*pair)
        jobs[("kernel", megapixels)] = kernel(*pair)
    for what in ("solve", "smooth", "kernel"):
        jobs[what, sizes[0]]()  # compiles, or loads what is compiled
    memory = {key: peak_bytes(job) for key, job in jobs.items()}
    times = interleaved(jobs, 1 if quick else ROUNDS)
    least = {key: min(seconds) for key, seconds in times.items()}
    rows: list[tuple[Cell, ...]] = [
        (
            what,
            megapixels,
            1e3 * least[what, megapixels],
            least[what, megapixels] / least[what, UNIT] * UNIT / megapixels,
            memory[what, megapixels] / 1e6 / megapixels,
            memory[what, megapixels] / memory[what, UNIT] * UNIT / megapixels,
        )
        for what, megapixels in sorted(jobs)
    ]
    return [
        Table(
            "image_size",
            "Does the cost of solve grow linearly with the size of the picture?",
            "One scene in all sizes, 8 bits, already in memory; the streak covers 9 % of it and the "
            "true line is given. solve: measures the noise, finds the streak and solves each pixel "
            "alone; smooth: the pixels of the streak together; kernel: the closed form alone. ms: the "
            f"shortest of {ROUNDS} interleaved rounds. time: for each pixel, relative to 1 megapixel; "
            "1 is linear. bytes: peak memory for each pixel beyond the two pictures (24 bytes), with "
            "the solution (33 bytes); memory: relative to 1 megapixel.",
            ("what", "megapixels", "ms", "time", "bytes", "memory"),
            rows,
            x="megapixels",
            lines="what",
            y="time",
            log_x=True,
        )
    ]


if __name__ == "__main__":
    publish_all(tables)
