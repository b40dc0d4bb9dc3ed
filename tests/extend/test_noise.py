"""A noise model that is written outside the package: it solves, and the answer is honest."""

from dataclasses import dataclass

import numpy as np
import pytest

import blurmatte as bm
from blurmatte.radiometry import Noise


@dataclass(frozen=True)
class CubicNoise(Noise):
    """Variance a + b light³: no polynomial of degree two."""

    constant: float
    cubic: float

    def variance(self, light):
        return (self.constant + self.cubic * np.maximum(light, 0) ** 3).astype(light.dtype)

    def times(self, factor):
        return CubicNoise(factor * self.constant, factor * self.cubic)


NOISE = CubicNoise(1e-6, 4e-5)


@pytest.fixture(scope="module")
def pictures(paint):
    """A ball of one paint with this noise, and its plate."""
    rng = np.random.default_rng(3)

    def noisy(picture):
        std = np.sqrt(NOISE.variance(picture.rgb))
        return bm.LinearImage(picture.rgb + std * rng.standard_normal(std.shape), NOISE)

    return noisy(paint.image), noisy(paint.plate)


def test_its_variance_is_that_of_the_picture(pictures):
    image, _ = pictures
    assert np.array_equal(image.variance, NOISE.variance(image.rgb))
    assert image.crop((3, 4, 20, 30)).noise is NOISE


def test_errors_of_single_pixels_are_honest(pictures, paint):
    found = bm.solve(*pictures, paint.model, bm.Pixelwise())
    at = found.known & found.streak & (paint.layer.alpha > 0.02)
    z = (found.alpha - paint.layer.alpha)[at] / found.alpha_std[at]
    assert at.sum() > 500
    assert 0.9 < np.sqrt(np.mean(z**2)) < 1.1


def test_sweeps_are_fitted_with_it(pictures, paint):
    found = bm.solve(*pictures, paint.model, bm.Swept())
    assert found.sweep.radius == pytest.approx(14, abs=3 * found.stats.sweep.radius_std)


def test_the_numbers_of_an_answer_state_its_median(pictures, paint, tmp_path):
    found = bm.solve(*pictures, paint.model, bm.Pixelwise())
    bm.write(tmp_path / "layer.exr", found)
    stated = bm.read_solution(tmp_path / "layer.exr").stats.image_noise
    expected = np.sqrt(np.median(pictures[0].variance))
    assert stated.median_std == pytest.approx(float(expected), rel=1e-6)
