"""fit_sweep: from two pictures to path, shape and color, and how honest their errors are."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from blurmatte.sweep.attempt import Attempt
from numpy.testing import assert_allclose
from scipy.ndimage import gaussian_filter

from blurmatte.background import make_plate
from blurmatte.color import ColorModel
from blurmatte.errors import MotionError
from blurmatte.files import read, read_frames, write_frames
from blurmatte.radiometry import LinearImage, NoiseModel, with_noise
from blurmatte.rendering import (
    Ball,
    Camera,
    Change,
    Scene,
    Sheet,
    Shot,
    colorful_plate,
    plain_plate,
    render,
    textured_plate,
    two_hue_plate,
)
from blurmatte.streaks import Streak, find_streaks, require_streaks
from blurmatte.sweep import MAX_MISFIT, Sweep, fit_piece, fit_sweep
from blurmatte.sweep.fit.multistart import Search
from blurmatte.sweep.model.silhouette import Silhouette
from blurmatte.trajectory import Trajectory

SIZE = (160, 112)
GREEN = np.array([0.25, 0.7, 0.12])
OFF_GREEN = np.array([0.35, 0.6, 0.17])
ORANGE = np.array([0.9, 0.5, 0.1])
WALL = plain_plate(SIZE, (0.34, 0.33, 0.3), 4)
TILES = colorful_plate(SIZE, 2, tile=20)
LINE = Trajectory.line((44, 42), (112, 68))
WAYS = {
    "line": LINE,
    "arc": Trajectory.arc((36, 70), (80, 34), (122, 72)),
    "bounce": Trajectory.bounce((36, 36), (84, 84), (126, 50), 0.55),
    "from rest": Trajectory.from_rest((40, 40), (112, 70), 0.4),
}
BALL = Scene(WALL, LINE, Ball(11, GREEN))
TIMES = np.linspace(0, 1, 65)
CAMERA = Camera(code_std=1.5 / 255)


@cache
def rendered(scene):
    return render(scene, 160)


def taken(scene, seed=0):
    """The truth, image and plate of a scene."""
    shot = Shot(scene, CAMERA, plate_frames=3, seed=seed)
    truth = rendered(scene)
    return truth, *shot.photograph(truth)


def rmse(sweep, truth):
    true = truth.layer.alpha
    return np.sqrt(np.mean((sweep.alpha - true)[true > 0] ** 2))


def degrees_between(sweep, truth):
    """The largest angle from the colors of the one to those of the other."""
    basis = truth.model.basis
    off = basis - sweep.model.basis @ (sweep.model.basis.T @ basis)
    return np.degrees(np.arcsin(min(np.linalg.norm(off, 2), 1)))


def path_error(sweep, truth):
    """The largest distance from the true path, in the direction of time that fits better."""
    found, true = sweep.trajectory.at(TIMES), truth.trajectory.at(TIMES)
    return min(np.linalg.norm(found - way, axis=1).max() for way in (true, true[::-1]))


@pytest.fixture(scope="module")
def ball():
    truth, image, plate = taken(BALL)
    return truth, image, plate, fit_sweep(image, plate)


@pytest.mark.parametrize(
    ("way", "plate"),
    [
        ("line", TILES),
        ("arc", TILES),
        ("bounce", WALL),
        ("from rest", TILES),
    ],
    ids=["line, tiles", "arc, tiles", "bounce, wall", "from rest, tiles"],
)
def test_path_radius_and_color(way, plate):
    truth, image, picture = taken(Scene(plate, WAYS[way], Ball(11, GREEN)))
    sweep = fit_sweep(image, picture)
    assert sweep.family.name == way or way == "line"  # others hold the line
    assert sweep.silhouette.name == "disc"
    assert path_error(sweep, truth) < 1
    assert abs(sweep.radius - 11) < max(4 * sweep.radius_std, 0.03) < 0.3
    assert degrees_between(sweep, truth) < 1
    assert rmse(sweep, truth) < 0.005
    assert sweep.misfit < 1.3
    assert sweep.stats["doubtful"] < 0.01


@pytest.mark.parametrize("plate", [WALL, TILES], ids=["wall", "tiles"])
def test_a_short_path_that_leaves_an_opaque_middle(plate):
    truth, image, picture = taken(
        Scene(plate, Trajectory.line((74, 52), (86, 58)), Ball(13, GREEN))
    )
    assert truth.layer.alpha.max() > 0.999
    sweep = fit_sweep(image, picture)
    assert rmse(sweep, truth) < 0.005
    assert path_error(sweep, truth) < 0.3
    assert sweep.misfit < MAX_MISFIT


def test_a_faint_long_streak():
    way = Trajectory.line((14, 20), (130, 34))
    truth, image, picture = taken(Scene(WALL[:56, :144], way, Ball(3.6, ORANGE)))
    assert truth.layer.alpha.max() < 0.065
    sweep = fit_sweep(image, picture, Streak(truth.layer.alpha > 0))
    assert rmse(sweep, truth) < 0.006
    assert sweep.misfit < MAX_MISFIT


def test_a_small_ball_in_a_large_picture(monkeypatch):
    """Honest: what is found in cells of four pixels is much wider than the ball."""
    monkeypatch.setattr("blurmatte.streaks.find._MAX_CELLS", SIZE[0] * SIZE[1] / 16)
    way = Trajectory.line((66, 48), (90, 60))
    truth, image, plate = taken(Scene(TILES, way, Ball(3, GREEN)))
    streak = require_streaks(*with_noise(image, plate))[0]
    assert streak.cell == 4
    sweep = fit_sweep(image, plate, streak)
    assert sweep.misfit <= MAX_MISFIT
    assert rmse(sweep, truth) < 0.01
    assert abs(sweep.radius - 3) < 3 * sweep.radius_std < 0.3


@pytest.mark.parametrize("plate", [WALL, TILES], ids=["wall", "tiles"])
def test_an_object_that_leaves_the_picture(plate):
    way = Trajectory.line((108, 42), (165, 62))
    truth, image, picture = taken(Scene(plate, way, Ball(11, GREEN)))
    sweep = fit_sweep(image, picture)
    assert rmse(sweep, truth) < 0.01
    assert sweep.misfit < MAX_MISFIT
    assert sweep.alpha.shape == truth.layer.alpha.shape
    assert sweep.box[2] == SIZE[0]


FILE = Camera(code_std=1.5 / 255, jpeg_quality=90, chroma="4:2:0")


@pytest.mark.parametrize("told", [True, False], ids=["file says how", "nobody knows"])
@pytest.mark.parametrize("plate", [WALL, TILES], ids=["wall", "tiles"])
def test_a_file_that_blurs_colors_leaves_a_sharp_disc(plate, told):
    """Honest: rims seem soft, but alpha is not, and no other outline stands for it."""
    scene = Scene(plate, LINE, Ball(13, GREEN))
    truth = taken(scene)[0]
    for seed in range(3):
        image, picture = with_noise(*Shot(scene, FILE, seed=seed).photograph(truth))
        if not told:
            image = replace(image, meta=replace(image.meta, compression=None))
        sweep = fit_sweep(image, picture)
        assert (sweep.stats["rim"] > 0.5) != told
        assert sweep.silhouette == Silhouette(1)
        assert sweep.misfit < MAX_MISFIT
        assert rmse(sweep, truth) < 0.015
        assert abs(sweep.radius - 13) < max(4 * sweep.radius_std, 0.1)


@pytest.mark.parametrize("plate", [WALL, TILES], ids=["wall", "tiles"])
def test_colors_that_pixels_share_move_no_rim(plate):
    """Honest: without compression noise is that of single pixels, but for color."""
    scene = Scene(plate, LINE, Ball(13, GREEN))
    truth = taken(scene)[0]
    camera = Camera(code_std=1.5 / 255, chroma="4:2:0")
    sweep = fit_sweep(*with_noise(*Shot(scene, camera).photograph(truth)))
    assert sweep.silhouette == Silhouette(1)
    assert rmse(sweep, truth) < 0.006
    assert abs(sweep.radius - 13) < 2.5 * sweep.radius_std < 0.3


def test_a_lens_that_blurs_makes_a_soft_alpha(ball):
    truth, _, _, sharp = ball
    assert sharp.stats["rim"] == 0
    noise = np.random.default_rng(1).normal(0, 0.004, (2, *truth.image.rgb.shape))
    seen, empty = (
        LinearImage(gaussian_filter(light, (1.3, 1.3, 0)) + off, np.full(light.shape, 0.004**2))
        for light, off in zip((truth.image.rgb, truth.plate.rgb), noise, strict=True)
    )
    sweep = fit_sweep(seen, empty, Streak(truth.layer.alpha > 0))
    assert sweep.silhouette == Silhouette(1, soft=True)
    assert_allclose(sweep.stats["rim"], 1.3, atol=0.15)
    assert abs(sweep.radius - 11) < max(4 * sweep.radius_std, 0.05)
    blurred = gaussian_filter(truth.layer.alpha, 1.3)
    assert np.sqrt(np.mean((sweep.alpha - blurred)[blurred > 0.001] ** 2)) < 0.005


@pytest.mark.parametrize("quality", [None, 90])
def test_a_ball_out_of_focus_has_a_soft_alpha_in_every_file(quality):
    """Oracle, but for the lens: its blur is a disc's, not a normal distribution's."""
    scene = Scene(TILES, LINE, Ball(18, GREEN), defocus=7)
    truth, camera = taken(scene)[0], Camera(code_std=1.5 / 255, jpeg_quality=quality)
    sweep = fit_sweep(*with_noise(*Shot(scene, camera).photograph(truth)))
    assert sweep.silhouette == Silhouette(1, soft=True, defocused=True)
    assert_allclose(sweep.softness, 7 / 2, rtol=0.15)
    assert_allclose(sweep.radius, 18, rtol=0.02)
    assert sweep.misfit <= MAX_MISFIT
    assert rmse(sweep, truth) < 0.015


def test_two_paints():
    body = Ball(13, GREEN, second_color=np.array([0.7, 0.3, 0.1]))
    truth, image, picture = taken(Scene(TILES, LINE, body, Change(spin=(1.0, 0.5, 0.8))))
    sweep = fit_sweep(image, picture)
    assert sweep.model.rank == 2
    assert degrees_between(sweep, truth) < 3
    assert rmse(sweep, truth) < 0.02
    assert sweep.misfit < MAX_MISFIT


def test_a_large_ball_in_a_jpeg_file():
    """Honest: on pixels of several of the file's, the noise of which hangs together."""
    plate = colorful_plate((640, 480), 2, tile=60)
    scene = Scene(plate, Trajectory.line((230, 210), (420, 260)), Ball(95, (0.25, 0.7, 0.12)))
    truth, shot = render(scene, 300), Shot(scene, FILE, plate_frames=5, seed=2)
    sweep = fit_sweep(*shot.photograph(truth))
    assert sweep.misfit <= MAX_MISFIT
    assert rmse(sweep, truth) < 0.005
    assert abs(sweep.radius - 95) < 3 * sweep.radius_std < 1.5


