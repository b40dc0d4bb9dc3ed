"""GuessError: light in which errors of a guessed plate are independent."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from blurmatte.radiometry import GuessError, LinearImage, whitened


@pytest.fixture
def errors():
    rng = np.random.default_rng(1)
    root = rng.normal(size=(3, 3)) * (0.1, 0.01, 0.003)
    covariance = root @ root.T
    return GuessError(covariance, 10 * covariance)


def test_errors_are_independent_and_equal_in_its_light(errors):
    """exact: of errors with its covariance; the volume of colors stays."""
    W = errors.whitening
    mean = np.linalg.det(errors.covariance) ** (1 / 3)
    assert_allclose(W.T @ errors.covariance @ W, mean * np.eye(3), atol=1e-12)
    assert_allclose(np.linalg.det(W), 1)


@pytest.mark.parametrize(("of_sums", "times"), [(False, 1), (True, 10)])
def test_noise_of_plate_is_that_of_its_errors(errors, of_sums, times):
    """exact: in proportion to the variance of a pixel, for sums larger by their correlation."""
    part = np.array([[[1.0], [2.0]]])
    variance = part * np.diag(errors.covariance)
    plate = LinearImage(np.full((1, 2, 3), 0.5), variance)
    plate = replace(plate, meta=replace(plate.meta, guess_error=errors))
    image = LinearImage(np.full((1, 2, 3), 0.4), np.full((1, 2, 3), 1e-6))
    _, again = whitened(image, plate, of_sums)
    mean = times * np.linalg.det(errors.covariance) ** (1 / 3)
    assert_allclose(again.variance, mean * np.broadcast_to(part, (1, 2, 3)))


def test_a_mixture_of_light_is_the_same_mixture_there(errors):
    """invariant: C = alpha k + (1 - alpha) B."""
    rng, alpha = np.random.default_rng(2), 0.3
    B, k = rng.uniform(0, 1, (2, 4, 5, 3))
    pictures = [LinearImage(x, np.full(x.shape, 1e-4)) for x in (alpha * k + (1 - alpha) * B, B)]
    plate = replace(pictures[1], meta=replace(pictures[1].meta, guess_error=errors))
    image, plate = whitened(pictures[0], plate)
    assert_allclose(image.rgb, alpha * k @ errors.whitening + (1 - alpha) * plate.rgb)


def test_other_plates_stay_as_they_are():
    image, plate = (
        LinearImage(np.full((2, 2, 3), x), np.full((2, 2, 3), 1e-4)) for x in (0.1, 0.2)
    )
    assert whitened(image, plate) == (image, plate)
