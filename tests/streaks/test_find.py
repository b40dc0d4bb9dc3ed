"""find_streaks: finds faint moving objects, and nothing in noise and compressed files."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy import ndimage
from tests.scenes import on_line

from blurmatte.calibration import with_noise
from blurmatte.errors import PlateError
from blurmatte.files.reading import read
from blurmatte.radiometry import LinearImage, NoiseModel
from blurmatte.rendering import Ball, Camera
from blurmatte.streaks import Streak, find_streak_within, find_streaks, merge_across_occluder
from blurmatte.streaks.find import join_in_line

ORANGE = np.array([0.9, 0.5, 0.1])
NAMES = ["tiles", "dark", "plain", "two hues"]
SHAPE = 120, 300


def covered(streak, alpha):
    return alpha[streak.mask].sum() / alpha.sum()


# Nothing moved


@pytest.mark.diagonal
@pytest.mark.parametrize("plate", NAMES)
@pytest.mark.parametrize("code_std", [0, 0.3, 1, 2, 5])
def test_no_streak_in_noise(taken, plates, plate, code_std):
    for seed in range(2):
        assert find_streaks(*taken(plates[plate], plates[plate], code_std, seed)) == []


@pytest.mark.parametrize("sigma", [0.001, 0.01, 0.1])
def test_no_streak_in_noise_of_floats(sigma):
    """Small pictures are mostly border, where T must not be larger."""
    for seed in range(40):
        rng = np.random.default_rng(seed)
        image, plate = (LinearImage(0.4 + rng.normal(0, sigma, (40, 40, 3))) for _ in "ab")
        assert find_streaks(image, plate) == []


@pytest.mark.diagonal
@pytest.mark.parametrize("plate", NAMES)
@pytest.mark.parametrize("quality", [75, 85, 95])
def test_no_streak_in_jpeg(taken, plates, plate, quality):
    for seed in range(2):
        for code_std in (1, 2):
            pictures = taken(plates[plate], plates[plate], code_std, seed, jpeg=quality)
            assert find_streaks(*pictures) == []


@pytest.mark.parametrize(
    ("plate", "quality"),
    [("tiles", 85), ("dark", 85), ("plain", 75), ("plain", 85), ("two hues", 85)],
)
def test_no_streak_in_blocks_rounded_together(taken, plates, plate, quality):
    """With less noise than a code value, JPEG shifts whole blocks by one step or none."""
    for seed in range(2):
        pictures = taken(plates[plate], plates[plate], 0.5, seed, jpeg=quality)
        assert find_streaks(*pictures) == []


@pytest.mark.diagonal
@pytest.mark.parametrize("quality", [None, 85])
@pytest.mark.parametrize("code_std", [1, 2, 5])
def test_no_streak_in_shifted_plate(taken, plates, code_std, quality):
    """Hard edges shifted by a third of a pixel make thin differences of any size."""
    tiles = plates["tiles"]
    shifted = ndimage.shift(tiles, (0.2, 0.22, 0), order=3, mode="nearest")
    for seed in range(3):
        assert find_streaks(*taken(shifted, tiles, code_std, seed, jpeg=quality)) == []


def test_no_streak_in_exact_copies(paint):
    assert find_streaks(paint.plate, paint.plate) == []
    black = LinearImage(np.zeros((16, 16, 3)))
    assert find_streaks(black, black) == []


def test_no_streak_in_clipped_lamp(taken, paint):
    """Invalid pixels are not evidence of motion."""
    image, plate = taken(paint.plate.rgb, paint.plate.rgb, 1, 0)
    valid = np.ones(image.valid.shape, bool)
    valid[40:60, 50:80] = False
    rgb = np.where(valid[..., None], image.rgb, 0.9)
    assert find_streaks(LinearImage(rgb, valid=valid, meta=image.meta), plate) == []


# Something moved


@pytest.fixture(scope="module", params=NAMES)
def faint(plates, request):
    """A rendering whose alpha is at most 0.05."""
    return on_line(plates[request.param], (40, 50), (220, 150), Ball(5.2, ORANGE, ambient=0.8))


@pytest.mark.diagonal
@pytest.mark.parametrize("code_std", [1, 2])
def test_finds_faint_streak_completely(taken, faint, code_std):
    alpha = faint.layer.alpha
    assert alpha.max() < 0.051
    for seed in range(2):
        found = find_streaks(*taken(faint.image.rgb, faint.plate.rgb, code_std, seed))
        assert len(found) == 1
        assert covered(found[0], alpha) > 0.97
        assert np.mean(found[0].mask) < 3 * np.mean(alpha > 0)


def test_finds_exact_streak_completely(rendering):
    found = find_streaks(rendering.image, rendering.plate)
    assert len(found) == 1
    assert covered(found[0], rendering.layer.alpha) > 0.999


def test_floats_and_files_give_equal_masks(paint):
    noise = NoiseModel(gain=1e-4, read_std=0.003)
    masks = []
    for bits in (None, 16, 8):
        camera, rng = Camera(noise, bits=bits), np.random.default_rng(0)
        pictures = (camera.photograph(p.rgb, rng) for p in (paint.image, paint.plate))
        masks.append(find_streaks(*pictures)[0].mask)
    assert np.mean(masks[0] != masks[1]) < 0.01
    assert np.mean(masks[0] != masks[2]) < 0.03


def test_sorts_two_objects_by_evidence(taken, plates):
    one = on_line(plates["tiles"], (40, 40), (100, 40), Ball(12, ORANGE))
    two = on_line(one.image.rgb, (60, 150), (220, 140), Ball(6, ORANGE))
    found = find_streaks(*taken(two.image.rgb, plates["tiles"], 1, 0))
    assert len(found) == 2
    assert covered(found[0], one.layer.alpha) > 0.97
    assert covered(found[1], two.layer.alpha) > 0.9  # alpha is 0.07
    assert found[0].evidence > found[1].evidence > 0


@pytest.mark.diagonal
@pytest.mark.parametrize("gap", [13, 17])
@pytest.mark.parametrize("plate", ["tiles", "plain"])
def test_separates_balls_on_parallel_paths(plates, balls_side_by_side, plate, gap):
    """Exact: smoothing does not connect them, and neither mask covers the other ball."""
    one, two, pictures = balls_side_by_side(plates[plate], gap, 0.3)
    found = find_streaks(*pictures)
    shares = np.array([[covered(s, r.layer.alpha) for r in (one, two)] for s in found])
    assert shares.shape == (2, 2)
    assert_allclose(np.sort(shares, axis=1), [[0, 1], [0, 1]], atol=0.03)
    assert_allclose(np.sort(shares, axis=0), [[0, 0], [1, 1]], atol=0.03)


@pytest.mark.diagonal
@pytest.mark.parametrize("light", [0.02, 0.55 * ORANGE])
@pytest.mark.parametrize("width", [6, 14])
def test_line_of_the_plate_does_not_split_a_streak(taken, plates, width, light):
    """Invariant: for a dark line, and for one of the color of the ball's shaded side."""
    wall = plates["tiles"].copy()
    wall[:, 120 : 120 + width] = light
    ball = on_line(wall, (90, 80), (160, 100), Ball(18, ORANGE))
    found = find_streaks(*taken(ball.image.rgb, wall, 0.3, 1))
    assert len(found) == 1
    assert covered(found[0], ball.layer.alpha) > 0.95