def in_jpeg(scene, seed):
    """The truth of a scene, and what is found in its compressed pictures."""
    shot = Shot(scene, Camera(code_std=2 / 255, jpeg_quality=90), plate_frames=5, seed=seed)
    truth = rendered(scene)
    return truth, fit_sweep(*shot.photograph(truth))


@pytest.mark.parametrize(
    ("quality", "seed"),
    [
        (95, 3),
        pytest.param(95, 6, marks=pytest.mark.battery),
        pytest.param(85, 6, marks=pytest.mark.battery),
    ],
)
def test_compression_before_a_plain_wall_is_no_shadow_no_second_paint_and_no_bounce(quality, seed):
    """Honest: noise of this wall hangs together, and more of it in brightness than in some color."""
    rng = np.random.default_rng(seed)
    angle, middle = rng.uniform(0, np.pi), np.array([128, 96]) + rng.uniform(-10, 10, 2)
    half = 20 * np.array([np.cos(angle), np.sin(angle)])
    way, body = Trajectory.line(middle - half, middle + half), Ball(10, (0.8, 0.35, 0.06))
    truth = render(Scene(plain_plate((256, 192), (0.3, 0.33, 0.36), seed), way, body))
    camera = Camera(code_std=1 / 255, jpeg_quality=quality, chroma="4:2:0")
    shot = Shot(truth.scene, camera, plate_frames=5, seed=seed)
    sweep = fit_sweep(*shot.photograph(truth))
    assert sweep.misfit <= MAX_MISFIT
    assert (sweep.model.rank, sweep.family.name) == (1, "line")
    assert abs(sweep.radius - 10) < 0.2
    assert rmse(sweep, truth) < 0.02


