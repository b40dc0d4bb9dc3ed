"""Colors and light against the truth."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from blurmatte.color.model import ColorModel
from blurmatte.layer import Layer
from blurmatte.metrics import ColorDistance, color_distance, premultiplied_rmse, recomposite_psnr
from blurmatte.radiometry import SRGB, LinearImage


def turned(angle, axis=2):
    """(3, 3) rotation by degrees about a channel's axis."""
    c, s = np.cos(np.radians(angle)), np.sin(np.radians(angle))
    a, b = (axis + 1) % 3, (axis + 2) % 3
    R = np.eye(3)
    R[[a, a, b, b], [a, b, a, b]] = c, -s, s, c
    return R


def test_color_error_equals_that_computed_by_hand():
    """Red 0.6 and green 0.8 against pure red: green is the error, cos = 0.6."""
    distance = color_distance((1, 0, 0), (0.6, 0.8, 0))
    assert distance.units == pytest.approx(255 * 0.8)
    assert distance.degrees == pytest.approx(np.degrees(np.arccos(0.6)))


def test_line_error_equals_a_search_for_the_nearest_color():
    rng = np.random.default_rng(1)
    line, color = rng.uniform(0, 1, (2, 3))
    brightness = np.linspace(0, 3, 30001)[:, None]
    nearest = np.linalg.norm(color - brightness * line, axis=1).min()
    assert color_distance(line, color).units == pytest.approx(255 * nearest, rel=1e-6)


def test_plane_error_equals_a_search_for_the_worst_direction():
    """Of all directions in the plane of two paints, the one farthest from the other plane."""
    rng = np.random.default_rng(2)
    estimated, paints = rng.uniform(0, 1, (3, 2)), rng.uniform(0, 1, (2, 3))
    normal = np.cross(*estimated.T) / np.linalg.norm(np.cross(*estimated.T))
    u = np.linalg.svd(paints)[2][:2]
    t = np.radians(np.arange(0, 180, 0.01))
    sines = np.abs((np.cos(t)[:, None] * u[0] + np.sin(t)[:, None] * u[1]) @ normal)
    distance = color_distance(estimated, paints)
    assert distance.degrees == pytest.approx(np.degrees(np.arcsin(sines.max())), abs=1e-5)
    assert distance.units == pytest.approx(255 * np.abs(paints @ normal).max())


@pytest.mark.parametrize("angle", [1e-6, 0.1, 5, 60, 90])
def test_plane_error_is_the_angle_between_normals(angle):
    """The planes share the axis of their rotation."""
    plane = np.eye(3)[:, :2]
    distance = color_distance(turned(angle, axis=0) @ plane, plane.T)
    assert distance.degrees == pytest.approx(angle, rel=1e-6)


def test_ranks_may_differ():
    red, green, blue = np.eye(3)
    plane = np.stack([red, green], axis=1)
    assert color_distance(plane, (0.3, 0.4, 0)) == ColorDistance(0, 0)  # in the plane
    assert color_distance(plane, (0.3, 0, 0.3)).degrees == pytest.approx(45)
    assert color_distance(red, [red, 0.1 * blue]).degrees == 90  # a line cannot hold both
    assert color_distance(red, [red, 0.1 * blue]).units == pytest.approx(25.5)
    assert color_distance(plane, np.eye(3)).degrees == 90


def test_color_error_does_not_depend_on_brightness():
    color = np.array([0.7, 0.35, 0.1])
    model = ColorModel.from_samples(np.stack([color, 0.5 * color]), std=0)
    for estimated in (color, 0.01 * color, -color, model.basis):
        distance = color_distance(estimated, color)
        assert distance.units == pytest.approx(0, abs=1e-12)
        assert distance.degrees == pytest.approx(0, abs=1e-12)


