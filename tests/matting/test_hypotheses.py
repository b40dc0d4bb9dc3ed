"""Averages of hypotheses whose search was cut short."""

import numpy as np
import pytest

from blurmatte.explain.grade import grade_in_words
from blurmatte.matting import Averaged, Grade, solve
from blurmatte.rendering import Camera, Scene, Sheet, plain_plate, render
from blurmatte.trajectory import Trajectory

SIZE = (128, 72)


@pytest.fixture(scope="module")
def square():
    """A square, which no disc explains."""
    plate = plain_plate(SIZE, (0.3, 0.33, 0.36), 1)
    body = Sheet(20, 20, np.array([0.9, 0.45, 0.05]))
    truth = render(Scene(plate, Trajectory.line((35, 36), (92, 36)), body), 120)
    camera, rng = Camera(code_std=1 / 255), np.random.default_rng(0)
    return truth, *(camera.photograph(p.rgb, rng) for p in (truth.image, truth.plate))


def test_shapes_after_the_time_limit_are_named_and_nothing_is_confirmed(square):
    _, image, plate = square
    solution = solve(image, plate, solver=Averaged(seconds=1e-9))
    assert "an outline" in solution.stats.untried
    assert solution.stats.grade is not Grade.CONFIRMED
    assert solution.stats.grade_reasons[0] == "time"
    assert "not all explanations were tried in the given time (" in grade_in_words(solution)[0]
    assert solution.stats.sweep.is_disc


def test_without_a_limit_every_shape_that_is_worth_a_fit_is_tried(square):
    truth, image, plate = square
    solution = solve(image, plate)
    assert solution.stats.untried == ()
    assert not solution.stats.sweep.is_disc
    streak = truth.layer.alpha > 0.004
    assert np.sqrt(np.mean((solution.alpha - truth.layer.alpha)[streak] ** 2)) < 0.02
