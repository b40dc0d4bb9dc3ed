"""A sweep that is not believed: whether it counts, and what it does to errors."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from blurmatte.color import ColorModel
from blurmatte.explain import doubts
from blurmatte.matting import PixelMaps, solve
from blurmatte.matting.rival import is_rival, widen
from blurmatte.radiometry import LinearImage
from blurmatte.rendering import Ball, Camera, Scene, Shot, plain_plate, render, two_hue_plate
from blurmatte.sweep import fit_sweep
from blurmatte.trajectory import Trajectory

SIZE = (96, 72)
STD = 0.01  # radians


@pytest.fixture(scope="module")
def sweep():
    wall = plain_plate(SIZE, (0.34, 0.33, 0.3), 4)
    scene = Scene(wall, Trajectory.line((34, 30), (62, 42)), Ball(9, (0.25, 0.7, 0.12)))
    shot = Shot(scene, Camera(code_std=1 / 255), plate_frames=3, seed=0)
    return fit_sweep(*shot.photograph(render(scene)))


def off_by(sweep, angle):
    """A color so many radians from that of the sweep, known to `STD` in every direction."""
    pole, across = sweep.model.pole, np.linalg.svd(sweep.model.pole[:, None])[0][:, 1]
    turned = np.cos(angle) * pole + np.sin(angle) * across
    return ColorModel(turned[:, None], STD**2 * (np.eye(3) - np.outer(turned, turned)), {})


def test_a_rival_has_the_color_that_hues_tell(sweep):
    assert is_rival(sweep, off_by(sweep, 3 * STD))
    assert not is_rival(sweep, off_by(sweep, 6 * STD))


def test_what_is_not_plausible_is_no_rival(sweep):
    hopeless = replace(sweep, stats={**sweep.stats, "plausible": False})
    assert not is_rival(hopeless, sweep.model)
    assert not is_rival(replace(sweep, model=ColorModel.any()), sweep.model)


def test_errors_cover_both_answers(sweep):
    """exact: one of two that are as likely; where nothing is told nothing is."""
    w, h = SIZE
    maps = PixelMaps.empty(h, w, np.float64)
    for values, start in zip(maps, (0.1, 0.02, 0.2, 0.03, 0), strict=True):
        values[...] = start
    maps.alpha_std[30, 40] = np.inf
    plate = LinearImage(np.full((h, w, 3), 0.5))
    mask = np.zeros((h, w), bool)
    mask[20:50, 20:76] = True
    usual, of_sum = widen(maps, sweep, plate, mask, (0, 0, w, h))
    off = np.where(mask, sweep.alpha - 0.1, 0)
    off[30, 40] = 0
    told = mask.copy()
    told[30, 40] = False
    assert_allclose(usual, np.sqrt(np.mean(off[told] ** 2)))
    assert_allclose(of_sum, abs(off.sum()) / np.sqrt(2))
    assert_allclose(maps.alpha_std[told] ** 2, 0.02**2 + off[told] ** 2 / 2)
    light = 0.03**2 + (0.5 * off[told]) ** 2 / 2
    assert_allclose(maps.premultiplied_std[told][:, 1] ** 2, light)
    assert_array_equal(maps.alpha, 0.1)
    assert np.isinf(maps.alpha_std[30, 40])
    assert_array_equal(maps.alpha_std[~mask], 0.02)


@pytest.mark.battery
def test_a_highlight_of_the_color_of_the_wall_is_no_rival():
    """Hues tell a color to 3 degrees, and alpha would be off by 0.08 where the highlight went."""
    plate = two_hue_plate((110, 90), (0.45, 0.40, 0.36), (0.10, 0.22, 0.40), 0)
    body = Ball(14, (0.75, 0.5, 0.1), highlight=0.6)
    scene = Scene(plate, Trajectory.line((40, 40), (66, 56)), body)
    truth = render(scene, 160)
    shot = Shot(scene, Camera(code_std=1 / 255), plate_frames=5, seed=0)
    solution = solve(*shot.photograph(truth))
    told = (truth.layer.alpha > 0) & solution.known
    error = (solution.alpha - truth.layer.alpha)[told]
    assert np.sqrt(np.mean(error**2)) < 0.005
    assert_allclose(solution.stats["sum_alpha"], truth.layer.alpha.sum(), rtol=0.01)
    assert solution.stats["rival_off"] == 0
    assert not any("the errors cover both" in sentence for sentence in doubts(solution))


def test_a_shape_that_leaves_little_is_a_rival_of_what_hues_tell():
    """Honest: a ball so far out of focus that its shape is not believed."""
    plate = two_hue_plate((110, 90), (0.45, 0.40, 0.36), (0.10, 0.22, 0.40), 0)
    body, way = Ball(14, (0.75, 0.5, 0.1)), Trajectory.line((40, 40), (66, 56))
    scene = Scene(plate, way, body, defocus=9)
    truth = render(scene, 160)
    shot = Shot(scene, Camera(code_std=1 / 255), plate_frames=5, seed=0)
    solution = solve(*shot.photograph(truth))
    assert solution.sweep is None
    assert solution.stats["rival_off"] > 0
    told = (truth.layer.alpha > 0) & solution.known
    error = (solution.alpha - truth.layer.alpha)[told]
    assert np.sqrt(np.mean(error**2)) < 2 * np.sqrt(np.mean(solution.alpha_std[told] ** 2))
    total = truth.layer.alpha.sum()
    assert abs(solution.stats["sum_alpha"] - total) < 3 * solution.stats["sum_alpha_std"]
