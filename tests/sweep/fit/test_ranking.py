"""The choice among descents: parameters must pay, and what means nothing is not chosen."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from numpy.testing import assert_allclose

from blurmatte.radiometry import with_noise
from blurmatte.rendering import Ball, Camera, Scene, Shot, plain_plate, render
from blurmatte.streaks import Streak
from blurmatte.sweep.fit.ranking import best_of, contested, differ, ranked
from blurmatte.sweep.model.observation import observation_around
from blurmatte.sweep.fit.levenberg_marquardt import descend, state_at
from blurmatte.sweep.frame import Frame
from blurmatte.sweep.model.path import ARC, BOUNCE, CUBIC, FROM_REST, LINE, PARABOLA
from blurmatte.sweep.model.silhouette import DISC
from blurmatte.trajectory import Trajectory

SIZE = (160, 112)
GREEN = np.array([0.25, 0.7, 0.12])
WALL = plain_plate(SIZE, (0.34, 0.33, 0.3), 4)
TIMES = np.linspace(0, 1, 33)
WAYS = {
    LINE: Trajectory.line((44, 42), (112, 68)),
    ARC: Trajectory.arc((38, 70), (78, 40), (120, 70)),
    PARABOLA: Trajectory.parabola((38, 44), (20, 10), (120, 20)),
    BOUNCE: Trajectory.bounce((36, 36), (78, 76), (120, 50), 0.4),
    FROM_REST: Trajectory.from_rest((44, 42), (112, 68), 0.4),
}


@cache
def taken(way, seed=0):
    """The data around the streak of a ball, photographed."""
    shot = Shot(Scene(WALL, way, Ball(11, GREEN)), Camera(code_std=1.5 / 255), seed=seed)
    truth = render(shot.scene, 200)
    image, plate = with_noise(*shot.photograph(truth))
    return observation_around(Streak(truth.layer.alpha > 0), 12, image, plate, None)


def on(data, family, way):
    """A disc on the nearest path of a family."""
    frame = Frame.of(GREEN[:, None])
    path = family.starts(way.at(TIMES))[0]
    return state_at(data, family, path, DISC, DISC.start(11), frame)


@pytest.fixture(scope="module")
def three():
    """The same line as a line, a throw and a cubic, all as likely."""
    way = WAYS[LINE]
    data = taken(way)
    states = [on(data, family, way) for family in (CUBIC, LINE, PARABOLA)]
    return data, [replace(state, cost=states[1].cost, e=states[1].e) for state in states]


def test_the_simplest_of_equals_comes_first(three):
    data, states = three
    order = [state.family for _, state in ranked(data, states)]
    assert order == [LINE, PARABOLA, CUBIC]
    assert best_of(data, states).family is LINE


def test_more_parameters_must_pay(three):
    """What they gain by noise alone is half a unit each, in the mean."""
    data, (_, line, throw) = three
    extra = throw.size - line.size
    for gain, winner in ((0.5 * extra, LINE), (20 * extra, PARABOLA)):
        likelier = replace(throw, cost=line.cost - gain)
        assert best_of(data, [likelier, line]).family is winner


def test_scores_are_by_how_much_each_is_worse(three):
    data, states = three
    likelier = replace(states[1], cost=states[1].cost - 1000)
    scores, order = zip(*ranked(data, [*states, likelier]), strict=True)
    assert order[0] is likelier
    assert list(scores) == sorted(scores)
    assert scores[1] - scores[0] > 500


def test_contested_is_what_is_likely_with_another_alpha(three):
    data, (_, line, throw) = three
    large = replace(
        state_at(data, LINE, line.path, DISC, DISC.start(14), line.frame), cost=line.cost
    )
    assert differ(line, large)
    assert not differ(line, throw)
    a, b = line.swept.alpha, large.swept.alpha
    apart = np.sqrt(((a - b) ** 2).sum() / (b**2).sum())  # of the larger
    for gap, other, by in ((1, throw, 0), (1, large, apart), (9, large, 0)):
        first = contested(data, [(0.0, line), (float(gap), other)])
        assert first.path is line.path
        assert_allclose(first.contested, by, rtol=1e-12)
    assert contested(data, [(0.0, line)]).contested == 0


def test_residuals_that_hang_together_are_less_evidence(three):
    """The same gain decides where residuals are white, and not where they are smooth."""
    from scipy.ndimage import gaussian_filter

    data, (_, line, throw) = three
    white = np.random.default_rng(0).normal(size=line.e.shape)
    smooth = gaussian_filter(white, (0, 3, 3))
    winners = []
    for e in (white, smooth / smooth.std()):
        e[2] = 0
        likelier = replace(throw, cost=line.cost - 16, e=e)
        winners.append(best_of(data, [replace(line, e=e), likelier]).family)
    assert winners == [PARABOLA, LINE]


def test_what_means_nothing_is_left_out_unless_there_is_nothing_else(three):
    data, (_, line, _) = three
    path = line.path + np.array([0, 0, 0, 60.0])
    astray = state_at(data, LINE, path, DISC, line.shape, line.frame)
    astray = replace(astray, cost=line.cost - 1000)
    assert best_of(data, [astray, line]) is line
    assert [state for _, state in ranked(data, [astray, line])] == [line]
    assert best_of(data, [astray]) is astray


@pytest.mark.parametrize("truth", WAYS, ids=lambda family: family.name)
def test_of_descents_the_true_family_is_chosen(truth):
    data, way = taken(WAYS[truth]), WAYS[truth]
    ends = [
        descend(data, on(data, family, way), (3, 40)) for family in dict.fromkeys((LINE, truth))
    ]
    if truth is LINE:
        ends += [descend(data, on(data, family, way), (3, 40)) for family in (ARC, PARABOLA, CUBIC)]
    assert best_of(data, ends).family is truth
