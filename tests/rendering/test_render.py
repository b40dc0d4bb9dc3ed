"""Renderings against closed forms: disc and box on straight paths, light of a sphere."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from blurmatte.layer import Layer
from blurmatte.rendering import Ball, Scene, colorful_plate, render
from blurmatte.rendering.flat_bodies import Cube, Sheet, Sprite
from blurmatte.rendering.plates import wire_fence
from blurmatte.rendering.pose import AT_REST, Change
from blurmatte.rendering.render import filter_margin, filter_peak, filter_weights, filtered_body
from blurmatte.rendering.scene import Shadow
from blurmatte.trajectory import Trajectory

ORANGE = np.array([0.9, 0.5, 0.05])
BLUE = np.array([0.1, 0.2, 0.7])
SIZE = (96, 72)
STEPS = 40  # of the exposure, where a statement holds for any number
POSE = Change(turned=(0.4, -0.3, 0.6), squash=(1.2, 1), squash_angle=0.5).at(0)
FILTERED = {
    "ball": Ball(5, ORANGE, highlight=0.4),
    "sheet": Sheet(9, 6, ORANGE),
    "cube": Cube(7, ORANGE),
    "sprite": Sprite(Layer(np.ones((6, 9)), np.tile(ORANGE, (6, 9, 1)))),
}
X = np.arange(-9.0, 10) + 0.3
Y = np.arange(-8.0, 9) - 0.2


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
    motion = end - start

    def alpha_at(x, y):
        # The box covers x while |x − x(t)| < 6.5, y while |y − y(t)| < 4: an interval of t each.
        open_x, close_x = ((x - start[0] + s * 6.5) / motion[0] for s in (-1, 1))
        if motion[1] == 0:
            open_y, close_y = 0.0, np.where(np.abs(y - start[1]) < 4, 1.0, 0.0)
        else:
            open_y, close_y = ((y - start[1] + s * 4) / motion[1] for s in (-1, 1))
        opened = np.maximum(np.maximum(open_x, open_y), 0)
        closed = np.minimum(np.minimum(close_x, close_y), 1)
        return np.maximum(closed - opened, 0)

    alpha = render(Scene(plate, Trajectory.line(start, end), Sheet(13, 8, ORANGE))).layer.alpha
    # With motion[1] = 0 the closed form has a step at y = 30.2 ± 4 which 40 points hit exactly.
    assert_allclose(alpha, pixel_mean(alpha_at, SIZE, n=50), atol=1e-4 if motion[1] == 0 else 2e-4)


@pytest.mark.parametrize("substeps", [1, 7, None])
def test_sum_of_alpha_is_the_area_for_every_motion(plate, substeps):
    path = Trajectory.arc((20, 50), (40, 25), (75, 30))
    ball = render(Scene(plate, path, Ball(9.3, ORANGE)), substeps).layer
    sheet = render(Scene(plate, path, Sheet(11.3, 6.1, ORANGE)), substeps).layer
    assert_allclose(ball.alpha.sum(), np.pi * 9.3**2, rtol=1e-12)
    assert_allclose(sheet.alpha.sum(), 11.3 * 6.1, rtol=1e-12)


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
    truth = render(Scene(plate, Trajectory.line((25, 30), (65, 44)), body), STEPS)
    assert truth.model.rank == rank
    assert_allclose(truth.layer.premultiplied @ truth.model.normals, 0, atol=1e-14)
    spread = np.linalg.svd(truth.layer.premultiplied.reshape(-1, 3), compute_uv=False)
    assert spread[rank - 1] > 0.02 * spread[0]  # and every rank of the model is used
    assert truth.layer.alpha.min() == 0
    assert truth.layer.alpha.max() <= 1


@pytest.mark.parametrize("name", BODIES)
def test_image_is_the_layer_over_the_plate(plate, name):
    truth = render(Scene(plate, Trajectory.line((25, 30), (65, 44)), BODIES[name][0]), STEPS)
    alpha, P = truth.layer.alpha[..., None], truth.layer.premultiplied
    assert truth.image.rgb.dtype == np.float64
    assert_allclose(truth.image.rgb, P + (1 - alpha) * plate, rtol=0, atol=1e-14)
    assert_array_equal(truth.plate.rgb, plate)


def test_flat_ball_shows_its_color(plate):
    layer = render(
        Scene(plate, Trajectory.line((25, 30), (65, 44)), BODIES["flat"][0]), STEPS
    ).layer
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
    alpha = render(Scene(plate, path, body), STEPS).layer.alpha
    moved = render(Scene(plate, replace(path, xy=path.xy + shift), body), STEPS).layer.alpha
    reverse = render(Scene(plate, replace(path, xy=path.xy[::-1]), body), STEPS).layer.alpha
    assert_allclose(moved, np.roll(alpha, shift[::-1], axis=(0, 1)), atol=1e-12)
    assert_allclose(reverse, alpha, atol=1e-12)


@pytest.mark.parametrize("body", [BODIES["two paints"][0], BODIES["sheet"][0]])
def test_path_may_leave_the_picture(plate, body):
    path = Trajectory.line((-20, 30), (90, 90))
    wide = np.pad(plate, [(40, 40), (40, 40), (0, 0)])
    cut = render(Scene(plate, path, body), STEPS).layer
    whole = render(Scene(wide, replace(path, xy=path.xy + 40), body), STEPS).layer
    assert_allclose(cut.alpha, whole.alpha[40:-40, 40:-40], atol=1e-12)
    assert_allclose(cut.premultiplied, whole.premultiplied[40:-40, 40:-40], atol=1e-12)


def test_same_scene_same_bytes(plate):
    scene = Scene(plate, Trajectory.arc((25, 40), (45, 30), (65, 44)), BODIES["glossy"][0])
    assert render(scene, STEPS).image.rgb.tobytes() == render(scene, STEPS).image.rgb.tobytes()


@pytest.mark.parametrize("cores", [1, 7])
def test_same_scene_same_bytes_on_any_number_of_threads(plate, cores, monkeypatch):
    path = Trajectory.arc((25, 40), (45, 30), (65, 44))
    scene = Scene(plate, path, BODIES["glossy"][0], shadow=Shadow((9, 5)), defocus=1.5)
    first = render(scene).image.rgb.tobytes()
    monkeypatch.setattr("os.cpu_count", lambda: cores)
    assert render(scene).image.rgb.tobytes() == first


def test_sum_of_alpha_of_a_growing_ball_is_its_mean_area(plate):
    scene = Scene(
        plate, Trajectory.line((35, 36), (60, 36)), Ball(6, ORANGE), Change(scale=(0.5, 2))
    )
    average = np.pi * 6**2 * (0.5**2 + 0.5 * 2 + 2**2) / 3  # of π (6 s)², s even in 0.5…2
    assert_allclose(render(scene).layer.alpha.sum(), average, rtol=1e-4)


def test_squash_preserves_the_area(plate):
    change = Change(squash=(1.6, 0.7), squash_angle=0.4)
    scene = Scene(plate, Trajectory.line((35, 36), (60, 36)), Ball(8, ORANGE), change)
    assert_allclose(render(scene).layer.alpha.sum(), np.pi * 64, rtol=1e-6)


def test_a_stick_that_turns_in_place_covers_each_ring_for_the_share_of_its_width(plate):
    """At distance ρ a stick of half width b covers 4 asin(b / ρ) of each turn of 2π."""
    stick = Sheet(50, 4, ORANGE)
    scene = Scene(plate, Trajectory.line((48, 36), (48, 36)), stick, Change(spin=(0, 0, 2 * np.pi)))
    alpha = render(scene).layer.alpha
    y, x = np.indices(alpha.shape)
    rho = np.hypot(x - 48, y - 36)
    ring = (rho > 10) & (rho < 23)
    assert_allclose(alpha[ring], 4 * np.arcsin(2 / rho[ring]) / (2 * np.pi), rtol=0.01)


def test_opacity_scales_alpha_and_light(plate):
    path = Trajectory.line((25, 30), (65, 44))
    whole, thin = (
        render(Scene(plate, path, BODIES["shaded"][0], opacity=o), STEPS).layer for o in (1, 0.3)
    )
    assert_allclose(thin.alpha, 0.3 * whole.alpha, atol=1e-15)
    assert_allclose(thin.premultiplied, 0.3 * whole.premultiplied, atol=1e-15)


def test_defocus_is_a_mean_over_a_disc(plate):
    path, radius, n = Trajectory.line((30, 30), (34, 31)), 3.4, 31
    sharp, soft = (
        render(Scene(plate, path, BODIES["glossy"][0], defocus=d), 8).layer for d in (0, radius)
    )
    # Oracle: shift the disc's own points, n across, to whole pixels; a coarse mean.
    offsets = radius * (2 * np.arange(n) + 1 - n) / n
    discs = [(u, v) for u in offsets for v in offsets if u**2 + v**2 < radius**2]
    mean = np.zeros_like(sharp.alpha)
    for u, v in discs:
        mean += np.roll(sharp.alpha, (round(v), round(u)), axis=(0, 1)) / len(discs)
    assert_allclose(soft.alpha, mean, atol=0.01)
    assert_allclose(soft.alpha.sum(), sharp.alpha.sum(), rtol=1e-12)
    assert_allclose(soft.premultiplied.sum(), sharp.premultiplied.sum(), rtol=1e-12)


def test_trapezoid_shutter_weights_time(plate):
    """A narrow sheet on an even path is a clock: alpha along it is the shutter's opening."""
    ramp, path = 0.25, Trajectory.line((18, 36), (78, 36))
    alpha = render(Scene(plate, path, Sheet(1, 9, ORANGE), shutter_ramp=ramp)).layer.alpha
    t = (np.arange(96) - 18) / 60
    opening = np.clip(np.minimum(t, 1 - t) / ramp, 0, 1) / (1 - ramp) / 60
    inner = np.abs(t - 0.5) < 0.5 - 1.5 / 60
    corners = np.minimum(np.abs(t - ramp), np.abs(t - 1 + ramp)) < 1.5 / 60
    assert_allclose(alpha[36][inner & ~corners], opening[inner & ~corners], atol=1e-4)
    assert_allclose(alpha.sum(), 9, rtol=1e-12)


