"""Ranking: penalty for parameters, and exclusion of inadmissible states."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.ndimage import gaussian_filter
from tests.sweep.scenes import BALL, BALLS, BOUNDS, FLAT, ONE_PAINT, disc_at, observed

from blurmatte.rendering import Ball
from blurmatte.sweep.fit.levenberg_marquardt import minimize
from blurmatte.sweep.fit.ranking import (
    MAX_LIGHT,
    UNSEEN_END,
    best_of,
    bic_penalty,
    ends_unseen,
    inside_mask,
    is_source,
    ranked,
    rejection,
    self_overlaps,
)
from blurmatte.sweep.model.path import ARC, BOUNCE, CUBIC, FROM_REST, LINE, PARABOLA
from blurmatte.sweep.model.silhouette import DISC
from blurmatte.sweep.model.state import state_at
from blurmatte.trajectory import Trajectory

PALE = replace(BALL, body=Ball(11, (0.9, 0.95, 0.7), ambient=0.9))


@pytest.fixture(scope="module")
def three():
    """The same line as a cubic, a line and a parabola, of the same cost."""
    line = disc_at(observed(FLAT[LINE], color=ONE_PAINT))
    return [
        replace(line.along(family), cost=line.cost, e=line.e) for family in (CUBIC, LINE, PARABOLA)
    ]


def test_the_simplest_of_equals_comes_first(three):
    assert [state.family for _, state in ranked(three)] == [LINE, PARABOLA, CUBIC]
    assert best_of(three).family is LINE


def test_scores_are_those_of_the_information_criterion(three):
    """exact: half a log of the weight for each parameter beyond those of the best."""
    scores = [score for score, _ in ranked(three)]
    each = 0.5 * np.log(three[0].observation.weight.sum())
    assert_allclose(scores, [0, 2 * each, 4 * each], rtol=1e-12)
    assert_allclose(bic_penalty(three[0].observation, 4), 4 * each)


def test_more_parameters_need_a_lower_cost(three):
    _, line, parabola = three
    extra = bic_penalty(line.observation, parabola.size - line.size)
    for gain, winner in ((0.9 * extra, LINE), (1.5 * extra, PARABOLA)):
        likelier = replace(parabola, cost=line.cost - gain)
        assert best_of([likelier, line]).family is winner


def test_a_kink_counts_twice(three):
    """exact: a path from rest has 5 parameters, and counts as one of 6."""
    line = three[1]
    path = line.along(FROM_REST)
    departed = replace(
        path.moved(np.array([*line.path, 0.0]), path.shape), cost=line.cost, e=line.e
    )
    scores = [score for score, _ in ranked([line, departed])]
    assert_allclose(scores[1], bic_penalty(line.observation, 2), rtol=1e-9)


def test_correlated_residuals_are_less_evidence(three):
    """The same gain is decisive for white residuals, and not for smooth ones."""
    _, line, parabola = three
    white = np.random.default_rng(0).normal(size=line.e.shape)
    smooth = gaussian_filter(white, (0, 3, 3))
    winners = []
    for e in (white, smooth / smooth.std()):
        likelier = replace(parabola, cost=line.cost - 16, e=e)
        winners.append(best_of([replace(line, e=e), likelier]).family)
    assert winners == [PARABOLA, LINE]


def test_inadmissible_states_are_excluded_if_there_are_others(three):
    line = three[1]
    inadmissible = line.moved(line.path + np.array([0, 0, 0, 60.0]), line.shape)
    inadmissible = replace(inadmissible, cost=line.cost - 1000)
    assert best_of([inadmissible, line]) is line
    assert [state for _, state in ranked([inadmissible, line])] == [line]
    assert best_of([inadmissible]) is inadmissible


@pytest.mark.parametrize("family", FLAT, ids=lambda family: family.name)
def test_the_true_family_is_the_best_of_fits(family):
    """honest: also of fits on richer families, if it is a line."""
    start = disc_at(observed(FLAT[family], color=ONE_PAINT), family)
    rich = (ARC, PARABOLA, CUBIC, BOUNCE) if family is LINE else (LINE,)
    fits = [minimize(start.along(other), BOUNDS) for other in (family, *rich)]
    assert best_of(fits).family is family


def disc_on(family, path, radius=11.0, scene=BALL):
    observation = observed(scene, color=ONE_PAINT)
    return state_at(observation, family, np.array(path, float), DISC, DISC.start(radius))


@pytest.mark.parametrize("family", BALLS, ids=lambda family: family.name)
def test_the_truth_is_admissible(family):
    """exact: for every family of paths."""
    state = disc_at(observed(BALLS[family], color=ONE_PAINT), family)
    assert rejection(state) == ""


def test_a_shape_that_needs_more_light_than_white_is_a_source():
    small = disc_at(observed(PALE, color=ONE_PAINT), radius=4.0)
    assert small.mean_color.max() > MAX_LIGHT
    assert is_source(small)
    assert rejection(small) == ""
    assert not rejection(disc_at(observed(PALE, color=ONE_PAINT)))


def test_negative_light_is_rejected():
    observation = observed(BALL, color=ONE_PAINT)
    alpha = disc_at(observation).swept.alpha
    darker = observation.C - np.where(alpha > 0, 0.1, 0)[..., None] * [0, 0, 1]
    assert rejection(disc_at(observation.with_light(darker))) == "needs negative light"


def test_a_path_must_stay_in_the_streak():
    detour = disc_on(CUBIC, [44, 42, 48, 115, 78, 55, 112, 68])
    assert not inside_mask(detour)
    assert rejection(detour) == "leaves the streak"


@pytest.fixture
def too_long():
    """The line of the ball, and on beyond the streak, where nothing changed."""
    line = disc_at(observed(BALL, color=ONE_PAINT))
    start, end = line.path[:2], line.path[2:]
    return line.moved(np.array([*start, *(end + 0.3 * (end - start))]), line.shape)


def test_a_path_must_not_end_where_nothing_changed(too_long):
    assert inside_mask(too_long)
    assert rejection(too_long) == UNSEEN_END


def test_a_path_may_end_before_a_plate_of_the_color_of_the_object(too_long):
    """exact: the object would not be seen there."""
    observation = too_long.observation
    color = observation.of_rgb(too_long.mean_color)
    outside = ~observation.streak[..., None]
    C, B = (np.where(outside, color, light) for light in (observation.C, observation.B))
    hidden = too_long.relit(replace(observation, C=C, B=B))
    assert not ends_unseen(hidden)


def test_a_path_may_be_hidden_between_its_ends():
    """exact: a post that hides the middle of the streak."""
    line = disc_at(observed(BALL, color=ONE_PAINT))
    observation, middle = line.observation, line.curve[16] - line.observation.origin
    columns = np.abs(np.arange(observation.C.shape[1]) - middle[0]) < 4
    C = np.where(columns[None, :, None], observation.B, observation.C)
    hidden = line.relit(replace(observation, C=C, streak=observation.streak & ~columns))
    assert not ends_unseen(hidden)


def test_a_source_of_light_may_go_out(too_long):
    alone = replace(too_long.observation, light_alone=True)
    assert not ends_unseen(too_long.relit(alone))


def test_a_path_may_leave_the_picture():
    leaves = replace(BALL, trajectory=Trajectory.line((112, 42), (170, 60)))
    assert inside_mask(disc_on(LINE, [112, 42, 170, 60], scene=leaves))
    assert not inside_mask(disc_on(LINE, [112, 42, 130, 110], scene=leaves))


def test_coarse_pixels_have_the_same_mask():
    """invariant"""
    for path in ([44, 42, 112, 68], [44, 42, 112, 130]):
        state = disc_on(LINE, path)
        assert inside_mask(state.on(state.observation.coarser(3))) == inside_mask(state)


@pytest.mark.parametrize(
    ("family", "path", "radius", "overlaps"),
    [
        (CUBIC, [68, 45, 96, 57, 60, 53, 88, 65], 11, True),
        (CUBIC, [68, 45, 96, 57, 60, 53, 88, 65], 2, False),
        (ARC, [78, 46, 78.5, 46, 20], 11, True),  # a circle of radius 10
        (ARC, [78, 46, 78.5, 46, 20], 3, False),
        (PARABOLA, [60, 48, 88, 60, 60, 48], 11, False),
        (BOUNCE, [78, 55, 86, 55, 78, 55, 0.5], 11, True),
        (BOUNCE, [78, 55, 102, 55, 78, 55, 0.5], 11, False),
    ],
    ids=["Z", "wide Z", "loop", "wide loop", "back once", "short bounce", "long bounce"],
)
def test_paths_that_double_back_within_their_width_overlap(family, path, radius, overlaps):
    assert self_overlaps(disc_on(family, path, float(radius))) == overlaps


@pytest.mark.parametrize("coarser", [1, 5])
@pytest.mark.parametrize("fraction", [0.4, 0.6])
def test_most_of_a_sweep_must_be_visible(fraction, coarser):
    """Invariant: on large pixels, too, most of which are cut by a border of what is hidden."""
    observation = observed(BALL, color=ONE_PAINT)
    alpha = disc_at(observation).swept.alpha
    valid = observation.valid & (np.cumsum(alpha.sum(axis=0)) >= fraction * alpha.sum())
    hidden = replace(observation, valid=valid, weight=observation.weight * valid)
    state = disc_at(hidden.coarser(coarser))
    expected = "lies mostly where the pictures are clipped or hidden" if fraction > 0.5 else ""
    assert rejection(state) == expected
