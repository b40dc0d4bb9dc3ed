"""Weights of hypotheses against the frequency with which the likeliest is nearest, and their fit."""

import numpy as np
from benchmarks.cycles.weights import Weighed, fit_odds, reliability
from numpy.testing import assert_allclose

from blurmatte.sweep.assess.calibration import OddsTerms


def weighed(renderer, weight, is_nearest):
    """A picture with two hypotheses."""
    errors = np.array([0.01, 0.02] if is_nearest else [0.02, 0.01])
    return Weighed(renderer, "png", [OddsTerms()] * 2, np.array([weight, 1 - weight]), errors)


def drawn(count, power, seed):
    """Pictures whose likeliest hypothesis is the nearest with a power of its weight."""
    rng = np.random.default_rng(seed)
    weights = rng.uniform(0.5, 1.0, count)
    return [weighed("cycles", w, rng.uniform() < w**power) for w in weights]


def test_right_weights_are_the_frequencies():
    """honest: of 4,000 pictures each group is within three standard deviations."""
    for _, stated, observed, std, count in reliability(drawn(4000, 1.0, 0)).rows:
        assert count == 1000
        assert abs(observed - stated) < 3 * std


def test_weights_that_state_too_much_are_seen():
    """honest"""
    rows = reliability(drawn(4000, 3.0, 1)).rows
    assert all(stated - observed > 3 * std for _, stated, observed, std, _ in rows[:3])


def test_groups_are_of_one_renderer_and_camera():
    """exact"""
    pictures = [weighed("cycles", 0.5, True), weighed("own", 0.9, False)]
    rows = reliability(pictures).rows
    assert [row[0] for row in rows] == ["cycles, png", "own, png"]
    assert_allclose([row[1:3] for row in rows], [(0.5, 1.0), (0.9, 0.0)])


def test_odds_are_those_by_which_hypotheses_were_drawn():
    """oracle: the nearest of five hypotheses is drawn with known odds, 3,000 times."""
    rng, c = (
        np.random.default_rng(2),
        {"seen": 0.6, "unseen": 0.3, "outline": -0.5, "shapeless": 0.2},
    )
    pictures = []
    for _ in range(3000):
        terms = [
            OddsTerms(
                seen=rng.uniform(0, 4),
                unseen=rng.uniform(0, 4),
                outline=float(rng.random() < 0.3),
                shapeless=float(k == 4),
            )
            for k in range(5)
        ]
        odds = np.exp([-sum(c[name] * getattr(one, name) for name in c) for one in terms])
        errors = np.full(5, 0.02)
        errors[rng.choice(5, p=odds / odds.sum())] = 0.01
        pictures.append(Weighed("cycles", "png", terms, odds / odds.sum(), errors))
    noise = Weighed("cycles", "png", [], np.array([0.9, 0.1]), np.array([0.02, 0.01]))
    found = fit_odds([*pictures, noise])  # where only noise remains no odds are used
    for name in found:
        assert abs(found[name] - c.get(name, 0)) < 0.1
