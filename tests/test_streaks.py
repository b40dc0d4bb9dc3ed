"""find_streaks: what moved is found, faint as it may be; noise and files make no streaks."""

import io

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from PIL import Image
from scipy import ndimage

from blurmatte import streaks
from blurmatte.errors import ColorModelError, MotionError, PlateError
from blurmatte.files import read
from blurmatte.radiometry import SRGB, LinearImage, NoiseModel, decode, with_noise
from blurmatte.rendering import (
    Ball,
    Camera,
    Scene,
    colorful_plate,
    plain_plate,
    render,
    two_hue_plate,
)
from blurmatte.streaks import (
    Streak,
    find_streak_within,
    find_streaks,
    joined_behind,
    pieces_apart,
    strongest_told,
)
from blurmatte.trajectory import Trajectory

SIZE = (256, 192)
PLATES = {
    "tiles": colorful_plate(SIZE, 1),
    "dark": 0.05 * colorful_plate(SIZE, 2),
    "plain": plain_plate(SIZE, (0.5, 0.4, 0.3), 1),
    "two hues": two_hue_plate(SIZE, (0.5, 0.1, 0.1), (0.1, 0.2, 0.5), 1),
}
ORANGE = np.array([0.9, 0.5, 0.1])


def codes(light, code_std, rng):
    return Camera(code_std=code_std / 255).expose(light, rng)


def through_jpeg(pixels, quality):
    file = io.BytesIO()
    Image.fromarray(pixels).save(file, "jpeg", quality=quality, subsampling="4:2:0")
    return np.asarray(Image.open(file).convert("RGB"))


def taken(light, plate, code_std, seed, jpeg=None):
    rng = np.random.default_rng(seed)
    files = [codes(picture, code_std, rng) for picture in (light, plate)]
    if jpeg is not None:
        files = [through_jpeg(pixels, jpeg) for pixels in files]
    return [decode(pixels, SRGB) for pixels in files]


def covered(streak, alpha):
    return alpha[streak.mask].sum() / alpha.sum()


# Nothing moved


@pytest.mark.parametrize("plate", PLATES)
@pytest.mark.parametrize("code_std", [0, 0.3, 1, 2, 5])
def test_noise_is_no_streak(plate, code_std):
    for seed in range(2):
        assert find_streaks(*taken(PLATES[plate], PLATES[plate], code_std, seed)) == []


@pytest.mark.parametrize("sigma", [0.001, 0.01, 0.1])
def test_noise_of_floats_is_no_streak(sigma):
    """Small pictures are mostly border: noise must be no stronger there."""
    for seed in range(40):
        rng = np.random.default_rng(seed)
        image, plate = (LinearImage(0.4 + rng.normal(0, sigma, (40, 40, 3))) for _ in "ab")
        assert find_streaks(image, plate) == []


@pytest.mark.parametrize("plate", PLATES)
@pytest.mark.parametrize("quality", [75, 85, 95])
def test_jpeg_is_no_streak(plate, quality):
    for seed in range(2):
        for code_std in (1, 2):
            pictures = taken(PLATES[plate], PLATES[plate], code_std, seed, jpeg=quality)
            assert find_streaks(*pictures) == []


@pytest.mark.parametrize(
    ("plate", "quality"),
    [("tiles", 85), ("dark", 85), ("plain", 75), ("plain", 85), ("two hues", 85)],
)
def test_blocks_rounded_as_one_are_no_streak(plate, quality):
    """With less noise than a code value, JPEG shifts whole blocks by one step or none."""
    for seed in range(2):
        pictures = taken(PLATES[plate], PLATES[plate], 0.5, seed, jpeg=quality)
        assert find_streaks(*pictures) == []


@pytest.mark.parametrize("quality", [None, 85])
@pytest.mark.parametrize("code_std", [1, 2, 5])
def test_a_shifted_plate_is_no_streak(code_std, quality):
    """Hard edges a third of a pixel off make thin differences, as strong as they like."""
    tiles = PLATES["tiles"]
    shifted = ndimage.shift(tiles, (0.2, 0.22, 0), order=3, mode="nearest")
    for seed in range(3):
        assert find_streaks(*taken(shifted, tiles, code_std, seed, jpeg=quality)) == []


