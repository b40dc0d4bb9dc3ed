"""What is known of a color: the turns against it, and what they cost."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from blurmatte.color import ColorModel
from blurmatte.sweep.frame import Frame
from blurmatte.sweep.model.color_prior import ColorPrior, known_color

PAINTS = np.array([[0.7, 0.35, 0.1], [0.1, 0.3, 0.7]])
TURNS = np.array([3e-3, -5e-3])
ranks = pytest.mark.parametrize("rank", [1, 2])


def sampled(rank):
    """A measured model, of a covariance that differs by direction."""
    rng = np.random.default_rng(rank)
    colors = rng.uniform(0.2, 1, (60, rank)) @ PAINTS[:rank] + rng.normal(0, 0.01, (60, 3))
    return ColorModel.from_samples(colors, rank)


@ranks
def test_turns_are_those_by_which_a_frame_was_turned(rank):
    known = known_color(sampled(rank))
    assert_allclose(known.turns(known.frame), 0, atol=1e-14)
    for turns in (TURNS, TURNS[::-1], [1e-3, 0], [0, 1e-3]):
        turned = known.frame.turned(np.array(turns))
        assert_allclose(known.turns(turned), turns, rtol=1e-4, atol=1e-12)


@ranks
def test_the_cost_is_half_a_squared_number_of_sigmas(rank):
    frame = Frame.of(PAINTS[:rank].T)
    known = ColorPrior(frame, np.diag([1 / 0.01**2, 1 / 0.002**2]))
    assert_allclose(known.cost(frame), 0, atol=1e-14)
    assert_allclose(known.cost(frame.turned(np.array([0.01, 0]))), 0.5, rtol=1e-3)
    assert_allclose(known.cost(frame.turned(np.array([0, -0.004]))), 2, rtol=1e-3)
    assert_allclose(known.cost(frame.turned(np.array([0.01, 0.004]))), 2.5, rtol=1e-3)


@ranks
def test_a_model_is_known_as_well_as_its_covariance_says(rank):
    """The pole of a turned frame is as far away, in sigmas, as the model's own covariance has it."""
    model = sampled(rank)
    known = known_color(model)
    assert known.frame.rank == rank
    assert_allclose(known.frame.across.T @ model.basis, 0, atol=1e-14)
    for turns in 0.01 * np.random.default_rng(0).normal(size=(5, 2)):
        turned = known.frame.turned(turns)
        pole = (turned.within if rank == 1 else turned.across)[:, 0]
        off = pole / (pole @ model.pole) - model.pole
        z2 = off @ np.linalg.pinv(model.covariance) @ off
        assert_allclose(known.cost(turned), z2 / 2, rtol=1e-3)


@ranks
def test_a_color_that_is_given_is_known_to_a_millionth(rank):
    known = known_color(ColorModel.from_hex(*["#ff8000", "#2040ff"][:rank]))
    assert_allclose(known.information, 1e12 * np.eye(2))
