"""Alternatives: hypotheses with their colors, and the ratio of their alpha to the answer's."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from blurmatte.color.model import ColorModel
from blurmatte.matting import PixelMaps
from blurmatte.matting.averaging import MIN_WEIGHT, AlphaEstimate
from blurmatte.matting.fitted_hypothesis import Shapeless
from blurmatte.matting.summary import (
    MAX_ALTERNATIVES,
    Alternative,
    StreakSums,
    known_alpha,
    mean_light,
    ordered,
    with_mean_light,
)
from blurmatte.radiometry import LinearImage, NoiseModel
from blurmatte.sweep.assess.model_selection import Evidence

NOISE = NoiseModel(read_std=1e-3)
PLATE, COLOR = np.array([0.3, 0.32, 0.35]), np.array([0.6, 0.3, 0.1])
SECOND = np.array([0.1, 0.2, 0.5])
BOX = 0, 0, 12, 9
ONE = Alternative("disc on an arc, one paint", (0.6, 0.3, 0.1), "#cb9559", 0.9, 1.0, 0.0, 8.0)


def with_colors(model):
    """A hypothesis without a shape."""
    return Shapeless(Evidence(0.0, 1.0, 0, 1.0), model, PixelMaps.zeros(9, 12), BOX, 1.0, 0.0)


def estimate(alpha):
    return AlphaEstimate(alpha, np.full(alpha.shape, 0.01), 1.0)


def pictures(alpha):
    light = alpha[..., None] * COLOR + (1 - alpha[..., None]) * PLATE
    plate = np.broadcast_to(PLATE, light.shape).copy()
    return LinearImage(light, NOISE), LinearImage(plate, NOISE)


def compared(by, known=True):
    """An alternative whose alpha is `by` times that of the answer, and which gives the same light."""
    alpha = np.random.default_rng(0).uniform(0.1, 0.5, (9, 12))
    color = PLATE + (COLOR - PLATE) / by
    model = ColorModel.from_samples(color[None], std=1e-9)
    own = estimate(np.where(known, by * alpha, np.nan))
    return color, with_colors(model).alternative(0.2, own, estimate(alpha), pictures(alpha), BOX)


@pytest.mark.parametrize("by", [0.8, 1.0, 1.6])
def test_factor_and_color_before_one_hue(by):
    """exact: more alpha of a color nearer to the plate's predicts the same light."""
    color, found = compared(by)
    assert_allclose(found.alpha_factor, by, rtol=1e-9)
    assert_allclose(found.rgb, color, rtol=1e-6)
    assert found.radius is None
    assert found.name == "no shape, one paint"
    assert found.disagrees == (by != 1)


def test_one_paint_has_the_color_of_its_model():
    """exact: the brightest channel is 1"""
    color, found = compared(1.0)
    codes = 1.055 * (color / color.max()) ** (1 / 2.4) - 0.055
    assert found.hex == "#{:02x}{:02x}{:02x}".format(*np.rint(255 * codes).astype(int))


def test_any_colors_have_their_mean_encoded():
    """exact"""
    alpha = np.random.default_rng(0).uniform(0.1, 0.5, (9, 12))
    own = estimate(alpha)
    found = with_colors(ColorModel.any()).alternative(0.2, own, own, pictures(alpha), BOX)
    codes = 1.055 * COLOR ** (1 / 2.4) - 0.055
    assert found.hex == "#{:02x}{:02x}{:02x}".format(*np.rint(255 * codes).astype(int))


def test_unknown_pixels_are_excluded():
    """exact"""
    color, found = compared(1.25, known=np.indices((9, 12))[1] < 5)
    assert_allclose(found.alpha_factor, 1.25, rtol=1e-9)
    assert_allclose(found.rgb, color, rtol=1e-6)


def with_weight(name, weight, factor=1.0):
    return replace(ONE, name=name, weight=weight, alpha_factor=factor)


def test_alternatives_are_sorted_by_weight():
    """exact"""
    few = [with_weight("c", 0.08, 1.4), with_weight("a", 0.7), with_weight("d", 0.02, 0.5),
           with_weight("b", 0.2)]  # fmt: skip
    weights = np.array([one.weight for one in few])
    for order in ([0, 1, 2, 3], [3, 2, 1, 0]):
        found = ordered([few[i] for i in order], weights[order], order.index(1))
        assert [one.name for one in found] == ["a", "b", "c", "d"]