def test_exact_copies_make_no_streak(paint):
    assert find_streaks(paint.plate, paint.plate) == []
    black = LinearImage(np.zeros((16, 16, 3)))
    assert find_streaks(black, black) == []


def test_a_clipped_lamp_is_no_streak(paint):
    """What is not valid cannot say that something moved."""
    image, plate = taken(paint.plate.rgb, paint.plate.rgb, 1, 0)
    valid = np.ones(image.valid.shape, bool)
    valid[40:60, 50:80] = False
    rgb = np.where(valid[..., None], image.rgb, 0.9)
    assert find_streaks(LinearImage(rgb, valid=valid, meta=image.meta), plate) == []


# Something moved


@pytest.fixture(scope="module", params=PLATES)
def faint(request):
    """A rendering whose alpha is at most 0.05."""
    path = Trajectory.line((40, 50), (220, 150))
    return render(Scene(PLATES[request.param], path, Ball(5.2, ORANGE, ambient=0.8)))


@pytest.mark.parametrize("code_std", [1, 2])
def test_a_faint_streak_is_found_whole(faint, code_std):
    alpha = faint.layer.alpha
    assert alpha.max() < 0.051
    for seed in range(2):
        found = find_streaks(*taken(faint.image.rgb, faint.plate.rgb, code_std, seed))
        assert len(found) == 1
        assert covered(found[0], alpha) > 0.97
        assert np.mean(found[0].mask) < 3 * np.mean(alpha > 0)


def test_an_exact_streak_is_found_whole(rendering):
    found = find_streaks(rendering.image, rendering.plate)
    assert len(found) == 1
    assert covered(found[0], rendering.layer.alpha) > 0.999


def test_floats_and_files_show_the_same(paint):
    noise = NoiseModel(gain=1e-4, read_std=0.003)
    masks = []
    for bits in (None, 16, 8):
        camera, rng = Camera(noise, bits=bits), np.random.default_rng(0)
        pictures = (camera.photograph(p.rgb, rng) for p in (paint.image, paint.plate))
        masks.append(find_streaks(*pictures)[0].mask)
    assert np.mean(masks[0] != masks[1]) < 0.01
    assert np.mean(masks[0] != masks[2]) < 0.03


def test_two_objects_are_two_streaks_the_stronger_first():
    one = render(Scene(PLATES["tiles"], Trajectory.line((40, 40), (100, 40)), Ball(12, ORANGE)))
    two = render(Scene(one.image.rgb, Trajectory.line((60, 150), (220, 140)), Ball(6, ORANGE)))
    found = find_streaks(*taken(two.image.rgb, PLATES["tiles"], 1, 0))
    assert len(found) == 2
    assert covered(found[0], one.layer.alpha) > 0.97
    assert covered(found[1], two.layer.alpha) > 0.9  # alpha is 0.07
    assert found[0].evidence > found[1].evidence > 0


def balls_side_by_side(wall, gap, code_std=1):
    """Of radius 9 and 7, both 40 px long, with so many pixels between them; truths and pictures."""
    way = Trajectory.line((92, 96 + gap), (132, 96 + gap))
    one = render(Scene(wall, Trajectory.line((90, 80), (130, 80)), Ball(9, ORANGE)))
    two = render(Scene(one.image.rgb, way, Ball(7, (0.1, 0.3, 0.9))))
    return one, two, with_noise(*taken(two.image.rgb, wall, code_std, 1))


@pytest.mark.parametrize("gap", [13, 17])
@pytest.mark.parametrize("plate", ["tiles", "plain"])
def test_two_balls_side_by_side_are_two_streaks(plate, gap):
    """Exact: what smoothing shows between them belongs to neither, and takes none of them away."""
    one, two, pictures = balls_side_by_side(PLATES[plate], gap, 0.3)
    found = find_streaks(*pictures)
    shares = np.array([[covered(s, r.layer.alpha) for r in (one, two)] for s in found])
    assert shares.shape == (2, 2)
    assert_allclose(np.sort(shares, axis=1), [[0, 1], [0, 1]], atol=0.03)
    assert_allclose(np.sort(shares, axis=0), [[0, 0], [1, 1]], atol=0.03)


