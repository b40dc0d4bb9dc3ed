"""register_frames, and plate, parallax and refusals of a camera that moves."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.ndimage import gaussian_filter
from tests.handheld import STRAIGHT, fine_scene, noisy, shown, similarity

from blurmatte.background import parallax_between
from blurmatte.background.parallax import camera_path
from blurmatte.background.plate import make_plate
from blurmatte.background.registration import CameraPath, register_frames, show_one_scene
from blurmatte.background.warp import PixelGrid, Warp, composed, inverse
from blurmatte.errors import PlateError
from blurmatte.explain import explain
from blurmatte.radiometry import LinearImage
from blurmatte.rendering.plates import textured_plate

SIZE = (192, 120)
SHAKEN = [
    similarity(SIZE, *at, zoom, turn)
    for at, zoom, turn in (
        ((0, 0), 1, 0),
        ((19, -17), 1.01, 0.01),
        ((-20, 12), 1, -0.012),
        ((4, 20), 0.985, 0),
        ((-9.3, -6.7), 1.015, 0.006),
    )
]

STRAIGHT_ONES = (STRAIGHT,) * len(SHAKEN)


@pytest.fixture(scope="module")
def points():
    return fine_scene((300, 200))


@pytest.fixture(scope="module")
def shaken(points):
    return [noisy(shown(points, SIZE, h), k) for k, h in enumerate(SHAKEN)]


@pytest.fixture(scope="module")
def fit(shaken):
    return make_plate(shaken)


def errors(path, views, lens=0.0, bends=STRAIGHT_ONES):
    """(n,) root mean square error of the places that each frame shows, pixels."""
    x, y = np.meshgrid(np.linspace(0, SIZE[0] - 1, 6), np.linspace(0, SIZE[1] - 1, 4))
    xy, back = np.stack([x, y], axis=-1).reshape(-1, 2), inverse(views[path.reference])
    warps = (Warp(composed(h, back), SIZE, lens) for h in views)
    true = [replace(how, bends=c).points(xy) for how, c in zip(warps, bends, strict=False)]
    found = [view.points(xy) for view in path.views]
    return [float(np.sqrt(np.mean((a - b) ** 2))) for a, b in zip(found, true, strict=True)]


def test_places_of_a_camera_that_shakes_by_20_pixels_are_found_to_a_twentieth_of_a_pixel(fit):
    # exact
    path = fit.camera
    assert path.lens == 0
    assert path.reference == 2
    assert max(errors(path, SHAKEN)) < 0.05


def test_what_moves_in_the_scene_does_not_move_the_camera(points):
    # invariant
    views = [similarity(SIZE, 7 * k, -4 * k) for k in range(4)]
    frames = [noisy(shown(points, SIZE, h), k) for k, h in enumerate(views)]
    for k, frame in enumerate(frames):  # a tenth of the picture
        frame.rgb[30 + 8 * k : 70 + 8 * k, 30 + 20 * k : 85 + 20 * k] = (0.5, 0.2, 0.1)
    assert max(errors(register_frames(frames), views)) < 0.05


def test_exposure_and_white_balance_may_change_from_frame_to_frame(shaken):
    # invariant
    gains = np.random.default_rng(1).uniform(0.8, 1.2, (len(shaken), 3))
    frames = [LinearImage(f.rgb * g.astype(np.float32)) for f, g in zip(shaken, gains, strict=True)]
    assert max(errors(register_frames(frames), SHAKEN)) < 0.05


def test_lens_of_a_pan_is_found(points):
    # exact
    views = [similarity(SIZE, x) for x in (-32, 0, 32)]
    frames = [noisy(shown(points, SIZE, h, -0.05), k) for k, h in enumerate(views)]
    path = register_frames(frames)
    assert path.lens == pytest.approx(-0.05, abs=0.015)
    assert max(errors(path, views, -0.05)) < 0.3


def test_bends_by_a_rolling_shutter_are_found(points):
    # exact: a homography alone is .34 pixels off
    bends = [
        np.array([c, (0, 0)]) for c in ((0, 0), (0.015, 0), (0, -0.015), (-0.01, 0.01), (0, 0))
    ]
    frames = [
        noisy(shown(points, SIZE, h, bends=c), k)
        for k, (h, c) in enumerate(zip(SHAKEN, bends, strict=True))
    ]
    path = register_frames(frames)
    assert max(errors(path, SHAKEN, bends=bends)) < 0.1
    assert not path.view(0).bends.any()
    assert all(path.view(k).bends.any() for k in (1, 2, 3))


def test_rows_of_bent_frames_are_read_at_other_times():
    # exact
    views = [Warp(similarity(SIZE, 0, y), SIZE) for y in (0, 12, 0)]
    still = CameraPath(SIZE, tuple(views), PixelGrid(SIZE))
    bent = replace(views[1], bends=np.array([(0.01, 0), (0, 0)]))
    path = replace(still, views=(views[0], bent, views[2]))
    assert still.delay_std == 0
    assert path.delay_std == pytest.approx(12 / SIZE[1] / np.sqrt(3), rel=1e-2)


def test_frames_of_a_zoom_are_displaced_at_their_corners():
    # exact: its center stays where it is
    views = tuple(Warp(similarity(SIZE, zoom=zoom), SIZE) for zoom in (0.99, 1.0, 1.01))
    far = np.hypot(*(np.array(SIZE) - 1)) / 2
    assert CameraPath(SIZE, views, PixelGrid(SIZE), 1).reach == pytest.approx(0.01 * far)
    assert CameraPath(SIZE, views, PixelGrid(SIZE), 0).reach == pytest.approx(0.02 * far)


def test_plate_holds_all_that_the_frames_show_within_its_error(points, fit):
    # honest
    canvas = fit.camera.canvas
    assert all(large > small for large, small in zip(fit.plate.size, SIZE, strict=True))
    h = SHAKEN[fit.camera.reference]
    for h_true, k in ((h, fit.camera.reference), (SHAKEN[0], 0)):
        seen = fit.camera.plate_at(k, fit.plate)
        assert seen.valid.mean() > 0.85
        z = (seen.rgb - shown(points, SIZE, h_true))[seen.valid] / np.sqrt(seen.noise[seen.valid])
        assert 0.8 < np.sqrt(np.mean(z**2)) < 1.25
        assert np.mean(np.abs(z) < 3) > 0.95
    x, y = canvas.origin
    assert not fit.plate.valid[0, 0]
    assert min(x, y) < 0


def test_places_on_the_canvas_and_in_a_frame_are_inverse(fit):
    # exact
    xy = np.array([[3.0, 5.0], [150.0, 100.0]])
    assert_allclose(fit.camera.to_frame(1, fit.camera.to_canvas(1, xy)), xy, atol=1e-9)


def test_words_state_the_motion_and_the_frames_that_are_not_registered(shaken):
    # door
    other = LinearImage(shaken[0].rgb[::-1, ::-1])
    fog = LinearImage(np.full_like(shaken[0].rgb, shaken[0].rgb.mean()))
    fit = make_plate([*shaken[:2], other, *shaken[2:4], fog])
    assert [k for k, _ in fit.camera.unregistered] == [2, 5]
    said = " ".join(explain(fit))
    assert "The camera moves: 4 of 6 frames are registered to frame 3" in said
    assert "Frame 2 is not registered: it does not look like the frames before" in said
    assert "Frame 5 is not registered: it shows nothing: its light is even" in said
    with pytest.raises(PlateError, match="the camera moved, and the frame is not registered"):
        fit.camera.plate_at(2, fit.plate)


def test_frames_of_different_scenes_are_refused(shaken):
    # door
    others = [
        noisy(shown(fine_scene((200, 130), seed, tile=12), SIZE, SHAKEN[0]), seed)
        for seed in (5, 6, 7, 8)
    ]
    with pytest.raises(PlateError, match="only 1 of 4 frames show one scene from one place"):
        register_frames(others)
    assert show_one_scene(*shaken[:2])
    assert not show_one_scene(*others[:2])


def test_frames_are_registered_to_a_plate_that_was_given(shaken, fit):
    # oracle
    path = camera_path(shaken[:2], fit.plate)
    xy = np.array([[20.0, 30.0], [170.0, 100.0]])
    for k in range(2):
        assert_allclose(path.to_canvas(k, xy), fit.camera.to_canvas(k, xy), atol=0.05)


@pytest.mark.battery
def test_parallax_is_where_another_depth_is():
    # exact
    size, whole = (320, 180), (440, 220)
    far_points = fine_scene(whole)
    near_points = textured_plate(tuple(3 * side for side in whole), 8)
    near_points = gaussian_filter(near_points, (1.8, 1.8, 0))
    column = np.zeros((*near_points.shape[:2], 1))
    column[:, 780:900] = 1  # x from 200 to 240 in a frame in the middle
    frames = []
    for k, x in enumerate(np.linspace(-30, 30, 6)):
        far, near = similarity(size, x), similarity(size, 1.12 * x)
        mask = shown(column, size, near)
        light = (1 - mask) * shown(far_points, size, far) + mask * shown(near_points, size, near)
        frames.append(noisy(light, k))
    path = camera_path(frames)
    (region,) = path.parallax
    x0, _, x1, _ = region.box
    assert 1.0 < region.shift < 1.9  # 0.12 times 12 pixels between two frames
    first = -path.canvas.origin[0]
    assert first + 200 - 42 <= x0 < x1 <= first + 240 + 42


def test_scene_without_depth_has_no_parallax(fit, shaken):
    assert fit.camera.parallax == ()
    seen = fit.camera.plate_at(0, fit.plate)
    assert parallax_between(shaken[0], seen) == []


def test_a_frame_of_noise_alone_shows_nothing(shaken):
    """door"""
    fog = noisy(np.full_like(shaken[0].rgb, np.median(shaken[0].rgb)), 7)
    ((number, why),) = make_plate([*shaken[:4], fog]).camera.unregistered
    assert number == 4
    assert why == "it shows nothing: its light is even"


def test_one_shifted_shot_of_two_is_no_parallax(fit, shaken):
    """exact: the light on which most shots agree is not shifted; of both, and of one alone, it is."""
    seen = fit.camera.plate_at(0, fit.plate)
    rgb = seen.rgb.copy()
    rgb[64:] = np.roll(rgb[64:], 4, axis=1)
    shifted = replace(seen, rgb=rgb)
    assert parallax_between(shaken[0], shifted, seen) == []
    for shots in ([shifted], [shifted, shifted]):
        (region,) = parallax_between(shaken[0], *shots)
        assert region.box[1] == 64
        assert_allclose(region.shift, 4, atol=0.1)
