"""A layer over the plate it was taken from gives the image back."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from blurmatte.layer import Layer
from blurmatte.radiometry import LinearImage, Meta, NoiseModel


@pytest.fixture
def layer():
    alpha = np.array([[0.0, 0.25, 1.0]])
    return Layer(alpha, alpha[..., None] * [0.8, 0.4, 0.2])


def test_over_is_the_mixture(layer):
    plate = LinearImage(np.array([[[0.1, 0.2, 0.3]] * 3]), noise=NoiseModel(gain=1e-3),
                        valid=np.array([[True, False, True]]), meta=Meta("wall.png"))  # fmt: skip
    image = layer.over(plate)
    assert_allclose(image.rgb[0, 0], [0.1, 0.2, 0.3])
    assert_allclose(image.rgb[0, 1], [0.275, 0.25, 0.275])  # a quarter ball, three quarters wall
    assert_allclose(image.rgb[0, 2], [0.8, 0.4, 0.2])
    assert image.noise is None
    assert_array_equal(image.valid, plate.valid)
    assert image.meta.source == "wall.png"


def test_over_the_plate_gives_the_image_back(rendering):
    assert_allclose(rendering.layer.over(rendering.plate).rgb, rendering.image.rgb, atol=1e-15)


def test_over_does_not_clip(layer):
    bright = LinearImage(np.full((1, 3, 3), 4.0))
    assert_allclose(layer.over(bright).rgb[0, 0], 4)


def test_straight_is_the_color(layer):
    straight = layer.straight()
    assert_allclose(straight[0, 1:], [[0.8, 0.4, 0.2]] * 2)
    assert_array_equal(straight[0, 0], 0)  # nothing is there


def test_dtype_is_kept(layer):
    single = Layer(layer.alpha.astype(np.float32), layer.premultiplied.astype(np.float32))
    plate = LinearImage(np.full((1, 3, 3), 0.5, np.float32))
    assert single.over(plate).rgb.dtype == single.straight().dtype == np.float32


def test_face(layer):
    assert layer.size == (3, 1)
    assert repr(layer) == "Layer(3x1, alpha up to 1.00)"


@pytest.mark.parametrize(
    ("alpha", "premultiplied", "error", "words"),
    [
        (np.ones((1, 3)), np.ones((3, 1, 3)), ValueError, r"alpha must have the shape \(3, 1\)"),
        (np.ones((1, 3), np.uint8), np.ones((1, 3, 3)), TypeError, "alpha must have a dtype of"),
        (
            np.ones((1, 3)),
            np.ones((1, 3, 3), np.uint8),
            TypeError,
            "premultiplied must hold linear",
        ),
        (np.ones((1, 3)), np.ones((1, 3)), ValueError, "premultiplied must have the shape"),
    ],
)
def test_door(alpha, premultiplied, error, words):
    with pytest.raises(error, match=words):
        Layer(alpha, premultiplied)


def test_sizes_that_differ(layer):
    with pytest.raises(ValueError, match="the layer is 3x1 pixels and the background 2x2"):
        layer.over(LinearImage(np.ones((2, 2, 3))))


def test_a_background_of_a_camera_is_seen_as_srgb(layer):
    """Exact: else the object would be put before colors of another kind."""
    to_srgb = ((2.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.5, 1.5))
    meta = Meta(color_space="camera", to_srgb=to_srgb)
    image = layer.over(LinearImage(np.array([[[0.1, 0.2, 0.3]] * 3]), meta=meta))
    assert_allclose(image.rgb[0, 0], [0.2, 0.2, 0.55])
    assert_allclose(image.rgb[0, 2], [0.8, 0.4, 0.2])
    assert image.meta.color_space == "sRGB"