def test_brightness_of_the_truth_scales_units_only():
    bright, dark = (color_distance((1, 1, 1), c * np.array([0.8, 0.4, 0.2])) for c in (1, 0.25))
    assert dark.units == pytest.approx(bright.units / 4)
    assert dark.degrees == pytest.approx(bright.degrees)


def test_color_error_does_not_depend_on_the_basis():
    rng = np.random.default_rng(4)
    basis, paints = rng.normal(size=(3, 2)), rng.uniform(0, 1, (2, 3))
    R = turned(33, 0) @ turned(70, 1)
    mixed = R @ basis @ np.array([[2, 1], [-1, 3]])  # other vectors of the same plane
    assert_allclose(
        list(vars(color_distance(mixed, paints @ R.T)).values()),
        list(vars(color_distance(basis, paints)).values()),
    )


def test_shades_have_no_color_error():
    """Rounding of float32 must not separate shades of one color."""
    color = np.array([0.7, 0.35, 0.1], np.float32)
    shades = color * np.linspace(0.1, 1, 50, dtype=np.float32)[:, None]
    assert color_distance(color.astype(float), shades).degrees < 1e-4


@pytest.mark.parametrize(
    ("estimated", "true", "says"),
    [
        (np.eye(3), (1, 0, 0), r"estimated must have the shape \(3,\), \(3, 1\) or \(3, 2\)"),
        (np.ones((2, 3)), (1, 0, 0), "estimated must have the shape"),
        ((0, 0, 0), (1, 0, 0), "estimated must hold 1 independent colors, got 0"),
        (np.ones((3, 2)), (1, 0, 0), "estimated must hold 2 independent colors, got 1"),
        ((np.nan, 1, np.nan), (1, 0, 0), "estimated must be finite, got 2 NaN or infinite of 3"),
        ((1, 0, 0), (1, np.inf, 0), "true must be finite, got 1"),
        ((1, 0, 0), [(0, 0, 0), (1, 0, 0)], "true must hold colors that are not black, got 1 "),
        ((1, 0, 0), np.ones((3, 2)), r"true must have the shape \(3,\) or \(n, 3\), got \(3, 2\)"),
        ((1, 0, 0), np.ones((0, 3)), "true must have the shape"),
    ],
)
def test_color_distance_rejects_wrong_arguments(estimated, true, says):
    with pytest.raises(ValueError, match=says):
        color_distance(estimated, true)


@pytest.fixture
def true():
    """A streak of one row of three pixels, in a picture of 4 by 5."""
    alpha = np.zeros((5, 4))
    alpha[2, 1:] = 0.25, 0.5, 1.0
    return Layer(alpha, alpha[..., None] * [0.8, 0.4, 0.2])


def test_premultiplied_error_equals_that_computed_by_hand(true):
    estimated = true.premultiplied.copy()
    estimated[2, 1] += 0.3, 0, -0.4
    estimated[0, 0] = 7  # outside the streak
    assert premultiplied_rmse(estimated, true) == pytest.approx(np.sqrt(0.25 / 9))
    assert premultiplied_rmse(true.premultiplied, true) == 0


def test_recomposite_equals_that_computed_by_hand(true):
    """An object that is missing altogether: gray instead of a mixture."""
    gray = LinearImage(np.full((5, 4, 3), 0.5))
    nothing = Layer(0 * true.alpha, 0 * true.premultiplied)
    light = 0.5 + np.array([0.25, 0.5, 1])[:, None] * (np.array([0.8, 0.4, 0.2]) - 0.5)
    error = np.mean((SRGB.encode(light) - SRGB.encode(0.5)) ** 2)
    assert recomposite_psnr(nothing, true, gray) == pytest.approx(10 * np.log10(1 / error))


def test_recomposite_of_the_truth_is_infinite(true):
    assert recomposite_psnr(true, true, LinearImage(np.full((5, 4, 3), 0.2))) == np.inf


