"""A small ball of patches on a line, with its true sweep."""

from typing import NamedTuple

import numpy as np
import pytest
from tests.scenes import noisy, rendered

import blurmatte as bm
from blurmatte.metrics import subframe_psnr
from blurmatte.radiometry import LinearImage, NoiseModel
from blurmatte.rendering import Rendering
from blurmatte.rendering.plates import textured_plate
from blurmatte.sweep import Sweep
from blurmatte.sweep.model.path import LINE
from blurmatte.sweep.model.silhouette import DISC

NOISE = NoiseModel(read_std=1 / 255)


class Case(NamedTuple):
    """A rendering, its noisy pictures, and the sweep of the truth."""

    truth: Rendering
    image: LinearImage
    plate: LinearImage
    sweep: Sweep


def patches(seed: int) -> np.ndarray:
    """(96, 192, 3) texture of 4 by 8 patches of random paint."""
    paint = np.random.default_rng(seed).uniform(0.1, 0.9, (4, 8, 3))
    return np.repeat(np.repeat(paint, 24, axis=0), 24, axis=1)


def case(start=(18.2, 16.4), end=(44.7, 24.1), radius=8.0, seed=0, std=0.05, texture=None) -> Case:
    """A ball on a line; `std` of the parameters of its sweep, pixels."""
    ball = bm.rendering.Ball(
        radius, texture=patches(seed) if texture is None else texture, ambient=1.0
    )
    scene = bm.rendering.Scene(textured_plate((64, 42), seed), bm.Trajectory.line(start, end), ball)
    truth = rendered(scene)
    path = np.array([*start, *end])
    sweep = Sweep(
        *(LINE, path, DISC, np.array([radius]), bm.ColorModel.any()),
        *(std**2 * np.eye(5), (64, 42)),
    )
    return Case(truth, *noisy(truth, NOISE, seed), sweep)


def psnr(layers, truth: Rendering) -> float:
    """Of sub-frames before the plate, as encoded."""
    shown, true = (
        np.stack([one.over(truth.plate).rgb for one in subframes])
        for subframes in (layers, truth.subframes(len(layers)))
    )
    coded = [bm.SRGB.encode(np.clip(x, 0, 1)) for x in (shown, true)]
    return subframe_psnr(*coded, bm.SRGB.encode(truth.plate.rgb))


@pytest.fixture(scope="module")
def ball() -> Case:
    return case()