def test_a_second_paint_of_which_compression_leaves_little_is_asked_for():
    """Honest: one paint leaves no more than noise there, and another alpha (0.045 off)."""
    body = Ball(9, (0.58, 0.56, 0.2), second_color=(0.15, 0.65, 0.61))
    way = Trajectory.line((60, 50), (100, 66))
    truth, sweep = in_jpeg(Scene(TILES, way, body), 2)
    assert sweep.model.rank == 2
    assert rmse(sweep, truth) < 0.02


@pytest.mark.battery
def test_a_darker_paint_is_no_shadow():
    """Honest: what is darker is most of the ball; without it the rest seems a smaller one."""
    body = Ball(16, (0.27, 0.1, 0.65), second_color=(0.45, 0.52, 0.2))
    plate = two_hue_plate((200, 120), (0.45, 0.40, 0.36), (0.10, 0.22, 0.40), 2)
    truth, sweep = in_jpeg(Scene(plate, Trajectory.line((60, 68), (140, 50)), body), 2)
    assert sweep.model.rank == 2
    assert sweep.misfit < MAX_MISFIT
    assert rmse(sweep, truth) < 0.02


@pytest.mark.battery
def test_a_second_paint_is_looked_for_where_the_first_saw_a_shadow():
    """Honest: without what is dark for one paint too little is left to tell two of a small ball."""
    body = Ball(10.5, (0.41, 0.12, 0.27), second_color=(0.55, 0.57, 0.11))
    way = Trajectory.line((46.6, 51.7), (50.4, 44.9))
    scene = Scene(plain_plate((96, 96), (0.3, 0.33, 0.36), 0), way, body)
    truth = rendered(scene)
    shot = Shot(scene, Camera(code_std=2 / 255), plate_frames=5)
    sweep = fit_sweep(*shot.photograph(truth))
    assert sweep.model.rank == 2
    assert sweep.misfit <= MAX_MISFIT
    assert rmse(sweep, truth) < 0.01


