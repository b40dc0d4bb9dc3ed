"""A prior of the radius from other frames of a clip."""

import numpy as np
import pytest

import blurmatte as bm
from blurmatte.rendering import Ball, Scene, colorful_plate, render
from blurmatte.sweep import SizePrior
from blurmatte.trajectory import Trajectory


@pytest.fixture(scope="module")
def pictures():
    """A ball of radius 6 before tiles, with noise."""
    plate = colorful_plate((64, 48), 1, tile=12)
    ball = Ball(6, np.array([0.7, 0.35, 0.1]))
    light = render(Scene(plate, Trajectory.line((18, 20), (44, 27)), ball)).image.rgb
    rng = np.random.default_rng(1)
    noise = bm.NoiseModel(read_std=0.02)
    return [bm.LinearImage(x + rng.normal(0, 0.02, x.shape), noise) for x in (light, plate)]


def test_derivatives_are_those_of_the_cost():
    prior, shape, step = SizePrior(6.0, 0.3), np.array([6.4, 1.0]), 1e-4
    H, g = prior.added(np.zeros((5, 5)), np.zeros(5), shape)
    up, down = (prior.cost(shape + np.array([d, 0])) for d in (step, -step))
    assert g == pytest.approx([0, 0, 0, (up - down) / (2 * step), 0], rel=1e-6)
    assert H[3, 3] == pytest.approx((up - 2 * prior.cost(shape) + down) / step**2, rel=1e-4)


def test_precise_prior_sets_the_radius_and_its_error(pictures):
    free = bm.solve(*pictures, matching=bm.Matching.NONE).sweep
    known = bm.solve(*pictures, matching=bm.Matching.NONE, known_size=SizePrior(6.0, 0.01)).sweep
    assert abs(known.radius - 6) < 0.05
    assert known.radius_std < free.radius_std / 2


def test_vague_prior_changes_nothing(pictures):
    free = bm.solve(*pictures, matching=bm.Matching.NONE).sweep
    vague = bm.solve(*pictures, matching=bm.Matching.NONE, known_size=SizePrior(6.0, 1e4)).sweep
    assert vague.radius == pytest.approx(free.radius, abs=0.2 * free.radius_std)


def test_impossible_prior_is_refused():
    with pytest.raises(ValueError, match="above 0"):
        SizePrior(0.0, 1.0)
