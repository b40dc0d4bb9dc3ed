"""Scenes rendered and photographed once, for the tests of several packages."""

from functools import lru_cache

import numpy as np
from benchmarks.rendered import add_noise

from blurmatte.color.model import ColorModel
from blurmatte.matting import Quality, SolutionStats
from blurmatte.matting.solution import Solution
from blurmatte.radiometry import LinearImage
from blurmatte.rendering import Scene, Shot, render
from blurmatte.trajectory import Trajectory

RED = ColorModel.from_hex("#ff0000")


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