@pytest.mark.battery
@pytest.mark.parametrize("seed", [0, 1])
def test_of_any_colors_nothing_is_in_front(seed):
    """Honest: where its paints are like the plate's, something in front seemed to hide half of it."""
    colors = np.random.default_rng(seed).uniform(0.05, 0.9, (4, 8, 3))
    body = Ball(13.2, np.ones(3), texture=np.kron(colors, np.ones((8, 8, 1))))
    way = Trajectory.line((58, 44.5), (54, 51.5))
    scene = Scene(textured_plate((112, 96), seed), way, body, Change(spin=(-0.3, 0.3, 0)))
    shot = Shot(scene, Camera(code_std=2 / 255), plate_frames=5, seed=seed)
    truth = render(scene)
    sweep = fit_sweep(*shot.photograph(truth))
    assert sweep.model.rank == 3
    assert sweep.misfit <= MAX_MISFIT
    assert rmse(sweep, truth) < 0.03
    assert abs(sweep.radius - 13.2) < 0.2


@pytest.mark.battery
def test_what_is_dark_for_one_paint_is_the_second():
    """Honest: without the "shadow" that the first saw the rest went another way, and was no answer."""
    body = Ball(37.5, (0.438, 0.49, 0.065), second_color=(0.03, 0.403, 0.387))
    way = Trajectory.line((240.63, 131.46), (145.07, 163.1))
    scene = Scene(textured_plate((384, 288), 593645626), way, body)
    camera = Camera(code_std=2 / 255, jpeg_quality=90, chroma="4:2:0")
    truth = render(scene)
    image, picture = Shot(scene, camera, plate_frames=5, seed=464).photograph(truth)
    image = replace(image, meta=replace(image.meta, compression=None))
    sweep = fit_sweep(image, picture)
    assert sweep.model.rank == 2
    assert sweep.misfit <= MAX_MISFIT
    assert rmse(sweep, truth) < 0.02


def test_another_shape_is_found_too():
    egg = Scene(WALL, LINE, Ball(12, GREEN), Change(squash=(1.5, 1.5), squash_angle=0.9))
    truth, image, picture = taken(egg)
    sweep = fit_sweep(image, picture)
    assert sweep.silhouette.name == "ellipse"
    assert rmse(sweep, truth) < 0.01
    assert abs(sweep.radius - 12) < 4 * sweep.radius_std
    reach = np.linalg.norm(sweep.outline, axis=1)
    assert_allclose([reach.max(), reach.min()], [18, 8], rtol=0.03)


def test_what_cannot_be_explained_is_not_believed():
    """A sheet that turns about an axis in the picture: no outline is seen all the time."""
    way = Trajectory.line((60, 50), (100, 60))
    sheet = Scene(WALL, way, Sheet(24, 14, GREEN), Change(spin=(0.0, 3.0, 0.0)))
    _, image, picture = taken(sheet)
    assert fit_sweep(image, picture).misfit > MAX_MISFIT


@pytest.mark.battery
def test_a_sheet_that_goes_along_its_side_may_be_long_or_have_gone_far():
    """Before one color both leave the same trapezoid; before many the color tells which it was."""
    sheet = Sheet(32, 14, GREEN)
    way = Trajectory.line((52, 52), (106, 52))
    for plate, tells in ((WALL, False), (TILES, True)):
        truth, image, picture = taken(Scene(plate, way, sheet))
        sweep = fit_sweep(image, picture)
        assert sweep.stats["contested"] is not tells
        assert (sweep.misfit <= MAX_MISFIT) is tells
        words = sweep.complaint(MAX_MISFIT)
        assert words.startswith("two shapes") is not tells
        if tells:
            assert rmse(sweep, truth) < 0.05


