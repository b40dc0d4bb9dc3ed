"""ColorPrior: axes of color space from a color model, or from the light of an object."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from blurmatte.color import ColorModel
from blurmatte.sweep.model.color_prior import ColorPrior

PAINTS = np.array([[0.7, 0.35, 0.1], [0.1, 0.3, 0.7]])
ranks = pytest.mark.parametrize("rank", [1, 2])


def sampled(rank):
    """A measured model whose covariance differs by direction."""
    rng = np.random.default_rng(rank)
    colors = rng.uniform(0.2, 1, (60, rank)) @ PAINTS[:rank] + rng.normal(0, 0.01, (60, 3))
    return ColorModel.from_samples(colors, rank)


@ranks
def test_the_first_axes_span_the_model(rank):
    model = sampled(rank)
    prior = ColorPrior.of(model)
    assert_allclose(prior.axes.T @ prior.axes, np.eye(3), atol=1e-12)
    assert_allclose(prior.axes[:, rank:].T @ model.basis, 0, atol=1e-12)
    assert (prior.rank, prior.varied) == (rank, rank)


@ranks
def test_the_angle_is_as_uncertain_as_the_model(rank):
    model = sampled(rank)
    std = np.radians(model.angle_std)
    assert std > 1e-3
    assert_allclose(ColorPrior.of(model).angle_std, np.hypot(std, 1e-3), rtol=1e-12)


@ranks
def test_exact_model_has_an_angle_std_of_a_thousandth(rank):
    prior = ColorPrior.of(ColorModel.from_hex(*["#ff8000", "#2040ff"][:rank]))
    assert_allclose(prior.angle_std, 1e-3)


def test_any_colors_leave_all_axes_free():
    prior = ColorPrior.of(ColorModel.any())
    assert (prior.rank, prior.varied, prior.angle_std) == (3, 3, 0.0)
    assert_allclose(prior.axes, np.eye(3))


def test_one_paint_varies_in_brightness_alone():
    prior = ColorPrior.of(sampled(2))
    one = prior.of_one_paint
    assert (one.rank, one.varied) == (2, 1)
    assert one.axes is prior.axes


def random_moments(seed=0):
    rng = np.random.default_rng(seed)
    root = rng.normal(size=(3, 3))
    return rng.uniform(0.1, 0.9, 3), root @ root.T


def test_axes_are_along_the_mean_and_the_largest_spread_across_it():
    """oracle: no direction perpendicular to the mean has larger moments than the second axis."""
    mean, moments = random_moments()
    axes = ColorPrior.along(mean, moments).axes
    assert_allclose(axes.T @ axes, np.eye(3), atol=1e-9)
    assert_allclose(axes[:, 0], mean / np.linalg.norm(mean))
    angles = np.linspace(0, np.pi, 1000)
    around = np.outer(axes[:, 1], np.cos(angles)) + np.outer(axes[:, 2], np.sin(angles))
    spread = np.einsum("ci,cd,di->i", around, moments, around)
    assert_allclose(spread.max(), axes[:, 1] @ moments @ axes[:, 1], rtol=1e-9)


def test_rotated_moments_give_rotated_axes():
    """invariant: up to the signs of the axes."""
    mean, moments = random_moments()
    R = np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))[0]
    plain = ColorPrior.along(mean, moments).axes
    turned = ColorPrior.along(R @ mean, R @ moments @ R.T).axes
    assert_allclose(np.abs((R @ plain).T @ turned), np.eye(3), atol=1e-9)


def test_brightness_does_not_change_the_axes():
    """invariant"""
    mean, moments = random_moments()
    plain = ColorPrior.along(mean, moments).axes
    assert_allclose(ColorPrior.along(3 * mean, 9 * moments).axes, plain, atol=1e-9)


def test_axes_of_black_are_finite():
    axes = ColorPrior.along(np.zeros(3), np.zeros((3, 3))).axes
    assert np.all(np.isfinite(axes))
