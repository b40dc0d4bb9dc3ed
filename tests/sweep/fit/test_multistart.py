"""Multistart: the global search finds a rendered ball on a path of every family."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.ndimage import gaussian_filter
from tests.sweep.scenes import (
    BALL,
    BEFORE_TILES,
    FLAT,
    FLAT_BEFORE_TILES,
    NEUTRAL,
    ONE_PAINT,
    PATHS,
    RADIUS,
    TIMES,
    alpha_error,
    path_error,
    photographed,
    rendered,
    within,
)

from blurmatte.rendering import Ball
from blurmatte.streaks import require_streaks
from blurmatte.sweep.assess.diagnostics import sweep_of
from blurmatte.sweep.fit.levenberg_marquardt import ROUGH_TOLERANCE
from blurmatte.sweep.fit.multistart import (
    Multistart,
    center_curve,
    depth_of,
    fitted_to_hue,
    with_varied_colors,
)
from blurmatte.sweep.fit.ranking import Candidate
from blurmatte.sweep.model.path import ARC, LINE, PARABOLA
from blurmatte.trajectory import Trajectory

every_family = pytest.mark.parametrize("family", PATHS, ids=lambda family: family.name)
SIZE = (140, 100)
TRUE_LINE = Trajectory.line((28, 26), (112, 70))
TRUE_ARC = Trajectory.arc((25, 75), (70, 25), (115, 75), points=200)
CORNER = Trajectory.bounce((25, 25), (70, 75), (115, 25))


def searched(scene, seed=0):
    image, plate = photographed(scene, seed)
    return Multistart.of(require_streaks(image, plate)[0], image, plate, NEUTRAL)


@every_family
@pytest.mark.parametrize(
    "scenes",
    [
        pytest.param(FLAT, id="wall"),
        pytest.param(FLAT_BEFORE_TILES, marks=pytest.mark.battery, id="tiles"),
    ],
)
def test_a_ball_on_every_path_is_found(family, scenes):
    """honest: radius and path within 3 standard deviations."""
    one_paint, varied = searched(scenes[family]).best()
    image, _ = photographed(scenes[family])
    assert one_paint[0].converged
    sweep = sweep_of(Candidate(one_paint[0]), image)
    assert abs(sweep.radius - RADIUS) < 3 * sweep.radius_std < 0.3
    xy, D = sweep.family.at(sweep.path, TIMES)
    path = sweep.covariance[: len(sweep.path), : len(sweep.path)]
    std = np.sqrt(np.einsum("tcp,pq,tcq->t", D, path, D).max())
    assert path_error(xy, family) < 3 * std < 1.5
    true = rendered(scenes[family]).layer.alpha
    for state in (one_paint[0], varied[0]):
        assert alpha_error(state.swept.alpha, within(state.observation, true)) < 0.006


@pytest.mark.parametrize("family", [LINE, ARC], ids=lambda family: family.name)
def test_quick_finds_a_disc_on_a_parabola(family):
    """honest"""
    quick = searched(FLAT[family]).quick()
    assert quick.family is PARABOLA
    assert_allclose(quick.shape[0], RADIUS, rtol=0.02)
    true = within(quick.observation, rendered(FLAT[family]).layer.alpha)
    assert alpha_error(quick.swept.alpha, true) < 0.02


def test_near_starts_from_a_shifted_path():
    """invariant: the curve is shifted onto the streak."""
    search = searched(FLAT[ARC]).of_one_paint
    curve = ARC.at(PATHS[ARC], np.linspace(0, 1, 33))[0]
    at, elsewhere = (search.near(ARC, curve + shift, RADIUS) for shift in (0, (60, -20)))
    assert_allclose(at.path, elsewhere.path, atol=1e-6)
    assert_allclose(at.shape[0], RADIUS, atol=0.1)


def test_starts_are_curves_through_the_streak():
    """exact: a disc of each radius, a fraction of the half width, is within the streak."""
    search = searched(BALL)
    radii = [radius for _, radius in search.curves]
    low, high = search.bounds
    assert low < min(radii) < max(radii) < high
    assert low < RADIUS < high
    for curve, radius in search.curves:
        path = LINE.at(PATHS[LINE], np.linspace(0, 1, 1000))[0]
        off = np.linalg.norm(curve[:, None] - path, axis=2).min(axis=1)
        assert off.max() < max(RADIUS - radius, 0) + 3


def test_large_pixels_hold_the_same_light():
    """invariant"""
    search = searched(BALL)
    by = round(search.coarse.scale / search.observation.scale)
    assert by > 1
    assert_array_equal(search.observation.coarser(by).C, search.coarse.C)
    loud = search.with_noise_inflated(3.0)
    assert_allclose(loud.coarse.C_variance, 3 * search.coarse.C_variance)
    assert loud.observation.noise_inflation == 3 * search.observation.noise_inflation


def test_one_paint_and_varied_colors_differ_in_the_prior_alone():
    search = searched(BALL)
    one = search.of_one_paint
    assert one.observation.color.varied == one.coarse.color.varied == 1
    disc = one.quick()
    varied = with_varied_colors(disc)
    assert varied.observation.color.varied == 3
    assert varied.swept is disc.swept


def test_a_soft_rim_is_taken_only_if_it_is_likelier():
    """honest: a sharp ball has a sharp rim in each of four pictures."""
    for seed in range(4):
        assert not searched(FLAT[LINE], seed).quick().silhouette.soft


@pytest.mark.parametrize(
    ("blur", "color"),
    [
        (0.0, NEUTRAL),
        (1.5, ONE_PAINT),
        pytest.param(
            1.5,
            NEUTRAL,
            marks=pytest.mark.xfail(
                strict=True, reason="with free colors both searches end at twice the radius"
            ),
        ),
        pytest.param(
            0.0,
            ONE_PAINT,
            marks=pytest.mark.xfail(
                strict=True, reason="a blur at its least value counts as surely blurred"
            ),
        ),
    ],
)
def test_the_disc_that_is_fitted_soft_first_is_that_of_both_fits(blur, color):
    """invariant: with a sharp and a blurred rim."""
    image, plate = photographed(FLAT[LINE])
    image = replace(image, rgb=gaussian_filter(image.rgb, (blur, blur, 0)))
    search = Multistart.of(require_streaks(image, plate)[0], image, plate, color)
    both, soft = search.quick(), search.soft()
    assert soft.silhouette == both.silhouette
    assert soft.silhouette.soft == (blur > 0)
    assert abs(soft.cost - both.cost) < 2 * ROUGH_TOLERANCE
    assert_allclose(soft.path, both.path, atol=0.05)
    assert_allclose(soft.shape, both.shape, atol=0.05)


def test_the_search_is_deterministic():
    """invariant: fits run on several threads."""
    search = searched(FLAT[ARC])
    first, second = (search.best()[0][0] for _ in range(2))
    assert_array_equal(first.path, second.path)
    assert first.cost == second.cost


@cache
def radii_of_shaded_balls():
    """Errors of the radius by a smooth color and by hue, px, and that stated by hue, of 64 draws."""
    rows = []
    for seed in range(64):
        search = searched(BEFORE_TILES[LINE], seed).of_one_paint
        smooth = search.quick()
        hue = fitted_to_hue(smooth, search.bounds)
        sweep = sweep_of(Candidate(hue), photographed(BEFORE_TILES[LINE], seed)[0])
        rows.append([smooth.shape[0] - RADIUS, hue.shape[0] - RADIUS, sweep.radius_std])
    return np.transpose(rows)


@pytest.mark.battery
def test_the_radius_of_shaded_balls_by_hue_has_an_honest_error():
    """honest: before tiles of many hues"""
    _, off, std = radii_of_shaded_balls()
    assert 0.8 < np.sqrt(np.mean(np.square(off / std))) < 1.25


@pytest.mark.battery
@pytest.mark.xfail(strict=True, reason="hue alone is off by 0.020 px, the field by 0.019 px")
def test_hue_gives_the_radius_of_shaded_balls():
    """honest: before tiles of many hues"""
    by_color, by_hue, _ = np.abs(radii_of_shaded_balls())
    assert by_hue.mean() < by_color.mean()


def test_hue_is_not_used_without_contrast_of_hue():
    """exact: colors that vary, and an object of the wall's hue"""
    search = searched(FLAT[LINE])
    varied = with_varied_colors(search.quick())
    assert fitted_to_hue(varied, search.bounds) is varied
    gray = replace(FLAT[LINE], body=Ball(RADIUS, 0.4 * np.array([0.34, 0.33, 0.3])))
    search = searched(gray).of_one_paint
    quick = search.quick()
    assert fitted_to_hue(quick, search.bounds) is quick


