"""Ball: agreement with point counting and closed forms; invariance under rotation."""

import numpy as np
import pytest
from benchmarks.rendered import render_flight
from numpy.testing import assert_allclose, assert_array_equal
from scipy.ndimage import map_coordinates
from tests.rendering.bodies import around, means, points_in

from blurmatte import Intrinsics
from blurmatte.rendering import Ball
from blurmatte.rendering.lighting import Lamp
from blurmatte.rendering.pose import AT_REST, Change, Pose

ORANGE = np.array([0.9, 0.5, 0.05])
BLUE = np.array([0.1, 0.2, 0.7])
LAMPS = (Lamp((-0.5, -0.6, 0.5), (1, 0.9, 0.7)), Lamp((0.8, -0.2, 0.4), (0.2, 0.3, 0.6)))
TEXTURE = np.random.default_rng(0).uniform(0.1, 1, (6, 10, 3))
TURNED = Change(turned=(0.5, 0.8, -0.3)).at(0)
SQUASHED = Change(turned=(0.5, 0.8, -0.3), scale=(1.2, 1), squash=(1.3, 1), squash_angle=0.4).at(0)
SHEARED = Pose(TURNED.rotation, np.array([[1.2, 0.5], [-0.1, 0.9]]))
POSES = {"at rest": AT_REST, "turned": TURNED, "squashed": SQUASHED, "sheared": SHEARED}
LENS = Intrinsics(60, 62, 30, 22, np.array([-0.1, 0.02, 2e-3, -1e-3]))
PLATE = np.full((44, 60, 3), 0.25)


def unit(direction):
    return np.asarray(direction) / np.linalg.norm(direction)


def painted(ball, on_body):
    """Paint at directions (..., 3) of the body."""
    if ball.texture is not None:
        h, w = ball.texture.shape[:2]
        down = np.arccos(np.clip(-on_body[..., 1], -1, 1)) / np.pi
        around = np.arctan2(on_body[..., 0], on_body[..., 2]) / (2 * np.pi) + 0.5
        texture = np.pad(ball.texture, [(1, 1), (0, 0), (0, 0)], mode="edge")
        texture = np.pad(texture, [(0, 0), (1, 1), (0, 0)], mode="wrap")
        at = [down * h + 0.5, around * w + 0.5]
        texels = [map_coordinates(texture[..., c], at, order=1) for c in range(3)]
        return ball.color * np.stack(texels, axis=-1)
    if ball.second_color is not None:
        banded = np.abs(on_body @ unit(ball.axis)) < ball.band
        return np.where(banded[..., None], ball.second_color, ball.color)
    return ball.color


def light_at(ball, normal, pose):
    paint = painted(ball, normal @ pose.rotation)
    light = ball.ambient * paint * np.mean([lamp.color for lamp in ball.lamps], axis=0)
    for lamp in ball.lamps:
        facing = np.maximum(normal @ unit(lamp.direction), 0)[..., None]
        halfway = unit(unit(lamp.direction) + np.array([0, 0, 1]))
        gloss = ball.highlight * np.maximum(normal @ halfway, 0)[..., None] ** ball.shininess
        light = light + ((1 - ball.ambient) * paint * facing + gloss) * lamp.color
    return light


def counted(ball, x, y, pose, n):
    """Coverage and light as means over n × n points of every pixel."""
    u = points_in(x, y, n) @ np.linalg.inv(pose.stretch).T / ball.radius
    inside = np.sum(u**2, axis=-1) <= 1
    z = np.sqrt(np.maximum(1 - np.sum(u**2, axis=-1), 0))
    light = light_at(ball, np.dstack([u, z]), pose) * inside[..., None]
    return means(inside, x, y, n), means(light, x, y, n)


BALLS = {
    "flat": ({"ambient": 1}, 1),
    "shaded": ({}, 1),
    "glossy": ({"highlight": 0.5, "shininess": 8}, 2),
    "white and glossy": ({"color": np.full(3, 0.7), "highlight": 0.5}, 1),
    "two paints": ({"second_color": BLUE}, 2),
    "two paints, glossy": ({"second_color": BLUE, "highlight": 0.5}, None),
    "two lamps": ({"lamps": LAMPS}, 2),
    "two lamps, no shades": ({"lamps": LAMPS, "ambient": 1}, 1),
    "two lamps, glossy": ({"lamps": LAMPS, "highlight": 0.5}, None),
    "painted": ({"texture": TEXTURE}, None),
    "painted in grays": ({"texture": TEXTURE[..., :1] * np.ones(3)}, 1),
    "painted in two colors": ({"texture": TEXTURE[..., :2] @ [[1, 0.2, 0], [0, 0.3, 1]]}, 2),
    "everything": ({"texture": TEXTURE, "lamps": LAMPS, "highlight": 0.4, "shininess": 8}, None),
}


