"""Layer: compositing over a background, and edits."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from blurmatte.layer import Layer
from blurmatte.radiometry import LinearImage, Meta, NoiseModel


@pytest.fixture
def layer():
    alpha = np.array([[0.0, 0.25, 1.0]])
    return Layer(alpha, alpha[..., None] * [0.8, 0.4, 0.2])


def test_over_is_the_compositing_equation(layer):
    plate = LinearImage(np.array([[[0.1, 0.2, 0.3]] * 3]), noise=NoiseModel(gain=1e-3),
                        valid=np.array([[True, False, True]]), meta=Meta("wall.png"))  # fmt: skip
    image = layer.over(plate)
    assert_allclose(image.rgb[0, 0], [0.1, 0.2, 0.3])
    assert_allclose(image.rgb[0, 1], [0.275, 0.25, 0.275])  # a quarter ball, three quarters wall
    assert_allclose(image.rgb[0, 2], [0.8, 0.4, 0.2])
    assert image.noise is None
    assert_array_equal(image.valid, plate.valid)
    assert image.meta.source == "wall.png"


def test_over_the_plate_is_the_image(rendering):
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


def test_repr_and_size(layer):
    assert layer.size == (3, 1)
    assert repr(layer) == "Layer(3x1, alpha up to 1.00)"


@pytest.mark.parametrize(
    ("alpha", "premultiplied", "error", "words"),
    [
        (np.ones((1, 3)), np.ones((3, 1, 3)), ValueError, r"alpha must have the shape \(3, 1\)"),
        (np.ones((1, 3), np.uint8), np.ones((1, 3, 3)), TypeError, "alpha must hold floats"),
        (
            np.ones((1, 3)),
            np.ones((1, 3, 3), np.uint8),
            TypeError,
            "premultiplied must hold linear",
        ),
        (np.ones((1, 3)), np.ones((1, 3)), ValueError, "premultiplied must have the shape"),
    ],
)
def test_rejects_wrong_arguments(alpha, premultiplied, error, words):
    with pytest.raises(error, match=words):
        Layer(alpha, premultiplied)


def test_rejects_different_sizes(layer):
    with pytest.raises(ValueError, match="the layer is 3x1 pixels and the background 2x2"):
        layer.over(LinearImage(np.ones((2, 2, 3))))


def test_camera_background_is_converted_to_srgb(layer):
    """Exact: object and background have the same primaries."""
    to_srgb = ((2.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.5, 1.5))
    meta = Meta(color_space="camera", to_srgb=to_srgb)
    image = layer.over(LinearImage(np.array([[[0.1, 0.2, 0.3]] * 3]), meta=meta))
    assert_allclose(image.rgb[0, 0], [0.2, 0.2, 0.55])
    assert_allclose(image.rgb[0, 2], [0.8, 0.4, 0.2])
    assert image.meta.color_space == "sRGB"


def test_fading_multiplies_alpha_and_keeps_the_color(rendering):
    # exact
    layer = rendering.layer
    for factor in (0.0, 0.4, 1.0, 2.5):
        faded = layer.fade(factor)
        assert_allclose(faded.alpha, factor * layer.alpha, atol=1e-15)
        inside = faded.alpha > 0
        assert_allclose(faded.straight()[inside], layer.straight()[inside], atol=1e-12)


def test_alpha_is_at_most_one_and_shading_is_kept(rendering):
    # exact: [GC07 Fig. 4], "note preserved shading"
    layer = rendering.layer
    faded = layer.fade(10)
    assert faded.alpha.max() == 1
    inside = layer.alpha > 1e-9
    assert_allclose(faded.straight()[inside], layer.straight()[inside], atol=1e-9)


def test_light_without_alpha_fades_too():
    glow = Layer(np.zeros((1, 1)), np.full((1, 1, 3), 0.2))
    assert_allclose(glow.fade(0.5).premultiplied, 0.1)


def test_relighting_changes_light_alone(layer):
    lit = layer.relight([2, 1, 0.5])
    assert_array_equal(lit.alpha, layer.alpha)
    assert_allclose(lit.premultiplied, layer.premultiplied * [2, 1, 0.5])
    assert_allclose(layer.relight(3).premultiplied, 3 * layer.premultiplied)


def test_amplifying_brings_a_faint_dark_object_to_full_brightness(paint):
    dark = paint.layer.relight(0.05).fade(0.1)
    plain = dark.amplify(10)
    assert_allclose(plain.alpha, 10 * dark.alpha, rtol=1e-12)
    inside = plain.alpha > 0.01
    brighter = plain.straight().max(axis=-1) > 1 + 1e-12
    assert 0 < plain.alpha[brighter].sum() <= 0.01 * plain.alpha.sum()
    ratio = plain.straight()[inside] / dark.straight()[inside]
    assert_allclose(ratio, ratio.ravel()[0], rtol=1e-9)  # one factor: hue and shading stay


def test_recoloring_keeps_the_shading(paint):
    # exact: an object of one paint in another paint is as if it had been painted so
    layer = paint.layer
    blue = np.array([0.1, 0.2, 0.8])
    painted = layer.recolor(blue)
    share = layer.premultiplied @ layer.color / (layer.color @ layer.color)
    assert_array_equal(painted.alpha, layer.alpha)
    assert_allclose(painted.premultiplied, share[..., None] * blue, atol=1e-12)
    assert_allclose(painted.color, blue, atol=1e-12)


def test_each_paint_gets_its_new_color(paints):
    # exact: the other paint stays where it stays
    red, blue = np.array([0.7, 0.35, 0.1]), np.array([0.1, 0.3, 0.7])
    green = np.array([0.1, 0.9, 0.2])
    painted = paints.layer.recolor(green, blue, paints=[red, blue])
    amounts = np.linalg.lstsq(
        np.stack([red, blue]).T, paints.layer.premultiplied.reshape(-1, 3).T, rcond=None
    )[0].T
    assert_allclose(
        painted.premultiplied.reshape(-1, 3), amounts @ np.stack([green, blue]), atol=1e-12
    )
    same = paints.layer.recolor(red, blue, paints=[red, blue])
    assert_allclose(same.premultiplied, paints.layer.premultiplied, atol=1e-12)


def test_hex_is_srgb(layer):
    assert_allclose(layer.recolor("#ff8000").color, [1, 0.21586, 0], atol=1e-5)


def test_box_encloses_the_object():
    alpha = np.zeros((9, 12))
    alpha[2:5, 3:11] = 0.5
    assert Layer(alpha, np.zeros((9, 12, 3))).box == (3, 2, 11, 5)


def test_placing_moves_whole_pixels(rendering):
    # exact: scale 1 copies
    layer = rendering.layer
    x0, y0, x1, y1 = layer.box
    moved = layer.place((300, 260), ((x0 + x1 - 1) / 2 + 40, (y0 + y1 - 1) / 2 + 70))
    assert moved.size == (300, 260)
    assert moved.box == (x0 + 40, y0 + 70, x1 + 40, y1 + 70)
    assert_array_equal(moved.crop(moved.box).premultiplied, layer.crop(layer.box).premultiplied)


def test_placing_scales_area_and_keeps_the_color(paint):
    for scale in (0.5, 2.0):
        placed = paint.layer.place((500, 400), (250, 200), scale)
        assert_allclose(placed.alpha.sum(), scale**2 * paint.layer.alpha.sum(), rtol=0.01)
        assert_allclose(placed.color, paint.layer.color, rtol=0.01)
        x0, y0, x1, y1 = placed.box
        assert_allclose([(x0 + x1 - 1) / 2, (y0 + y1 - 1) / 2], [250, 200], atol=1.5)


def test_parts_outside_are_cropped(rendering):
    # oracle: placed where there is room, and cropped then
    layer = rendering.layer
    cut, whole = layer.place((60, 40), (3, 39)), layer.place((360, 340), (153, 189))
    assert cut.size == (60, 40)
    assert cut.alpha.any()
    assert_array_equal(cut.alpha, whole.crop((150, 150, 210, 190)).alpha)
    assert_array_equal(cut.premultiplied, whole.crop((150, 150, 210, 190)).premultiplied)


EMPTY = Layer(np.zeros((4, 4)), np.zeros((4, 4, 3)))


def in_32_bits(layer):
    return Layer(layer.alpha.astype(np.float32), layer.premultiplied.astype(np.float32))


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda layer: layer.fade(-1), "factor must be 0 or more, got -1"),
        (lambda layer: layer.fade(np.nan), "factor must be 0 or more"),
        (lambda layer: layer.amplify(2, -1), "brightness must be 0 or more"),
        (lambda layer: layer.relight([1, 2]), "one number or three"),
        (lambda layer: layer.relight(-2), "gain must be 0 or more"),
        (lambda layer: layer.recolor("blue"), "must look like #d8ff3c"),
        (lambda layer: layer.recolor(), "one to three colors"),
        (lambda layer: layer.recolor("#ff0000", "#00ff00"), "as many colors as paints, 1, got 2"),
        (lambda layer: layer.recolor("#ff0000", paints=["#000000"]), "a paint is black"),
        (
            lambda layer: layer.recolor("#ff0000", "#00ff00", paints=["#ff8000", "#804000"]),
            "mixtures of one another",
        ),
        (lambda layer: layer.place((0, 5)), "both 1 or more"),
        (lambda layer: in_32_bits(layer).relight(1e300), "gain must be 0 or more, got inf"),
        (lambda layer: layer.place((5, 5), scale=0), "scale must be above 0"),
        (lambda layer: layer.place((5, 5), scale=1e9), "makes the object"),
        (lambda layer: layer.place((5, 5), (50, 50)), "outside the picture"),
        (lambda layer: EMPTY.place((5, 5)), "the layer is empty"),
        (lambda layer: EMPTY.recolor("#ff0000"), "the layer is empty"),
        (lambda layer: EMPTY.amplify(3), "the layer is empty"),
    ],
)
def test_edits_reject_wrong_arguments(layer, change, words):
    with pytest.raises(ValueError, match=words):
        change(layer)


def light_alone():
    """A layer of alpha 0 with light in one pixel."""
    light = np.zeros((4, 5, 3))
    light[1, 2] = 0.4, 0.2, 0.1
    return Layer(np.zeros((4, 5)), light)


def test_a_layer_of_light_alone_is_added_to_what_is_behind():
    layer, behind = light_alone(), LinearImage(np.full((4, 5, 3), 0.3))
    assert layer.only_adds_light
    assert_allclose(layer.over(behind).rgb, behind.rgb + layer.premultiplied)
    assert not Layer(np.ones((4, 5)), layer.premultiplied).only_adds_light
    assert not Layer(np.zeros((4, 5)), np.zeros((4, 5, 3))).only_adds_light


def test_edits_of_light_alone_change_its_light():
    layer = light_alone()
    assert_allclose(layer.color, (1, 0.5, 0.25))
    assert_allclose(layer.recolor((0, 1, 0)).premultiplied[1, 2], (0, 0.4, 0))
    assert_allclose(layer.fade(0.5).premultiplied, layer.premultiplied / 2)
    assert_allclose(layer.amplify(3, 0.8).premultiplied[1, 2], (0.8, 0.4, 0.2))