def stroke(path, radius):
    """(h, w) bool, the pixels that a disc on a path touches."""
    x, y = np.meshgrid(*map(np.arange, SIZE))
    return np.any([np.hypot(x - a, y - b) <= radius for a, b in path.at(np.linspace(0, 1, 200))], 0)


def distance(points, path):
    curve = path.at(np.linspace(0, 1, 1000))
    return np.linalg.norm(points[:, None] - curve, axis=2).min(axis=1)


def ends_apart(curve, path):
    """Largest distance of the ends of a curve from those of a path, in the better direction."""
    ends = path.at([0, 1])
    return min(np.linalg.norm(curve[[i, -1 - i]] - ends, axis=1).max() for i in (0, -1))


@pytest.mark.parametrize("radius", [3, 8.5, 14])
@pytest.mark.parametrize("path", [TRUE_LINE, TRUE_ARC], ids=["line", "arc"])
def test_half_width_of_a_stroke_is_its_radius(path, radius):
    assert_allclose(depth_of(stroke(path, radius)).max(), radius, atol=1)


def test_half_width_is_also_of_masks_that_touch_the_border_and_of_one_pixel():
    assert depth_of(np.ones((7, 30), bool)).max() == 4
    assert depth_of(np.ones((1, 1), bool)).max() == 1