def test_recomposite_is_restricted_to_the_box_of_the_streak(true):
    background = LinearImage(np.random.default_rng(0).uniform(0, 1, (5, 4, 3)))
    alpha, light = true.alpha.copy(), true.premultiplied.copy()
    alpha[2, 2] = 0.4
    worse = Layer(alpha, light)
    score = recomposite_psnr(worse, true, background)
    alpha[0, 0], light[4, 3] = 1, 5  # outside the box
    assert recomposite_psnr(Layer(alpha, light), true, background) == score < 40
    larger = [
        Layer(np.pad(one.alpha, 3), np.pad(one.premultiplied, ((3, 3), (3, 3), (0, 0))))
        for one in (worse, true)
    ]
    padded = LinearImage(np.pad(background.rgb, ((3, 3), (3, 3), (0, 0))))
    assert recomposite_psnr(*larger, padded) == pytest.approx(score)


def test_recomposite_ignores_clipped_light(true):
    bright = LinearImage(np.full((5, 4, 3), 9.0))
    alpha, light = true.alpha.copy(), true.premultiplied.copy()
    alpha[2, 1] = 0.1  # 8.1 instead of 7.0: both white
    light[2, 3] = 0.8, 0.4, 0.2
    assert recomposite_psnr(Layer(alpha, light), true, bright) == np.inf


def test_errors_cancel_over_the_plate_only(rendering):
    """The reason to use another background."""
    image, plate, true = rendering.image.rgb, rendering.plate.rgb, rendering.layer
    alpha = 0.5 * true.alpha
    wrong = Layer(alpha, image - (1 - alpha[..., None]) * plate)
    other = LinearImage(1 - plate)
    assert recomposite_psnr(wrong, true, rendering.plate) > 250
    assert recomposite_psnr(wrong, true, other) < 40


def broken(layer, name):
    array = getattr(layer, name).copy()
    array[0, 0] = np.nan
    return Layer(**{**vars(layer), name: array})


def test_premultiplied_rejects_wrong_arguments(true):
    light = true.premultiplied
    with pytest.raises(ValueError, match="estimated is 4x4 pixels and true 4x5"):
        premultiplied_rmse(light[:4], true)
    with pytest.raises(ValueError, match="estimated must be finite, got 1 NaN or infinite of 60"):
        premultiplied_rmse(np.where(light == 0.8, np.nan, light), true)
    with pytest.raises(TypeError, match="estimated must hold linear light as floats"):
        premultiplied_rmse(light.astype(np.uint8), true)
    with pytest.raises(TypeError, match="true must be a Layer, got ndarray"):
        premultiplied_rmse(light, light)
    with pytest.raises(ValueError, match="true must hold a streak"):
        premultiplied_rmse(light, Layer(0 * true.alpha, light))


def test_recomposite_rejects_wrong_arguments(true):
    picture = LinearImage(np.ones((5, 4, 3)))
    small = Layer(true.alpha[:4], true.premultiplied[:4])
    with pytest.raises(ValueError, match="estimated is 4x4 pixels and true 4x5"):
        recomposite_psnr(small, true, picture)
    with pytest.raises(ValueError, match="the layer is 4x4 pixels and the background 4x5"):
        recomposite_psnr(small, small, picture)
    with pytest.raises(ValueError, match="the alpha of estimated must be finite, got 1 NaN"):
        recomposite_psnr(broken(true, "alpha"), true, picture)
    with pytest.raises(ValueError, match="the premultiplied light of true must be finite, got 3"):
        recomposite_psnr(true, broken(true, "premultiplied"), picture)
    with pytest.raises(TypeError, match="estimated must be a Layer, got ndarray"):
        recomposite_psnr(true.alpha, true, picture)
    with pytest.raises(TypeError, match="background must be a LinearImage, got ndarray"):
        recomposite_psnr(true, true, picture.rgb)
    with pytest.raises(ValueError, match="true must hold a streak"):
        recomposite_psnr(true, Layer(0 * true.alpha, true.premultiplied), picture)
