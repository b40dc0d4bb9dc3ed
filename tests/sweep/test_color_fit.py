"""fit_color: shape, hues and feasibility together, and a refusal where none of them tells."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from blurmatte.color import fit_color_from_hues
from blurmatte.errors import ColorModelError
from blurmatte.radiometry import Meta
from blurmatte.rendering import Ball, Camera, Scene, Shot, plain_plate, render
from blurmatte.streaks import find_streaks
from blurmatte.sweep import color, fit_color, fit_sweep
from blurmatte.trajectory import Trajectory

GREEN = np.array([0.25, 0.7, 0.12])
WALL = plain_plate((150, 110), (0.34, 0.33, 0.3), 4)
PATH = Trajectory.line((40, 40), (108, 66))


def taken(body, seed):
    shot = Shot(Scene(WALL, PATH, body), Camera(code_std=1.5 / 255), plate_frames=3, seed=seed)
    return shot.photograph(render(shot.scene, 160))


def degrees(model, color):
    return np.degrees(np.arccos(min(model.pole @ color / np.linalg.norm(color), 1)))


def test_the_shape_tells_what_the_hues_leave_open():
    image, plate = taken(Ball(12, GREEN), 1)
    with pytest.raises(ColorModelError, match="leaves the object's color open"):
        fit_color_from_hues(image, plate)
    model = fit_color(image, plate)
    assert degrees(model, GREEN) < max(4 * model.angle_std, 0.5) < 2
    assert model.evidence["shape"] < 1
    assert model.evidence["hue variation"] > 3


def test_its_error_is_honest():
    """Over noise: the angle of two independent directions, 1.5 std at the median of a Rayleigh."""
    z = []
    for seed in range(12):
        model = fit_color(*taken(Ball(12, GREEN), 20 + seed))
        off = GREEN / (model.pole @ GREEN) - model.pole
        z.append(off @ np.linalg.pinv(model.covariance) @ off / 2)
    assert 0.4 < np.mean(z) < 2.0


def test_a_shape_that_is_not_believed_tells_no_color(monkeypatch):
    """door: nor do the hues of a plain wall."""
    image, plate = taken(Ball(12, GREEN), 1)
    sweep = fit_sweep(image, plate)
    doubted = replace(sweep, stats={**sweep.stats, "misfit": np.inf})
    monkeypatch.setattr(color, "fit_piece", lambda *asked: (doubted, asked[2]))
    with pytest.raises(ColorModelError, match=r"Nor does the shape of the streak tell it"):
        fit_color(image, plate)


@pytest.mark.battery
def test_any_colors_are_neither_a_line_nor_a_plane():
    colors = np.random.default_rng(1).uniform(0.05, 0.9, (4, 8, 3))
    image, plate = taken(Ball(14, np.ones(3), texture=np.kron(colors, np.ones((8, 8, 1)))), 2)
    with pytest.raises(ColorModelError, match=r"Nor does the shape of the streak tell it"):
        fit_color(image, plate)


def test_several_frames_tell_more():
    frames = [taken(Ball(12, GREEN), seed) for seed in (1, 2, 3)]
    plate = frames[0][1]
    together = fit_color([image for image, _ in frames], plate)
    alone = fit_color(frames[0][0], plate)
    assert together.evidence["frames"] == pytest.approx(together.angle_std, rel=0.3)
    assert together.angle_std < alone.angle_std
    assert degrees(together, GREEN) < 4 * together.angle_std
    empty = fit_color([frames[0][0], plate], plate)  # where nothing moved, nothing is told
    assert_allclose(empty.pole, alone.pole)


def test_door():
    image, plate = taken(Ball(12, GREEN), 1)
    with pytest.raises(ValueError, match="max_brightness must be positive, got 0"):
        fit_color(image, plate, max_brightness=0)
    with pytest.raises(ValueError, match="images must be one or more, got none"):
        fit_color([], plate)
    with pytest.raises(ValueError, match="a streak is that of one image"):
        fit_color([image], plate, find_streaks(image, plate)[0])
    with pytest.raises(ColorModelError, match="is gray"):
        fit_color(image, replace(plate, meta=Meta("wall.png", gray=True)))