@pytest.mark.parametrize("gap", [3, 6])
@pytest.mark.parametrize("plate", ["tiles", "plain"])
def test_two_balls_close_by_are_pieces_of_one_streak(plate, gap):
    """Exact: each pixel of the streak belongs to one piece, each ball to its own."""
    one, two, pictures = balls_side_by_side(PLATES[plate], gap)
    (streak,) = find_streaks(*pictures)
    pieces = pieces_apart(streak, *pictures)
    shares = np.array([[covered(s, r.layer.alpha) for r in (one, two)] for s in pieces])
    assert_allclose(np.sort(shares, axis=1), [[0, 1], [0, 1]], atol=0.01)
    assert_array_equal(sum(s.mask.astype(int) for s in pieces), streak.mask)
    assert pieces[0].evidence >= pieces[1].evidence > 0


def test_pieces_of_a_large_picture_are_pieces_too(monkeypatch):
    """Invariant: found in cells, they fill the same streak."""
    monkeypatch.setattr(streaks, "_MAX_CELLS", SIZE[0] * SIZE[1] / 4)
    *_, pictures = balls_side_by_side(PLATES["tiles"], 6)
    (streak,) = find_streaks(*pictures)
    first, second = pieces_apart(streak, *pictures)
    assert streak.cell == first.cell == 2
    assert_array_equal(first.mask ^ second.mask, streak.mask)


@pytest.mark.parametrize("plate", PLATES)
def test_one_ball_is_one_piece(plate):
    """Invariant: neither noise nor the plate's tiles cut it."""
    ball = render(Scene(PLATES[plate], Trajectory.line((90, 80), (160, 100)), Ball(18, ORANGE)))
    pictures = with_noise(*taken(ball.image.rgb, PLATES[plate], 1, 1))
    (streak,) = find_streaks(*pictures)
    assert pieces_apart(streak, *pictures) == []


@pytest.mark.parametrize("light", [0.02, 0.55 * ORANGE])
@pytest.mark.parametrize("width", [6, 14])
def test_a_line_of_the_plate_behind_a_ball_does_not_cut_it(width, light):
    """Invariant: one streak, be the line dark, or of the ball's own color in its shade."""
    wall = PLATES["tiles"].copy()
    wall[:, 120 : 120 + width] = light
    ball = render(Scene(wall, Trajectory.line((90, 80), (160, 100)), Ball(18, ORANGE)))
    found = find_streaks(*taken(ball.image.rgb, wall, 0.3, 1))
    assert len(found) == 1
    assert covered(found[0], ball.layer.alpha) > 0.95


def test_a_weak_shadow_beside_it_is_left_out():
    """A shadow dims every channel by a little, next to the ball that throws it."""
    ball = render(Scene(PLATES["plain"], Trajectory.line((60, 60), (140, 60)), Ball(14, ORANGE)))
    light = ball.image.rgb.copy()
    light[76:110, 50:150] *= 0.985
    found = find_streaks(*taken(light, PLATES["plain"], 0.5, 0))
    assert covered(found[0], ball.layer.alpha) > 0.97
    assert found[0].box[3] < 90


@pytest.mark.parametrize("edge", [(0, 96), (255, 96), (128, 0), (128, 191), (0, 0)])
def test_a_streak_at_the_border_is_found(edge):
    path = Trajectory.line(edge, (128, 96))
    scene = render(Scene(PLATES["tiles"], path, Ball(10, ORANGE)))
    found = find_streaks(*taken(scene.image.rgb, scene.plate.rgb, 1, 0))
    assert len(found) == 1
    assert covered(found[0], scene.layer.alpha) > 0.97


def test_large_pictures_are_searched_in_cells(faint, monkeypatch):
    pictures = taken(faint.image.rgb, faint.plate.rgb, 1, 0)
    monkeypatch.setattr(streaks, "_MAX_CELLS", faint.plate.rgb.size / 3 / 3.5)  # cells of 2 x 2
    found = find_streaks(*pictures)
    assert len(found) == 1
    assert found[0].mask.shape == pictures[0].valid.shape
    assert covered(found[0], faint.layer.alpha) > 0.97
    everywhere = Streak.from_box((0, 0, *pictures[0].size), pictures[0].size)
    within = find_streak_within(everywhere, *pictures)
    assert [streak.cell for streak in (found[0], within, everywhere)] == [2, 2, 1]