def test_excludes_weak_shadow(taken, plates):
    """A shadow next to the ball dims every channel by 1.5 %."""
    ball = on_line(plates["plain"], (60, 60), (140, 60), Ball(14, ORANGE))
    light = ball.image.rgb.copy()
    light[76:110, 50:150] *= 0.985
    found = find_streaks(*taken(light, plates["plain"], 0.5, 0))
    assert covered(found[0], ball.layer.alpha) > 0.97
    assert found[0].box[3] < 90


@pytest.mark.parametrize("edge", [(0, 96), (255, 96), (128, 0), (128, 191), (0, 0)])
def test_finds_streak_at_the_border(taken, plates, edge):
    scene = on_line(plates["tiles"], edge, (128, 96), Ball(10, ORANGE))
    found = find_streaks(*taken(scene.image.rgb, scene.plate.rgb, 1, 0))
    assert len(found) == 1
    assert covered(found[0], scene.layer.alpha) > 0.97


def test_searches_large_pictures_in_cells(taken, plates):
    small = on_line(plates["plain"], (40, 50), (220, 150), Ball(5.2, ORANGE, ambient=0.8))
    height, width = small.layer.alpha.shape
    plate = np.tile(small.plate.rgb, (1001 // height + 1, 1001 // width + 1, 1))[:1001, :1001]
    light, alpha = plate.copy(), np.zeros(plate.shape[:2])
    light[:height, :width], alpha[:height, :width] = small.image.rgb, small.layer.alpha
    pictures = taken(light, plate, 1, 0)
    everywhere = Streak.from_box((0, 0, *pictures[0].size), pictures[0].size)
    found = find_streak_within(everywhere, *pictures)
    assert found.mask.shape == alpha.shape
    assert covered(found, alpha) > 0.97
    assert [streak.cell for streak in (found, everywhere)] == [2, 1]


@pytest.mark.diagonal
@pytest.mark.parametrize("radius", [14, 24])
@pytest.mark.parametrize("plate", ["tiles", "plain"])
def test_finds_object_over_a_quarter_of_the_picture(taken, plates, plate, radius):
    wall = plates[plate][:128, :192]
    scene = on_line(wall, (45, 45), (145, 80), Ball(radius, ORANGE))
    found = find_streaks(*taken(scene.image.rgb, wall, 1, 0))
    assert len(found) == 1
    assert covered(found[0], scene.layer.alpha) > 0.97


def test_uses_known_noise(paint):
    """Ten times the noise hides a faint streak; the true noise shows it."""
    scaled = 0.2 * (paint.image.rgb - paint.plate.rgb) + paint.plate.rgb
    pictures = [LinearImage(a + np.random.default_rng(i).normal(0, 0.005, a.shape))
                for i, a in enumerate((scaled, paint.plate.rgb))]  # fmt: skip
    true, large = (NoiseModel(read_std=s) for s in (0.005, 0.1))
    assert len(find_streaks(*(p.with_noise(true) for p in pictures))) == 1
    assert find_streaks(*(p.with_noise(large) for p in pictures)) == []
    assert len(find_streaks(*with_noise(*pictures))) == 1


# Real pictures: where the ball is, x0, y0, x1, y1


@pytest.mark.filterwarnings("ignore::blurmatte.errors.TransferWarning")
@pytest.mark.parametrize(
    ("name", "ball"), [("floorball1", (728, 325, 847, 479)), ("floorball2", (386, 238, 470, 285))]
)
def test_real_ball_has_the_largest_evidence(real_data, name, ball):
    pictures = read(real_data / f"{name}.png"), read(real_data / "floorball_plate.png")
    found = find_streaks(*pictures)
    assert len(found) < 8
    assert_allclose(found[0].box, ball, atol=10)
    assert found[0].evidence > 100 * sum(other.evidence for other in found[1:])


def test_rejects_unusable_pictures(paint):
    small = LinearImage(np.ones((15, 200, 3)))
    with pytest.raises(ValueError, match="image is 192x128 pixels and plate 200x15"):
        find_streaks(paint.image, small)
    with pytest.raises(PlateError, match="200x15 pixels; it must be 16x16 or more"):
        find_streaks(small, small)
    lost = LinearImage(np.ones((20, 20, 3)), valid=np.zeros((20, 20), bool))
    with pytest.raises(PlateError, match="no unclipped pixel in common; expose shorter"):
        find_streaks(lost, LinearImage(np.ones((20, 20, 3))))


def test_region_returns_its_streak_or_itself(paint):
    found = find_streaks(paint.image, paint.plate)[0]
    x0, y0, x1, y1 = found.box
    width, height = paint.image.size
    around = Streak.from_box(
        (max(0, x0 - 3), max(0, y0 - 3), min(width, x1 + 3), min(height, y1 + 3)), (width, height)
    )
    within = find_streak_within(around, paint.image, paint.plate)
    assert np.array_equal(within.mask, found.mask)
    elsewhere = Streak.from_box((0, 0, 8, 8), (width, height))
    assert not (elsewhere.mask & found.mask).any()
    assert find_streak_within(elsewhere, paint.image, paint.plate) is elsewhere


def test_region_has_no_streaks_that_are_faint_beside_its_strongest(taken, paint):
    image, plate = taken(paint.image.rgb, paint.plate.rgb, 1, 0)
    strong = find_streaks(image, plate)[0]
    rgb = np.array(image.rgb)
    rgb[2:12, 2:12] += 0.02
    marked = replace(image, rgb=rgb)
    streaks = find_streaks(marked, plate)
    assert len(streaks) == 2
    assert streaks[1].evidence < 0.01 * streaks[0].evidence
    everywhere = Streak(np.ones(strong.mask.shape, bool))
    within = find_streak_within(everywhere, marked, plate)
    assert np.array_equal(within.mask, streaks[0].mask)


def test_merge_across_occluder_joins_parts_on_both_sides():
    """Exact: two parts on both sides of a post are joined, a third one elsewhere is not."""
    parts = [Streak.from_box(box, (80, 40)) for box in
             ((10, 10, 30, 20), (40, 12, 60, 22), (10, 34, 14, 38))]  # fmt: skip
    occluder = np.zeros((40, 80), bool)
    occluder[:, 30:40] = True
    joined = merge_across_occluder(parts, occluder)
    assert [s.box[::2] for s in joined] == [(10, 60), (10, 14)]
    assert joined[0].mask[15, 30:40].all()
    assert not joined[0].mask[30:, 30:40].any()
    assert [s.box for s in merge_across_occluder(parts, np.zeros_like(occluder))] == [
        s.box for s in parts
    ]


def test_pictures_without_an_opaque_pixel_are_named(paint):
    image, plate = paint.image, paint.plate
    transparent = replace(image, valid=np.zeros_like(image.valid))
    with pytest.raises(PlateError, match="the image has no opaque pixel: its alpha is below 1"):
        find_streaks(transparent, plate)
    with pytest.raises(PlateError, match="the plate has no opaque pixel"):
        find_streaks(image, replace(plate, valid=np.zeros_like(plate.valid)))


def strip(start, end, bend=0.0, offset=0.0, half_width=6):
    """Cells of a strip along a parabola between two x."""
    y, x = np.indices(SHAPE)
    center = 60 + offset + bend * (x - 150) ** 2
    return (x >= start) & (x < end) & (np.abs(y - center) <= half_width)


def evidence_of(*strips):
    """T of a picture: noise of three degrees of freedom, and 50 in the strips."""
    T = np.random.default_rng(1).chisquare(3, SHAPE)
    T[np.logical_or.reduce(strips)] = 50
    return T


@pytest.mark.parametrize("bend", [0.0, 0.0012])
def test_parts_on_one_curve_with_weak_evidence_between_are_joined(bend):
    one, other = strip(20, 100, bend), strip(200, 280, bend)
    T = evidence_of(one, other)
    T[strip(100, 200, bend)] += 8
    (whole,) = join_in_line([one, other], T)
    assert np.mean(whole[strip(20, 280, bend)]) > 0.97
    assert np.mean(whole & ~strip(20, 280, bend, half_width=8)) == 0


@pytest.mark.parametrize(
    ("one", "other"),
    [
        (strip(20, 100), strip(200, 280, offset=20)),  # parallel
        (strip(20, 100), strip(40, 130, offset=30)),  # next to each other
        (strip(20, 100, half_width=3), strip(200, 280, half_width=10)),  # of two widths
        (strip(90, 100), strip(200, 210)),  # without a direction
    ],
)
def test_other_parts_stay_apart(one, other):
    T = evidence_of(one, other) + 8 * strip(100, 200, half_width=40)
    T[one | other] = 50
    assert len(join_in_line([one, other], T)) == 2


def test_two_objects_on_one_line_with_nothing_between_stay_apart():
    one, other = strip(20, 100), strip(200, 280)
    assert len(join_in_line([one, other], evidence_of(one, other))) == 2


def test_streak_before_a_plate_of_nearly_its_color_is_one_streak():
    noise = NoiseModel(read_std=0.004)
    rng = np.random.default_rng(2)
    plate = np.full((*SHAPE, 3), (0.3, 0.1, 0.1))
    plate[:, 100:200] = 0.78, 0.68, 0.205
    color, alpha = np.array([0.8, 0.7, 0.2]), 0.3 * strip(30, 270)[..., None]
    light = (1 - alpha) * plate + alpha * color
    image, plate = (
        LinearImage(picture + rng.normal(0, 0.004, picture.shape)).with_noise(noise)
        for picture in (light, plate)
    )
    (streak,) = find_streaks(image, plate)
    assert streak.mask[strip(40, 260, half_width=4)].all()
