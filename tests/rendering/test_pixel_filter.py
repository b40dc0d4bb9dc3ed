"""A pixel filter wider than the pixel, the same for coverage and light."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from blurmatte.layer import Layer
from blurmatte.rendering import (
    AT_REST,
    Ball,
    Change,
    Cube,
    Scene,
    Sheet,
    Sprite,
    colorful_plate,
    render,
)
from blurmatte.rendering.pixel_filter import filter_margin, filter_peak, filter_weights
from blurmatte.rendering.render import filtered_body
from blurmatte.trajectory import Trajectory

ORANGE = np.array([0.9, 0.5, 0.05])
POSE = Change(turned=(0.4, -0.3, 0.6), squash=(1.2, 1), squash_angle=0.5).at(0)
BODIES = {
    "ball": Ball(5, ORANGE, highlight=0.4),
    "sheet": Sheet(9, 6, ORANGE),
    "cube": Cube(7, ORANGE),
    "sprite": Sprite(Layer(np.ones((6, 9)), np.tile(ORANGE, (6, 9, 1)))),
}
X = np.arange(-9.0, 10) + 0.3
Y = np.arange(-8.0, 9) - 0.2


def window(s):
    """Blackman-Harris over -0.5…0.5."""
    a = (0.35875, 0.48829, 0.14128, 0.01168)
    inside = sum(c * np.cos(2 * np.pi * k * s) for k, c in enumerate(a))
    return np.where(np.abs(s) < 0.5, inside, 0)


@pytest.mark.parametrize("width", [0.5, 1, 1.5, 2, 3.3])
def test_weights_are_integrals_of_the_window(width):
    weights = filter_weights(width)
    cells = len(weights)
    assert cells == 4 * (2 * filter_margin(width) + 1)
    fine = (np.arange(cells * 200) + 0.5) / 800 - cells / 8
    sampled = window(fine / width).reshape(cells, 200).sum(axis=1)
    assert_allclose(weights, sampled / sampled.sum(), atol=1e-5)
    assert_allclose(weights.sum(), 1, rtol=1e-14)
    assert_allclose(weights, weights[::-1], atol=1e-15)


def test_peak_is_that_of_the_window():
    fine = (np.arange(4000) + 0.5) / 1000 - 2
    weights = window(fine / 1.7)
    assert filter_peak(1.7) == pytest.approx(weights.max() / (weights.mean() * 4), rel=1e-5)


@pytest.mark.parametrize("name", BODIES)
def test_sums_are_preserved(name):
    """Nearly: windows around all pixels do not add up to a constant, but their waves average out."""
    box, wide = BODIES[name].sharp(X, Y, POSE), filtered_body(BODIES[name], X, Y, POSE, 2.4)
    for a, b in zip(wide, box, strict=True):
        # Light is sampled in cells, and these are finer here; so is a sprite.
        assert_allclose(a.sum((0, 1)), b.sum((0, 1)), rtol=1e-2 if name == "sprite" else 2e-3)
    if name != "sprite":
        assert_allclose(wide[0].sum(), box[0].sum(), rtol=1e-4)


def test_pixels_within_the_body_are_covered():
    coverage, light = filtered_body(Ball(9, ORANGE, ambient=1), X, Y, AT_REST, 2.4)
    inside = np.hypot(X, Y[:, None]) < 9 - 1.2 * np.sqrt(2)
    assert inside.sum() > 100
    assert_allclose(coverage[inside], 1, rtol=1e-13)
    assert_allclose(light[inside], np.tile(ORANGE, (inside.sum(), 1)), rtol=1e-13)


@pytest.mark.parametrize("name", BODIES)
def test_a_body_of_one_color_keeps_it(name):
    body = Ball(5, ORANGE, ambient=1) if name == "ball" else BODIES[name]
    if name == "cube":
        body = Cube(7, ORANGE, ambient=1)
    coverage, light = filtered_body(body, X, Y, POSE, 1.8)
    assert_allclose(light, coverage[..., None] * ORANGE, atol=1e-9)


def test_coverage_agrees_with_weighted_points():
    coverage, _ = filtered_body(BODIES["ball"], X, Y, POSE, 2.0)
    n = 40
    offsets = (np.arange(2 * n) + 0.5) / n - 1
    weights = window(offsets / 2) / window(offsets / 2).sum()
    to_ball = np.linalg.inv(POSE.stretch) / 5
    expected = np.zeros_like(coverage)
    for j, y in enumerate(Y):
        for i, x in enumerate(X):
            points = np.stack(np.meshgrid(x + offsets, y + offsets), axis=-1) @ to_ball.T
            expected[j, i] = weights @ (np.sum(points**2, axis=-1) < 1) @ weights
    # The window is constant within a quarter of a pixel.
    assert_allclose(coverage, expected, atol=0.02)


@pytest.mark.parametrize("width", [0.0, 1.5, 2.0])
def test_image_is_the_layer_over_the_plate(width):
    plate = colorful_plate((60, 44), 1, tile=11)
    path, ball = Trajectory.line((15, 20), (42, 24)), Ball(6, ORANGE)
    truth = render(Scene(plate, path, ball, pixel_filter=width))
    alpha = truth.layer.alpha[..., None]
    assert_allclose(truth.image.rgb, truth.layer.premultiplied + (1 - alpha) * plate, atol=1e-15)
    assert_allclose(truth.layer.alpha.sum(), np.pi * 36, rtol=1e-3)
    assert_allclose(truth.layer.premultiplied @ truth.model.normals, 0, atol=1e-14)


def test_a_wider_filter_makes_a_softer_rim():
    plate = colorful_plate((60, 44), 1, tile=11)
    path, ball = Trajectory.line((30, 22), (30.01, 22)), Ball(9, ORANGE)
    partial = [
        np.count_nonzero((a > 1e-3) & (a < 1 - 1e-3))
        for a in (
            render(Scene(plate, path, ball, pixel_filter=w), 1).layer.alpha for w in (0, 2, 4)
        )
    ]
    assert partial[0] < partial[1] < partial[2]


def test_default_substeps_bound_the_error_of_alpha():
    scene = Scene(
        colorful_plate((60, 44), 1),
        Trajectory.line((15, 20), (42, 24)),
        Ball(3, ORANGE),
        pixel_filter=1.5,
    )
    assert_allclose(render(scene).layer.alpha, render(scene, 1000).layer.alpha, atol=1e-4)


def test_rejects_wrong_arguments():
    scene = (colorful_plate((20, 20), 1), Trajectory.line((5, 5), (9, 9)), Ball(3, ORANGE))
    for wrong in (-1, np.nan):
        with pytest.raises(ValueError, match="pixel_filter must be finite and not negative"):
            Scene(*scene, pixel_filter=wrong)
