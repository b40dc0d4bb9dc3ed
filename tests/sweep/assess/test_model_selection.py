"""Evidence for an alpha, and the weights of hypotheses."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from tests.sweep.scenes import (
    BALLS,
    BEFORE_TILES,
    FLAT,
    FLAT_BEFORE_TILES,
    disc_at,
    observed,
    rendered,
    within,
)

from blurmatte.sweep.assess.calibration import OddsTerms, fitted_calibration
from blurmatte.sweep.assess.model_selection import (
    Evidence,
    evidence_of,
    hypothesis_probabilities,
    hypothesis_scores,
    hypothesis_weights,
    in_observation,
    is_decisively_likelier,
    leaves_only_noise,
    odds_terms,
    unseen_loss,
)
from blurmatte.sweep.model.path import ARC, LINE

THREE = [
    Evidence(120.0, 1.3, 5, 4000),
    Evidence(118.0, 1.1, 9, 4000),
    Evidence(131.0, 1.6, 5, 4000),
]


def alpha_of(scene):
    observation = observed(scene)
    return observation, np.asarray(within(observation, rendered(scene).layer.alpha), float)


def test_weights_sum_to_one():
    assert_allclose(hypothesis_weights(THREE).sum(), 1, rtol=1e-12)
    assert hypothesis_weights(THREE[:1]) == 1


def test_weights_are_invariant_to_a_common_cost():
    """invariant: only differences of log likelihoods count, however large both are."""
    for common in (-5e5, 1e3, 1e6):
        moved = [replace(one, cost=one.cost + common) for one in THREE]
        assert_allclose(hypothesis_weights(moved), hypothesis_weights(THREE), rtol=1e-6)


def test_weights_do_not_depend_on_the_order():
    """invariant"""
    weights = hypothesis_weights(THREE)
    assert_allclose(hypothesis_weights(THREE[::-1]), weights[::-1], rtol=1e-12)


def test_weights_are_those_of_the_information_criterion():
    """exact: log ratio of weights, for hypotheses with the inflation of the likeliest."""
    one, other = Evidence(100.0, 2.0, 5, 1000), Evidence(104.0, 3.0, 4, 1000)
    a, b = hypothesis_weights([one, other])
    assert_allclose(np.log(b / a), -4 / 2 + 0.5 * np.log(1000 / 2), rtol=1e-9)


def test_scores_are_negative_logs_of_weights():
    """exact"""
    weights = hypothesis_weights(THREE)
    assert_allclose(hypothesis_scores(THREE), -np.log(weights / weights.max()), atol=1e-9)


def test_scores_are_ordered_where_weights_are_all_zero():
    """exact"""
    far = [Evidence(100.0 + cost, 1.0, 5, 4000) for cost in (0.0, 5000.0, 3000.0)]
    assert_allclose(hypothesis_weights(far), [1, 0, 0], atol=0)
    assert_allclose(hypothesis_scores(far), [0, 5000, 3000], rtol=1e-12)


def test_more_parameters_have_less_weight():
    simple, rich = Evidence(100.0, 1.0, 5, 4000), Evidence(100.0, 1.0, 6, 4000)
    a, b = hypothesis_weights([simple, rich])
    assert_allclose(a / b, np.sqrt(4000), rtol=1e-9)


def test_correlated_residuals_make_weights_more_even():
    sure, unsure = (
        hypothesis_weights([Evidence(100.0, v, 5, 4000), Evidence(104.0, v, 5, 4000)])
        for v in (1, 4)
    )
    assert sure[0] > unsure[0] > 0.5


def test_probabilities_are_those_of_the_calibrated_odds():
    """exact"""
    pair = [Evidence(100.0, 2.0, 5, 1000, 50.0), Evidence(160.0, 2.0, 5, 1000, 80.0)]
    pair[1] = replace(pair[1], kind=OddsTerms(growing=1.0))
    c = fitted_calibration().odds
    a, b = hypothesis_probabilities(pair)
    against = c["seen"] * np.log1p(30 / 30) + c["unseen"] * np.log1p(30 / 30) + c["growing"]
    assert_allclose((a + b, np.log(a / b)), (1, against), rtol=1e-9)


def test_smaller_misfit_of_the_likeliest_makes_probabilities_less_even():
    """invariant: where it explains the light, any difference of evidence counts more."""
    sure, unsure = (
        hypothesis_probabilities(
            [Evidence(100.0, v, 5, 4000), Evidence(100.0 + 20 * v, v, 5, 4000)]
        )
        for v in (1.1, 3.0)
    )
    assert sure[0] > unsure[0] > 0.5


def test_evidence_counts_in_full_where_no_misfit_is_seen():
    """exact: what remains of the light is noise, so that kinds and unseen pixels do not count."""
    kinds = OddsTerms(outline=1.0), OddsTerms(shapeless=1.0)
    pair = [
        Evidence(cost, 1.01, 5, 4000, unseen, kind)
        for cost, unseen, kind in zip((100.0, 103.0), (70.0, 50.0), kinds, strict=True)
    ]
    assert leaves_only_noise(pair)
    assert_allclose(hypothesis_probabilities(pair), hypothesis_weights(pair), rtol=1e-12)
    rough = [replace(one, inflation=1.5) for one in pair]
    assert not leaves_only_noise(rough)
    assert abs(hypothesis_probabilities(rough)[0] - hypothesis_weights(rough)[0]) > 0.1


@pytest.mark.parametrize(
    ("misfit", "difference", "is_decisive"),
    [(0.0, 4.9, False), (0.0, 5.1, True), (2.0, 59.0, False), (2.0, 61.0, True)],
)
def test_one_hypothesis_is_decisively_likelier_beyond_the_scale_of_its_misfit(
    misfit, difference, is_decisive
):
    """exact: 5 nats, or 30 for each unit of its variance inflation above 1."""
    inflation = 1 + misfit
    one = Evidence(100.0, inflation, 5, 4000)
    other = replace(one, cost=one.cost + difference * inflation)
    assert is_decisively_likelier(one, other) is is_decisive
    assert not is_decisively_likelier(other, one)


def test_unseen_pixels_do_not_count_if_a_loss_is_unknown():
    """exact"""
    one, other = Evidence(100.0, 2.0, 5, 1000, 50.0), Evidence(100.0, 2.0, 5, 1000, None)
    assert [terms.unseen for terms in odds_terms([one, other])] == [0, 0]


def test_the_true_alpha_predicts_unseen_pixels_best():
    """honest: against a disc that is smaller, larger, or elsewhere."""
    observation, alpha = alpha_of(BEFORE_TILES[LINE])
    nothing = np.zeros_like(alpha)
    true = unseen_loss(observation, alpha, nothing)
    for offset, radius in (((0, 0), 9.0), ((0, 0), 13.0), ((3.0, 2.0), 11.0)):
        wrong = disc_at(observation, LINE, offset, radius).swept.alpha
        assert unseen_loss(observation, wrong, nothing) > true


def test_varied_colors_predict_unseen_pixels_of_one_paint_no_better():
    """invariant"""
    observation, alpha = alpha_of(FLAT_BEFORE_TILES[LINE])
    nothing, varied = np.zeros_like(alpha), replace(observation.color, varied=3)
    costs = [
        (evidence_of(one, alpha, nothing).cost, unseen_loss(one, alpha, nothing))
        for one in (observation.of_one_paint, replace(observation, color=varied))
    ]
    # Colors that vary explain more of the noise, and predict no more of it.
    assert costs[1][1] > costs[0][1] - 1


@pytest.mark.diagonal
@pytest.mark.parametrize("scenes", [BALLS, BEFORE_TILES, FLAT, FLAT_BEFORE_TILES])
@pytest.mark.parametrize("family", [LINE, ARC], ids=lambda family: family.name)
def test_the_true_alpha_has_the_most_evidence(scenes, family):
    """honest: against a disc that is smaller, larger, or elsewhere."""
    observation, alpha = alpha_of(scenes[family])
    nothing = np.zeros_like(alpha)
    evidence = [evidence_of(observation, alpha, nothing, 5)]
    wrong = [
        disc_at(observation, family, offset, radius)
        for offset, radius in (((0, 0), 9.0), ((0, 0), 13.0), ((3.0, 2.0), 11.0), ((0, -3.0), 11.0))
    ]
    evidence += [evidence_of(observation, state.swept.alpha, nothing, 5) for state in wrong]
    assert hypothesis_weights(evidence)[0] > 0.99
    assert evidence[0].inflation == min(one.inflation for one in evidence)


def test_the_evidence_is_invariant_to_the_brightness_scale():
    """invariant"""
    observation, alpha = alpha_of(FLAT_BEFORE_TILES[LINE])
    brighter = replace(
        observation,
        C=2 * observation.C,
        B=2 * observation.B,
        C_variance=4 * observation.C_variance,
        B_variance=4 * observation.B_variance,
    )
    std = 0.05 * (alpha > 0)
    one, other = (evidence_of(x, alpha, std, 3) for x in (observation, brighter))
    assert_allclose(other.cost, one.cost, rtol=1e-6)
    assert_allclose(other.inflation, one.inflation, rtol=1e-6)
    assert (one.parameters, one.pixels) == (3, observation.weight.sum())


def test_correct_error_of_alpha_has_more_evidence_than_a_wrong_one():
    """honest: for an alpha off by 0.03 in each pixel, smaller and larger errors have less."""
    observation, alpha = alpha_of(FLAT_BEFORE_TILES[LINE])
    rng, inside = np.random.default_rng(0), alpha > 0
    off = np.where(inside, np.clip(alpha + rng.normal(0, 0.03, alpha.shape), 0, 1), 0)
    costs = {
        claimed: evidence_of(observation, off, claimed * inside).cost
        for claimed in (0.001, 0.03, 0.3)
    }
    assert costs[0.03] < min(costs[0.001], costs[0.3])


def test_an_alpha_without_a_shape_is_less_likely_than_the_true_shape():
    """honest: noisy alpha of single pixels predicts the light equally well."""
    observation, alpha = alpha_of(FLAT_BEFORE_TILES[LINE])
    color = disc_at(observation).mean_color
    change = color - observation.B
    variance = observation.C_variance + observation.B_variance
    information = np.sum(change**2 / variance, axis=-1)
    free = np.sum((observation.C - observation.B) * change / variance, axis=-1) / information
    inside = alpha > 0
    free, std = np.where(inside, free, 0), np.where(inside, information**-0.5, 0)
    evidence = [
        evidence_of(observation, alpha, np.zeros_like(alpha), 5),
        evidence_of(observation, free, std),
    ]
    assert hypothesis_weights(evidence)[0] > 0.99


def test_maps_of_the_picture_are_averaged_over_large_pixels():
    """oracle: means over blocks, cropped to the observation."""
    observation, alpha = alpha_of(FLAT[LINE])
    whole = rendered(FLAT[LINE]).layer.alpha
    assert_allclose(in_observation(whole, observation), alpha)
    coarse = observation.coarser(3)
    h, w = coarse.weight.shape
    blocks = alpha[: 3 * h, : 3 * w].reshape(h, 3, w, 3).mean(axis=(1, 3))
    assert_allclose(in_observation(whole, coarse), blocks)
