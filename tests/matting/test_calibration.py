"""Calibrated errors: their terms, their distribution over pixels, and grades."""

from dataclasses import asdict, fields, replace

import numpy as np
import pytest
import scipy
from numpy.testing import assert_allclose

from blurmatte.matting import calibration as module
from blurmatte.matting.averaging import AlphaEstimate, averaged
from blurmatte.matting.calibration import (
    GRADE_LIMITS,
    HypothesisSummary,
    calibrated,
    claimed_error,
    error_terms,
    grade_of,
    graded,
    reasons,
)
from blurmatte.matting.maps import Grade
from blurmatte.matting.stats import SolutionStats
from blurmatte.sweep.assess.calibration import (
    COMPRESSED,
    UNCOMPRESSED,
    ErrorCalibration,
    ErrorTerms,
    fitted_calibration,
)
from blurmatte.sweep.sweep import Diagnostics

SHAPE = (40, 60)
PLAIN = Diagnostics()
MAX_CONFIRMED, MAX_PLAUSIBLE = GRADE_LIMITS[Grade.CONFIRMED], GRADE_LIMITS[Grade.PLAUSIBLE]
_RIM_FLOOR_PX = 0.03  # pixels: the least error of a rim's place


def disc(radius, std=0.01, sum_std=1.0, scale_std=0.0):
    """A disc with a rim of 6 pixels, with the same error in each pixel that it covers."""
    y, x = np.indices(SHAPE)
    alpha = np.clip((radius - np.hypot(x - 30, y - 20)) / 6, 0, 1)
    return AlphaEstimate(alpha, np.where(alpha > 0, std, 0), sum_std, scale_std)


def slope(alpha):
    return np.hypot(*np.gradient(np.clip(alpha, 0, 1)))


def factors(monkeypatch, by):
    """A calibration that multiplies every claim by the same factor."""
    fixed = ErrorCalibration(float(np.log(by)), {}, {COMPRESSED: 1.0, UNCOMPRESSED: 1.0})
    monkeypatch.setattr(module, "fitted_calibration", lambda: fixed)


def terms_of(estimates, weights, ranks=None, inflation=1.0, shapes=None, diagnostics=PLAIN):
    ranks = ranks or [1] * len(estimates)
    shapes = shapes or [True] * len(estimates)
    summaries = [
        HypothesisSummary(w, rank, shape, inflation)
        for w, rank, shape in zip(weights, ranks, shapes, strict=True)
    ]
    average = averaged(estimates, np.array(weights))
    return error_terms(average, estimates, summaries, diagnostics)


# Claims


def test_claim_is_the_root_mean_square_over_the_streak():
    """exact: pixel errors and the common factor."""
    one = disc(14, std=0.03, scale_std=0.05)
    use = one.alpha > 0.004
    expected = np.sqrt(np.mean(0.03**2 + (0.05 * one.alpha[use]) ** 2))
    assert_allclose(claimed_error(one), expected)


def test_claim_excludes_unknown_pixels():
    one = disc(14, std=0.03)
    unknown = np.where(np.indices(SHAPE)[1] > 35, np.inf, one.alpha_std)
    assert_allclose(claimed_error(replace(one, alpha_std=unknown)), 0.03)


def test_claim_is_positive_without_errors():
    assert claimed_error(disc(14, std=0.0)) > 0
    assert claimed_error(replace(disc(14), alpha=np.zeros(SHAPE))) > 0


# Terms


def test_terms_of_a_single_hypothesis_are_zero():
    """exact: for a large claim; there is nothing to differ from."""
    assert set(asdict(terms_of([disc(14, std=0.05)], [1.0])).values()) == {0.0}


def test_hypotheses_that_agree_have_no_disagreement():
    """exact"""
    one = disc(14, std=0.05)
    terms = terms_of([one, one, one], [0.6, 0.3, 0.1], [1, 2, 1], shapes=[True, True, False])
    assert_allclose(list(asdict(terms).values()), 0, atol=1e-12)


def test_disagreement_is_relative_to_the_claim():
    """exact: log(1 + d/s)."""
    one, other = disc(14, std=0.05), disc(10, std=0.05)
    use = one.alpha > 0.004
    d = np.sqrt(np.mean((one.alpha - other.alpha)[use] ** 2))
    terms = terms_of([one, other], [1.0, 0.0])
    assert_allclose([terms.one_paint, terms.mean, terms.least], np.log1p(d / 0.05))
    assert terms.shapeless == 0


