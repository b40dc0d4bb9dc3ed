"""Scenes rendered and photographed once, for the tests of several packages."""

from functools import lru_cache

import numpy as np
from benchmarks.rendered import add_noise

from blurmatte.color.model import ColorModel
from blurmatte.files.writing import write
from blurmatte.matting import Quality, SolutionStats
from blurmatte.matting.solution import Solution
from blurmatte.radiometry import LinearImage
from blurmatte.rendering import Ball, Camera, Scene, Shot, colorful_plate, render
from blurmatte.trajectory import Trajectory

RED = ColorModel.from_hex("#ff0000")
BALL = Scene(colorful_plate((96, 72), 2, tile=18), Trajectory.line((26, 28), (70, 42)), Ball(9))
SMALL_BALL = Scene(
    *(colorful_plate((64, 48), rng=1, tile=9), Trajectory.line((18, 20), (44, 26))),
    Ball(6, (0.9, 0.5, 0.05)),
)


def rendered(scene, substeps=200):
    """The truth of a scene."""
    return _rendered(scene, substeps)


def on_line(plate, start, end, body, substeps=200):
    """The truth of a body that moves on a line before a plate."""
    return rendered(Scene(plate, Trajectory.line(start, end), body), substeps)


@lru_cache(maxsize=64)
def _rendered(scene, substeps):
    return render(scene, substeps)


@lru_cache(maxsize=64)
def photographed(scene, camera, seed=0, plate_frames=3, substeps=200):
    """Image and plate as a camera takes them; the plate is the median of several pictures."""
    shot = Shot(scene, camera, plate_frames=plate_frames, seed=seed)
    return shot.photograph(rendered(scene, substeps))


def ball_in(folder, image="image.png", plate="plate.png"):
    """The pictures of BALL by a camera of 8 bits, which are written into a folder."""
    pictures = photographed(BALL, Camera(code_std=1 / 255), plate_frames=1)
    for name, picture in zip((image, plate), pictures, strict=True):
        write(folder / name, picture)
    return pictures


def noisy(truth, noise, seed):
    """Image and plate of a rendering with known noise, float32 as of a file."""
    rng = np.random.default_rng(seed)
    return tuple(
        LinearImage(add_noise(light.rgb, noise, rng).astype(np.float32), noise)
        for light in (truth.image, truth.plate)
    )


def solution_of(alpha, std=0.01, streak=None, sweep=None, model=RED, **stats):
    """A solution with this alpha (h, w), known everywhere, or in the streak only."""
    quality = np.zeros(alpha.shape, np.uint8)
    if streak is not None:
        quality[~streak] = Quality.OUTSIDE
    light = alpha[..., None] * model.rgb[0]
    stds, numbers = np.full(alpha.shape, std, float), SolutionStats(**stats)
    ones = np.ones_like(light)
    return Solution(alpha, stds, light, ones, quality, model, "made up", numbers, sweep)