@pytest.mark.parametrize("cell", [2, 3, 7])
def test_cells_are_means_and_reach_the_border(cell):
    values = np.random.default_rng(0).uniform(size=(10, 13, 3))
    cells = streaks._cells(values, cell)
    assert cells.shape == (-(-10 // cell), -(-13 // cell), 3)
    assert_allclose(cells[0, 0], values[:cell, :cell].mean(axis=(0, 1)))
    assert_allclose(streaks._cells(np.ones((10, 13, 1)), cell), 1)


@pytest.mark.parametrize("radius", [14, 24])
@pytest.mark.parametrize("plate", ["tiles", "plain"])
def test_up_to_a_quarter_of_the_picture_may_move(plate, radius):
    wall = PLATES[plate][:128, :192]
    path = Trajectory.line((45, 45), (145, 80))
    scene = render(Scene(wall, path, Ball(radius, ORANGE)))
    found = find_streaks(*taken(scene.image.rgb, wall, 1, 0))
    assert len(found) == 1
    assert covered(found[0], scene.layer.alpha) > 0.97


def test_known_noise_is_believed(paint):
    """Ten times the noise hides a faint streak; the true noise shows it."""
    scaled = 0.2 * (paint.image.rgb - paint.plate.rgb) + paint.plate.rgb
    pictures = [LinearImage(a + np.random.default_rng(i).normal(0, 0.005, a.shape))
                for i, a in enumerate((scaled, paint.plate.rgb))]  # fmt: skip
    true, large = (NoiseModel(read_std=s) for s in (0.005, 0.1))
    assert len(find_streaks(*(p.with_noise(true) for p in pictures))) == 1
    assert find_streaks(*(p.with_noise(large) for p in pictures)) == []
    assert len(find_streaks(*with_noise(*pictures))) == 1


def test_thin_parts_fall_away():
    """Oracle: SciPy's opening, to the border."""
    rng = np.random.default_rng(5)
    for side in (3, 4, 31):
        mask = ndimage.gaussian_filter(rng.normal(size=(side, 40)), 1.2) > 0
        assert_array_equal(
            streaks.without_thin_parts(mask), ndimage.binary_opening(mask, np.ones((3, 3)))
        )


@pytest.mark.parametrize("by", [0, 1, 3])
def test_what_is_widened_is_dilated(by):
    """Oracle: SciPy's dilation, to the border; the mask itself stays."""
    mask = np.random.default_rng(6).random((9, 14)) > 0.95
    before = mask.copy()
    expected = ndimage.binary_dilation(mask, iterations=by) if by else before
    assert_array_equal(streaks.widened(mask, by), expected)
    assert_array_equal(mask, before)


# Real pictures: where the ball is, x0, y0, x1, y1


@pytest.mark.filterwarnings("ignore::blurmatte.errors.TransferWarning")
@pytest.mark.parametrize(
    ("name", "ball"), [("floorball1", (728, 325, 847, 479)), ("floorball2", (386, 238, 470, 285))]
)
def test_a_real_ball_is_the_strongest(real_data, name, ball):
    pictures = read(real_data / f"{name}.png"), read(real_data / "floorball_plate.png")
    found = find_streaks(*pictures)
    assert len(found) < 8
    assert_allclose(found[0].box, ball, atol=10)
    assert found[0].evidence > 100 * sum(other.evidence for other in found[1:])


# A region by hand


def test_a_box_is_a_streak():
    streak = Streak.from_box((2, 1, 5, 4), (8, 6))
    assert streak.mask.shape == (6, 8)
    assert streak.box == (2, 1, 5, 4)
    assert_array_equal(np.argwhere(streak.mask)[[0, -1]], [[1, 2], [3, 4]])
    assert streak.mask[streak.rows_columns].all()
    assert repr(streak) == "Streak(3x3 at 2,1, 9 pixels)"


def test_a_mask_is_a_streak():
    mask = np.zeros((6, 8), bool)
    mask[2, 3] = mask[4, 6] = True
    assert Streak(mask).box == (3, 2, 7, 5)


@pytest.mark.parametrize(
    "box", [(-1, 0, 4, 4), (0, 0, 9, 4), (0, 0, 4, 7), (4, 0, 4, 4), (4, 4, 2, 6)]
)
def test_a_box_that_does_not_fit(box):
    with pytest.raises(ValueError, match="must lie in the picture of 8x6 pixels, with x0 < x1"):
        Streak.from_box(box, (8, 6))


def test_door(paint):
    with pytest.raises(ValueError, match="at least one pixel; its mask is empty"):
        Streak(np.zeros((4, 4), bool))
    with pytest.raises(TypeError, match="mask must have a dtype of kind 'b'"):
        Streak(np.ones((4, 4)))
    small = LinearImage(np.ones((15, 200, 3)))
    with pytest.raises(ValueError, match="image is 192x128 pixels and plate 200x15"):
        find_streaks(paint.image, small)
    with pytest.raises(PlateError, match="200x15 pixels; 16x16 is the least"):
        find_streaks(small, small)
    lost = LinearImage(np.ones((20, 20, 3)), valid=np.zeros((20, 20), bool))
    with pytest.raises(PlateError, match="no unclipped pixel in common; expose shorter"):
        find_streaks(lost, LinearImage(np.ones((20, 20, 3))))


def test_a_region_holds_what_moved_in_it_or_else_all_of_it(paint):
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


def test_around_stays_in_the_picture():
    streak = Streak.from_box((3, 5, 10, 12), (20, 30))
    assert streak.around(0) == streak.box
    assert streak.around(2) == (1, 3, 12, 14)
    assert streak.around(100) == (0, 0, 20, 30)


def test_a_streak_goes_on_behind_an_occluder():
    """exact: two parts on both sides of a post are one, a third one elsewhere is not."""
    parts = [Streak.from_box(box, (80, 40)) for box in
             ((10, 10, 30, 20), (40, 12, 60, 22), (10, 34, 14, 38))]  # fmt: skip
    occluder = np.zeros((40, 80), bool)
    occluder[:, 30:40] = True
    joined = joined_behind(parts, occluder)
    assert [s.box[::2] for s in joined] == [(10, 60), (10, 14)]
    assert joined[0].mask[15, 30:40].all()
    assert not joined[0].mask[30:, 30:40].any()
    assert [s.box for s in joined_behind(parts, np.zeros_like(occluder))] == [s.box for s in parts]


# Which of them tells something


def of_evidence(*evidence, whole=True):
    mask = np.zeros((4, 4), bool)
    mask[1:3, int(whole) : 3] = True
    return [Streak(mask, evidence=e) for e in evidence]


def test_streaks_are_asked_until_one_tells_something():
    streaks, asked = of_evidence(9, 8, 7), []

    def tell(streak):
        asked.append(streak)
        if streak is streaks[0]:
            raise ColorModelError("a hand")
        return streak.evidence

    assert strongest_told(streaks, tell) == 8
    assert asked == streaks[:2]


@pytest.mark.parametrize(("evidence", "count"), [((9, 8, 7, 6, 5), 4), ((9, 0.2, 0.1), 2)])
def test_few_streaks_are_asked_and_none_that_is_faint(evidence, count):
    asked = []

    def tell(streak):
        asked.append(streak.evidence)
        raise (MotionError if asked[1:] else ColorModelError)(f"nothing in {streak.evidence}")

    with pytest.raises(ColorModelError, match="nothing in 9"):
        strongest_told(of_evidence(*evidence), tell)
    assert asked == list(evidence[:count])


def test_what_is_whole_in_the_picture_is_asked_first_but_the_strongest_refuses():
    streaks = [*of_evidence(9, 8, whole=False), *of_evidence(7, 6)]
    assert [one.is_whole for one in streaks] == [False, False, True, True]
    asked = []

    def tell(streak):
        asked.append(streak.evidence)
        raise ColorModelError(f"nothing in {streak.evidence}")

    with pytest.raises(ColorModelError, match="nothing in 9"):
        strongest_told(streaks, tell)
    assert asked == [7, 6, 9, 8]


def test_other_errors_are_not_passed_over():
    def tell(streak):
        raise ValueError("a mistake")

    with pytest.raises(ValueError, match="a mistake"):
        strongest_told(of_evidence(2, 1), tell)