def test_shadow_removes_light_where_the_body_is_not(plate):
    strength = np.array([0.6, 0.4, 0.1])
    path = Trajectory.line((25, 30), (45, 30))
    far = Shadow((20, 25), softness=1.5, strength=strength)
    truth = render(Scene(plate, path, Ball(6, ORANGE), shadow=far))
    dark = truth.shadow.sum(axis=(0, 1))
    assert_allclose(dark, np.pi * 36 * strength, rtol=1e-3)  # apart: all of it is seen
    remains = 1 - truth.layer.alpha[..., None] - truth.shadow
    assert_allclose(
        truth.image.rgb, truth.layer.premultiplied + remains * plate, rtol=0, atol=1e-14
    )
    y, x = np.indices(truth.layer.alpha.shape)
    assert_allclose(np.average(x, weights=truth.shadow[..., 0]), 35 + 20, atol=0.01)
    assert_allclose(np.average(y, weights=truth.shadow[..., 0]), 30 + 25, atol=0.01)


def test_body_hides_its_own_shadow(plate):
    still = Trajectory.line((40, 36), (40, 36))
    hidden = Shadow((0, 0), softness=0, strength=(1, 1, 1))
    truth = render(Scene(plate, still, Ball(9, ORANGE), shadow=hidden), STEPS)
    assert_allclose(truth.shadow[36, 40], 0, atol=1e-12)
    assert np.all(truth.shadow[truth.layer.alpha == 0] == 0)