@pytest.mark.parametrize("seed", [0, pytest.param(3, marks=pytest.mark.battery)])
def test_a_small_sheet_that_went_little_is_no_disc_that_went_far(seed):
    """Honest: in a JPEG a disc across it leaves no more than noise."""
    rng = np.random.default_rng(seed)
    angle, turned = rng.uniform(0, np.pi), rng.uniform(-3, 3)
    half = 1.6 * np.array([np.cos(angle), np.sin(angle)])
    middle = np.array([48, 40]) + rng.uniform(-1, 1, 2)
    way = Trajectory.line(middle - half, middle + half)
    sheet = Sheet(15, 6.3, np.array([0.225, 0.643, 0.69]))
    scene = Scene(textured_plate((96, 80), 2), way, sheet, Change(turned=(0, 0, turned)))
    truth, sweep = in_jpeg(scene, seed)
    assert sweep.misfit > MAX_MISFIT or rmse(sweep, truth) < 0.1


@pytest.mark.battery
def test_a_sheet_is_no_disc_that_was_slow_at_both_ends():
    """Honest: in this JPEG such a disc of half its width leaves no more than noise."""
    way = Trajectory.line((169.18196773, 128.44029172), (204.88528327, 154.21756546))
    sheet = Sheet(26.51723138, 11.04884641, (0.52891024, 0.20888542, 0.33205338))
    plate = plain_plate((384, 288), (0.30, 0.33, 0.36), 149963493)
    scene = Scene(plate, way, sheet, Change(turned=(0, 0, 0.6890383)))
    shot = Shot(scene, Camera(code_std=2 / 255, jpeg_quality=90), plate_frames=5, seed=140)
    truth = render(scene)
    sweep = fit_sweep(*shot.photograph(truth))
    assert sweep.misfit > MAX_MISFIT or rmse(sweep, truth) < 0.1


@pytest.mark.battery
def test_a_stick_is_no_disc_with_a_highlight():
    """Honest: neither it nor the outline that explains as much is believed, for that is likelier."""
    way = Trajectory.line((50.444, 44.937), (46.556, 51.663))
    stick, turned = Sheet(31.6, 4.2, (0.407, 0.121, 0.265)), Change(turned=(0, 0, 0.02))
    scene = Scene(colorful_plate((96, 96), 5, tile=40), way, stick, turned)
    camera = Camera(code_std=2 / 255, jpeg_quality=90, chroma="4:2:0")
    truth = rendered(scene)
    image, picture = Shot(scene, camera, plate_frames=5, seed=5).photograph(truth)
    image = replace(image, meta=replace(image.meta, compression=None))
    sweep = fit_sweep(image, picture)
    assert sweep.misfit > MAX_MISFIT or rmse(sweep, truth) < 0.1


@pytest.mark.battery
def test_a_shape_that_a_file_hardly_tells_from_another_is_contested_or_claims_little():
    """Honest: likelier of the light as it was found, not once each undid what the file did to color."""
    t = np.linspace(0, 1, 65)[:, None]
    half, over = np.array([9.476, 3.389]), np.array([-0.353, 0.988])
    way = Trajectory((193.79, 152.88) + (2 * t - 1) * half + (1 - (2 * t - 1) ** 2) * over, t[:, 0])
    sheet = Sheet(24.147, 10.061, (0.2426, 0.3542, 0.6685))
    plate = colorful_plate((384, 288), 1388783085, tile=40)
    scene = Scene(plate, way, sheet, Change(turned=(0, 0, -2.4547)))
    truth, sweep = in_jpeg(scene, 1)
    claimed = np.sqrt(np.mean(sweep.alpha_std[truth.layer.alpha > 0] ** 2))
    assert sweep.misfit > MAX_MISFIT or rmse(sweep, truth) < 1.5 * claimed


@pytest.mark.battery
def test_a_small_sheet_that_turned_is_no_outline_that_did_not():
    """Honest: one of eight order leaves no more than noise, is twice as wide, and was 0.49 off."""
    sheet = Sheet(16.63, 6.93, (0.032, 0.2155, 0.4143))
    way = Trajectory.line((199.738, 134.107), (180.469, 140.249))
    plate = two_hue_plate((384, 288), (0.45, 0.40, 0.36), (0.10, 0.22, 0.40), 1959048195)
    scene = Scene(plate, way, sheet, Change(turned=(0, 0, -1.593), spin=(0, 0, -0.7965)))
    truth = render(scene)
    sweep = fit_sweep(
        *Shot(scene, Camera(code_std=2 / 255), plate_frames=5, seed=65013).photograph(truth)
    )
    assert sweep.misfit > MAX_MISFIT or rmse(sweep, truth) < 0.03


