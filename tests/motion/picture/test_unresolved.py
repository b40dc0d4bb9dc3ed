"""Motions that blur less than the lens does."""

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter
from tests.sweep.scenes import GREEN, TILES, WALL

from blurmatte.motion.picture.measure import motion_of_sweep
from blurmatte.radiometry import LinearImage, NoiseModel
from blurmatte.rendering import Ball, Scene, render
from blurmatte.streaks import require_streaks
from blurmatte.sweep.discs import fit_disc
from blurmatte.trajectory import Trajectory

NOISE = 0.002


def measured(plate, moved, blur=0.6, seed=0):
    """The motion of a ball to the right by some pixels, that a lens blurs by a Gaussian."""
    rng = np.random.default_rng(seed)
    way = Trajectory.line((60, 40), (60 + max(moved, 1e-3), 40))
    light = render(Scene(plate, way, Ball(13, GREEN, ambient=0.5))).image.rgb, plate
    image, behind = (
        LinearImage(
            gaussian_filter(one, (blur, blur, 0)) + rng.normal(0, NOISE, one.shape),
            NoiseModel(read_std=NOISE),
        )
        for one in light
    )
    return motion_of_sweep(fit_disc(image, behind, require_streaks(image, behind)[0]), None)


@pytest.mark.parametrize("plate", [WALL, TILES], ids=["wall", "tiles"])
@pytest.mark.parametrize("moved", [0.0, 1.0])
def test_a_motion_below_the_blur_of_the_lens_is_within_its_error(plate, moved):
    """honest: the profile of the lens is not that of the model, which looks like a path of 3 px."""
    motion = measured(plate, moved)
    assert not motion.moved
    assert abs(motion.length - moved) < 2 * motion.length_std < 10
    assert abs(motion.top_speed - moved) < 2 * np.sqrt(motion.covariance[-1, -1])


@pytest.mark.parametrize("plate", [WALL, TILES], ids=["wall", "tiles"])
def test_a_motion_above_the_blur_of_the_lens_is_known(plate):
    """honest"""
    motion = measured(plate, 6.0)
    assert motion.moved
    assert abs(motion.length - 6) < 4 * motion.length_std < 0.6
