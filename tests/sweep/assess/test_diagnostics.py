"""Diagnostics of correct and of wrong sweeps."""

from dataclasses import fields, replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from tests.sweep.scenes import (
    BALL,
    BOUNDS,
    FLAT,
    FLAT_BEFORE_TILES,
    GREEN,
    NEUTRAL,
    ONE_PAINT,
    RADIUS,
    RED,
    disc_at,
    observed,
    photographed,
)

from blurmatte.files.models import sweep_from_json, sweep_to_json
from blurmatte.rendering import Ball
from blurmatte.rendering.flat_bodies import Sheet
from blurmatte.rendering.pose import Change
from blurmatte.sweep.assess.diagnostics import diagnosed, sweep_of
from blurmatte.sweep.fit.levenberg_marquardt import minimize
from blurmatte.sweep.fit.ranking import Candidate, residual_excess
from blurmatte.sweep.model.path import LINE
from blurmatte.sweep.model.silhouette import DISC
from blurmatte.sweep.sweep import Diagnostics

SQUARE = replace(BALL, body=Sheet(24, 24, GREEN), change=Change(turned=(0, 0, 0.4)))
TWO_PAINTS = replace(
    FLAT_BEFORE_TILES[LINE], body=Ball(RADIUS, GREEN, second_color=RED, ambient=1.0)
)


def known(scene, color=ONE_PAINT, **change):
    """State and diagnostics of the disc that fits best near the true path."""
    state = minimize(disc_at(observed(scene, color=color)), BOUNDS)
    candidate = replace(Candidate(state), **change)
    return state, diagnosed(candidate, RADIUS, 0.05, 0.4)


def test_defaults_are_those_of_a_correct_sweep():
    plain = Diagnostics()
    assert plain.rejection == ""
    assert plain.converged
    assert plain.residual_excess == plain.variance_inflation == plain.noise_inflation == 1
    assert plain.prior_probability == 1
    assert len(fields(plain)) == 15


@pytest.mark.parametrize("scenes", [FLAT, FLAT_BEFORE_TILES], ids=["wall", "tiles"])
def test_diagnostics_of_a_correct_sweep_are_small(scenes):
    """honest"""
    _, d = known(scenes[LINE])
    assert d.rejection == ""
    assert d.converged
    assert 0.8 < d.residual_excess < 1.2
    assert d.outlier_fraction < 0.01
    assert d.variance_inflation < 1.2
    assert d.noise_inflation == 1
    assert d.color_spread < 0.02
    assert d.blur_over_radius == d.chroma_blur == 0


def test_numbers_are_those_of_the_residuals():
    """exact"""
    state, d = known(SQUARE)
    assert d.variance_inflation == state.variance_inflation > 2
    assert d.residual_excess == residual_excess(state) > 1.2
    inside = np.count_nonzero((state.swept.alpha > 0) & state.observation.valid)
    assert_allclose(d.effective_pixels, inside / d.variance_inflation)


def test_errors_of_radius_and_color_are_those_given():
    _, d = known(FLAT[LINE], chroma_blur=0.7)
    assert_allclose(d.radius_error, 0.05 / RADIUS)
    assert d.color_angle_std == 0.4
    assert d.chroma_blur == 0.7


def test_two_paints_spread_in_color():
    """honest"""
    _, one = known(FLAT_BEFORE_TILES[LINE], NEUTRAL)
    _, two = known(TWO_PAINTS, NEUTRAL)
    assert one.color_spread < 0.03 < 0.1 < two.color_spread


def test_signal_to_noise_is_the_change_over_the_noise():
    """exact: half of it for four times the variance."""
    state, d = known(FLAT[LINE])
    raised = diagnosed(Candidate(state.on(state.observation.raised(4.0))), RADIUS, 0.05, 0.4)
    assert_allclose(raised.signal_to_noise, d.signal_to_noise / 2, rtol=1e-9)
    assert raised.noise_inflation == 4


def test_a_path_that_leaves_the_streak_is_rejected():
    state = disc_at(observed(FLAT[LINE], color=ONE_PAINT), offset=(0, 45))
    assert diagnosed(Candidate(state), RADIUS, 0.05, 0.4).rejection


@pytest.mark.parametrize("opacity", [0.3, 0.9])
def test_an_unknown_area_leaves_an_opacity_the_error_of_a_fraction(opacity):
    """exact; the sweep can be written and read."""
    state = disc_at(observed(FLAT[LINE], color=ONE_PAINT)).of_kind(DISC.with_opacity(opacity))
    known = 1e-6 * np.eye(len(state.path) + len(state.shape))
    image, _ = photographed(FLAT[LINE])
    small, large = (
        sweep_of(Candidate(state, opacity_std=0.05, covariance=by * known), image)
        for by in (1, 1e12)
    )
    assert_allclose(small.opacity_std, 0.05, rtol=0.01)
    assert_allclose(large.opacity_std, np.hypot(12**-0.5, opacity - 0.5))
    assert sweep_from_json(sweep_to_json(large)).opacity_std == large.opacity_std