@pytest.mark.battery
def test_a_sheet_that_turned_on_its_way_is_no_long_thing_that_went_little():
    """Honest: an outline of six times its area leaves no more than noise, and was 0.74 off."""
    sheet = Sheet(27.97138, 11.65474, (0.47062947, 0.29854613, 0.04950328))
    way = Trajectory.line((181.904, 95.248), (194.685, 197.122))
    plate = plain_plate((384, 288), (0.30, 0.33, 0.36), 239943310)
    scene = Scene(plate, way, sheet, Change(turned=(0, 0, -2.49193), spin=(0, 0, -1.24597)))
    truth = render(scene)
    sweep = fit_sweep(
        *Shot(scene, Camera(code_std=2 / 255), plate_frames=5, seed=66021).photograph(truth)
    )
    assert sweep.misfit > MAX_MISFIT or rmse(sweep, truth) < 0.02


@pytest.mark.battery
def test_a_small_drop_is_no_disc_of_which_something_in_front_hides_a_little():
    """Honest: without six of its pixels a disc of less than its size explains it, 0.33 off."""
    drop = Change(squash=(1, 2.0344), squash_angle=1.0344)
    body = Ball(4.0266, (0.16164676, 0.71056499, 0.77205468))
    way = Trajectory.line((186.35173, 149.41577), (189.231, 151.8504))
    scene = Scene(colorful_plate((384, 288), 908655404, tile=40), way, body, drop)
    truth = render(scene)
    sweep = fit_sweep(
        *Shot(scene, Camera(code_std=2 / 255), plate_frames=5, seed=65024).photograph(truth)
    )
    assert sweep.misfit > MAX_MISFIT or rmse(sweep, truth) < 0.1


def test_what_is_contested_is_not_told_as_two_paints(monkeypatch):
    """door: colors enough would explain any of both answers."""
    _, image, picture = taken(BALL)
    contested = property(
        lambda self: replace(self.end, state=replace(self.end.state, contested=0.5))
    )
    monkeypatch.setattr(Attempt, "shaped", contested)
    sweep = fit_sweep(image, picture)
    assert sweep.model.rank == 1
    assert sweep.misfit == np.inf
    assert sweep.complaint(MAX_MISFIT).startswith("two shapes")


def known(color, std):
    pole = color / np.linalg.norm(color)
    return ColorModel(pole[:, None], std**2 * (np.eye(3) - np.outer(pole, pole)), {})


def test_a_model_that_is_given_is_respected(ball):
    truth, image, plate, free = ball
    wrong = known(OFF_GREEN, 0)
    bound = fit_sweep(image, plate, model=wrong)
    assert abs(bound.model.pole @ wrong.pole) > 1 - 1e-6
    right = fit_sweep(image, plate, model=known(GREEN, 0))
    assert rmse(right, truth) < 0.003
    assert right.radius_std <= 1.02 * free.radius_std
    assert abs(bound.radius - 11) > abs(right.radius - 11)


def test_a_plane_that_is_given_is_respected(ball):
    truth, image, plate, _ = ball
    red = np.array([0.8, 0.1, 0.1])
    basis = np.linalg.qr(np.stack([GREEN, red], axis=1))[0]
    sweep = fit_sweep(image, plate, model=ColorModel(basis, np.zeros((3, 3)), {}))
    assert sweep.model.rank == 2
    assert np.linalg.norm(sweep.model.basis.T @ np.cross(*basis.T)) < 1e-4
    assert rmse(sweep, truth) < 0.01


def test_a_streak_that_is_given_is_where_to_look():
    other = Scene(WALL, Trajectory.line((36, 88), (60, 94)), Ball(9, ORANGE))
    truth, second = rendered(BALL), rendered(other)
    both = replace(truth, image=second.layer.over(truth.image))
    image, plate = Shot(BALL, CAMERA, plate_frames=3).photograph(both)
    for one in (truth, second):
        sweep = fit_sweep(image, plate, Streak(one.layer.alpha > 0))
        assert rmse(sweep, one) < 0.006


