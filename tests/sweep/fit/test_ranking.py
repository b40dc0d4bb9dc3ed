"""Ranking: penalty for parameters, and exclusion of inadmissible states."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.ndimage import gaussian_filter
from tests.sweep.scenes import BOUNDS, FLAT, ONE_PAINT, disc_at, observed

from blurmatte.sweep.fit.levenberg_marquardt import minimize
from blurmatte.sweep.fit.ranking import best_of, bic_penalty, ranked, rms_difference
from blurmatte.sweep.model.path import ARC, BOUNCE, CUBIC, FROM_REST, LINE, PARABOLA


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


def test_rms_difference_is_of_the_larger_alpha(three):
    """exact"""
    line = three[1]
    large = line.moved(line.path, np.array([14.0]))
    a, b = line.swept.alpha, large.swept.alpha
    expected = np.sqrt(((a - b) ** 2).sum() / (b**2).sum())
    assert_allclose([rms_difference(line, large), rms_difference(large, line)], expected)
    assert rms_difference(line, line) == 0