def test_the_alternative_of_the_result_is_the_first():
    """exact: though another has a larger weight"""
    few = [with_weight("a", 0.3), with_weight("b", 0.25), with_weight("c", 0.45)]
    found = ordered(few, np.array([0.3, 0.25, 0.45]), 0)
    assert [one.name for one in found] == ["a", "c", "b"]


def test_alternatives_of_no_weight_are_listed_if_they_disagree():
    """exact: by a factor, or in single pixels."""
    little = 0.5 * MIN_WEIGHT
    agreeing = with_weight("agrees", little)
    scaled = with_weight("scaled", little, 1.3)
    elsewhere = replace(with_weight("elsewhere", little), alpha_difference=0.1)
    found = ordered([ONE, agreeing, scaled, elsewhere], np.array([1, little, little, little]), 0)
    assert [one.name for one in found] == [ONE.name, "scaled", "elsewhere"]


def test_at_most_five_alternatives_are_listed():
    weights = np.linspace(0.2, 0.1, 9)
    found = ordered([with_weight(str(i), 0.1) for i in range(9)], weights, 0)
    assert [one.name for one in found] == [str(i) for i in range(MAX_ALTERNATIVES)]


@pytest.mark.parametrize("name", ["weight", "alpha_factor", "alpha_difference"])
@pytest.mark.parametrize("value", [-0.1, np.nan, np.inf])
def test_rejects_wrong_arguments(name, value):
    """door"""
    with pytest.raises(ValueError, match=f"{name} must be finite and not negative"):
        replace(ONE, **{name: value})


def seen_in(alpha, factor, rank):
    """Pixel maps of a streak and its plate, with all alpha multiplied by a factor."""
    rng = np.random.default_rng(1)
    plate = rng.uniform(0.2, 0.6, (*alpha.shape, 3))
    paints = COLOR if rank == 1 else rng.uniform(size=alpha.shape)[..., None] * COLOR + SECOND
    image = alpha[..., None] * paints + (1 - alpha[..., None]) * plate
    maps = PixelMaps.zeros(*alpha.shape, np.float64)
    maps.alpha[...], maps.alpha_std[...] = factor * alpha, 0.01
    maps.premultiplied[...] = image - (1 - factor * alpha[..., None]) * plate
    return maps, LinearImage(plate, NOISE), paints


@pytest.mark.parametrize("rank", [1, 2])
def test_color_errs_with_the_sum_of_alpha(rank):
    """oracle: one standard deviation of all alpha turns the mean color by one of its own."""
    alpha, step = np.random.default_rng(0).uniform(0.1, 0.5, (9, 12)), 1e-5
    maps, plate, paints = seen_in(alpha, 1.0, rank)
    one = np.array([COLOR]) if rank == 1 else np.array([COLOR, SECOND])
    model = ColorModel.from_samples(np.repeat(one, 40, axis=0), rank=rank, std=1e-9)
    sums = StreakSums(108, 108, 0, float(alpha.sum()), step * float(alpha.sum()), 0.0)
    found = with_mean_light(model, maps, plate, sums)
    brighter = seen_in(alpha, 1 + step, rank)[0]
    moved = mean_light(brighter, *known_alpha(brighter))
    if rank == 1:
        turned = moved / np.linalg.norm(moved) - model.pole
        assert_allclose(found.covariance, np.outer(turned, turned), atol=1e-3 * turned @ turned)
    else:
        sine = model.pole @ moved / np.linalg.norm(moved)
        direction = found.mean / np.linalg.norm(found.mean)
        assert_allclose(direction @ found.covariance @ direction, sine**2, rtol=1e-3)
    assert_allclose(found.mean, (alpha[..., None] * paints).sum((0, 1)) / alpha.sum(), rtol=1e-9)


def test_given_colors_keep_no_error():
    """invariant"""
    maps, plate, _ = seen_in(np.full((9, 12), 0.3), 1.0, 1)
    sums = StreakSums(108, 108, 0, 32.4, 3.0, 0.0)
    for model in (ColorModel.from_hex("#cb9559"), ColorModel.any()):
        assert not with_mean_light(model, maps, plate, sums).covariance.any()