def test_what_moved_more_but_tells_nothing_is_passed_over(ball):
    """Exact: the sweep is that of the ball's own streak."""
    _, image, plate, alone = ball
    rgb = image.rgb.copy()
    colors = np.random.default_rng(3).uniform(0, 0.6, (10, 8, 3))
    rgb[78:108, 16:40] = np.kron(colors, np.ones((3, 3, 1)))
    image = replace(image, rgb=rgb)
    hand, *_ = require_streaks(image, plate)
    assert fit_sweep(image, plate, hand).misfit > MAX_MISFIT
    sweep = fit_sweep(image, plate)
    assert sweep.misfit < MAX_MISFIT
    assert abs(sweep.radius - alone.radius) < 0.5 * alone.radius_std


def test_of_two_things_side_by_side_one_is_told():
    """Exact but for noise: no shape explains both, which are one streak; its own does the sheet."""
    way = Trajectory.line((70.1, 78.7), (77.6, 81.6))
    truth, sheet = rendered(BALL), rendered(Scene(WALL, way, Sheet(20, 12, ORANGE)))
    both = replace(truth, image=sheet.layer.over(truth.image))
    image, plate = with_noise(*Shot(BALL, CAMERA, plate_frames=3).photograph(both))
    (streak,) = find_streaks(image, plate)
    sweep, piece = fit_piece(image, plate, streak)
    assert sweep.misfit < MAX_MISFIT
    assert sweep.radius == pytest.approx(np.sqrt(20 * 12 / np.pi), rel=0.01)
    assert rmse(sweep, sheet) < 0.015
    assert piece.mask[sheet.layer.alpha > 0].all()
    assert not piece.mask[truth.layer.alpha > 0].any()
    given = fit_sweep(image, plate, Streak(streak.mask))  # all of it is meant
    assert given.misfit > MAX_MISFIT


def test_errors_are_honest():
    """Over noise: of the radius, and of alpha in the mean over the streak."""
    z_radius, z_alpha, z_area = [], [], []
    for seed in range(32):
        truth, image, plate = taken(BALL, 100 + seed)
        sweep, true = fit_sweep(image, plate), truth.layer.alpha
        z_radius.append((sweep.radius - 11) / sweep.radius_std)
        z_area.append((sweep.alpha.sum() - true.sum()) / sweep.area_std())
        core = (true > 0.05) & (sweep.alpha_std > 0)
        z_alpha.append((sweep.alpha - true)[core] / sweep.alpha_std[core])
    for z in (z_radius, z_area, np.concatenate(z_alpha)):
        assert 0.75 < np.sqrt(np.mean(np.square(z))) < 1.3


def test_exact_data_give_the_exact_sweep():
    noise = NoiseModel(read_std=1e-3)
    truth = rendered(BALL)
    sweep = fit_sweep(*(picture.with_noise(noise) for picture in (truth.image, truth.plate)))
    assert sweep.family.name == "line"
    assert_allclose(sweep.radius, 11, atol=0.02)
    assert path_error(sweep, truth) < 0.03
    assert_allclose(sweep.alpha, truth.layer.alpha, atol=5e-3)


def turned_by_a_quarter(picture):
    rgb = np.ascontiguousarray(picture.rgb.transpose(1, 0, 2)[:, ::-1, ::-1])
    return replace(picture, rgb=rgb, noise=None, valid=picture.valid.T[:, ::-1])


def test_pictures_turned_give_sweeps_turned(ball):
    """By a quarter, and with red and blue exchanged."""
    _, image, plate, sweep = ball
    turned = fit_sweep(*(turned_by_a_quarter(picture) for picture in (image, plate)))
    assert_allclose(turned.alpha, sweep.alpha.T[:, ::-1], atol=2e-3)
    assert_allclose(turned.radius, sweep.radius, atol=0.01)
    assert_allclose(turned.model.pole, sweep.model.pole[::-1], atol=1e-3)


def test_what_a_sweep_says_of_itself(ball):
    truth, _, _, sweep = ball
    assert isinstance(sweep, Sweep)
    assert path_error(sweep, truth) < 0.3
    assert_allclose(sweep.length, LINE.length, atol=0.5)
    assert_allclose(np.linalg.norm(sweep.outline, axis=1), sweep.radius, rtol=1e-9)
    assert sweep.outline.shape == (129, 2)
    assert_allclose(sweep.outline[0], sweep.outline[-1])
    assert sweep.alpha.shape == sweep.alpha_std.shape == SIZE[::-1]
    assert sweep.area_std() > 0
    assert np.all(np.diag(sweep.covariance) > 0)
    assert repr(sweep).startswith("Sweep(disc on a line, ")
    assert f"radius {sweep.radius:.2f} ± {sweep.radius_std:.2f} px" in repr(sweep)


