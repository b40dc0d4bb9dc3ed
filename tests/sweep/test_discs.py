"""Discs of single frames of a clip, and their colors."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from tests.sweep.scenes import (
    FLAT,
    GREEN,
    JPEG,
    RADIUS,
    RED,
    TILES,
    WALL,
    along,
    alpha_error,
    degrees_between,
    photographed,
    rendered,
)

from blurmatte.rendering import Ball, Scene
from blurmatte.rendering.pose import Change
from blurmatte.streaks import require_streaks
from blurmatte.sweep.discs import fit_disc, fit_disc_colors
from blurmatte.sweep.model.path import LINE, PARABOLA
from blurmatte.trajectory import Trajectory


@pytest.mark.parametrize("scene", [FLAT[LINE], FLAT[PARABOLA]], ids=["line", "parabola"])
def test_fit_disc_is_a_quick_fit_of_a_parabola(scene):
    """honest"""
    image, plate = photographed(scene)
    sweep = fit_disc(image, plate, require_streaks(image, plate)[0])
    assert sweep.family.name == "parabola"
    assert alpha_error(sweep.alpha, rendered(scene).layer.alpha) < 0.01
    assert abs(sweep.radius - RADIUS) < max(4 * sweep.radius_std, 0.05)


@pytest.mark.parametrize("length", [2.5, 3.0, 4.0, 5.0])
def test_a_short_way_is_not_taken_for_one_there_and_back(length):
    """honest"""
    way = Trajectory.line((60, 40), (60 + length, 40 + 0.3 * length))
    image, plate = photographed(Scene(TILES, way, Ball(13, GREEN, ambient=1.0)))
    sweep = fit_disc(image, plate, require_streaks(image, plate)[0])
    assert abs(sweep.length - way.length) < 0.2


def test_noise_of_neighbors_is_no_second_paint():
    """honest: in a JPEG with chroma of half the resolution."""
    image, plate = photographed(FLAT[LINE], 0, JPEG)
    found = fit_disc_colors(image, plate, require_streaks(image, plate)[0])
    assert max(found.log_odds) < 1
    assert degrees_between(found.mean.pole, GREEN) < 5


def test_a_disc_of_two_paints_says_so():
    """honest"""
    body = Ball(13, GREEN, second_color=RED, ambient=1.0)
    image, plate = photographed(Scene(WALL, along(LINE), body, Change(spin=(1.0, 0.5, 0.8))))
    found = fit_disc_colors(image, plate, require_streaks(image, plate)[0])
    assert found.log_odds[0] > 50
    assert found.log_odds[1] < 1
    normal = np.cross(GREEN, RED) / np.linalg.norm(np.cross(GREEN, RED))
    assert abs(found.plane.pole @ normal) > np.cos(np.radians(5))
    assert_allclose(found.sweep.radius, 13, rtol=0.03)