def ball_of(name, radius=5.0):
    return Ball(**{"radius": radius, "color": ORANGE} | BALLS[name][0])


@pytest.mark.diagonal
@pytest.mark.parametrize("pose", POSES)
@pytest.mark.parametrize("name", ["flat", "glossy", "two paints", "everything"])
def test_agrees_with_counted_points(name, pose):
    ball = ball_of(name)
    x, y = around(ball, POSES[pose])
    coverage, light = ball.sharp(x, y, POSES[pose])
    counted_coverage, counted_light = counted(ball, x, y, POSES[pose], 60)
    assert_allclose(coverage, counted_coverage, atol=5e-3)
    # Light is that of 4 × 4 cells of a pixel, so the edge of a band may be an eighth of one off.
    each, all_of_it = (0.08, 1e-2) if name == "two paints" else (0.012, 4e-3)
    assert_allclose(light, counted_light, atol=each)
    assert_allclose(light.sum((0, 1)), counted_light.sum((0, 1)), rtol=all_of_it)


@pytest.mark.parametrize("pose", POSES)
def test_a_large_ball_agrees_with_counted_points(pose):
    ball = ball_of("everything", 40.0)
    patches = (
        (np.arange(-20.0, 4), np.arange(-28.0, -8)),
        (np.arange(20.0, 50), np.arange(-3.0, 3)),
    )
    for x, y in patches:
        coverage, light = ball.sharp(x + 0.3, y, POSES[pose])
        counted_coverage, counted_light = counted(ball, x + 0.3, y, POSES[pose], 40)
        assert_allclose(coverage, counted_coverage, atol=5e-3)
        assert_allclose(light, counted_light, atol=5e-3)
        assert np.sqrt(np.mean((light - counted_light) ** 2)) < 5e-4


def test_four_points_per_pixel_agree_with_sixteen():
    """A ball just large enough for four points a pixel and one just too small."""
    x = np.arange(-23.0, 24)
    balls = (Ball(r, ORANGE, highlight=0.5) for r in (24.0, 24.0 - 1e-9))
    large, small = (ball.sharp(x, x[:20], AT_REST)[1] for ball in balls)
    assert_allclose(large, small, atol=2e-3)
    assert not np.array_equal(large, small)


@pytest.mark.parametrize("name", BALLS)
def test_model_holds_every_color(name):
    ball, rank = ball_of(name), BALLS[name][1]
    lights = [ball.sharp(*around(ball, pose), pose)[1].reshape(-1, 3) for pose in POSES.values()]
    spread = np.linalg.svd(np.vstack(lights), compute_uv=False)
    if rank is None:
        assert ball.model is None
        assert spread[2] > 0.005 * spread[0]
    else:
        assert ball.model.rank == rank
        assert_allclose(np.vstack(lights) @ ball.model.normals, 0, atol=1e-14)
        assert spread[rank - 1] > 0.01 * spread[0]  # and every rank of the model is used


@pytest.mark.parametrize("phase", [0.0, 0.6, 1.5, 2.4])
def test_light_of_a_ball_is_that_of_a_lambert_sphere(phase):
    """∫ max(n·l, 0) over the disc is 2/3 r² (sin θ + (π − θ) cos θ), θ between lamp and camera."""
    lamp = Lamp((-np.sin(phase) * 0.6, np.sin(phase) * 0.8, np.cos(phase)), (1, 0.8, 0.5))
    ball = Ball(15, ORANGE, ambient=0.25, lamps=(lamp,))
    light = ball.sharp(*around(ball), AT_REST)[1].sum((0, 1))
    lambert = 2 / 3 * (np.sin(phase) + (np.pi - phase) * np.cos(phase))
    expected = 15**2 * (0.25 * np.pi + 0.75 * lambert) * ORANGE * lamp.color
    assert_allclose(light, expected, rtol=2e-3)


def test_lamps_add_up():
    both, one, other = (Ball(6, ORANGE, 0.0, lamps) for lamps in (LAMPS, LAMPS[:1], LAMPS[1:]))
    x, y = around(both)
    parts = one.sharp(x, y, AT_REST)[1] + other.sharp(x, y, AT_REST)[1]
    assert_allclose(both.sharp(x, y, AT_REST)[1], parts, atol=1e-14)


