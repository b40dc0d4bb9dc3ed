"""Averages of hypotheses: a search that was cut short, errors that are simulated or not."""

from dataclasses import replace

import numpy as np
import pytest
from benchmarks.accuracy.verdict import FILES, KINDS, draw
from benchmarks.trials import photograph
from tests.sweep.scenes import BEFORE_TILES, photographed

import blurmatte as bm
from blurmatte.explain.solution import grade_in_words
from blurmatte.matting import Averaged, hypotheses, solve
from blurmatte.matting.averaging import QUARTILE
from blurmatte.matting.maps import Grade
from blurmatte.matting.smooth import Smooth
from blurmatte.rendering import Ball, Camera, Scene, render
from blurmatte.rendering.flat_bodies import Sheet
from blurmatte.rendering.lighting import Lamp
from blurmatte.rendering.plates import plain_plate
from blurmatte.sweep import candidates
from blurmatte.sweep.assess.diagnostics import sweep_of
from blurmatte.sweep.model.path import LINE
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


def test_a_shape_that_did_not_converge_is_not_confirmed(monkeypatch):
    pictures = photographed(BEFORE_TILES[LINE])
    assert solve(*pictures).grade is Grade.CONFIRMED

    def unfinished(candidate, image):
        sweep = sweep_of(candidate, image)
        return replace(sweep, diagnostics=replace(sweep.diagnostics, converged=False))

    monkeypatch.setattr(candidates, "sweep_of", unfinished)
    solution = solve(*pictures)
    assert solution.grade is Grade.PLAUSIBLE
    assert solution.stats.grade_reasons[0] == "convergence"
    assert "the fit of the likeliest shape did not converge" in grade_in_words(solution)[0]


def test_without_a_limit_every_shape_that_is_worth_a_fit_is_tried(square):
    truth, image, plate = square
    solution = solve(image, plate)
    assert solution.stats.untried == ()
    assert not solution.stats.sweep.is_disc
    streak = truth.layer.alpha > 0.004
    assert np.sqrt(np.mean((solution.alpha - truth.layer.alpha)[streak] ** 2)) < 0.02


def test_an_error_that_is_not_simulated_changes_alpha_by_less_than_its_error(square, monkeypatch):
    _, image, plate = square
    without = solve(image, plate)
    monkeypatch.setattr(hypotheses, "_may_enter_mean", lambda *_: True)
    simulated = solve(image, plate)
    assert max(without.stats.weights[-1], simulated.stats.weights[-1]) < QUARTILE
    change = np.abs(without.alpha - simulated.alpha)
    assert np.all(change <= 0.1 * simulated.alpha_std + 1e-9)


def test_an_alpha_without_a_shape_that_has_weight_has_a_simulated_error(monkeypatch):
    """Two balls that cross are no shape on a path."""
    plate = image = bm.LinearImage(plain_plate(SIZE, (0.3, 0.33, 0.36), 1))
    for start, end in (((25, 20), (100, 52)), ((25, 52), (100, 20))):
        body = Ball(9, (0.9, 0.45, 0.05))
        layer = render(Scene(plate.rgb, Trajectory.line(start, end), body), 120).layer
        image = layer.over(image)
    camera, rng = Camera(code_std=1 / 255), np.random.default_rng(0)
    pictures = [camera.photograph(one.rgb, rng) for one in (image, plate)]
    simulated, original = [], Smooth.simulated_error

    def counted(*given):
        simulated.append(1)
        return original(*given)

    monkeypatch.setattr(Smooth, "simulated_error", counted)
    assert solve(*pictures).stats.weights[-1] > QUARTILE
    assert simulated


@pytest.mark.battery
def test_errors_of_the_radius_contain_other_likely_shapes():
    """honest: of balls with gloss or a shadow as JPEG, before all plates. The error contains
    the radii of other likely shapes, and is far larger than that of half of the shadows.
    """
    z = []
    for kind in ("glossy ball", "ball and its shadow"):
        for seed in range(12, 24):
            drawn = draw(93_000 + seed)
            pictures = photograph(KINDS[kind](drawn).truth, FILES["JPEG"], seed)
            sweep = solve(*pictures).sweep
            z.append((sweep.radius - drawn.radius) / sweep.radius_std)
    assert np.mean(np.abs(z) < 3) >= 0.9
    assert 0.62 < np.sqrt(np.mean(np.square(z))) < 1


@pytest.mark.battery
def test_errors_contain_a_side_as_bright_as_the_wall():
    """honest: radius and alpha of matte balls of about the hue of a plain wall, lit from one side."""
    z, over_claim = [], []
    for seed in range(48):
        rng = np.random.default_rng([seed, 12])
        wall = rng.uniform(0.2, 0.4) * rng.uniform(0.9, 1.1, 3)
        turn, tilt = rng.uniform(0, 2 * np.pi), rng.uniform(0.5, 1.1)
        lamp = Lamp((np.cos(turn) * np.sin(tilt), np.sin(turn) * np.sin(tilt), np.cos(tilt)))
        radius, paint = rng.uniform(6, 11), rng.uniform(0.6, 0.9) * rng.uniform(0.9, 1.1, 3)
        ball = Ball(radius, paint, ambient=0.3, lamps=(lamp,))
        path = Trajectory.line((40, 36), (40 + rng.uniform(16, 48), 36 + rng.uniform(-8, 8)))
        truth = render(Scene(plain_plate(SIZE, wall, seed), path, ball), 96)
        camera = Camera(code_std=1 / 255)
        pictures = (camera.photograph(one.rgb, rng) for one in (truth.image, truth.plate))
        solution = solve(*pictures)
        z.append((solution.sweep.radius - radius) / solution.sweep.radius_std)
        off = (solution.layer.alpha - truth.layer.alpha)[truth.layer.alpha > 0]
        over_claim.append(np.sqrt(np.mean(off**2)) / solution.stats.alpha_error)
    assert np.mean(np.abs(z) < 3) >= 0.95
    assert 0.8 < np.sqrt(np.mean(np.square(z))) < 1.25
    assert np.mean(np.array(over_claim) < 2) >= 0.95


@pytest.mark.battery
def test_squares_do_not_exchange_their_length_and_that_of_their_path():
    """honest: both leave nearly the same light, and the order of an outline does not decide."""
    off, claim = [], []
    for seed in range(16):
        case = KINDS["square"](draw(98_000 + seed))
        solution = solve(*photograph(case.truth, FILES["PNG"], seed))
        alpha = case.truth.layer.alpha
        off.append(np.sqrt(np.mean((solution.layer.alpha - alpha)[alpha > 0] ** 2)))
        claim.append(solution.stats.alpha_error)
    assert max(off) < 0.1
    assert np.mean(np.array(off) < 2 * np.array(claim)) >= 0.9


def test_several_shapes_are_together_likelier_than_none():
    """exact: alpha without a shape has the largest weight, but the shapes have more together"""
    shapes, box = [None, None], (0, 0, 1, 1)
    for weights, has_shape in (((0.3, 0.25, 0.45), True), ((0.25, 0.2, 0.55), False)):
        known = shapes, [None], [True] * 3, np.array(weights), box, []
        assert hypotheses.WeightedHypotheses(*known).has_shape is has_shape
