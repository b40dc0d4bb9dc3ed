"""Errors of smooth fields, in flat regions and at rims."""

from functools import cache

import numpy as np
from numpy.testing import assert_allclose

from blurmatte.matting.pyramid import BORDER, CellEvidence
from blurmatte.matting.smooth_error import simulated_variance
from blurmatte.matting.smooth_field import MIN_ALPHA, Prior, fit_field

SIDE, STD = 96, 0.1
PRIOR = Prior(2, 0.04)


def with_a_rim(seed):
    """A plateau with soft rims, and noisy observations of it."""
    y, x = np.mgrid[:SIDE, :SIDE] - (SIDE - 1) / 2
    field = np.pad(0.25 * (1 - np.tanh((np.hypot(x, y) - 28) / 2)), BORDER)
    mask = np.pad(np.hypot(x, y) < 46, BORDER)
    information = mask / STD**2
    noise = np.random.default_rng(seed).normal(size=field.shape) * np.sqrt(information)
    evidence = CellEvidence(
        information,
        information * field + noise,
        mask,
        np.full(field.shape, MIN_ALPHA),
    )
    steep = np.hypot(*np.gradient(field)) > 0.03
    return field * mask, evidence, steep


def settled(evidence, scale=PRIOR.scale, local=False):
    """From rough to smooth."""
    field = None
    for larger in (16 * scale, 8 * scale, 4 * scale, 2 * scale):
        field = fit_field(evidence, Prior(2, larger), field, 4)
    return fit_field(evidence, Prior(2, scale), field, 8, local=local)


@cache
def spreads(local):
    """Root mean square of error over std, own and simulated, on rims and elsewhere."""
    found = []
    for seed in range(2):
        truth, evidence, steep = with_a_rim(seed)
        field = settled(evidence, local=local)
        simulated, _ = simulated_variance(
            evidence, PRIOR, field, lambda drawn: settled(drawn, local=local).x
        )
        for variance in (field.variance, simulated):
            score = (field.x - truth) / np.sqrt(np.where(evidence.mask, variance, 1))
            found += [np.mean(score[evidence.mask & k] ** 2) for k in (steep, ~steep)]
    return np.sqrt(np.reshape(found, (2, 2, 2)).mean(axis=0))


def test_rims_and_flat_regions_have_different_error_scales():
    """Honest: one scale would be too small at rims and too large in flat regions."""
    (rim, flat), (honest_rim, honest_flat) = spreads(local=False)
    assert rim > 1.5 * flat
    assert honest_rim < rim
    assert 0.7 < honest_flat < 1.3


def test_a_local_scale_follows_rims():
    errors = []
    for local in (False, True):
        truth, evidence, _ = with_a_rim(5)
        field = settled(evidence, local=local)
        errors.append(np.sqrt(np.mean((field.x - truth)[evidence.mask] ** 2)))
    assert errors[1] < 0.95 * errors[0]
    rim, flat = spreads(local=True)[1]
    assert 0.7 < rim < 1.6
    assert 0.7 < flat < 1.3


def test_uncertain_choice_of_the_prior_adds_to_the_error():
    """Honest: a prior that varies between trials increases the error, for the same field."""
    _, evidence, _ = with_a_rim(2)
    field = settled(evidence)
    scales = iter((PRIOR.scale / 8, PRIOR.scale) * 2)
    steady, jumping = (
        simulated_variance(evidence, PRIOR, field, solved)[0][evidence.mask].mean()
        for solved in (
            lambda drawn: settled(drawn).x,
            lambda drawn: settled(drawn, next(scales)).x,
        )
    )
    assert jumping > 1.2 * steady


def test_bias_of_the_sum_is_estimated():
    """Honest: with little information a smooth field is biased towards the zero around it."""
    _, evidence, _ = with_a_rim(3)
    field = settled(evidence)
    whole, part = (
        simulated_variance(evidence, PRIOR, field, solved)[1]
        for solved in (lambda drawn: settled(drawn).x, lambda drawn: 0.8 * settled(drawn).x)
    )
    assert_allclose(np.sqrt(part), 0.2 * field.x.sum(), rtol=0.1)
    assert whole < 0.01 * part


def test_the_same_every_time():
    _, evidence, _ = with_a_rim(1)
    field = settled(evidence)
    first, second = (
        simulated_variance(evidence, PRIOR, field, lambda drawn: settled(drawn).x)[0]
        for _ in range(2)
    )
    assert np.array_equal(first, second)
