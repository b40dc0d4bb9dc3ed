"""fit_color: shape, hues and feasibility together, and an error if they are not sufficient."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from tests import scenes
from tests.sweep.scenes import FLAT, FLAT_BEFORE_TILES, LINE, degrees_between, photographed

from blurmatte.color.streak import fit_color_from_hues
from blurmatte.errors import ColorModelError
from blurmatte.radiometry import Meta
from blurmatte.rendering import Ball, Camera, Scene
from blurmatte.rendering.plates import plain_plate
from blurmatte.streaks import find_streaks, require_streaks
from blurmatte.sweep import fit_sweep
from blurmatte.sweep.color_fit import color_of, fit_color
from blurmatte.trajectory import Trajectory

GREEN = np.array([0.25, 0.7, 0.12])
WALL = plain_plate((150, 110), (0.34, 0.33, 0.3), 4)
SCENE = Scene(WALL, Trajectory.line((40, 40), (108, 66)), Ball(12, GREEN))


def taken(seed):
    """Image and plate of a shaded ball before a wall."""
    return scenes.photographed(SCENE, Camera(code_std=1.5 / 255), seed, substeps=160)


@pytest.mark.parametrize("scenes", [FLAT, FLAT_BEFORE_TILES], ids=["wall", "tiles"])
@pytest.mark.parametrize("seed", range(3))
def test_the_color_of_a_ball_is_found(scenes, seed):
    """honest: within three of its standard deviations."""
    model = fit_color(*photographed(scenes[LINE], seed))
    assert model.rank == 1
    assert degrees_between(model.pole, GREEN) < 3 * model.angle_std < 1.5


def test_shape_determines_a_color_ambiguous_by_hue():
    image, plate = taken(1)
    with pytest.raises(ColorModelError, match="color is uncertain by"):
        fit_color_from_hues(image, plate)
    model = fit_color(image, plate)
    assert degrees_between(model.pole, GREEN) < max(4 * model.angle_std, 0.5) < 2
    assert model.evidence["shape"] < 1
    assert model.evidence["hue variation"] > 3


@pytest.mark.battery
def test_its_error_is_honest():
    """honest: the direction, in two independent angles, over 40 draws of noise."""
    z = []
    for seed in range(40):
        model = fit_color(*photographed(FLAT[LINE], 20 + seed))
        off = GREEN / (model.pole @ GREEN) - model.pole
        z.append(off @ np.linalg.pinv(model.covariance) @ off / 2)
    assert 0.8 < np.sqrt(np.mean(z)) < 1.25


@pytest.mark.battery
def test_color_of_a_rejected_sweep_is_that_of_the_hues():
    """door: if hues are ambiguous too, the sweep's color is used."""
    wall, tiles = photographed(FLAT[LINE]), photographed(FLAT_BEFORE_TILES[LINE])
    for (image, plate), decided in ((wall, False), (tiles, True)):
        sweep, streak = fit_sweep(image, plate), require_streaks(image, plate)[0]
        rejected = replace(sweep, diagnostics=replace(sweep.diagnostics, converged=False))
        model = color_of(rejected, image, plate, streak)
        assert (model is sweep.model) is not decided
        assert degrees_between(model.pole, GREEN) < 3


@pytest.mark.battery
def test_several_frames_give_a_smaller_error():
    frames = [taken(seed) for seed in (1, 2, 3)]
    plate = frames[0][1]
    together = fit_color([image for image, _ in frames], plate)
    alone = fit_color(frames[0][0], plate)
    assert together.evidence["frames"] == pytest.approx(together.angle_std, rel=0.3)
    assert together.angle_std < alone.angle_std
    assert degrees_between(together.pole, GREEN) < max(4 * together.angle_std, 0.5)
    empty = fit_color([frames[0][0], plate], plate)  # nothing moved in the second
    assert_allclose(empty.pole, alone.pole)


def test_rejects_wrong_arguments():
    """door"""
    image, plate = taken(1)
    with pytest.raises(ValueError, match="max_brightness must be positive, got 0"):
        fit_color(image, plate, max_brightness=0)
    with pytest.raises(ValueError, match="images must be one or more, got none"):
        fit_color([], plate)
    with pytest.raises(ValueError, match="a streak is that of one image"):
        fit_color([image], plate, find_streaks(image, plate)[0])
    with pytest.raises(ColorModelError, match="is gray"):
        fit_color(*(replace(p, meta=Meta("wall.png", gray=True)) for p in (image, plate)))
