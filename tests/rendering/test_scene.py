"""Renderings against closed forms: disc and box on straight paths, light of a sphere."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from blurmatte.rendering import Ball, Scene, Sheet, colorful_plate, render
from blurmatte.trajectory import Trajectory

ORANGE = np.array([0.9, 0.5, 0.05])
BLUE = np.array([0.1, 0.2, 0.7])
SIZE = (96, 72)


@pytest.fixture(scope="module")
def plate():
    return colorful_plate(SIZE, 1)


def time_on_path(along, half_chord, length):
    """Exposure fraction of a point `along` a path, where the shape is 2 half_chord long."""
    overlap = np.minimum(along + half_chord, length) - np.maximum(along - half_chord, 0)
    return np.maximum(overlap, 0) / length


def pixel_mean(alpha_at, size, n=40):
    """Average of alpha_at(x, y) over n × n points of every pixel."""
    x, y = ((np.arange(side * n) + 0.5) / n - 0.5 for side in size)
    width, height = size
    return alpha_at(x, y[:, None]).reshape(height, n, width, n).mean(axis=(1, 3))


@pytest.mark.parametrize(
    ("end", "size", "n"),
    [((70.3, 30.2), SIZE, 40), ((62.0, 51.0), SIZE, 40), ((22.2, 33.1), (36, 44), 64)],
)
def test_alpha_of_a_disc_is_the_time_its_chord_takes(plate, end, size, n):
    start, r = np.array([20.3, 30.2]), 7.3
    length = np.hypot(*(end - start))
    ux, uy = (end - start) / length

    def alpha_at(x, y):
        along = (x - start[0]) * ux + (y - start[1]) * uy
        across = (y - start[1]) * ux - (x - start[0]) * uy
        half_chord = np.sqrt(np.maximum(r**2 - across**2, 0))
        return time_on_path(along, half_chord, length)

    alpha = render(Scene(plate, Trajectory.line(start, end), Ball(r, ORANGE))).layer.alpha
    width, height = size
    assert_allclose(alpha[:height, :width], pixel_mean(alpha_at, size, n), atol=1e-4)


@pytest.mark.parametrize("end", [(70.3, 30.2), (60.3, 45.0)])
def test_alpha_of_a_box_is_the_time_it_takes_to_pass(plate, end):
    start = np.array([20.3, 30.2])
    way = end - start

    def alpha_at(x, y):
        # The box covers x while |x − x(t)| < 6.5, y while |y − y(t)| < 4: an interval of t each.
        open_x, close_x = ((x - start[0] + s * 6.5) / way[0] for s in (-1, 1))
        if way[1] == 0:
            open_y, close_y = 0.0, np.where(np.abs(y - start[1]) < 4, 1.0, 0.0)
        else:
            open_y, close_y = ((y - start[1] + s * 4) / way[1] for s in (-1, 1))
        opened = np.maximum(np.maximum(open_x, open_y), 0)
        closed = np.minimum(np.minimum(close_x, close_y), 1)
        return np.maximum(closed - opened, 0)

    alpha = render(Scene(plate, Trajectory.line(start, end), Sheet(13, 8, ORANGE))).layer.alpha
    # With way[1] = 0 the closed form has a step at y = 30.2 ± 4 which 40 points hit exactly.
    assert_allclose(alpha, pixel_mean(alpha_at, SIZE, n=50), atol=1e-4 if way[1] == 0 else 2e-4)


@pytest.mark.parametrize("substeps", [1, 7, None])
def test_sum_of_alpha_is_the_area_whatever_the_motion(plate, substeps):
    path = Trajectory.arc((20, 50), (40, 25), (75, 30))
    ball = render(Scene(plate, path, Ball(9.3, ORANGE)), substeps).layer
    sheet = render(Scene(plate, path, Sheet(11.3, 6.1, ORANGE)), substeps).layer
    assert_allclose(ball.alpha.sum(), np.pi * 9.3**2, rtol=1e-12)
    assert_allclose(sheet.alpha.sum(), 11.3 * 6.1, rtol=1e-12)


@pytest.mark.parametrize("phase", [0.0, 0.6, 1.5, 2.4])
def test_light_of_a_ball_is_that_of_a_lambert_sphere(plate, phase):
    """∫ max(n·l, 0) over the disc is 2/3 r² (sin θ + (π − θ) cos θ), θ between lamp and camera."""
    lamp = (-np.sin(phase) * 0.6, np.sin(phase) * 0.8, np.cos(phase))
    ball = Ball(15, ORANGE, ambient=0.25, lamp=lamp)
    layer = render(Scene(plate, Trajectory.line((30, 30), (55, 40)), ball)).layer
    lambert = 2 / 3 * (np.sin(phase) + (np.pi - phase) * np.cos(phase))
    expected = 15**2 * (0.25 * np.pi + 0.75 * lambert) * ORANGE
    assert_allclose(layer.premultiplied.sum(axis=(0, 1)), expected, rtol=2e-3)


def test_the_side_towards_the_lamp_is_bright(plate):
    ball = Ball(12, ORANGE, lamp=(-1, -1, 0.5))
    still = render(Scene(plate, Trajectory.line((40, 36), (40, 36)), ball)).layer
    assert still.premultiplied[30, 34, 0] > 2 * still.premultiplied[42, 46, 0]
    assert still.alpha[36, 40] == pytest.approx(1)


BODIES = {
    "flat": (Ball(8, ORANGE, ambient=1), 1),
    "shaded": (Ball(8, ORANGE), 1),
    "glossy": (Ball(8, ORANGE, highlight=0.5), 2),
    "white and glossy": (Ball(8, np.full(3, 0.7), highlight=0.5), 1),
    "two paints": (Ball(8, ORANGE, second_color=BLUE), 2),
    "sheet": (Sheet(12, 7, BLUE), 1),
}


@pytest.mark.parametrize("name", BODIES)
def test_model_holds_every_color_of_the_layer(plate, name):
    body, rank = BODIES[name]
    truth = render(Scene(plate, Trajectory.line((25, 30), (65, 44)), body))
    assert truth.model.rank == rank
    assert_allclose(truth.layer.premultiplied @ truth.model.normals, 0, atol=1e-14)
    spread = np.linalg.svd(truth.layer.premultiplied.reshape(-1, 3), compute_uv=False)
    assert spread[rank - 1] > 0.02 * spread[0]  # and every rank of the model is used
    assert truth.layer.alpha.min() == 0
    assert truth.layer.alpha.max() <= 1


@pytest.mark.parametrize("name", BODIES)
def test_image_is_the_layer_over_the_plate(plate, name):
    truth = render(Scene(plate, Trajectory.line((25, 30), (65, 44)), BODIES[name][0]))
    alpha, P = truth.layer.alpha[..., None], truth.layer.premultiplied
    assert truth.image.rgb.dtype == np.float64
    assert_allclose(truth.image.rgb, P + (1 - alpha) * plate, rtol=0, atol=1e-14)
    assert_array_equal(truth.plate.rgb, plate)


def test_flat_ball_shows_its_color(plate):
    layer = render(Scene(plate, Trajectory.line((25, 30), (65, 44)), BODIES["flat"][0])).layer
    assert_allclose(layer.premultiplied, layer.alpha[..., None] * ORANGE, atol=1e-14)


def test_image_is_the_average_of_sharp_images(plate):
    ball, path = BODIES["glossy"][0], Trajectory.line((25, 30), (65, 44))
    moments = [
        render(Scene(plate, Trajectory.line(at, at), ball)).image.rgb
        for at in path.at([0.125, 0.375, 0.625, 0.875])
    ]
    blurred = render(Scene(plate, path, ball), substeps=4).image.rgb
    assert_allclose(blurred, np.mean(moments, axis=0), atol=1e-14)


def test_shift_by_whole_pixels_and_reversal_change_nothing_else(plate):
    body, shift = BODIES["shaded"][0], (5, -3)
    path = Trajectory.arc((25, 40), (45, 30), (65, 44))
    alpha = render(Scene(plate, path, body)).layer.alpha
    moved = render(Scene(plate, replace(path, xy=path.xy + shift), body)).layer.alpha
    reverse = render(Scene(plate, replace(path, xy=path.xy[::-1]), body)).layer.alpha
    assert_allclose(moved, np.roll(alpha, shift[::-1], axis=(0, 1)), atol=1e-12)
    assert_allclose(reverse, alpha, atol=1e-12)


@pytest.mark.parametrize("body", [BODIES["two paints"][0], BODIES["sheet"][0]])
def test_path_may_leave_the_picture(plate, body):
    path = Trajectory.line((-20, 30), (90, 90))
    wide = np.pad(plate, [(40, 40), (40, 40), (0, 0)])
    cut = render(Scene(plate, path, body)).layer
    whole = render(Scene(wide, replace(path, xy=path.xy + 40), body)).layer
    assert_allclose(cut.alpha, whole.alpha[40:-40, 40:-40], atol=1e-12)
    assert_allclose(cut.premultiplied, whole.premultiplied[40:-40, 40:-40], atol=1e-12)


def test_same_scene_same_bytes(plate):
    scene = Scene(plate, Trajectory.arc((25, 40), (45, 30), (65, 44)), BODIES["glossy"][0])
    assert render(scene).image.rgb.tobytes() == render(scene).image.rgb.tobytes()


def test_prints_on_one_line(plate):
    scene = Scene(plate, Trajectory.line((25, 30), (65, 44)), BODIES["glossy"][0])
    assert repr(scene.body).startswith("Ball(radius 8, #")
    assert repr(BODIES["sheet"][0]).startswith("Sheet(12x7, #")
    for value in (scene, render(scene, 3)):
        assert "\n" not in repr(value)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"radius": 0}, "radius must be a positive number"),
        ({"radius": np.nan}, "radius must be"),
        ({"color": (0.5, 0.5)}, "color must be three linear values"),
        ({"color": (0, 0, 0)}, "color must be"),
        ({"color": (-0.1, 0.5, 0.5)}, "color must be"),
        ({"ambient": 1.2}, "ambient must lie between 0 and 1, got 1.2"),
        ({"band": -0.1}, "band must"),
        ({"highlight": -1}, "highlight must be finite"),
        ({"shininess": 0}, "shininess must be 1 or more"),
        ({"lamp": (0, 0, 0)}, "lamp must be a direction"),
        ({"axis": (1, 0)}, "axis must be a direction"),
        ({"second_color": BLUE, "highlight": 0.5}, "span all RGB"),
    ],
)
def test_door_of_the_ball(change, says):
    with pytest.raises(ValueError, match=says):
        Ball(**{"radius": 5, "color": ORANGE} | change)


def test_door_of_sheet_and_scene(plate):
    path = Trajectory.line((25, 30), (65, 44))
    with pytest.raises(ValueError, match="height must be a positive number of pixels, got 0"):
        Sheet(4, 0, ORANGE)
    with pytest.raises(TypeError, match="plate must hold linear light as floats"):
        Scene((255 * plate).astype(np.uint8), path, Sheet(4, 4, ORANGE))
    with pytest.raises(ValueError, match="plate must be finite"):
        Scene(np.full((4, 4, 3), np.nan), path, Sheet(4, 4, ORANGE))
    with pytest.raises(TypeError, match="trajectory must be a Trajectory, got list"):
        Scene(plate, [(0, 0), (1, 1)], Sheet(4, 4, ORANGE))
    with pytest.raises(ValueError, match="substeps must be 1 or more"):
        render(Scene(plate, path, Sheet(4, 4, ORANGE)), substeps=0)
