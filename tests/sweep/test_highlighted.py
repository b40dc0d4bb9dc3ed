"""Glossy balls: a disc of one paint and its highlight, told together."""

from dataclasses import replace

import numpy as np
import pytest

from blurmatte.color import ColorModel
from blurmatte.radiometry import with_noise
from blurmatte.rendering import (
    Ball,
    Camera,
    Change,
    Scene,
    Shadow,
    Sheet,
    Shot,
    plain_plate,
    render,
)
from blurmatte.streaks import require_streaks
from blurmatte.sweep import MAX_MISFIT, fit_sweep, highlighted
from blurmatte.sweep.attempt import Attempt
from blurmatte.sweep.fit.ranking import CLEARLY
from blurmatte.sweep.highlighted import with_highlight
from blurmatte.sweep.model.color_prior import known_color
from blurmatte.sweep.fit.multistart import Search
from blurmatte.sweep.model.residual_statistics import overstated
from blurmatte.trajectory import Trajectory

SIZE = (200, 140)
BLUE = np.array([0.15, 0.35, 0.7])
GRAY = plain_plate(SIZE, (0.4, 0.4, 0.4), 4)
WAYS = {
    "line": Trajectory.line((62, 50), (130, 84)),
    "arc": Trajectory.arc((56, 90), (100, 56), (144, 90)),
}


def taken(way="line", highlight=0.6, quality=None, seed=1, shadow=None):
    ball = Ball(16, BLUE, highlight=highlight)
    truth = render(Scene(GRAY, WAYS[way], ball, shadow=shadow), 200)
    camera = Camera(code_std=1.5 / 255, jpeg_quality=quality)
    return truth, *with_noise(*Shot(truth.scene, camera, seed=seed).photograph(truth))


def attempted(image, plate):
    streak = require_streaks(image, plate)[0]
    search = Search.of(streak, image, plate, None)
    return Attempt(image, plate, streak, search, search.best(1))


def degrees(one, other):
    """Angle between two planes through black."""
    return np.degrees(np.arccos(min(abs(one.pole @ other.pole), 1.0)))


@pytest.mark.parametrize(
    ("way", "quality", "most"),
    [
        pytest.param("line", None, 0.006, id="line, png"),
        pytest.param("line", 90, 0.015, id="line, jpeg", marks=pytest.mark.battery),
        pytest.param("arc", None, 0.006, id="arc, png", marks=pytest.mark.battery),
        pytest.param("arc", 90, 0.015, id="arc, jpeg", marks=pytest.mark.battery),
    ],
)
def test_a_white_highlight_before_a_gray_wall_is_told(way, quality, most):
    """No plane can: it holds the wall's color, and any alpha would do."""
    truth, image, plate = taken(way, quality=quality)
    sweep = fit_sweep(image, plate)
    assert sweep.misfit <= MAX_MISFIT
    alpha = truth.layer.alpha
    assert np.sqrt(np.mean((sweep.alpha - alpha)[alpha > 0] ** 2)) < most
    assert abs(sweep.radius - 16) < max(4 * sweep.radius_std, 0.1)
    assert sweep.model.rank == 2
    told = sweep.stats["highlight"]
    assert 3 < np.hypot(*told["offset"]) < 12
    paint = ColorModel.from_hex(told["paint"]).pole
    assert np.degrees(np.arccos(min(paint @ BLUE / np.linalg.norm(BLUE), 1))) < 4
    assert degrees(sweep.model, truth.scene.body.model) < (3 if quality is None else 6)


def test_a_glossy_ball_that_casts_a_shadow_is_told_with_both():
    shadow = Shadow((-14, 26), softness=4, strength=(0.5, 0.5, 0.5))
    truth, image, plate = taken(shadow=shadow)
    sweep = fit_sweep(image, plate)
    assert sweep.misfit <= MAX_MISFIT
    alpha = truth.layer.alpha
    assert np.sqrt(np.mean((sweep.alpha - alpha)[alpha > 0] ** 2)) < 0.006
    assert sweep.stats["highlight"] is not None
    assert np.linalg.norm(sweep.cast.offset - shadow.offset) < 1


