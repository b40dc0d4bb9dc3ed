"""Shadows if no sweep locates the object: flags, and an error that covers their alpha."""

from dataclasses import replace

import numpy as np
import pytest

from blurmatte.color import ColorModel
from blurmatte.matting import Pixelwise, Quality, Smooth, solve
from blurmatte.rendering import Ball, Camera, Scene, Shadow, Shot, render, two_hue_plate
from blurmatte.trajectory import Trajectory

COLOR = np.array([0.15, 0.43, 0.40])
MODEL = ColorModel.from_samples(np.array([COLOR]), std=1e-4)
PLATE = two_hue_plate((160, 120), (0.45, 0.40, 0.36), (0.10, 0.22, 0.40), 3)
SCENE = Scene(PLATE, Trajectory.line((60, 45), (100, 45)), Ball(14, COLOR))


def solved(scene, solver):
    truth = render(scene)
    image, plate = Shot(scene, Camera(code_std=1 / 255), seed=1).photograph(truth)
    return truth, solve(image, plate, MODEL, solver)


@pytest.mark.parametrize("solver", [Pixelwise(), Smooth()], ids=["pixelwise", "smooth"])
def test_error_covers_the_alpha_of_a_possible_shadow(solver):
    """honest: the errors of alpha and of its sum are at most those claimed."""
    truth, solution = solved(replace(SCENE, shadow=Shadow((0, 34), 3, (0.5,) * 3)), solver)
    marked = (solution.quality & np.uint8(Quality.SHADOW)) != 0
    nothing = marked & (truth.layer.alpha == 0)
    off = (solution.alpha - truth.layer.alpha)[nothing]
    assert np.median(off) > 0.1
    assert np.mean(np.abs(off) < 2 * solution.alpha_std[nothing]) > 0.9
    off_sum = solution.stats.sum_alpha - truth.layer.alpha.sum()
    assert 0.5 < off_sum / solution.stats.sum_alpha_std < 1.5


def test_without_a_shadow_errors_are_those_of_the_solver():
    _, solution = solved(SCENE, Smooth())
    marked = (solution.quality & np.uint8(Quality.SHADOW)) != 0
    assert not marked.any()
    assert solution.stats.sum_alpha_std < 0.02 * solution.stats.sum_alpha
