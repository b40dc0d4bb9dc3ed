"""The published formula: exact without noise, with its known bias for noisy light."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from blurmatte.color import published_color_line
from blurmatte.rendering import plain_plate

PAINT = np.array([0.7, 0.35, 0.1])
WALL = np.array([0.3, 0.35, 0.45])


def streak_colors(B, rng):
    """Image colors before plate colors B (n, 3), for any shade and alpha."""
    alpha, shade = rng.uniform(0.1, 0.9, (2, len(B), 1))
    return alpha * shade * PAINT + (1 - alpha) * B


def degrees_between(a, b):
    return np.degrees(np.arctan2(np.linalg.norm(np.cross(a, b)), a @ b))


@pytest.mark.parametrize("pixels", [2, 3, 1000])
def test_exact_without_noise(pixels):
    rng = np.random.default_rng(pixels)
    B = rng.uniform(0.1, 1, (pixels, 3))
    model = published_color_line(streak_colors(B, rng), B)
    assert model.rank == 1
    assert_allclose(model.pole, PAINT / np.linalg.norm(PAINT), rtol=0, atol=1e-9)
    assert not model.covariance.any()  # the paper has no error


def test_two_pixels_are_the_cross_product_of_the_paper():
    B = np.random.default_rng(0).uniform(0.1, 1, (2, 3))
    C = np.random.default_rng(1).uniform(0.1, 1, (2, 3))  # not even from one paint
    line = np.cross(*np.cross(C, B))
    line /= np.linalg.norm(line) * np.sign(line.sum())
    assert_allclose(published_color_line(C, B).pole, line, rtol=0, atol=1e-9)


def test_accepts_pictures_and_lists_of_pixels():
    rng = np.random.default_rng(2)
    B = rng.uniform(0.1, 1, (60, 3))
    C = streak_colors(B, rng)
    pictures = published_color_line(C.reshape(6, 10, 3), B.reshape(6, 10, 3))
    assert_allclose(pictures.pole, published_color_line(C, B).pole, rtol=0, atol=0)


@pytest.mark.parametrize(("plate_std", "off"), [(0, 1), (0.005, 12)])
def test_noise_biases_the_formula_to_the_plate_color(plate_std, off):
    """The bias that `fit_color` must not have. Noise of the image adds |B|² I − B Bᵀ, which is least
    along the plate; noise of the plate adds the same of C, between plate and paint.
    """
    rng = np.random.default_rng(3)
    wall = plain_plate((60, 50), WALL, 4).reshape(-1, 3)
    image = streak_colors(wall, rng)
    found = published_color_line(
        image + rng.normal(0, 0.005, image.shape), wall + plate_std * rng.normal(size=wall.shape)
    ).pole
    assert degrees_between(PAINT, WALL) > 30
    assert degrees_between(found, WALL) < off


@pytest.mark.parametrize(("image_shape", "plate_shape"), [((1, 3), (1, 3)), ((5, 3), (4, 3))])
def test_rejects_too_few_pixels_and_different_shapes(image_shape, plate_shape):
    said = f"two or more pixels .* got {image_shape[0]} of the image and {plate_shape[0]} of the"
    with pytest.raises(ValueError, match=said):
        published_color_line(np.ones(image_shape), np.ones(plate_shape))
