"""The calibration of the package, and its factors for given terms."""

from dataclasses import asdict, fields, replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from blurmatte.sweep.assess.calibration import (
    COMPRESSED,
    REASONS,
    UNCOMPRESSED,
    ErrorCalibration,
    ErrorTerms,
    fitted_calibration,
)

TERMS = [field.name for field in fields(ErrorTerms)]
CLASSES = {COMPRESSED: 1.5, UNCOMPRESSED: 2.0}
MADE_UP = ErrorCalibration(-1.0, {"radius": 0.5, "mean": 1.0, "least": 0.8, "noise": 0.1}, CLASSES)


def test_the_data_file_has_a_coefficient_for_every_term():
    """door"""
    shipped = fitted_calibration()
    assert set(shipped.coefficients) == set(TERMS)
    assert all(c >= 0 for c in shipped.coefficients.values())
    assert any(c > 0 for c in shipped.coefficients.values())
    assert set(shipped.class_factors) == {COMPRESSED, UNCOMPRESSED}
    assert all(factor > 0 for factor in shipped.class_factors.values())
    assert np.isfinite(shipped.intercept)
    assert shipped.provenance


def test_the_data_file_is_read_once():
    assert fitted_calibration() is fitted_calibration()


def test_factor_is_the_exponential_of_a_sum():
    """exact"""
    terms = ErrorTerms(radius=0.4, mean=0.3)
    assert_allclose(MADE_UP.factor(terms, COMPRESSED), 1.5 * np.exp(-1 + 0.2 + 0.3))
    assert_allclose(MADE_UP.factor(terms, UNCOMPRESSED), 2.0 * np.exp(-0.5))
    assert_allclose(MADE_UP.factor(ErrorTerms(), COMPRESSED), 1.5 / np.e)


@pytest.mark.parametrize("file_class", [COMPRESSED, UNCOMPRESSED])
@pytest.mark.parametrize("term", TERMS)
def test_factor_never_decreases_with_a_term(term, file_class):
    """invariant: monotone in each, for any values of the others."""
    shipped = fitted_calibration()
    for others in (0.0, 0.7):
        base = ErrorTerms(**dict.fromkeys(TERMS, others))
        steps = [replace(base, **{term: t}) for t in (0.0, 0.7, 1.4, 5.0)]
        factors = [shipped.factor(terms, file_class) for terms in steps]
        assert np.all(np.diff(factors) >= 0)
        assert (factors[-1] > factors[0]) == (shipped.coefficients[term] > 0)


def test_reasons_name_the_largest_terms():
    """exact: the largest first, each once, no small ones."""
    assert MADE_UP.reasons(ErrorTerms()) == []
    assert MADE_UP.reasons(ErrorTerms(radius=2.0, mean=0.5)) == ["size", "disagreement"]
    assert MADE_UP.reasons(ErrorTerms(radius=2.0, mean=1.5)) == ["disagreement", "size"]
    assert MADE_UP.reasons(ErrorTerms(mean=1.0, least=1.0)) == ["disagreement"]
    assert MADE_UP.reasons(ErrorTerms(noise=1.0)) == []  # adds a tenth


def test_at_most_three_reasons_are_named():
    all_large = ErrorTerms(**dict.fromkeys(TERMS, 3.0))
    reasons = fitted_calibration().reasons(all_large)
    assert len(reasons) == len(set(reasons)) == 3
    assert set(reasons) <= set(REASONS.values())


def test_reasons_cover_all_terms():
    assert set(REASONS) == set(TERMS)


@pytest.mark.parametrize("value", [-0.1, np.nan])
def test_rejects_negative_and_unknown_terms(value):
    """door"""
    with pytest.raises(ValueError, match="terms must be 0 or more, got radius"):
        ErrorTerms(radius=value)


def test_terms_are_zero_by_default():
    assert set(asdict(ErrorTerms()).values()) == {0.0}