def test_disagreement_with_alpha_without_a_shape_is_a_separate_term():
    """exact: the likeliest of the other kind; several shapes are represented by the likeliest."""
    one, near, far = (disc(radius, std=0.05) for radius in (14, 13, 9))
    by_shape = terms_of([one, far], [1.0, 0.0], shapes=[True, False])
    without = terms_of([one, far], [0.0, 1.0], shapes=[True, False])
    assert by_shape.shapeless == by_shape.mean > 0
    assert by_shape.without_shape == 0
    assert without.without_shape == 1
    three = terms_of([near, one, far], [0.0, 0.0, 1.0], shapes=[True, True, False])
    alone = terms_of([near, far], [0.0, 1.0], shapes=[True, False])
    assert_allclose(three.shapeless, alone.shapeless)


def test_one_paint_term_is_set_for_hypotheses_of_one_paint():
    one, other = disc(14, std=0.05), disc(10, std=0.05)
    assert terms_of([one, other], [1.0, 0.0], ranks=[1, 3]).one_paint == 0
    assert terms_of([one, other], [1.0, 0.0], ranks=[3, 1]).one_paint > 0


@pytest.mark.parametrize(
    ("change", "term", "expected"),
    [
        ({"color_spread": 0.2}, "color_spread", 0.2),
        ({"color_angle_std": 3.0}, "color_angle", np.log(4)),
        ({"radius_error": 0.02}, "radius", np.log(3)),
        ({"blur_over_radius": 0.05}, "blur", np.log(6)),
        ({"residual_excess": 1.5}, "residuals", np.log(1.5)),
        ({"residual_excess": 0.8}, "residuals", 0.0),
        ({"noise_inflation": 2.0}, "noise", np.log(2)),
    ],
)
def test_diagnostics_become_terms(change, term, expected):
    """exact"""
    terms = terms_of([disc(14, std=0.05)], [1.0], diagnostics=replace(PLAIN, **change))
    assert_allclose(getattr(terms, term), expected)
    assert_allclose(sum(asdict(terms).values()), expected)  # and no other one


def test_unknown_diagnostics_give_finite_terms():
    unknown = replace(PLAIN, radius_error=np.inf, color_angle_std=np.inf, noise_inflation=1e9)
    terms = terms_of([disc(14)], [1.0], diagnostics=unknown)
    assert np.isfinite(list(asdict(terms).values())).all()


def test_correlated_residuals_and_small_claims_are_terms():
    """exact"""
    terms = terms_of([disc(14, std=0.005)], [1.0], inflation=2.0)
    assert_allclose(terms.correlation, np.log(2))
    assert_allclose(terms.small_claim, np.log(10))


# Errors


def test_factor_one_adds_only_the_floor_at_rims(monkeypatch):
    """exact"""
    factors(monkeypatch, 1.0)
    one = disc(14, std=0.03)
    same = calibrated(one, [one], ErrorTerms(), compressed=False)
    expected, use = one.alpha_std**2 + (_RIM_FLOOR_PX * slope(one.alpha)) ** 2, one.alpha > 0.004
    assert_allclose(same.alpha_std[use] ** 2, expected[use])
    assert same.alpha is one.alpha
    assert same.sum_std == one.sum_std
    assert same.scale_std == 0


@pytest.mark.parametrize("by", [1.5, 4.0, 20.0])
@pytest.mark.parametrize("scale_std", [0.0, 0.02])
def test_error_over_the_streak_is_the_claim_times_the_factor(monkeypatch, by, scale_std):
    """exact, up to the floor at rims and pixels at the streak's border."""
    factors(monkeypatch, by)
    one = disc(14, std=0.03, scale_std=scale_std)
    after = calibrated(one, [one], ErrorTerms(), compressed=False)
    assert_allclose(claimed_error(after), by * claimed_error(one), rtol=0.02)


def test_a_factor_below_one_shrinks_the_error(monkeypatch):
    """exact: twice too large a claim is halved."""
    factors(monkeypatch, 0.5)
    one = disc(14, std=0.1)
    after = calibrated(one, [one], ErrorTerms(), compressed=False)
    assert_allclose(claimed_error(after), 0.05, rtol=0.02)