def test_what_smooth_light_would_have_otherwise_is_an_error(ball):
    """exact: part of alpha, beside what noise leaves open."""
    sweep = ball[3]
    unsure = replace(sweep, stats={**sweep.stats, "unsure": 0.1})
    expected = np.hypot(sweep.alpha_std, 0.1 * sweep.alpha)
    assert_allclose(unsure.alpha_std, expected, rtol=1e-12)
    assert sweep.stats["unsure"] == 0


def test_alpha_is_the_same_within_a_box(ball):
    _, _, _, sweep = ball
    x0, y0, x1, y1 = box = sweep.box
    alpha, std = sweep.within(box)
    assert_allclose(alpha, sweep.alpha[y0:y1, x0:x1], atol=1e-12)
    assert_allclose(std, sweep.alpha_std[y0:y1, x0:x1], atol=1e-12)
    assert_allclose(alpha.sum(), sweep.alpha.sum())
    assert_allclose(sweep.alpha.sum(), np.pi * sweep.radius**2, rtol=1e-4)


def test_nothing_moved(ball):
    _, _, plate, _ = ball
    rng = np.random.default_rng(0)
    same = CAMERA.photograph(rendered(BALL).plate.rgb, rng)
    with pytest.raises(MotionError, match="nothing moved"):
        fit_sweep(same, plate)


def test_door(ball):
    _, image, plate, _ = ball
    with pytest.raises(ValueError, match="160x112"):
        fit_sweep(image, plate.crop((0, 0, 150, 112)))


@pytest.mark.parametrize("name", ["line", "arc"])
def test_the_sweep_of_another_frame_is_a_start(name, monkeypatch):
    """Exact: the same answer from a path elsewhere, without the search."""
    _, image, plate = taken(Scene(TILES, WAYS[name], Ball(11, GREEN)))
    found = fit_sweep(image, plate)
    elsewhere = replace(found, path=found.path + 6.0 * (np.arange(len(found.path)) < 4))
    monkeypatch.setattr(Search, "best", None)  # not called
    again = fit_sweep(image, plate, start=elsewhere)
    assert again.family is found.family
    assert abs(again.radius - found.radius) < 0.1 * found.radius_std
    assert_allclose(np.sort(again.outline_at(0.5), 0), np.sort(found.outline_at(0.5), 0), atol=0.05)


def test_a_start_that_leads_nowhere_does_no_harm():
    """Invariant: a path that is a line is no start for a bounce; the search finds it all the same."""
    _, image, plate = taken(Scene(TILES, WAYS["bounce"], Ball(11, GREEN)))
    _, *straight = taken(BALL)
    found, again = fit_sweep(image, plate), fit_sweep(image, plate, start=fit_sweep(*straight))
    assert again.family is found.family
    assert_allclose(again.path, found.path)


def test_a_codec_that_repeats_what_stands_still_hides_its_noise(tmp_path):
    """honest: H.264 leaves no noise beside a ball, and much of it within."""
    pytest.importorskip("av")
    shot = Shot(Scene(TILES, LINE, Ball(11, ORANGE)), Camera(code_std=2 / 255), seed=1)
    truth = rendered(shot.scene)
    frames = [shot.camera.photograph(truth.plate.rgb, k) for k in range(8)]
    moved = [shot.camera.photograph(truth.image.rgb, 8)]
    write_frames(tmp_path / "clip.mp4", [*frames, *moved, *frames], rate=30)
    clip = read_frames(tmp_path / "clip.mp4")
    image, plate = with_noise(clip[8], make_plate(clip[:8]).plate)
    sweep = fit_sweep(image, plate)
    assert sweep.stats["louder"] > 2
    assert sweep.misfit < MAX_MISFIT
    assert_allclose(sweep.radius, 11, rtol=0.03)
    assert degrees_between(sweep, truth) < 1.5
    assert rmse(sweep, truth) < 0.02


# Real pictures


@pytest.mark.filterwarnings("ignore::blurmatte.errors.TransferWarning")
def test_a_real_ball_has_one_size(real_data):
    """Invariant: twice the same ball, once long and faint in its shadow, once short."""
    plate = read(real_data / "floorball_plate.png")
    sweeps = [fit_sweep(read(real_data / f"floorball{i}.png"), plate) for i in (1, 2)]
    assert all(sweep.misfit <= MAX_MISFIT for sweep in sweeps)
    assert all(sweep.silhouette.order == 1 for sweep in sweeps)
    assert_allclose(sweeps[0].radius, sweeps[1].radius, rtol=0.02)