def test_an_occluder_hides_body_and_plate(plate):
    fence = wire_fence(SIZE, 14, 3, (0.2, 0.2, 0.25))
    path = Trajectory.line((25, 30), (65, 44))
    free = render(Scene(plate, path, BODIES["shaded"][0]), STEPS)
    behind = render(Scene(plate, path, BODIES["shaded"][0], occluder=fence), STEPS)
    wire = fence.alpha == 1
    assert 0.1 < wire.mean() < 0.6
    assert_array_equal(behind.layer.alpha[wire], 0)
    assert_array_equal(behind.image.rgb[wire], behind.plate.rgb[wire])
    assert_array_equal(behind.layer.alpha[~wire], free.layer.alpha[~wire])
    assert_array_equal(behind.image.rgb[~wire], free.image.rgb[~wire])


def test_the_layer_is_the_mean_of_its_subframes(plate):
    change = Change(spin=(0, 0, 1), scale=(1, 1.5))
    path = Trajectory.line((25, 30), (65, 44))
    truth = render(Scene(plate, path, Sheet(13, 6, ORANGE), change, opacity=0.8), substeps=6)
    frames = truth.subframes(6)
    assert_allclose(np.mean([f.alpha for f in frames], axis=0), truth.layer.alpha, atol=1e-14)
    light = np.mean([f.premultiplied for f in frames], axis=0)
    assert_allclose(light, truth.layer.premultiplied, atol=1e-14)