def test_lamps_do_not_turn_with_the_ball():
    ball = Ball(12, ORANGE, lamps=(Lamp((-1, -1, 0.5)),))
    for pose in (AT_REST, TURNED):
        light = ball.sharp(np.arange(-12.0, 13), np.arange(-12.0, 13), pose)[1]
        assert light[6, 6, 0] > 2 * light[18, 18, 0]


@pytest.mark.parametrize("scale", [0.4, 1.7])
def test_area_is_that_of_the_ellipse(scale):
    ball = Ball(7.3, ORANGE)
    for change in (Change(), Change(squash=(1.4, 1), squash_angle=1.1)):
        stretch = scale * change.at(0).stretch
        pose = Pose(TURNED.rotation, stretch)
        coverage = ball.sharp(*around(ball, pose), pose)[0]
        assert_allclose(coverage.sum(), scale**2 * np.pi * 7.3**2, rtol=1e-10)


def test_reach_is_the_extent_of_the_picture():
    ball = Ball(7.3, ORANGE)
    x, y = np.arange(-12.0, 13), np.arange(-11.0, 12)
    seen = ball.sharp(x, y, SHEARED)[0] > 0
    for centers, any_seen, reach in zip(
        (x, y), (seen.any(0), seen.any(1)), ball.reach(SHEARED), strict=True
    ):
        assert_array_equal(any_seen, np.abs(centers) - 0.5 < reach)


def test_nothing_is_brighter_than_paint_that_faces_the_lamp():
    ball = Ball(5, ORANGE, 0.0, (Lamp((1, 0.2, 0)),))
    coverage, light = ball.sharp(*around(ball), AT_REST)
    assert np.all(light <= coverage[..., None] * ORANGE * (1 + 1e-12))


def test_a_scaled_ball_is_a_larger_ball():
    x, y = around(Ball(9, ORANGE))
    for stretch in (1.5 * np.eye(2), 1.5 * np.array([[0.6, -0.8], [0.8, 0.6]])):
        scaled = Ball(6, ORANGE, ambient=1).sharp(x, y, Pose(np.eye(3), stretch))
        for a, b in zip(scaled, Ball(9, ORANGE, ambient=1).sharp(x, y, AT_REST), strict=True):
            assert_allclose(a, b, atol=1e-12)


def test_rotation_does_not_change_a_ball_of_one_paint():
    ball = ball_of("glossy")
    x, y = around(ball)
    for a, b in zip(ball.sharp(x, y, AT_REST), ball.sharp(x, y, TURNED), strict=True):
        assert_array_equal(a, b)


@pytest.mark.parametrize("name", ["two paints", "painted"])
def test_quarter_turn_rotates_the_picture(name):
    ball = Ball(**{"radius": 6, "color": ORANGE, "ambient": 1} | BALLS[name][0])
    x = np.arange(-7.0, 8)
    quarter = Pose(np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]]) @ TURNED.rotation, np.eye(2))
    upright, turned = (ball.sharp(x, x, pose)[1] for pose in (TURNED, quarter))
    assert_allclose(turned, np.rot90(upright, -1), atol=1e-12)  # x goes to y: clockwise on screen
    assert np.abs(turned - upright).max() > 0.1


def globe():
    """Red above, blue below, and green on the right of what the camera sees at rest."""
    texture = np.zeros((8, 16, 3))
    texture[:4, :, 0], texture[4:, :, 2], texture[:, 8:, 1] = 1, 1, 1
    return Ball(6, texture=texture, ambient=1)


@pytest.mark.parametrize(
    ("turned", "left", "right"),
    [
        ((0, 0, 0), (-3, -3, [1, 0, 0]), (3, 3, [0, 1, 1])),
        ((0, np.pi, 0), (-3, -3, [1, 1, 0]), (3, 3, [0, 0, 1])),  # seen from behind
        ((np.pi, 0, 0), (-3, -3, [0, 0, 1]), (3, 3, [1, 1, 0])),  # upside down, from behind
        ((0, 0, np.pi), (-3, -3, [0, 1, 1]), (3, 3, [1, 0, 0])),  # upside down
    ],
)
def test_texture_is_upright_and_turns_with_the_ball(turned, left, right):
    pose = Change(turned=turned).at(0)
    for x, y, color in (left, right):
        assert_allclose(globe().sharp(np.array([x]), np.array([y]), pose)[1], [[color]], atol=1e-12)