def test_a_dull_ball_has_none():
    """invariant: it is no likelier with one, nor is that asked for."""
    _, image, plate = taken(highlight=0.0)
    dull = attempted(image, plate)
    glossy = with_highlight(dull)
    assert glossy is None or not glossy.end.is_clearly_likelier_than(dull.end)
    assert fit_sweep(image, plate).model.rank == 1


def test_where_a_highlight_gains_little_on_large_pixels_nothing_is_searched(monkeypatch):
    """invariant: a glossy ball is searched for again, a dull one is not."""
    dull, glossy = (attempted(*taken(highlight=part, quality=90)[1:]) for part in (0.0, 0.6))

    def searched(search, rank):
        raise AssertionError

    monkeypatch.setattr(Search, "best", searched)
    assert with_highlight(dull) is None
    with pytest.raises(AssertionError):
        with_highlight(glossy)


def test_what_leaves_much_on_large_pixels_is_not_searched(monkeypatch):
    """invariant: a sheet, even if a highlight paid."""
    scene = Scene(GRAY, WAYS["line"], Sheet(20, 50, BLUE))
    pictures = Shot(scene, Camera(code_std=1.5 / 255)).photograph(render(scene, 200))
    sheet = attempted(*with_noise(*pictures))

    def searched(search, rank):
        raise AssertionError

    monkeypatch.setattr(highlighted, "_pays", lambda *ends: True)
    monkeypatch.setattr(Search, "best", searched)
    assert with_highlight(sheet) is None
    monkeypatch.setattr(highlighted, "_MOST_LEFT", np.inf)
    with pytest.raises(AssertionError):
        with_highlight(sheet)


@pytest.mark.parametrize("seed", [0, *(pytest.param(s, marks=pytest.mark.battery) for s in (3, 5))])
def test_a_sheet_that_went_little_is_no_disc_with_a_highlight_that_went_far(seed):
    """Honest: a disc of a third of its area, with a highlight, leaves nothing; outlines contest it."""
    wall = plain_plate(SIZE, (0.3, 0.33, 0.36), 2)
    sheet = Sheet(32.5, 13.5, np.array([0.206, 0.335, 0.607]))
    way = Trajectory.line((96.6, 66.4), (103.4, 73.6))
    truth = render(Scene(wall, way, sheet, Change(turned=(0, 0, 0.547))), 200)
    shot = Shot(truth.scene, Camera(code_std=2 / 255), plate_frames=5, seed=seed)
    image, plate = with_noise(*shot.photograph(truth))
    sweep = fit_sweep(image, plate)
    alpha = truth.layer.alpha
    off = np.sqrt(np.mean((sweep.alpha - alpha)[alpha > 0] ** 2))
    assert off < 0.05 or sweep.misfit > MAX_MISFIT


def test_a_highlight_is_no_likelier_only_because_an_outline_has_more_parameters():
    """exact: it must leave less, by itself, than what else explains the streak."""
    _, image, plate = taken()
    glossy = with_highlight(attempted(image, plate)).end
    data, disc = glossy.search.data, glossy.state
    outline = replace(disc.silhouette, order=12)
    shape = outline.like(disc.silhouette, disc.shape)
    trust = overstated(data, disc)
    for gain, likelier in ((-1, False), (CLEARLY - 1, False), (CLEARLY + 1, True)):
        cost = disc.cost + gain * trust
        shaped = replace(disc, silhouette=outline, shape=shape, cost=cost)
        assert glossy.is_clearly_likelier_than(replace(glossy, state=shaped)) is likelier


def test_a_known_color_is_not_asked_for_another(monkeypatch):
    """exact: nothing is fitted."""
    monkeypatch.setattr(highlighted, "_in_turns", None)
    first = attempted(*taken()[1:])
    known = known_color(Ball(16, BLUE).model)
    data = replace(first.search.data, known=known)
    assert with_highlight(replace(first, search=replace(first.search, data=data))) is None


@pytest.mark.battery
def test_a_sweep_of_a_known_color_has_no_highlight():
    """invariant"""
    _, image, plate = taken()
    assert with_highlight(attempted(image, plate)) is not None
    sweep = fit_sweep(image, plate, model=Ball(16, BLUE).model)
    assert sweep.model.rank == 1
    assert sweep.stats["highlight"] is None
