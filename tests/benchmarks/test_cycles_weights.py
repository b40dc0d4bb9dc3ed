"""Weights of hypotheses against the frequency with which the likeliest is the nearest."""

import numpy as np
from benchmarks.cycles.weights import Weighed, reliability
from numpy.testing import assert_allclose


def drawn(count, power, seed):
    """Pictures whose likeliest hypothesis is the nearest with a power of its weight."""
    rng = np.random.default_rng(seed)
    weights = rng.uniform(0.3, 1.0, count)
    return [Weighed("cycles", "png", float(w), bool(rng.uniform() < w**power)) for w in weights]


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
    pictures = [Weighed("cycles", "png", 0.5, True), Weighed("own", "png", 0.9, False)]
    rows = reliability(pictures).rows
    assert [row[0] for row in rows] == ["cycles, png", "own, png"]
    assert_allclose([row[1:3] for row in rows], [(0.5, 1.0), (0.9, 0.0)])