def test_added_error_is_largest_at_rims_of_all_hypotheses(monkeypatch):
    """The object may be where any hypothesis places it."""
    factors(monkeypatch, 5.0)
    one, wider = disc(14, std=0.02), disc(18, std=0.02)
    after = calibrated(one, [one, wider], ErrorTerms(), compressed=False)
    rim = (one.alpha > 0.3) & (one.alpha < 0.7)
    assert after.alpha_std[rim].min() > after.alpha_std[one.alpha == 1].max()
    only_wider = (wider.alpha > 0.1) & (slope(one.alpha) == 0) & (one.alpha == 0)
    assert only_wider.any()
    assert (after.alpha_std[only_wider] > 0.01).all()
    far = np.hypot(*(np.indices(SHAPE) - [[[20]], [[30]]])) > 28
    assert not after.alpha_std[far].any()


@pytest.mark.parametrize(
    ("position_std", "beyond"), [(0.5, 0), (1.5, 0), (3.0, 0), (0.5, 3), (1.5, 3)]
)
def test_errors_outside_a_rim_are_honest(monkeypatch, position_std, beyond):
    """honest: discs whose rim has a Student-t distribution, where the estimate has no alpha, and
    only farther out than `beyond` standard deviations of the rim."""
    factors(monkeypatch, 1.0)
    one = disc(12)
    one = replace(one, alpha_std=position_std * slope(one.alpha))
    std = calibrated(one, [one], ErrorTerms(), compressed=False).alpha_std
    quantiles = scipy.stats.t(3).ppf((np.arange(4000) + 0.5) / 4000) / np.sqrt(3)
    square = np.mean([disc(12 + d).alpha ** 2 for d in position_std * quantiles], axis=0)
    distance = np.hypot(*(np.indices(SHAPE) - [[[20]], [[30]]])) - 12
    outside = (distance > max(beyond * position_std, 0.1)) & (distance < 7 * position_std)
    assert 0.8 < np.sqrt(square[outside].mean() / np.mean(std[outside] ** 2)) < 1.25


def test_unknown_pixels_stay_unknown(monkeypatch):
    factors(monkeypatch, 3.0)
    one = disc(14)
    std = one.alpha_std.copy()
    std[20, 30] = np.inf
    after = calibrated(replace(one, alpha_std=std), [one], ErrorTerms(), compressed=True)
    assert np.isinf(after.alpha_std[20, 30])
    assert np.isfinite(after.alpha_std).sum() == after.alpha_std.size - 1


@pytest.mark.parametrize("term", list(asdict(ErrorTerms())))
@pytest.mark.parametrize("compressed", [False, True])
def test_errors_never_decrease_with_a_term(term, compressed):
    """invariant: monotone, with the calibration of the package."""
    one = disc(14, std=0.03)
    errors = [
        claimed_error(calibrated(one, [one], ErrorTerms(**{term: t}), compressed))
        for t in (0.0, 0.5, 1.0, 2.0)
    ]
    assert np.all(np.diff(errors) >= 0)


def test_an_exact_color_has_no_angle_and_a_smaller_error():
    """exact: the same claim and disagreements, with the color given."""
    one, other = disc(14, std=0.02), disc(13, std=0.02)
    average, summaries = (
        averaged([one, other], np.array([1.0, 0.0])),
        [HypothesisSummary(w, 1, True, 1.0) for w in (1.0, 0.0)],
    )
    known = replace(PLAIN, color_angle_std=2.0)
    free, exact = (
        error_terms(average, [one, other], summaries, known, given) for given in (False, True)
    )
    assert exact == replace(free, color_angle=0.0) != free
    errors = [
        claimed_error(calibrated(average, [one, other], exact, False, given))
        for given in (False, True)
    ]
    assert_allclose(errors[1] / errors[0], fitted_calibration().exact_color, rtol=0.05)
    assert fitted_calibration().exact_color < 1


