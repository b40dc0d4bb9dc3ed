"""A smooth field from noisy cells: its estimate, its error, and its smoothness."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from numpy.testing import assert_allclose

from blurmatte.matting import smooth_kernel as compiled
from blurmatte.matting.smooth_field import (
    BORDER,
    MIN_ALPHA,
    CellEvidence,
    Prior,
    finer_field,
    fit_field,
    simulated_variance,
    sum_variance,
)

SIDE = 64
PRIORS = [Prior(1, 0.03), Prior(2, 0.01)]
SIDE_OF_RIM, STD = 96, 0.1
PRIOR = Prior(2, 0.04)


def bump():
    """A smooth field with an edge, between 0 and 0.6, and where it may differ from 0."""
    y, x = np.mgrid[:SIDE, :SIDE] - (SIDE - 1) / 2
    inside = np.hypot(x, y) < 0.4 * SIDE
    field = np.where(inside, 0.3 + 0.2 * np.cos(x / 8) * np.cos(y / 11), 0)
    return np.pad(field, BORDER), np.pad(inside, BORDER)


def least(field):
    return np.full_like(field, MIN_ALPHA)


def settled(evidence, order, samples):
    """The smoothness of least risk, searched from rough to smooth."""
    field, found = None, []
    for scale in 0.64 / 2.0 ** np.arange(9):
        field = fit_field(evidence, Prior(order, float(scale)), field, samples)
        found.append(field)
    return min(found, key=lambda field: field.risk)


def noisy(seed, std=0.1):
    truth, mask = bump()
    rng = np.random.default_rng(seed)
    information = mask * rng.uniform(0.3, 3, truth.shape) / std**2
    noise = rng.normal(size=truth.shape) * np.sqrt(information)
    return truth, CellEvidence(information, information * truth + noise, mask, least(truth))


def test_a_fit_that_takes_the_largest_number_of_steps_has_not_converged():
    """Stiff: errors of cells differ by six orders of magnitude, and neighbors by less than any."""
    truth, mask = bump()
    information = mask * 10 ** np.random.default_rng(0).uniform(0, 12, truth.shape)
    evidence = CellEvidence(information, information * truth, mask, least(truth))
    assert not fit_field(evidence, Prior(2, 1e-6), None, samples=0).converged
    assert fit_field(evidence, Prior(2, 1.0), None, samples=0).converged


@pytest.mark.parametrize("order", [1, 2])
def test_noise_is_reduced_and_errors_are_calibrated(order):
    scores = []
    for seed in range(4):
        truth, evidence = noisy(seed)
        field = settled(evidence, order, 16)
        error = (field.x - truth)[evidence.mask]
        assert np.sqrt(np.mean(error**2)) < 0.5 * 0.1
        scores.append(error / np.sqrt(field.variance[evidence.mask]))
    assert 0.8 < np.sqrt(np.mean(np.square(scores))) < 1.25


@pytest.mark.parametrize("prior", PRIORS)
def test_cells_without_error_are_unchanged(prior):
    truth, evidence = noisy(0, std=1e-7)
    assert_allclose(fit_field(evidence, prior, None, 2).x, truth, atol=1e-5)


def test_cells_without_information_are_filled_from_their_neighbors():
    truth, evidence = noisy(1, std=0.02)
    hole = np.zeros(truth.shape, bool)
    hole[30:36, 28:40] = True
    blind = replace(
        evidence,
        information=np.where(hole, 0, evidence.information),
        pull=np.where(hole, 0, evidence.pull),
    )
    seeing, field = (settled(e, 2, 8) for e in (evidence, blind))
    assert np.abs(field.x - truth)[hole].max() < 0.1
    assert field.variance[hole].mean() > 1.5 * seeing.variance[hole].mean()


def test_estimated_risk_equals_the_true_risk():
    """In units of noise, in the mean, up to a constant."""
    found = []
    for seed in range(6):
        truth, evidence = noisy(seed)
        for prior in (Prior(1, 0.003), Prior(1, 0.03), Prior(2, 0.1), Prior(2, 1.0)):
            field = fit_field(evidence, prior, None, 16)
            true = np.mean((evidence.information * (field.x - truth) ** 2)[evidence.mask])
            cells = np.count_nonzero(evidence.mask)
            found.append((field.risk / cells + 1, true))
    risk, true = np.array(found).T
    assert abs(np.mean(risk - true)) < 0.03
    assert np.corrcoef(risk, true)[0, 1] > 0.9


def test_field_is_not_far_above_one():
    _, evidence = noisy(2)
    high = replace(evidence, pull=3 * evidence.pull)
    assert fit_field(high, PRIORS[1], None, 2).x.max() < 1.05


def test_field_is_not_far_below_its_lower_bound():
    truth, evidence = noisy(2, std=0.5)
    least = np.where(evidence.mask, truth - 0.05, MIN_ALPHA)
    short = []
    for known in (evidence, replace(evidence, lower=least)):
        field = None
        for _ in range(2):
            field = fit_field(known, PRIORS[1], field, 2)
        short.append(np.clip(least - field.x, 0, None)[evidence.mask].mean())
    assert short[1] < 0.05 * short[0]


def test_lower_bound_of_a_cell_is_the_mean_of_its_pixels():
    _, evidence = noisy(4)
    rising = replace(evidence, lower=0.01 * np.indices(evidence.mask.shape)[1])
    coarse = rising.coarser()
    whole = coarse.mask[12:20, 12:20]
    assert whole.all()
    x = 2 * np.arange(12, 20) - BORDER + 0.5
    assert_allclose(coarse.lower[12:20, 12:20], np.broadcast_to(0.01 * x, (8, 8)))


@pytest.mark.parametrize("prior", PRIORS)
def test_variance_of_the_sum_is_that_of_the_inverse(prior):
    _, evidence = noisy(3)
    field = fit_field(evidence, prior, None, 4)
    root = np.zeros(field.squares.shape)
    of_all = np.full(field.x.shape, prior.scale**2)
    compiled.precision(field.squares, prior.order, of_all, 2.0, root)
    ones, whole = evidence.mask.astype(float), np.zeros(field.x.shape)
    compiled.conjugate_gradients(
        evidence.information, root, prior.order, evidence.mask, ones, whole, 2000, 0.0
    )
    assert_allclose(sum_variance(evidence, prior, field), whole.sum(), rtol=0.02)


def test_coarser_cells_keep_all_information():
    _, evidence = noisy(4)
    coarse = evidence.coarser()
    assert_allclose(coarse.information.sum(), evidence.information.sum())
    assert_allclose(coarse.pull.sum(), evidence.pull.sum())
    assert not coarse.mask[:BORDER].any()
    assert not coarse.mask[:, -BORDER:].any()
    maps = evidence.information, evidence.pull, evidence.mask, evidence.lower
    odd = CellEvidence(*(m[:-1, :-1] for m in maps))
    assert odd.coarser().mask.shape == coarse.mask.shape


def test_a_field_is_as_smooth_in_smaller_cells():
    truth, evidence = noisy(5)
    coarse = fit_field(evidence.coarser(), Prior(2, 0.16), None, 2, 4)
    start = finer_field(coarse, truth.shape, 2)
    assert start.x.shape == truth.shape
    assert np.sqrt(np.mean((start.x - truth)[evidence.mask] ** 2)) < 0.08
    assert Prior(2, 0.04).finer() == Prior(2, 0.01)
    assert Prior(1, 0.04).finer() == Prior(1, 0.02)


def test_the_same_every_time():
    _, evidence = noisy(6)
    first, second = (fit_field(evidence, PRIORS[0], None, 3) for _ in range(2))
    assert np.array_equal(first.x, second.x)
    assert np.array_equal(first.variance, second.variance)


def with_a_rim(seed):
    """A plateau with soft rims, and noisy observations of it."""
    y, x = np.mgrid[:SIDE_OF_RIM, :SIDE_OF_RIM] - (SIDE_OF_RIM - 1) / 2
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


def settled_at(evidence, scale=PRIOR.scale, local=False):
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
        field = settled_at(evidence, local=local)
        simulated, _ = simulated_variance(
            evidence, PRIOR, field, lambda drawn: settled_at(drawn, local=local).x
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
    assert 0.8 < honest_flat < 1.25


def test_a_local_scale_follows_rims_whose_errors_are_40_percent_too_small():
    errors = []
    for local in (False, True):
        truth, evidence, _ = with_a_rim(5)
        field = settled_at(evidence, local=local)
        errors.append(np.sqrt(np.mean((field.x - truth)[evidence.mask] ** 2)))
    assert errors[1] < 0.95 * errors[0]
    rim, flat = spreads(local=True)[1]
    assert 1.25 < rim < 1.6
    assert 0.8 < flat < 1.25


def test_uncertain_choice_of_the_prior_adds_to_the_error():
    """Honest: a prior that varies between trials increases the error, for the same field."""
    _, evidence, _ = with_a_rim(2)
    field = settled_at(evidence)
    scales = iter((PRIOR.scale / 8, PRIOR.scale) * 2)
    steady, jumping = (
        simulated_variance(evidence, PRIOR, field, solved)[0][evidence.mask].mean()
        for solved in (
            lambda drawn: settled_at(drawn).x,
            lambda drawn: settled_at(drawn, next(scales)).x,
        )
    )
    assert jumping > 1.2 * steady


def test_bias_of_the_sum_is_estimated():
    """Honest: with little information a smooth field is biased towards the zero around it."""
    _, evidence, _ = with_a_rim(3)
    field = settled_at(evidence)
    whole, part = (
        simulated_variance(evidence, PRIOR, field, solved)[1]
        for solved in (lambda drawn: settled_at(drawn).x, lambda drawn: 0.8 * settled_at(drawn).x)
    )
    assert_allclose(np.sqrt(part), 0.2 * field.x.sum(), rtol=0.1)
    assert whole < 0.01 * part


def test_error_is_the_same_every_time():
    _, evidence, _ = with_a_rim(1)
    field = settled_at(evidence)
    first, second = (
        simulated_variance(evidence, PRIOR, field, lambda drawn: settled_at(drawn).x)[0]
        for _ in range(2)
    )
    assert np.array_equal(first, second)
