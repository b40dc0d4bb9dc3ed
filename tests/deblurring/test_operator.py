"""The blur operator: its rows against alpha, against plain loops, and its adjoint."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from blurmatte.deblurring.lattice import Lattice
from blurmatte.deblurring.operator import poses_of, seen_moments
from blurmatte.sweep.model.pixels import Pixels
from blurmatte.sweep.model.silhouette import Silhouette


def operator(sweep, **kwargs):
    return Lattice.of(sweep).blur(sweep, Pixels.of_box(sweep.box), **kwargs).A


def test_rows_sum_to_the_alpha_of_the_operator(ball):
    lattice, pixels = Lattice.of(ball.sweep), Pixels.of_box(ball.sweep.box)
    A, alpha = lattice.blur(ball.sweep, pixels, poses_of(ball.sweep, 0.1, 0.6))
    assert_allclose(alpha, np.asarray(A.sum(axis=1)).ravel(), atol=1e-12)


@pytest.mark.parametrize(
    "change", [[0, 0, 0, 0.01, 0], [0.01, -0.01, 0.01, 0, 0], [0, 0, 0, 0, 0.01]]
)
def test_the_moments_of_a_motion_serve_a_near_one(ball, change):
    sweep, lattice, pixels = ball.sweep, Lattice.of(ball.sweep), Pixels.of_box(ball.sweep.box)
    values = np.random.default_rng(0).uniform(size=(lattice.size, 2))

    def blurred(sweep, near=None):
        A, alpha = lattice.blur(sweep, pixels, poses_of(sweep, count=30), near)
        return alpha, A @ values

    seen = seen_moments(sweep, pixels, poses_of(sweep, count=30))
    moved = replace(sweep, path=sweep.path + change[:4], shape=sweep.shape + change[4])
    parts = zip(blurred(sweep), blurred(moved, seen), blurred(moved), strict=True)
    for before, near, exact in parts:
        assert np.linalg.norm(near - exact) < 0.05 * np.linalg.norm(exact - before)


def test_rows_sum_to_alpha(ball):
    rows = np.asarray(operator(ball.sweep).sum(axis=1)).reshape(Pixels.of_box(ball.sweep.box).shape)
    assert_allclose(rows, ball.sweep.within(ball.sweep.box)[0], atol=2e-3)


@pytest.mark.parametrize(
    ("kind", "shape"),
    [
        (Silhouette(2, turns=True), [8.0, 0.3, -0.1, 0.8]),
        (Silhouette(1, changes=True), [8.0, 0.3]),
        (Silhouette(1, soft=True), [8.0, 1.0]),
        (Silhouette(3), [8.0, 0.1, 0.0, 0.05, 0.02]),
    ],
)
def test_rows_sum_to_alpha_of_other_silhouettes(ball, kind, shape):
    shape = np.array(shape)
    covariance = 1e-4 * np.eye(4 + len(shape))
    sweep = replace(ball.sweep, silhouette=kind, shape=shape, covariance=covariance)
    rows = np.asarray(operator(sweep).sum(axis=1)).reshape(Pixels.of_box(sweep.box).shape)
    assert_allclose(rows, sweep.within(sweep.box)[0], atol=4e-3)


def test_constant_color_is_reproduced(ball):
    A = operator(ball.sweep)
    alpha = np.asarray(A.sum(axis=1))
    assert_allclose(A @ np.full((A.shape[1], 1), 0.37), 0.37 * alpha, atol=1e-12)


def test_agrees_with_interpolation_in_plain_loops(ball):
    """Oracle: one pixel in the middle of the streak, always covered where it is near."""
    sweep, lattice = ball.sweep, Lattice.of(ball.sweep)
    rng = np.random.default_rng(1)
    values = rng.normal(size=lattice.size)
    poses = poses_of(sweep)
    x, y = 31, 20
    whole = np.where(lattice.node >= 0, values[lattice.node], 0)
    expected = 0.0
    for weight, center in zip(poses.durations, poses.xy, strict=True):
        dx, dy = np.array([x, y]) - center
        if np.hypot(dx, dy) > sweep.radius - 1:
            continue
        u, v = dx - lattice.corner[0], dy - lattice.corner[1]
        i, j = int(u), int(v)
        block, f, g = whole[j : j + 2, i : i + 2], u - i, v - j
        expected += weight * np.array([1 - g, g]) @ block @ np.array([1 - f, f])
    inner = replace(sweep, shape=sweep.shape)
    pixels = Pixels((1, 1), (float(x), float(y)))
    near = np.hypot(*(np.array([[x, y]]) - poses.xy).T)
    rim = (near > sweep.radius - 1) & (near < sweep.radius + 1)
    result = float((lattice.blur(inner, pixels).A @ values)[0])
    assert abs(result - expected) < np.abs(values).max() * poses.durations[0] * rim.sum() + 1e-12


def test_adjoint(ball):
    A = operator(ball.sweep)
    rng = np.random.default_rng(0)
    x, y = rng.normal(size=A.shape[1]), rng.normal(size=A.shape[0])
    assert_allclose(np.vdot(A @ x, y), np.vdot(x, A.T @ y))


def test_renders_the_blurred_ball(ball):
    """Exact: the true color at the nodes gives the light that the renderer gives."""
    lattice = Lattice.of(ball.sweep)
    reach = -int(lattice.corner[0])
    at = np.arange(-reach, reach + 1.0)
    scene = ball.truth.scene
    coverage, light = scene.body.sharp(at, at, scene.pose(0.5))
    straight = light / np.maximum(coverage, 1e-12)[..., None]
    # Nodes outside the rim have no true color: they take that of the nearest node inside.
    from scipy.ndimage import distance_transform_edt

    _, (j, i) = distance_transform_edt(coverage <= 0, return_indices=True)
    color = np.zeros((lattice.size, 3))
    color[lattice.node[lattice.node >= 0]] = straight[j, i][lattice.node >= 0]
    x0, y0, x1, y1 = ball.sweep.box
    P = (operator(ball.sweep) @ color).reshape(y1 - y0, x1 - x0, 3)
    error = P - ball.truth.layer.premultiplied[y0:y1, x0:x1]
    assert np.sqrt(np.mean(error**2)) < 0.004


def test_a_coarser_lattice_has_fewer_nodes_in_the_same_place(ball):
    lattice = Lattice.of(ball.sweep, 1.5)
    assert lattice.size < 0.65 * Lattice.of(ball.sweep).size
    ramp = lattice.pitch * (np.argwhere(lattice.node >= 0) + lattice.corner[::-1])[:, 1]
    values = np.zeros(lattice.size)
    values[lattice.node[lattice.node >= 0]] = ramp
    t = poses_of(ball.sweep, 0.5, 0.5)
    A, _ = lattice.blur(ball.sweep, Pixels.of_box(ball.sweep.box), t)
    x0, y0, x1, y1 = ball.sweep.box
    columns = np.tile(np.arange(x0, x1), y1 - y0)
    rows = np.repeat(np.arange(y0, y1), x1 - x0)
    inside = np.hypot(columns - t.xy[0, 0], rows - t.xy[0, 1]) < ball.sweep.radius - 2
    assert_allclose((A @ values)[inside], columns[inside] - t.xy[0, 0], atol=1e-9)
