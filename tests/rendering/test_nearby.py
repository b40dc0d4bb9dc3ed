"""Nearby light: agreement with sums over time and with traced rays."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from blurmatte.rendering import Ball, Scene, colorful_plate, render
from blurmatte.rendering.plates import wire_fence
from blurmatte.rendering.pose import Change
from blurmatte.rendering.scene import Nearby, Shadow
from blurmatte.trajectory import Trajectory

ORANGE = np.array([0.9, 0.5, 0.05])
SIZE = (96, 72)
STEPS = 40  # of the exposure, where a statement holds for any number
SCENE = Scene(
    colorful_plate(SIZE, 1, tile=16),
    Trajectory.line((25, 30), (65, 44)),
    Ball(8, ORANGE),
    nearby=Nearby(occlusion=0.03, bounce=0.01, reach=1.5),
)


@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"shadow": Shadow((9, 6), 2.0, (0.4, 0.4, 0.3))},
        {"occluder": wire_fence(SIZE, 24, 3, (0.1, 0.1, 0.1))},
        {"change": Change(scale=(0.6, 1.3)), "opacity": 0.7, "pixel_filter": 1.5},
    ],
    ids=["plain", "shadow", "fence", "growing"],
)
def test_image_satisfies_the_compositing_equation(changes):
    truth = render(replace(SCENE, **changes), STEPS)
    passed = 1 - truth.layer.alpha[..., None] - truth.shadow - truth.nearby
    image = truth.layer.premultiplied + passed * truth.plate.rgb
    assert_allclose(truth.image.rgb, image, atol=1e-15)
    assert np.abs(truth.nearby).max() > 0.005


def test_effect_is_the_time_average_of_the_sharp_effect():
    steps = 30
    truth = render(SCENE, steps)
    color = truth.layer.premultiplied.sum((0, 1)) / truth.layer.alpha.sum()
    x, y = np.arange(SIZE[0]), np.arange(SIZE[1])[:, None]
    expected = np.zeros((*SIZE[::-1], 3))
    for n, still in enumerate(truth.subframes(steps)):
        cx, cy = SCENE.trajectory.at((n + 0.5) / steps)
        g = (1 + ((x - cx) ** 2 + (y - cy) ** 2) / (1.5 * 8) ** 2) ** -1.5
        effect = (1 - still.alpha) * g
        expected += effect[..., None] * (0.03 - 0.01 * color) / steps
    assert_allclose(truth.nearby, expected, atol=1e-15)


def test_layer_and_shadow_do_not_depend_on_nearby_light():
    shadow = Shadow((9, 6), 2.0)
    with_it, without = (
        render(replace(SCENE, shadow=shadow, nearby=nearby), STEPS)
        for nearby in (SCENE.nearby, None)
    )
    assert_array_equal(with_it.layer.alpha, without.layer.alpha)
    assert_array_equal(with_it.layer.premultiplied, without.layer.premultiplied)
    assert_array_equal(with_it.shadow, without.shadow)
    assert not without.nearby.any()


def test_profile_agrees_with_traced_ambient_occlusion():
    """Light from all sides that a sphere hides from a point of a wall, by rays of a cosine law."""
    rng = np.random.default_rng(0)
    radius, height = 1.0, 2.0
    r, turn = np.sqrt(rng.uniform(size=400_000)), rng.uniform(0, 2 * np.pi, 400_000)
    rays = np.stack([r * np.cos(turn), r * np.sin(turn), np.sqrt(1 - r**2)], axis=1)
    hidden = []
    for d in (0, 1, 2.5):
        center = np.array([-d, 0, height])
        distance2 = center @ center - (rays @ center) ** 2
        hidden.append(np.mean((distance2 < radius**2) & (rays @ center > 0)))
    d = np.array([0, 1, 2.5])
    assert_allclose(hidden / hidden[0], (1 + (d / height) ** 2) ** -1.5, atol=0.01)


def test_effect_follows_the_path():
    nearby = render(SCENE, STEPS).nearby[..., 2]
    near_path = nearby[37 - 12, 45]  # next to the middle of the path
    assert near_path > 3 * nearby[68, 4] > 0


def test_bounce_has_the_color_of_the_body():
    truth = render(replace(SCENE, nearby=Nearby(occlusion=0, bounce=0.01)), STEPS)
    assert truth.nearby.max() <= 0
    given = -truth.nearby.sum((0, 1))
    assert_allclose(given / given[0], ORANGE / ORANGE[0], rtol=1e-9)


def test_body_outside_the_picture_reflects_no_color():
    path = Trajectory.line((-40, 10), (-30, 10))
    truth = render(replace(SCENE, trajectory=path))
    assert not truth.layer.alpha.any()
    assert np.all(truth.nearby > 0)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"occlusion": -0.1}, "occlusion must lie between 0 and 1, got -0.1"),
        ({"bounce": 2}, "bounce must lie between 0 and 1, got 2"),
        ({"reach": 0}, "reach must be a positive number of radii, got 0"),
    ],
)
def test_rejects_wrong_arguments(settings, message):
    with pytest.raises(ValueError, match=message):
        Nearby(**settings)