@pytest.mark.parametrize("part", [0.6, 0.8])
@pytest.mark.parametrize("path", [TRUE_LINE, TRUE_ARC, CORNER], ids=["line", "arc", "corner"])
def test_the_curve_goes_through_the_middle_of_a_stroke(path, part):
    radius = 8
    curve = center_curve(depth_of(stroke(path, radius)), part * radius)
    middle = curve[len(curve) // 5 : -len(curve) // 5]
    assert distance(middle, path).max() < (2.5 if path is CORNER else 1)
    assert ends_apart(curve, path) < (1 - part) * radius + 1.5


@pytest.mark.parametrize("path", [TRUE_LINE, TRUE_ARC], ids=["line", "arc"])
def test_its_points_are_equally_far_from_each_other(path):
    curve = center_curve(depth_of(stroke(path, 8)), 6)
    steps = np.linalg.norm(np.diff(curve, axis=0), axis=1)
    assert_allclose(steps, steps.mean(), rtol=0.2)
    assert_allclose(steps.sum(), path.length, rtol=0.08)


def test_holes_in_a_streak_are_filled():
    mask = stroke(TRUE_LINE, 8)
    holed = mask.copy()
    holed[44:48, 60:70] = False
    assert mask[44:48, 60:70].all()
    assert depth_of(holed).max() == depth_of(mask).max()
    assert_allclose(
        center_curve(depth_of(holed), 6), center_curve(depth_of(mask), 6), rtol=0, atol=0
    )


@pytest.mark.parametrize("part", [0.4, 0.8, 1.0])
def test_a_disc_alone_gives_a_short_line_through_its_middle(part):
    mask = stroke(Trajectory.line((60, 50), (60, 50)), 15)
    curve = center_curve(depth_of(mask), part * 15)
    assert np.all(np.isfinite(curve))
    length = np.linalg.norm(np.diff(curve, axis=0), axis=1).sum()
    assert 15 * part / 2 - 0.1 < length < 2.5 * (1 - part) * 15 + 15 * part
    assert np.hypot(*(curve.mean(axis=0) - (60, 50))) < (1 - part) * 15 + 0.5


def test_disc_without_a_core_gives_a_line_of_half_its_radius_along_its_longer_axis():
    """A core of few pixels has no length, and the ellipse is perpendicular to the path."""
    x, y = np.meshgrid(*map(np.arange, SIZE))
    curve = center_curve(depth_of(np.hypot((x - 60) / 16, (y - 50) / 15) <= 1), 15)
    assert_allclose(curve[[0, -1], 1], 50, atol=1e-6)
    assert_allclose(sorted(curve[[0, -1], 0]), [60 - 15 / 4, 60 + 15 / 4], atol=1e-6)


def test_only_the_largest_piece_counts():
    mask = stroke(TRUE_LINE, 8) | stroke(Trajectory.line((20, 85), (24, 85)), 8)
    assert_allclose(
        center_curve(depth_of(mask), 6),
        center_curve(depth_of(stroke(TRUE_LINE, 8)), 6),
        rtol=0,
        atol=1e-9,
    )


def test_a_turned_picture_turns_the_curve():
    mask = stroke(TRUE_LINE, 8)
    curve, turned = center_curve(depth_of(mask), 6), center_curve(depth_of(mask.T), 6)[:, ::-1]
    distance = min(np.abs(curve - turned).max(), np.abs(curve - turned[::-1]).max())
    assert distance < 2.5
    shifted = center_curve(depth_of(np.roll(mask, (5, -9), axis=(0, 1))), 6)
    assert_allclose(shifted, curve + np.array([-9, 5]), rtol=0, atol=1e-9)