def test_frames_without_a_gap_sum_up_to_the_whole_exposure(plate):
    change = Change(turned=(0, 0, 0.3), spin=(0, 0, 2), scale=(1, 1.4), squash=(1, 1.2))
    path = Trajectory.arc((25, 40), (45, 30), (65, 44))
    scene = Scene(plate, path, Sheet(13, 6, ORANGE), change)
    frames = [render(part).layer.alpha for part in scene.exposures(3, duty=1)]
    assert_allclose(np.mean(frames, axis=0), render(scene).layer.alpha, atol=2e-4)


def test_gap_omits_the_path_between_frames(plate):
    scene = Scene(plate, Trajectory.line((12, 36), (84, 36)), Ball(4, ORANGE))
    parts = scene.exposures(3, duty=0.5)
    assert_allclose(parts[1].trajectory.xy, [(36, 36), (48, 36)], atol=1e-12)
    alpha = render(parts[0]).layer.alpha
    assert alpha[36, 15] > 0.3
    assert alpha[36, 30:].max() == 0


def test_repr_is_one_line(plate):
    scene = Scene(plate, Trajectory.line((25, 30), (65, 44)), BODIES["glossy"][0])
    assert repr(render(scene, 3)).startswith("Rendering(Layer(96x72")
    assert "\n" not in repr(render(scene, 3))


def test_rejects_wrong_arguments(plate):
    path = Trajectory.line((25, 30), (65, 44))
    with pytest.raises(ValueError, match="substeps must be 1 or more"):
        render(Scene(plate, path, Sheet(4, 4, ORANGE)), substeps=0)


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


@pytest.mark.parametrize("name", FILTERED)
def test_sums_are_preserved(name):
    """Nearly: windows around all pixels do not add up to a constant, but their waves average out."""
    box, wide = (
        FILTERED[name].sharp(X, Y, POSE),
        filtered_body(FILTERED[name], X, Y, POSE, 2.4),
    )
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


@pytest.mark.parametrize("name", FILTERED)
def test_a_body_of_one_color_keeps_it(name):
    body = Ball(5, ORANGE, ambient=1) if name == "ball" else FILTERED[name]
    if name == "cube":
        body = Cube(7, ORANGE, ambient=1)
    coverage, light = filtered_body(body, X, Y, POSE, 1.8)
    assert_allclose(light, coverage[..., None] * ORANGE, atol=1e-9)


def test_coverage_agrees_with_weighted_points():
    coverage, _ = filtered_body(FILTERED["ball"], X, Y, POSE, 2.0)
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
def test_filtered_image_is_the_layer_over_the_plate(width):
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


def test_rejects_wrong_filters():
    scene = (colorful_plate((20, 20), 1), Trajectory.line((5, 5), (9, 9)), Ball(3, ORANGE))
    for wrong in (-1, np.nan):
        with pytest.raises(ValueError, match="pixel_filter must be finite and not negative"):
            Scene(*scene, pixel_filter=wrong)