def test_texture_is_continuous_and_multiplies_the_color():
    texture = np.cos(2 * np.pi * (np.arange(64) + 0.5) / 64)[None, :, None] * np.full(3, 0.3) + 0.5
    ball = Ball(10, ORANGE, texture=np.repeat(texture, 4, axis=0), ambient=1)
    x, behind = np.arange(-2.0, 3), Change(turned=(0, np.pi, 0)).at(0)
    light = ball.sharp(x, x, behind)[1]
    expected = 0.5 + 0.3 * np.cos(2 * np.pi * np.arctan2(x, np.sqrt(100 - x**2)) / (2 * np.pi))
    assert_allclose(light[2], expected[:, None] * ORANGE, atol=2e-3)


def test_lamp_behind_the_ball_gives_no_light():
    ball = Ball(6, ORANGE, 0.2, (Lamp((0, 0, -1)),), highlight=0.5)
    coverage, light = ball.sharp(*around(ball), AT_REST)
    assert_allclose(light, 0.2 * coverage[..., None] * ORANGE, atol=1e-12)


def test_repr_is_one_line():
    assert repr(ball_of("glossy", 8)).startswith("Ball(radius 8, #")
    assert repr(ball_of("everything", 8)) == "Ball(radius 8, all colors, highlight 0.4)"


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"radius": 0}, "radius must be a positive number"),
        ({"radius": np.nan}, "radius must be"),
        ({"color": (0.5, 0.5)}, "color must be three linear values"),
        ({"color": (0, 0, 0)}, "color must be"),
        ({"color": (-0.1, 0.5, 0.5)}, "color must be"),
        ({"second_color": (0, 0, 0)}, "second_color must be"),
        ({"ambient": 1.2}, "ambient must lie between 0 and 1, got 1.2"),
        ({"lamps": ()}, "lamps must be one or more"),
        ({"band": -0.1}, "band must"),
        ({"highlight": -1}, "highlight must be finite"),
        ({"shininess": 0}, "shininess must be 1 or more"),
        ({"axis": (1, 0)}, "axis must be a direction"),
        ({"texture": np.full((4, 8, 3), -0.1)}, "texture must not be negative"),
        ({"texture": np.full((4, 8, 3), np.nan)}, "texture must be finite"),
        ({"texture": np.ones((4, 8))}, "texture must have the shape"),
        ({"texture": TEXTURE, "second_color": BLUE}, "a second_color or a texture, got both"),
    ],
)
def test_rejects_wrong_arguments(change, says):
    with pytest.raises(ValueError, match=says):
        Ball(**{"radius": 5, "color": ORANGE} | change)


def covered_by_rays(centers, radius, cells=10):
    """(H, W) part of the rays within each pixel that meet a ball, in the mean of its places."""
    at = (np.arange(cells) + 0.5) / cells - 0.5
    y, x = (np.arange(n)[:, None] + at for n in PLATE.shape[:2])
    pixels = np.stack(np.broadcast_arrays(x.ravel()[None], y.ravel()[:, None]), axis=-1)
    rays = LENS.rays(pixels)
    hits = np.mean([rays @ c > np.sqrt(c @ c - radius**2) for c in centers], axis=0)
    h, w = PLATE.shape[:2]
    return hits.reshape(h, cells, w, cells).mean(axis=(1, 3))


def test_alpha_is_the_fraction_of_rays_that_hit_the_ball():
    """oracle: at three places, far off the axis, with distortion."""
    X = np.array([[0.3, 0.2, 1.0], [0.0, 0.0, 0.7], [-0.25, -0.1, 0.9]])
    image, layer = render_flight(PLATE, LENS, X, 0.11, (0.8, 0.3, 0.1))
    rays = covered_by_rays(X, 0.11)
    assert_allclose(layer.alpha, rays, atol=0.02)  # 100 rays in a pixel
    assert_allclose(layer.alpha.sum(), rays.sum(), rtol=3e-4)
    assert_allclose(image.rgb, layer.premultiplied + (1 - layer.alpha[..., None]) * PLATE)


def test_flight_rejects_wrong_arguments():
    """door: the camera is not within the ball."""
    with pytest.raises(ValueError, match="in front of the camera"):
        render_flight(PLATE, LENS, [[0, 0, 0.1]], 0.11, (1, 1, 1))