@pytest.mark.parametrize("solver", ["Smooth", "Pixelwise"])
@pytest.mark.parametrize("compressed", [False, True])
def test_a_single_solver_has_its_own_factor(solver, compressed):
    """exact: errors and grade from the claim; never less than the claim, less with a given color."""
    one = disc(14, std=0.01, sum_std=0.0)
    given, fitted = (
        SolutionStats().graded_alone(one, solver, compressed, exact) for exact in (True, False)
    )
    name = COMPRESSED if compressed else UNCOMPRESSED
    factor = fitted_calibration().solver_factor(solver, name, True)
    assert given.claimed_error == pytest.approx(0.01)
    assert given.alpha_error == pytest.approx(0.01 * factor)
    assert 0.01 <= given.alpha_error <= fitted.alpha_error
    assert given.grade is grade_of(given.alpha_error, 0.0)
    assert ("color" in fitted.grade_reasons, "color" in given.grade_reasons) == (True, False)


def test_each_class_of_files_has_its_own_factor():
    """exact: the ratio of both, far above the floor."""
    one, terms = disc(14, std=0.05), ErrorTerms(mean=3.0, shapeless=3.0)
    errors = [claimed_error(calibrated(one, [one], terms, c)) for c in (True, False)]
    classes = fitted_calibration().class_factors
    expected = classes[COMPRESSED] / classes[UNCOMPRESSED]
    assert_allclose(errors[0] / errors[1], expected, rtol=0.02)


# Grades


@pytest.mark.parametrize(
    ("error", "scale", "grade"),
    [
        (0.0, 0.0, Grade.CONFIRMED),
        (*MAX_CONFIRMED, Grade.CONFIRMED),
        (1.001 * MAX_CONFIRMED[0], 0.0, Grade.PLAUSIBLE),
        (0.0, 1.001 * MAX_CONFIRMED[1], Grade.PLAUSIBLE),
        (*MAX_PLAUSIBLE, Grade.PLAUSIBLE),
        (1.001 * MAX_PLAUSIBLE[0], 0.0, Grade.ASSUMED),
        (0.0, 1.001 * MAX_PLAUSIBLE[1], Grade.ASSUMED),
        (np.inf, 0.0, Grade.ASSUMED),
        (0.0, np.nan, Grade.ASSUMED),
    ],
)
def test_a_grade_needs_both_errors_within_its_thresholds(error, scale, grade):
    assert grade_of(error, scale) is grade


def test_thresholds_are_those_that_the_grades_document():
    assert MAX_CONFIRMED == (0.02, 0.03)
    assert MAX_PLAUSIBLE == (0.05, 0.1)


def test_grade_includes_the_error_of_the_sum():
    """exact: its relative error is an error of the scale."""
    one = disc(14, std=0.01, sum_std=0.0)
    total = one.alpha.sum()
    assert graded(one) == (Grade.CONFIRMED, pytest.approx(0.01))
    assert graded(replace(one, sum_std=0.05 * total))[0] is Grade.PLAUSIBLE
    assert graded(replace(one, sum_std=0.2 * total))[0] is Grade.ASSUMED
    assert graded(replace(one, alpha_std=5 * one.alpha_std))[0] is Grade.PLAUSIBLE


def test_reasons_are_true_of_their_numbers():
    """Over random terms, claims, weights and files: no reason without its fact."""
    rng = np.random.default_rng(0)
    names = [field.name for field in fields(ErrorTerms)]
    seen = set()
    for _ in range(300):
        terms = ErrorTerms(**dict(zip(names, rng.exponential(1, len(names)), strict=True)))
        weights, claim = rng.dirichlet([0.1] * 3), rng.exponential(0.02)
        compressed = bool(rng.integers(2))
        found = reasons(terms, claim, weights, compressed)
        assert len(found) <= 3
        assert compressed or "file" not in found
        assert np.sort(weights)[-2] >= 0.01 or "disagreement" not in found
        assert ("noise" in found) == (claim > 0.02)
        assert np.expm1(terms.radius) > 1.5 or "size" not in found  # percent: 3 % of the area
        seen |= set(found)
    assert {"noise", "disagreement", "shape", "size"} <= seen
    assert reasons(ErrorTerms(noise=6.5), 0.001, np.array([1.0]), True) == ["file"]
    assert reasons(ErrorTerms(small_claim=5.0), 0.001, np.array([1.0]), True) == []
    exact = ErrorTerms(radius=float(np.log1p(0.3)))  # ± 0.3 %
    assert reasons(exact, 0.001, np.array([1.0]), False) == []
