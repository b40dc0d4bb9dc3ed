"""Cubes: which faces are seen, how large and how bright they are."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from tests.rendering.bodies import around, means, points_in

from blurmatte.rendering.flat_bodies import Cube
from blurmatte.rendering.lighting import Lamp
from blurmatte.rendering.pose import AT_REST, Change, Pose

CYAN = np.array([0.05, 0.55, 0.6])
SIX = np.random.default_rng(1).uniform(0.1, 1, (6, 3))
LAMPS = (Lamp((-0.5, -0.6, 0.5), (1, 0.9, 0.7)), Lamp((0.8, -0.2, 0.4), (0.2, 0.3, 0.6)))
POSES = {
    "at rest": Change(),
    "one edge": Change(turned=(0, 0.6, 0)),
    "a face almost from the edge": Change(turned=(0.2, 1.5, 0)),
    "a corner": Change(turned=(0.6, 0.5, -0.2)),
    "the far corner": Change(turned=(2.6, 0.9, 1.2)),
    "deformed": Change(turned=(0.6, 0.5, -0.2), scale=(1.3, 1), squash=(1.4, 1), squash_angle=0.5),
}


def counted(cube, x, y, pose, n=60):
    """Coverage and light as means over n × n rays of every pixel, cut with the cube's slabs."""
    plane = points_in(x, y, n) @ np.linalg.inv(pose.stretch).T
    start = plane @ pose.rotation[:2] + 100 * pose.rotation[2]  # in the cube's own directions
    ray = np.where(np.abs(pose.rotation[2]) < 1e-12, 1e-12, -pose.rotation[2])
    enter = (-np.sign(ray) * cube.side / 2 - start) / ray
    leave = (np.sign(ray) * cube.side / 2 - start) / ray
    hit = enter.max(axis=-1) < leave.min(axis=-1)
    axis = enter.argmax(axis=-1)  # the face through which the ray enters last
    faces = 2 * axis + (ray[axis] > 0)
    light = np.array([face_light(cube, k, pose) for k in range(6)])[faces] * hit[..., None]
    return means(hit, x, y, n), means(light, x, y, n)


def face_light(cube, k, pose):
    normal = (-1) ** k * pose.rotation[:, k // 2]
    paint = cube.color[k] if cube.color.ndim == 2 else cube.color
    light = cube.ambient * np.mean([lamp.color for lamp in cube.lamps], axis=0)
    for lamp in cube.lamps:
        cosine = normal @ lamp.direction / np.linalg.norm(lamp.direction)
        light = light + (1 - cube.ambient) * max(cosine, 0) * np.array(lamp.color)
    return paint * light


@pytest.mark.diagonal
@pytest.mark.parametrize("name", POSES)
@pytest.mark.parametrize("cube", [Cube(11.3, CYAN), Cube(8.2, SIX, 0.3, LAMPS)])
def test_agrees_with_rays(cube, name):
    pose = POSES[name].at(0)
    x, y = around(cube, pose)
    coverage, light = cube.sharp(x, y, pose)
    expected_coverage, expected_light = counted(cube, x, y, pose)
    assert_allclose(coverage, expected_coverage, atol=0.02)
    assert_allclose(light, expected_light, atol=0.02)
    assert_allclose(light.sum((0, 1)), expected_light.sum((0, 1)), rtol=5e-3)


@pytest.mark.parametrize("name", POSES)
def test_area_is_the_projected_area_of_a_cube(name):
    """A cube of side 1 throws a shadow of area |n_x| + |n_y| + |n_z| along its own direction n."""
    pose, cube = POSES[name].at(0), Cube(11.3, CYAN)
    expected = 11.3**2 * np.abs(pose.rotation[2]).sum() * np.linalg.det(pose.stretch)
    coverage = cube.sharp(*around(cube, pose), pose)[0]
    assert_allclose(coverage.sum(), expected, rtol=1e-12)
    assert coverage.max() <= 1 + 1e-12


def test_area_is_quadratic_in_scale():
    turned, cube = POSES["a corner"].at(0), Cube(7, CYAN)
    larger = Pose(turned.rotation, 1.7 * np.eye(2))
    x, y = around(Cube(12, CYAN), turned)
    for a, b in zip(cube.sharp(x, y, larger), Cube(11.9, CYAN).sharp(x, y, turned), strict=True):
        assert_allclose(a, b, atol=1e-12)


def test_quarter_turn_rotates_the_picture():
    cube, upright = Cube(9, SIX, ambient=1), POSES["a corner"].at(0)
    quarter = Pose(np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]]) @ upright.rotation, np.eye(2))
    x = np.arange(-9.0, 10)
    for a, b in zip(cube.sharp(x, x, quarter), cube.sharp(x, x, upright), strict=True):
        assert_allclose(a, np.rot90(b, -1), atol=1e-12)  # x goes to y: clockwise on screen


@pytest.mark.parametrize(
    ("turned", "face"),
    [
        ((0, -np.pi / 2, 0), 0),  # +x is turned towards the camera
        ((0, np.pi / 2, 0), 1),
        ((np.pi / 2, 0, 0), 2),
        ((-np.pi / 2, 0, 0), 3),
        ((0, 0, 0), 4),
        ((np.pi, 0, 0), 5),
    ],
)
def test_each_face_has_its_color(turned, face):
    center = np.array([0.0])
    light = Cube(9, SIX, ambient=1).sharp(center, center, Change(turned=turned).at(0))[1]
    assert_allclose(light[0, 0], SIX[face], atol=1e-12)


@pytest.mark.parametrize(
    ("cube", "rank"),
    [
        (Cube(9, CYAN), 1),
        (Cube(9, CYAN, 0.3, LAMPS), 2),
        (Cube(9, CYAN, 1.0, LAMPS), 1),
        (Cube(9, np.array([CYAN, SIX[0]])[[0, 1, 0, 1, 1, 0]]), 2),
    ],
)
def test_model_holds_every_color(cube, rank):
    assert cube.model.rank == rank
    for change in POSES.values():
        pose = change.at(0)
        assert_allclose(
            cube.sharp(*around(cube, pose), pose)[1] @ cube.model.normals, 0, atol=1e-14
        )


def test_six_colors_span_rgb():
    assert Cube(9, SIX).model is None


def test_a_lamp_from_the_camera_shows_the_face_at_rest_in_its_color():
    light = Cube(9, CYAN, 0.2, (Lamp((0, 0, 1)),)).sharp(np.zeros(1), np.zeros(1), AT_REST)[1]
    assert_allclose(light[0, 0], CYAN)


def test_repr_is_one_line():
    assert repr(Cube(8, CYAN)).startswith("Cube(side 8, #")
    assert repr(Cube(8, SIX)) == "Cube(side 8, all colors)"


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"side": 0}, "side must be a positive number of pixels, got 0"),
        ({"side": np.nan}, "side must be"),
        ({"color": (0.5, 0.5)}, "color must be three linear values"),
        ({"color": np.vstack([SIX[:5], np.zeros(3)])}, r"color\[5\] must be three linear values"),
        ({"ambient": -0.1}, "ambient must lie between 0 and 1, got -0.1"),
        ({"lamps": ()}, "lamps must be one or more"),
    ],
)
def test_rejects_wrong_arguments(change, says):
    with pytest.raises(ValueError, match=says):
        Cube(**{"side": 5, "color": CYAN} | change)
