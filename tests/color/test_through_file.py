"""What a file does to a color that hues tell: drawn as it was written, and claimed."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from blurmatte.color import fit_color_from_hues
from blurmatte.color.through_file import drawn
from blurmatte.radiometry import Compression, with_noise
from blurmatte.rendering import Camera, Scene, Sheet, Shot, colorful_plate, render
from blurmatte.streaks import Streak
from blurmatte.trajectory import Trajectory

SIZE = (160, 112)
GREEN = np.array([0.25, 0.7, 0.12])
PATH = Trajectory.line((50, 46), (110, 66))


def taken(width, seed=0, **file):
    """The truth, image and plate of a thing so many pixels wide, and where it was."""
    plate = colorful_plate(SIZE, seed, tile=18)
    truth = render(Scene(plate, PATH, Sheet(24, width, GREEN)), 120)
    shot = Shot(truth.scene, Camera(code_std=1 / 255, **file), plate_frames=5, seed=seed)
    image, plate = with_noise(*shot.photograph(truth))
    return truth, image, plate, Streak(truth.layer.alpha > 0)


def degrees(a, b):
    return np.degrees(np.arccos(np.clip(a @ b / np.linalg.norm(a) / np.linalg.norm(b), -1, 1)))


def test_what_is_drawn_is_the_picture():
    """Of the true color it differs from what was taken by little more than noise differs."""
    truth, image, plate, streak = taken(16, jpeg_quality=95, chroma="4:4:4")
    image = replace(image, meta=replace(image.meta, compression=fine()))
    l = GREEN / np.linalg.norm(GREEN)
    again = drawn(l, image, plate, streak, 0)
    inside, beside = streak.mask, ~streak.mask
    within, usual = (
        np.sqrt(np.mean((again.rgb - image.rgb)[where] ** 2)) for where in (inside, beside)
    )
    assert within < 2 * usual
    assert_allclose(
        np.median((again.rgb - plate.rgb)[beside], axis=0), 0, atol=2e-3
    )  # nothing was there


def test_its_noise_is_as_new():
    truth, image, plate, streak = taken(16, jpeg_quality=90, chroma="4:2:0")
    l = GREEN / np.linalg.norm(GREEN)
    same, again, other = (drawn(l, image, plate, streak, seed).rgb for seed in (0, 0, 1))
    assert np.array_equal(same, again)
    assert not np.array_equal(same, other)
