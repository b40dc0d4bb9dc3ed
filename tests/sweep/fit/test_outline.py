"""Outlines: a disc unless the data clearly ask for something else."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from numpy.testing import assert_allclose

from blurmatte.color import ColorModel
from blurmatte.radiometry import with_noise
from blurmatte.rendering import (
    Ball,
    Camera,
    Change,
    Scene,
    Sheet,
    Shot,
    colorful_plate,
    plain_plate,
    render,
)
from blurmatte.streaks import Streak
from blurmatte.sweep import outline
from blurmatte.sweep.model.observation import observation_around
from blurmatte.sweep.fit.levenberg_marquardt import descend, state_at
from blurmatte.sweep.frame import Frame
from blurmatte.sweep.model.color_prior import known_color
from blurmatte.sweep.fit.outline import (
    _bulgier,
    _is_astray,
    _is_ruled_out,
    _is_scaled,
    _lucky,
    is_oval,
    likelier,
    refined,
)
from blurmatte.sweep.fit.outline_start import exchanged, rescaled
from blurmatte.sweep.model.path import LINE
from blurmatte.sweep.model.silhouette import DISC, ELLIPSE, Silhouette
from blurmatte.sweep.model.residual_statistics import (
    MAX_MISFIT,
    is_contested,
    left_beyond_noise,
    misfit,
    overstated,
)
from blurmatte.trajectory import Trajectory

SIZE = (160, 112)
GREEN = np.array([0.25, 0.7, 0.12])
WALL = plain_plate(SIZE, (0.34, 0.33, 0.3), 4)
TILES = colorful_plate(SIZE, 2, tile=20)
WAY = Trajectory.line((46, 42), (110, 66))
BALL = Scene(WALL, WAY, Ball(11, GREEN))
EGG = Scene(WALL, WAY, Ball(12, GREEN), Change(squash=(1.5, 1.5), squash_angle=0.9))
SQUARE = Scene(TILES, WAY, Sheet(24, 24, GREEN), Change(turned=(0.0, 0.0, 1.1)))
SHEET = Scene(WALL, WAY, Sheet(30, 14, GREEN), Change(turned=(0.0, 0.0, 0.4), spin=(0.0, 0.0, 1.0)))


@cache
def taken(scene, seed=0, noise=1.5):
    """True alpha, the data, and the disc that fits best."""
    shot = Shot(scene, Camera(code_std=noise / 255), plate_frames=3, seed=seed)
    truth = render(scene, 160)
    streak = Streak(truth.layer.alpha > 0)
    data = observation_around(streak, 12, *with_noise(*shot.photograph(truth)), None)
    ends, frame = WAY.xy.ravel(), Frame.of(GREEN[:, None])
    start = state_at(data, LINE, ends, DISC, DISC.start(11), frame)
    x, y = (int(side) for side in data.origin)
    h, w = data.weight.shape
    return truth.layer.alpha[y : y + h, x : x + w], data, descend(data, start, (3, 40))


@cache
def found(scene):
    """The best outline for what is in `taken`."""
    _, data, disc = taken(scene)
    return refined(data, disc)


def rmse(state, alpha):
    return np.sqrt(np.mean((state.swept.alpha - alpha)[alpha > 0] ** 2))


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("plate", [WALL, TILES], ids=["wall", "tiles"])
def test_a_ball_remains_a_disc(plate, seed):
    scene = BALL if plate is WALL else replace(BALL, plate=TILES)
    _, data, disc = taken(scene, seed)
    assert refined(data, disc) is disc


@pytest.mark.parametrize("plate", [WALL, TILES], ids=["wall", "tiles"])
def test_a_squashed_ball_becomes_an_ellipse(plate):
    scene = EGG if plate is WALL else replace(EGG, plate=plate)
    (alpha, data, disc), end = taken(scene), found(scene)
    assert end.silhouette.name == "ellipse"
    assert rmse(end, alpha) < 0.01 < 0.03 < rmse(disc, alpha)
    assert misfit(data, end) < MAX_MISFIT < misfit(data, disc)
    assert end.cost < disc.cost


def test_a_disc_is_contested_by_what_noise_hardly_hides():
    """Honest: an ellipse that is not clearly better has another alpha; beside a ball it is luck."""
    contested = {}
    for scene in (EGG, BALL):
        ends = [refined(*taken(scene, seed, noise=16)[1:]) for seed in range(4)]
        contested[scene] = sum(end.contested > 0 or end.silhouette.order > 1 for end in ends)
    assert contested[EGG] >= 3
    assert contested[BALL] <= 2


def test_what_noise_beside_a_disc_gives_is_no_evidence_against_it(monkeypatch):
    """exact: the likelihood counts as much less as noise hangs together, within or beside."""
    _, data, disc = taken(EGG)
    egg = found(EGG)
    trust = overstated(data, egg)
    for gain, beside, counts in ((20, 1, True), (20, 10, False), (200, 10, True)):
        monkeypatch.setattr(outline, "coherence_beside", lambda data, state, by=beside: by * trust)
        rival = replace(egg, cost=disc.cost - gain * trust)
        assert _lucky(data, disc, [rival]) == ([rival] if counts else [])


def test_a_rival_is_astray_if_light_that_changes_little_finds_another_alpha():
    _, data, disc = taken(replace(BALL, plate=TILES))
    ends, frame = WAY.xy.ravel(), Frame.of(GREEN[:, None])
    thin = state_at(data, LINE, ends, ELLIPSE, ELLIPSE.start(6), frame)
    assert not _is_astray(data, disc)
    assert _is_astray(data, thin)
    known = known_color(ColorModel.from_samples(GREEN[None], std=1e-3))
    assert not _is_astray(replace(data, known=known), thin)  # pixels tell alpha then


def test_axes_of_an_ellipse():
    """Stretches by 1.5 and 1/1.5 along and across its angle; the area stays."""
    end = found(EGG)
    angle = EGG.change.squash_angle
    expected = np.log(1.5) * np.array([np.cos(2 * angle), np.sin(2 * angle)])
    assert_allclose(end.shape[1:3], expected, atol=0.02)
    assert_allclose(end.silhouette.radius(end.shape), 12, atol=0.15)


def test_a_turning_sheet():
    (alpha, data, disc), end = taken(SHEET), found(SHEET)
    assert end.silhouette.turns
    assert rmse(end, alpha) < 0.05 < rmse(disc, alpha)
    assert_allclose(end.shape[-1], 1, atol=0.1)
    assert_allclose(end.silhouette.area(end.shape), 30 * 14, rtol=0.02)
    assert misfit(data, end) < MAX_MISFIT < misfit(data, disc)


@pytest.mark.parametrize(
    "size",
    [
        pytest.param((40, 14), id="along its way"),
        pytest.param((12, 30), id="across", marks=pytest.mark.battery),
    ],
)
def test_a_long_thing_on_its_way(size):
    """A disc that stands for it takes another color, and with that goes another way.

    Nor does a wall tell whether it is long or has gone far.
    """
    scene = Scene(WALL, WAY, Sheet(*size, GREEN), Change(turned=(0.0, 0.0, np.arctan2(24, 64))))
    truth, data, _ = taken(scene)
    state = found(scene)
    assert np.sqrt(np.mean((state.swept.alpha - truth)[truth > 0] ** 2)) < 0.03
    assert is_contested(state)
    assert misfit(data, replace(state, contested=0.0)) < MAX_MISFIT
    assert_allclose(state.silhouette.area(state.shape), size[0] * size[1], rtol=0.03)


@pytest.mark.battery
def test_a_long_thing_on_a_bent_way():
    """What is thinner went further on a line, and with a ragged rim leaves little more than noise."""
    way = Trajectory.line((46, 42), (110, 66)).xy
    t = np.linspace(0, 1, 65)[:, None]
    bent = way[0] + t * (way[-1] - way[0]) + 4 * t * (1 - t) * np.array([-4.0, 10.7])
    scene = Scene(WALL, Trajectory(bent, t[:, 0]), Sheet(44, 18, GREEN))
    (alpha, data, _), state = taken(scene), found(scene)
    assert rmse(state, alpha) < 0.03
    assert not state.contested
    assert misfit(data, state) < MAX_MISFIT


@pytest.mark.parametrize(("scene", "least", "most"), [(SQUARE, 8, 16), (EGG, 2, 2)])
def test_corners_get_the_bulges_that_they_need(scene, least, most):
    """From an ellipse to as many as large pixels would not show; a squashed ball has none."""
    alpha, data, disc = taken(scene)
    frame, shape = Frame.of(GREEN[:, None]), ELLIPSE.start(13)
    start = state_at(data, LINE, WAY.xy.ravel(), ELLIPSE, shape, frame)
    end = _bulgier(data, descend(data, start, (3, 40)), (3, 40))
    assert least <= end.silhouette.order <= most
    assert rmse(end, alpha) < 0.02 < rmse(disc, alpha)


def test_the_likelier_end_pays_for_its_parameters():
    _, data, disc = taken(EGG)
    egg = found(EGG)
    assert likelier((data, disc), (data, egg))
    assert not likelier((data, egg), (data, disc))
    assert not likelier((data, disc), (data, disc))
    just_as_good = replace(egg, cost=disc.cost)
    assert not likelier((data, disc), (data, just_as_good))


def test_what_cannot_be_is_not_likelier():
    _, data, disc = taken(EGG)
    too_bright = replace(data, C=data.B + 9 * (data.C - data.B))
    assert not likelier((data, disc), (too_bright, replace(found(EGG), cost=0.0)))
    assert likelier((too_bright, disc), (data, disc))


def test_what_is_longer_and_went_less_far_reaches_as_far():
    """invariant: from end to end along the way; and it has the area that stretching gives it."""
    _, data, _ = taken(SHEET)
    state = replace(found(SHEET), family=LINE)
    state = state_at(data, LINE, WAY.xy.ravel(), state.silhouette, state.shape, state.frame)
    way = (WAY.xy[1] - WAY.xy[0]) / WAY.length
    reach = WAY.length + np.ptp(state.silhouette.outline(state.shape, 720) @ way)
    others = list(rescaled(data, state, (3, 40)))
    lengths = [np.linalg.norm(np.diff(other.curve[[0, -1]], axis=0)) for other in others]
    assert min(lengths) < 0.7 * WAY.length
    for other, length in zip(others, lengths, strict=True):
        wide = np.ptp(other.silhouette.outline(other.shape, 720) @ way)
        assert_allclose(length + wide, reach, rtol=1e-3)


def test_a_side_and_the_way_of_a_sheet_may_be_exchanged():
    """Invariant: alpha is the same but for scale, as far as twelve order make a rectangle."""
    way, silhouette = Trajectory.line((66, 44), (90, 68)), Silhouette(12)
    alpha, data, disc = taken(Scene(WALL, way, Sheet(30, 20, GREEN)))
    angles = 2 * np.pi * np.arange(720) / 720
    edge = -np.log(np.maximum(np.abs(np.cos(angles)), np.abs(np.sin(angles))))
    shape = silhouette.start(1.0)
    shape[1] = np.log(30 / 20) / 2
    shape[[5, 13, 21]] = [2 * np.mean(edge * np.cos(k * angles)) for k in (4, 8, 12)]
    shape[0] = np.sqrt(30 * 20 / silhouette.area(shape))
    sheet = state_at(data, LINE, way.xy[[0, -1]].ravel(), silhouette, shape, disc.frame)
    assert rmse(sheet, alpha) < 0.02
    tried = list(exchanged(data, sheet, (3, 40)))
    others = [other for other in tried if not other.silhouette.turns]
    turns = [other.silhouette.turn(other.shape) for other in tried if other not in others]
    assert sorted(turns) == [-1] * len(others) + [1] * len(others)
    lengths = [np.linalg.norm(np.diff(other.curve[[0, -1]], axis=0)) for other in others]
    assert_allclose(sorted(lengths), [20, 20, 30, 30], rtol=0.12)  # round corners are nearer
    for other in others:
        same = other.swept.alpha * (alpha.sum() / other.swept.alpha.sum())
        assert np.sqrt(np.mean((same - alpha)[alpha > 0] ** 2)) < 0.06
        assert _is_scaled(sheet, other)
    assert not _is_scaled(sheet, disc)
    discs = list(exchanged(data, disc, (3, 40)))  # nobody sees one turn
    assert discs
    assert not any(other.silhouette.turns for other in discs)


def test_what_leaves_less_is_not_ruled_out():
    """Exact: however much less likely it is said to be."""
    _, data, disc = taken(SQUARE)
    square = found(SQUARE)
    assert left_beyond_noise(data, square) < left_beyond_noise(data, disc)
    assert _is_ruled_out(data, square, disc, 1000.0)
    assert not _is_ruled_out(data, square, disc, 1.0)
    assert not _is_ruled_out(data, disc, square, 1000.0)


@pytest.mark.parametrize("scene", [BALL, EGG], ids=["ball", "egg"])
def test_an_egg_of_any_colors_is_oval(scene):
    _, data, disc = taken(replace(scene, plate=TILES))
    every = Frame.of(np.eye(3))
    start = state_at(data, disc.family, disc.path, DISC, disc.shape[:1], every)
    free = descend(data, start, (3, 40))
    assert is_oval(data, free) == (scene is EGG)
