"""Balls before a pinhole camera, against rays that are cast one by one."""

import numpy as np
import pytest
from benchmarks.rendered import render_flight
from numpy.testing import assert_allclose
from tests.rendering.bodies import around, means, points_in

from blurmatte.intrinsics import Intrinsics
from blurmatte.rendering import Ball, Scene, render
from blurmatte.rendering.flat_bodies import Sheet
from blurmatte.rendering.lighting import Lamp
from blurmatte.rendering.plates import plain_plate
from blurmatte.rendering.pose import (
    CameraView,
    Change,
    Pinhole,
    Pose,
    path_in_depth,
    sphere_outline,
)
from blurmatte.trajectory import Trajectory

ORANGE = np.array([0.9, 0.5, 0.05])
LAMPS = (Lamp((-0.5, -0.6, 0.5), (1, 0.9, 0.7)), Lamp((0.8, -0.2, 0.4), (0.2, 0.3, 0.6)))
GLOSSY = Ball(9, ORANGE, lamps=LAMPS, highlight=0.5, shininess=8)
TURNED = Change(turned=(0.5, 0.8, -0.3)).at(0).rotation
VIEWS = {
    "on the axis": CameraView((0.0, 0.0), 40.0),
    "wide angle": CameraView((0.7, -0.4), 40.0),
    "very near": CameraView((0.5, 0.9), 14.0),
    "long lens": CameraView((0.1, 0.05), 300.0),
}


def unit(v):
    return v / np.linalg.norm(v, axis=-1, keepdims=True)


def cast(ball, view, x, y, n):
    """Coverage and light as means over n × n rays of every pixel; space is x right, y down, z back."""
    u, v = view.slope
    slopes = np.array([u, v]) + points_in(x, y, n) / view.focal
    rays = unit(np.dstack([slopes, np.full(slopes.shape[:2], -1)]))
    center, R = np.array([u, v, -1]), ball.radius / view.focal
    near = rays @ center
    inside = near**2 - (center @ center - R**2)
    hit = (near - np.sqrt(np.maximum(inside, 0)))[..., None] * rays
    normal = (hit - center) / R
    light = ball.ambient * ball.color * np.mean([lamp.color for lamp in ball.lamps], axis=0)
    for lamp in ball.lamps:
        toward = unit(np.array(lamp.direction, float))
        facing = np.maximum(normal @ toward, 0)[..., None]
        gloss = np.maximum(np.sum(normal * unit(toward - rays), axis=-1), 0)[..., None]
        gloss = ball.highlight * gloss**ball.shininess
        light = light + ((1 - ball.ambient) * ball.color * facing + gloss) * lamp.color
    seen = inside > 0
    return means(seen, x, y, n), means(light * seen[..., None], x, y, n)


@pytest.mark.parametrize("name", VIEWS)
def test_agrees_with_rays(name):
    view = VIEWS[name]
    pose = Pose(TURNED, np.eye(2), view)
    x, y = around(GLOSSY, pose)
    coverage, light = GLOSSY.sharp(x, y, pose)
    cast_coverage, cast_light = cast(GLOSSY, view, x, y, 30)
    assert_allclose(coverage, cast_coverage, atol=8e-3)
    assert_allclose(light, cast_light, atol=0.012)
    assert_allclose(light.sum((0, 1)), cast_light.sum((0, 1)), rtol=3e-3)


@pytest.mark.parametrize("name", VIEWS)
def test_outline_is_where_rays_touch_the_sphere(name):
    view, radius = VIEWS[name], 9.0
    center, axes = sphere_outline(view, radius)
    turn = np.linspace(0, 2 * np.pi, 50)
    points = center + np.stack([np.cos(turn), np.sin(turn)], axis=1) @ axes
    rays = unit(np.column_stack([points / view.focal + view.slope, np.full(50, -1)]))
    middle = np.array([*view.slope, -1])
    distance = np.linalg.norm(np.cross(rays, middle), axis=1)
    assert_allclose(distance, radius / view.focal, rtol=1e-12)


def test_coverage_is_the_area_of_the_ellipse():
    pose = Pose(TURNED, 1.3 * np.eye(2), VIEWS["wide angle"])
    coverage = GLOSSY.sharp(*around(GLOSSY, pose), pose)[0]
    _, axes = sphere_outline(pose.view, 1.3 * GLOSSY.radius)
    assert_allclose(coverage.sum(), np.pi * np.linalg.det(axes), rtol=1e-10)


def test_outline_is_elongated_away_from_the_axis():
    center, axes = sphere_outline(CameraView((0.6, 0.8), 100.0), 20.0)
    lengths, directions = np.linalg.eigh(axes)
    assert lengths[1] / lengths[0] == pytest.approx(np.sqrt((2 - 0.04) / (1 - 0.04)))
    assert_allclose(np.abs(directions[:, 1]), [0.6, 0.8])
    assert_allclose(center / np.linalg.norm(center), [0.6, 0.8])


