"""Discs beside shadows: where a shadow that a ball casts lies on what is seen of it."""

from dataclasses import replace

import numpy as np
import pytest

from blurmatte.radiometry import with_noise
from blurmatte.rendering import Ball, Camera, Scene, Shadow, Shot, plain_plate, render
from blurmatte.scenes import read_shots
from blurmatte.streaks import require_streaks
from blurmatte.sweep import MAX_MISFIT, fit_sweep, shadowed
from blurmatte.sweep.attempt import Attempt
from blurmatte.sweep.fit.ranking import most_apart
from blurmatte.sweep.end import End
from blurmatte.sweep.fit.multistart import Search
from blurmatte.sweep.fit.shadow_search import beside_darkness, beside_shadow
from blurmatte.trajectory import Trajectory

SIZE = (240, 180)
WALL = plain_plate(SIZE, (0.42, 0.42, 0.4), 4)
WAY = Trajectory.line((90, 70), (140, 84))
SCENE = Scene(WALL, WAY, Ball(17, (0.27, 0.72, 0.13)))


def taken(shadow, seed=1, scene=SCENE, **camera):
    truth = render(replace(scene, shadow=shadow), 160)
    shot = Shot(truth.scene, Camera(code_std=1.5 / 255, **camera), plate_frames=3, seed=seed)
    return truth.layer.alpha, *with_noise(*shot.photograph(truth))


def first_of(image, plate):
    streak = require_streaks(image, plate)[0]
    search = Search.of(streak, image, plate, None)
    return Attempt(image, plate, streak, search, search.best(1))


def rmse(sweep, alpha):
    return np.sqrt(np.mean((sweep.alpha - alpha)[alpha > 0] ** 2))


@pytest.mark.parametrize("offset", [(-22, 10), (0, 24), (16, 14)], ids=["behind", "below", "ahead"])
@pytest.mark.parametrize(("quality", "most"), [(None, 0.003), (90, 0.01)], ids=["png", "jpeg"])
def test_a_ball_and_its_shadow_are_told_together(offset, quality, most):
    """Left out, a shadow along the way takes half of the ball with it, and it is 0.09 off."""
    shadow = Shadow(offset, strength=(0.5, 0.5, 0.5))
    alpha, image, plate = taken(shadow, jpeg_quality=quality)
    sweep = fit_sweep(image, plate)
    assert sweep.misfit <= MAX_MISFIT
    assert rmse(sweep, alpha) < most
    assert np.linalg.norm(sweep.cast.offset - offset) < 1


@pytest.mark.parametrize("quality", [None, 90])
def test_a_path_does_not_jump_into_the_shadow(quality):
    """Of a large ball that went a little a disc on a bounce would take its shadow, too."""
    wall, way = plain_plate(SIZE, (0.27, 0.3, 0.33), 2), Trajectory.line((138, 110), (105, 78))
    scene = Scene(wall, way, Ball(24, (0.0845, 0.3908, 0.603)))
    shadow = Shadow((-31, -40), softness=6.3, strength=(0.5, 0.5, 0.5))
    alpha, image, plate = taken(shadow, 2, scene, jpeg_quality=quality)
    sweep = fit_sweep(image, plate)
    assert sweep.misfit <= MAX_MISFIT
    assert rmse(sweep, alpha) < 0.01
    assert np.linalg.norm(sweep.cast.offset - shadow.offset) < 1


def test_a_shadow_that_hides_the_color_is_left_out_first():
    """No disc on all of it is of the object's color: a shadow as large, that went aside."""
    shadow = Shadow((-46, 34), softness=9, strength=(0.5, 0.5, 0.5))
    alpha, image, plate = taken(shadow)
    found = beside_darkness(first_of(image, plate))
    assert found.cast is not None
    assert np.linalg.norm(found.cast.offset - shadow.offset) < 1
    inside = alpha > 0
    x0, y0 = map(int, found.search.data.origin)
    h, w = found.disc.swept.alpha.shape
    off = (found.disc.swept.alpha - alpha[y0 : y0 + h, x0 : x0 + w])[
        inside[y0 : y0 + h, x0 : x0 + w]
    ]
    assert np.sqrt(np.mean(off**2)) < 0.005


def test_what_casts_none_stays_as_it_is():
    """invariant: the same attempt comes back."""
    _, image, plate = taken(None)
    first = first_of(image, plate)
    assert beside_shadow(first) is first


@pytest.fixture(scope="module")
def without_and_with():
    """The attempts of a ball that casts a shadow, in a JPEG."""
    _, image, plate = taken(Shadow((-22, 10), strength=(0.5, 0.5, 0.5)), jpeg_quality=90)
    first = first_of(image, plate)
    return first, beside_shadow(first)


@pytest.mark.parametrize("as_likely", [False, True])
def test_what_explains_all_is_contested_by_as_likely_a_shadow(
    monkeypatch, without_and_with, as_likely
):
    """invariant: the disc stays what it is; with the shadow it would have another alpha."""
    first, beside = without_and_with
    assert beside.cast is not None
    monkeypatch.setattr(shadowed, "MAX_MISFIT", np.inf)
    monkeypatch.setattr(End, "is_clearly_likelier_than", lambda self, other: False)
    monkeypatch.setattr(End, "is_about_as_likely_as", lambda self, other: as_likely)
    told = beside_shadow(first)
    assert (told is first) is not as_likely
    assert told.search is first.search
    assert np.array_equal(told.disc.swept.alpha, first.disc.swept.alpha)
    assert told.disc.contested == (most_apart(first.end.state, [beside.end.state]) * as_likely)
    assert most_apart(first.end.state, [beside.end.state]) > 0.1


@pytest.mark.battery
def test_no_shadow_is_told_where_the_disc_explains_more_without():
    """honest: what a file made of a photograph is darker in places along this path."""
    (shot,) = read_shots("coffee")
    truth = render(shot.scene)
    sweep = fit_sweep(*with_noise(*shot.photograph(truth)))
    assert sweep.cast is None
    assert sweep.misfit <= MAX_MISFIT
    assert rmse(sweep, truth.layer.alpha) < 0.004


def test_noise_of_the_plate_stays_as_loud_in_the_shadow():
    """invariant: and beside it the plate is as it was."""
    _, image, plate = taken(Shadow((0, 24)))
    sweep = fit_sweep(image, plate)
    box = (0, 0, *SIZE)
    shaded = sweep.in_shadow(plate, box)
    assert np.array_equal(shaded.variance, plate.variance)
    darker = np.any(shaded.rgb < plate.rgb, axis=-1)
    assert 0.02 < darker.mean() < 0.4
    assert np.all(shaded.rgb <= plate.rgb)
