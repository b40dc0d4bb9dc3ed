"""Statistics of residuals of correct and of wrong sweeps."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.ndimage import gaussian_filter
from tests.sweep.scenes import (
    BALL,
    BOUNDS,
    CAMERA,
    FLAT,
    FLAT_BEFORE_TILES,
    GREEN,
    JPEG,
    LINE,
    ONE_PAINT,
    disc_at,
    observed,
    residuals_of,
)

from blurmatte.rendering.flat_bodies import Sheet
from blurmatte.rendering.pose import Change
from blurmatte.sweep.fit.levenberg_marquardt import minimize
from blurmatte.sweep.fit.ranking import (
    colors_are_correlated,
    noise_inflation,
    outlier_fraction,
    residual_excess,
)

SQUARE = replace(BALL, body=Sheet(24, 24, GREEN), change=Change(turned=(0, 0, 0.4)))


def fitted(scene, seed=0, camera=CAMERA):
    """The disc of one paint that fits best near the true path."""
    return minimize(disc_at(observed(scene, seed, camera, ONE_PAINT)), BOUNDS)


def with_residuals(state, smooth, seed=0):
    """The state with other residuals: white noise, or filtered with a Gaussian of σ pixels."""
    e = np.random.default_rng(seed).normal(size=state.e.shape)
    if smooth:
        e = gaussian_filter(e, (0, smooth, smooth))
    return replace(state, e=e / e.std())


@pytest.fixture(scope="module")
def right():
    return fitted(FLAT[LINE])


@pytest.fixture(scope="module")
def wrong():
    return fitted(SQUARE)


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("scenes", [FLAT, FLAT_BEFORE_TILES], ids=["wall", "tiles"])
def test_residuals_of_a_correct_sweep_are_noise(scenes, seed):
    """honest"""
    state = fitted(scenes[LINE], seed)
    assert state.variance_inflation < 1.2
    assert 0.8 < residual_excess(state) < 1.2
    assert outlier_fraction(state) < 0.01
    assert noise_inflation(state) == 1


def test_residuals_of_a_disc_fitted_to_a_square_are_correlated(wrong):
    assert wrong.converged
    assert wrong.variance_inflation > 2
    assert residual_excess(wrong) > 1.2


def test_variance_inflation_of_white_noise_is_one(right):
    """exact up to sampling: weights limit large residuals, so that it is hardly above 1."""
    for seed in range(4):
        assert 1 <= with_residuals(right, 0, seed).variance_inflation < 1.15


def test_variance_inflation_grows_with_the_correlation_length(right):
    """oracle: a Gaussian of σ pixels correlates 4π σ² pixels; blocks of 8 limit it."""
    at = [
        np.mean([with_residuals(right, smooth, seed).variance_inflation for seed in range(6)])
        for smooth in (0, 1, 2, 4)
    ]
    assert at[0] < at[1] < at[2] < at[3]
    assert 4 < at[1] < 4 * np.pi


def test_variance_inflation_grows_with_the_noise_level(right):
    """Residuals of twice the stated noise have up to four times the variance."""
    loud = replace(right, e=1.5 * with_residuals(right, 0).e)
    assert 1.2 < loud.variance_inflation < 1.5**2


@pytest.mark.parametrize("smooth", [0.0, 1.0])
def test_residual_excess_compares_inside_with_outside(right, smooth):
    """invariant: noise of uniform correlation is no excess, at any level."""
    state = with_residuals(right, smooth)
    assert 0.8 < residual_excess(state) < 1.25
    mixed = np.where(right.swept.alpha > 0, with_residuals(right, 2.0).e, state.e)
    assert residual_excess(replace(state, e=mixed)) > 1.5


def test_noise_of_a_jpeg_is_no_excess():
    """honest: in the mean of 8; residuals of a correct sweep are as correlated as outside."""
    states = [fitted(FLAT[LINE], seed, JPEG) for seed in range(8)]
    assert 0.8 < np.mean([residual_excess(state) for state in states]) < 1.25
    assert np.mean([state.variance_inflation for state in states]) > 2


def test_outlier_fraction_is_that_of_another_object(right):
    observation, inside = right.observation, right.swept.alpha > 0
    rows = np.flatnonzero(inside.any(axis=1))
    hidden = np.zeros_like(inside)
    hidden[rows[0] : rows[len(rows) // 2]] = True
    C = np.where(hidden[..., None], (0.9, 0.1, 0.9), observation.C)
    e = residuals_of(right, observation.with_light(C), right.swept.alpha)
    state = replace(right, e=e)
    assert_allclose(outlier_fraction(state), (hidden & inside).sum() / inside.sum(), atol=0.02)


def test_outlier_fraction_of_noise_is_a_thousandth(right):
    """exact up to sampling, 0.0006."""
    fractions = [outlier_fraction(with_residuals(right, 0, seed)) for seed in range(8)]
    assert_allclose(np.mean(fractions), 0.001, atol=0.0008)


def test_a_sweep_outside_the_picture_has_outliers_only(right):
    assert outlier_fraction(right.moved(right.path - 900, right.shape)) == 1
    assert residual_excess(right.moved(right.path - 900, right.shape)) > 1.2


def repeated(state, by):
    """The state in a clip whose static parts are repeated, with noise understated by `by`."""
    observation = state.observation
    C = np.where((state.swept.alpha > 0)[..., None], observation.C, observation.B)
    quiet = replace(
        observation,
        C=C,
        C_variance=observation.C_variance / by,
        B_variance=observation.B_variance / by,
    )
    return state.on(quiet)


@pytest.mark.parametrize("by", [4.0, 9.0])
def test_noise_inflation_of_a_codec_that_repeats_is_measured_inside(right, by):
    """exact up to sampling: the factor by which noise was understated."""
    assert_allclose(noise_inflation(repeated(right, by)), by, rtol=0.15)


def test_noise_is_not_inflated_unless_it_is_repeated_outside(right, wrong):
    assert noise_inflation(right.on(right.observation.raised(0.25))) == 1
    assert noise_inflation(wrong) == 1


def test_noise_inflation_is_limited_by_the_change(right):
    """door: residuals as large as the change are no noise."""
    state = repeated(right, 4.0)
    C = state.observation.B + 0.05 * np.random.default_rng(0).normal(size=state.observation.C.shape)
    C = np.where((state.swept.alpha > 0)[..., None], C, state.observation.B)
    assert noise_inflation(state.on(state.observation.with_light(C))) == 1


@pytest.mark.diagonal
@pytest.mark.parametrize("quality", [None, 100, 90])
@pytest.mark.parametrize("chroma", ["4:2:0", "4:2:2"])
def test_chroma_subsampling_correlates_colors(chroma, quality):
    """honest"""
    camera = replace(CAMERA, jpeg_quality=quality, chroma=chroma)
    assert colors_are_correlated(disc_at(observed(BALL, camera=camera)))


def test_independent_noise_does_not_correlate_colors(right):
    """invariant: nor does slowly varying light."""
    assert not colors_are_correlated(right)
    ramp = np.linspace(0, 0.05, right.observation.C.shape[1])[:, None]
    changed = right.observation.with_light(right.observation.C * (1 + ramp))
    assert not colors_are_correlated(right.on(changed))