def test_agrees_with_the_far_camera_at_a_long_focal_length():
    for ball in (GLOSSY, Ball(9, ORANGE, second_color=(0.1, 0.2, 0.7))):
        near, far = Pose(TURNED, np.eye(2), CameraView((1e-6, 0.0), 1e7)), Pose(TURNED, np.eye(2))
        x, y = around(ball, far)
        for a, b in zip(ball.sharp(x, y, near), ball.sharp(x, y, far), strict=True):
            assert_allclose(a, b, atol=1e-6)


def test_perspective_hides_part_of_the_paint():
    """A camera near the ball sees less than half of it: the band at the rim disappears."""
    ball = Ball(9, ORANGE, ambient=1, second_color=(0.1, 0.2, 0.7), band=0.2, axis=(0, 0, 1))
    far, near = Pose(np.eye(3), np.eye(2)), Pose(np.eye(3), np.eye(2), CameraView((0.0, 0.0), 12.0))
    seen = [ball.sharp(*around(ball, p), p)[1][..., 2].max() for p in (far, near)]
    assert seen[0] > 0.2
    assert seen[1] <= ORANGE[2] + 1e-12


def test_alpha_agrees_with_the_traced_outline_of_a_flight():
    size, pinhole = (120, 90), Pinhole(70.0, (50.0, 48.0))
    plate = plain_plate(size, (0.3, 0.3, 0.3), 1)
    start, end, depth = np.array([20.0, 30]), np.array([95.0, 60]), np.array([1.0, 0.8])
    scene = Scene(
        plate,
        path_in_depth(start, end, tuple(depth)),
        Ball(8, ORANGE, ambient=1),
        Change(depth=tuple(depth)),
        pinhole=pinhole,
    )
    alpha = render(scene, 50).layer.alpha
    ends = (
        np.column_stack([(np.array([start, end]) - pinhole.center) / 70, [1, 1]]) * depth[:, None]
    )
    t = (np.arange(50)[:, None] + 0.5) / 50
    intrinsics = Intrinsics(70, 70, 50, 48)
    _, layer = render_flight(plate, intrinsics, (1 - t) * ends[0] + t * ends[1], 8 / 70, ORANGE)
    assert_allclose(alpha, layer.alpha, atol=1e-4)


def test_default_substeps_bound_the_error_of_alpha():
    scene = Scene(
        plain_plate((50, 40), ORANGE, 1),
        path_in_depth((8, 8), (35, 25), (1, 0.6)),
        Ball(4, ORANGE, ambient=1),
        Change(depth=(1, 0.6)),
        pinhole=Pinhole(20.0),
    )
    assert_allclose(render(scene).layer.alpha, render(scene, 1200).layer.alpha, atol=1e-4)


def test_path_in_depth_is_a_projected_line():
    X = np.array([[-0.4, 0.3, 2.0], [0.8, -0.1, 0.7]])
    f, c = 350, np.array([200, 150])
    start, end = f * X[:, :2] / X[:, 2:] + c
    path = path_in_depth(start, end, (2.0, 0.7))
    t = np.linspace(0, 1, 41)
    points = (1 - t[:, None]) * X[0] + t[:, None] * X[1]
    assert_allclose(path.at(t), f * points[:, :2] / points[:, 2:] + c, atol=1e-4 * path.length)


def test_size_is_divided_by_depth():
    change = Change(scale=(1, 1.5), depth=(2, 0.5))
    for t in (0, 0.3, 1):
        assert_allclose(change.at(t).stretch, (1 + 0.5 * t) / (2 - 1.5 * t) * np.eye(2))


def test_principal_point_defaults_to_the_middle():
    point, size = np.array([10.0, 20]), (101, 51)
    assert Pinhole(50).view(point, size) == Pinhole(50, (50, 25)).view(point, size)
    assert_allclose(Pinhole(50).view(point, size).slope, (-0.8, -0.1))


def test_rejects_wrong_arguments():
    scene = {
        "plate": plain_plate((40, 30), ORANGE, 1),
        "trajectory": Trajectory.line((5, 5), (30, 20)),
    }
    with pytest.raises(ValueError, match="focal must be a positive number of pixels, got 0"):
        Pinhole(0)
    with pytest.raises(ValueError, match="center must be two finite numbers of pixels"):
        Pinhole(100, (1, np.nan))
    with pytest.raises(TypeError, match="a pinhole camera sees a Ball, got Sheet"):
        Scene(**scene, body=Sheet(5, 5, ORANGE), pinhole=Pinhole(100))
    with pytest.raises(ValueError, match="a pinhole camera sees no squash"):
        Scene(**scene, body=GLOSSY, change=Change(squash=(1, 2)), pinhole=Pinhole(100))
    with pytest.raises(ValueError, match="focal must be larger than the ball's radius, 18 pixels"):
        Scene(**scene, body=GLOSSY, change=Change(depth=(1, 0.5)), pinhole=Pinhole(18))
    with pytest.raises(ValueError, match="depth must be two positive numbers"):
        path_in_depth((0, 0), (1, 1), (1, 0))
