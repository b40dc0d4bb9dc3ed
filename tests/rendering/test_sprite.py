"""Sprites: means of a bilinear function, whatever the pose; and the star."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.ndimage import map_coordinates
from tests.rendering.bodies import around, means, points_in

from blurmatte.layer import Layer
from blurmatte.rendering.flat_bodies import Sprite, sample_counts, star_sprite
from blurmatte.rendering.pose import AT_REST, Change, Pose

GOLD = np.array([1.0, 0.62, 0.1])


def blob(colors, seed=0, size=(9, 7)):
    """A soft shape of random alpha, in a random mixture of `colors` (n, 3)."""
    rng = np.random.default_rng(seed)
    alpha = rng.uniform(0, 1, size[::-1])
    mixture = rng.dirichlet(np.ones(len(colors)), size[::-1])
    return Sprite(Layer(alpha, alpha[..., None] * (mixture @ colors)))


SPRITE = blob(np.eye(3) + 0.1)
POSES = {
    "at rest": Change(),
    "turned in the picture": Change(turned=(0, 0, 0.6)),
    "turned in space": Change(turned=(0.7, -0.5, 0.3)),
    "seen from behind": Change(turned=(0, 2.6, 0.4)),
    "enlarged": Change(scale=(2.3, 1)),
    "shrunk": Change(scale=(0.3, 1), squash=(1.3, 1), squash_angle=0.8),
}


def counted(sprite, x, y, pose, n=40):
    """Coverage and light as means over n × n points of every pixel."""
    own = points_in(x, y, n) @ np.linalg.inv(pose.plane).T
    width, height = sprite.layer.size
    at = [own[..., 1] + (height - 1) / 2, own[..., 0] + (width - 1) / 2]
    rgba = np.dstack([sprite.layer.premultiplied, sprite.layer.alpha])
    # A wide border: what map_coordinates takes beyond the last pixel is 0 at once.
    rgba = np.pad(rgba, [(2, 2), (2, 2), (0, 0)])
    shifted = [c + 2 for c in at]
    seen = np.dstack([map_coordinates(rgba[..., c], shifted, order=1) for c in range(4)])
    seen = means(seen, x, y, n)
    return seen[..., 3], seen[..., :3]


@pytest.mark.parametrize("name", POSES)
def test_agrees_with_counted_points(name):
    pose = POSES[name].at(0)
    x, y = around(SPRITE, pose)
    for found, expected in zip(SPRITE.sharp(x, y, pose), counted(SPRITE, x, y, pose), strict=True):
        assert_allclose(found, expected, atol=0.02)
        assert_allclose(found.sum((0, 1)), expected.sum((0, 1)), rtol=0.01)


@pytest.mark.parametrize("shift", [(0, 0), (0.31, -0.17)])
def test_sum_is_preserved_when_unposed(shift):
    coverage, light = SPRITE.sharp(*around(SPRITE, AT_REST, shift), AT_REST)
    assert_allclose(coverage.sum(), SPRITE.layer.alpha.sum(), rtol=1e-12)
    assert_allclose(light.sum((0, 1)), SPRITE.layer.premultiplied.sum((0, 1)), rtol=1e-12)


def test_uniform_area_is_reproduced():
    light = np.full((12, 12, 3), 0.5) * GOLD
    sprite = Sprite(Layer(np.full((12, 12), 0.5), light))
    x = np.arange(-2.0, 3)
    for change in (POSES["at rest"], POSES["turned in space"]):
        coverage, shown = sprite.sharp(x, x, change.at(0))
        assert_allclose(coverage, 0.5)
        assert_allclose(shown, light[:5, :5])


@pytest.mark.parametrize("scale", [0.5, 2.0, 3.3])
def test_area_is_quadratic_in_scale(scale):
    sprite = star_sprite(40, GOLD)
    pose = Change(turned=(0, 0, 0.2), scale=(scale, 1)).at(0)
    coverage = sprite.sharp(*around(sprite, pose), pose)[0]
    assert_allclose(coverage.sum(), scale**2 * sprite.layer.alpha.sum(), rtol=2e-3)


def test_quarter_turn_rotates_the_picture():
    upright = POSES["turned in space"].at(0)
    quarter = Pose(np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]]) @ upright.rotation, np.eye(2))
    x = np.arange(-6.0, 7)
    for a, b in zip(SPRITE.sharp(x, x, quarter), SPRITE.sharp(x, x, upright), strict=True):
        assert_allclose(a, np.rot90(b, -1), atol=1e-12)  # x goes to y: clockwise on screen


def test_sprite_from_behind_is_mirrored():
    behind, x = Change(turned=(0, np.pi, 0)).at(0), np.arange(-6.0, 7)
    for a, b in zip(SPRITE.sharp(x, x, behind), SPRITE.sharp(x, x, AT_REST), strict=True):
        assert_allclose(a, b[:, ::-1], atol=1e-12)


@pytest.mark.parametrize("turn", [np.pi / 2 - 1e-3, np.pi / 2])
def test_edge_on_sprite_is_almost_invisible(turn):
    pose = Change(turned=(0, turn, 0)).at(0)
    coverage = SPRITE.sharp(*around(SPRITE, pose), pose)[0]
    assert_allclose(coverage.sum(), SPRITE.layer.alpha.sum() * np.cos(turn), atol=0.1)


@pytest.mark.parametrize("name", POSES)
def test_reach_is_the_extent_of_the_picture(name):
    pose, sprite = POSES[name].at(0), Sprite(Layer(np.ones((9, 14)), np.ones((9, 14, 3))))
    x, y = np.arange(-20.0, 21), np.arange(-19.0, 20)
    seen = sprite.sharp(x, y, pose)[0] > 0
    for centers, any_seen, reach in zip(
        (x, y), (seen.any(0), seen.any(1)), sprite.reach(pose), strict=True
    ):
        assert not any_seen[np.abs(centers) - 0.5 >= reach].any()
        assert any_seen[np.abs(centers) + 1.5 < reach].all()


@pytest.mark.parametrize("seed", range(5))
def test_sample_spacing_is_bounded_in_sprite_pixels(seed):
    to_sprite = np.random.default_rng(seed).normal(0, 4, (2, 2))
    across, down = sample_counts(to_sprite)
    steps = np.linalg.norm(to_sprite / [across, down], axis=0)
    assert np.all(steps <= 0.25)
    assert np.all(steps[np.array([across, down]) > 4] > 0.2)  # and not much closer


@pytest.mark.parametrize("rank", [1, 2, None])
def test_model_holds_every_color(rank):
    sprite = blob(np.array([[0.9, 0.5, 0.1], [0.1, 0.2, 0.7], [0.3, 0.9, 0.3]])[: rank or 3])
    if rank is None:
        assert sprite.model is None
        return
    assert sprite.model.rank == rank
    for change in POSES.values():
        pose = change.at(0)
        light = sprite.sharp(*around(sprite, pose), pose)[1]
        assert_allclose(light @ sprite.model.normals, 0, atol=1e-14)


@pytest.mark.parametrize("points", [3, 5, 8])
def test_a_star_has_its_points(points):
    sprite = star_sprite(61, GOLD, points)
    alpha = sprite.layer.alpha
    n, outer = points, 61 / 2 - 1
    area = n * outer * 0.42 * outer * np.sin(np.pi / n)  # 2n triangles from the center
    assert_allclose(alpha.sum(), area, rtol=1e-10)
    assert alpha[30, 30] == 1
    assert alpha[:8].sum() == pytest.approx(alpha[:8, 20:41].sum())  # one point up
    assert_allclose(alpha, alpha[:, ::-1], atol=1e-12)
    assert_allclose(sprite.layer.premultiplied, alpha[..., None] * GOLD)
    assert sprite.model.rank == 1


def test_repr_is_one_line():
    assert repr(SPRITE) == "Sprite(9x7, all colors)"
    assert repr(star_sprite(20, GOLD)).startswith("Sprite(20x20, #")


@pytest.mark.parametrize(
    ("make", "error", "says"),
    [
        (lambda: Sprite(np.ones((4, 4))), TypeError, "layer must be a Layer, got ndarray"),
        (lambda: layered(1.2, 0.5), ValueError, "alpha must be in 0…1, it is in 1.2…1.2"),
        (lambda: layered(-0.1, 0.5), ValueError, "alpha must be in 0…1"),
        (lambda: layered(np.nan, 0.5), ValueError, "alpha must be finite"),
        (lambda: layered(1.0, 0.0), ValueError, "premultiplied must not be negative nor all 0"),
        (lambda: layered(1.0, -0.5), ValueError, "premultiplied must not be negative"),
        (lambda: layered(1.0, np.inf), ValueError, "premultiplied must be finite"),
        (lambda: star_sprite(2, GOLD), ValueError, "size must be a whole number, 3 or more, got 2"),
        (lambda: star_sprite(20.5, GOLD), ValueError, "size must be a whole number"),
        (lambda: star_sprite(20, GOLD, 2), ValueError, "points must be a whole number, 3 or more"),
        (lambda: star_sprite(20, (0, 0, 0)), ValueError, "color must be three linear values"),
    ],
)
def test_rejects_wrong_arguments(make, error, says):
    with pytest.raises(error, match=says):
        make()


def layered(alpha, light):
    return Sprite(Layer(np.full((4, 5), alpha), np.full((4, 5, 3), light)))
