from dataclasses import replace

import numpy as np
import pytest
from tests.scenes import noisy, rendered

from blurmatte.background import PlateGuess
from blurmatte.color.model import ColorModel
from blurmatte.figures import draw_overview, style
from blurmatte.figures.solution import _layout, _surroundings
from blurmatte.matting import Pixelwise, Quality, solve
from blurmatte.matting.maps import Grade
from blurmatte.matting.solution import Solution
from blurmatte.matting.stats import SweepSummary
from blurmatte.matting.summary import Alternative
from blurmatte.radiometry import LinearImage, Meta, NoiseModel
from blurmatte.rendering import Ball, Scene, colorful_plate
from blurmatte.streaks import Streak
from blurmatte.sweep.sweep import Diagnostics
from blurmatte.trajectory import Trajectory

NOISE = NoiseModel(gain=1e-5, read_std=5e-4)
PAINT = np.array([0.9, 0.45, 0.05])


def solved(size, start, end, radius=6, region=None, name="image.png"):
    """A noisy image, its plate, and its solution with the true color."""
    scene = Scene(
        colorful_plate(size, rng=2, tile=20), Trajectory.line(start, end), Ball(radius, PAINT)
    )
    truth = rendered(scene)
    image, plate = (replace(p, meta=Meta(name)) for p in noisy(truth, NOISE, 1))
    streak = Streak.from_box(region, size) if region else Streak(truth.layer.alpha > 0)
    return image, plate, solve(image, plate, truth.model, Pixelwise(), streak=streak)


def texts(monkeypatch):
    """All texts drawn on sheets from now on, with their boxes."""
    from PIL import ImageDraw

    written = []
    usual = ImageDraw.ImageDraw.text

    def text(pen, place, words, *args, **kwargs):
        written.append((words, pen.textbbox(place, words, font=args[1])))
        return usual(pen, place, words, *args, **kwargs)

    monkeypatch.setattr(ImageDraw.ImageDraw, "text", text)
    return written


@pytest.mark.filterwarnings("ignore:around the streak")  # a region may cut through the streak
@pytest.mark.parametrize(
    ("size", "start", "end", "region"),
    [
        ((16, 16), (8, 8), (8, 8), (0, 0, 16, 16)),
        ((16, 16), (8, 8), (10, 8), (4, 4, 9, 8)),
        ((120, 90), (30, 40), (80, 50), None),
        ((120, 90), (-5, -5), (40, 30), None),
        ((120, 90), (119, 89), (60, 40), None),
        ((900, 60), (20, 30), (880, 30), None),
        ((60, 900), (30, 20), (30, 880), None),
        ((30, 400), (15, 20), (15, 60), None),
    ],
)
def test_streaks_of_every_size_and_position_are_drawn(monkeypatch, size, start, end, region):
    written = texts(monkeypatch)
    sheet = draw_overview(*solved(size, start, end, region=region))
    assert sheet.dtype == np.uint8
    assert sheet.shape[1:] == (1800, 3)
    assert 600 < sheet.shape[0] < 3200
    for words, (left, top, right, bottom) in written:
        assert left >= 0, words
        assert top >= 0, words
        assert right <= 1800 - 40, words
        assert bottom <= sheet.shape[0], words
    said = " ".join(words for words, _ in written)
    for title in ("image", "plate", "alpha", "color", "error", "layer", "white = 0."):
        assert title in said or "white = 1" in said


def test_a_tall_streak_fills_its_columns(monkeypatch):
    written = texts(monkeypatch)
    draw_overview(*solved((300, 520), (150, 150), (180, 260), radius=10))
    assert "THE STREAK, 4X ENLARGED" in [words for words, _ in written]


def test_crop_at_the_border_is_extended_on_the_other_side():
    _, _, solution = solved((400, 120), (390, 60), (399, 60))
    rows, columns = _surroundings(solution, _layout(solution, 6))
    assert columns.stop == 400
    left, _, right, _ = solution.stats.streak_box
    assert columns.stop - columns.start >= right - left + 2 * 4  # a rim for either side
    assert 0 < rows.start < rows.stop < 120


def test_warnings_are_highlighted():
    image, plate, good = solved((120, 90), (30, 40), (80, 50))
    bad = replace(good, alpha=good.alpha * 5)
    orange = [np.count_nonzero((draw_overview(image, plate, s)[:700, 1000:] == style.WARNING).all(-1))
              for s in (good, bad)]  # fmt: skip
    assert orange[0] == 0
    assert orange[1] > 100


@pytest.mark.parametrize(
    ("grade", "bar"),
    [(Grade.CONFIRMED, None), (Grade.PLAUSIBLE, style.STREAK), (Grade.ASSUMED, style.WARNING)],
)
def test_banner_unless_the_grade_is_confirmed(monkeypatch, grade, bar):
    image, plate, solution = solved((120, 90), (30, 40), (80, 50))
    graded = {"grade": grade, "alpha_error": 0.034, "grade_reasons": ("color",)}
    written = texts(monkeypatch)
    stats = replace(solution.stats, **graded)
    sheet = draw_overview(image, plate, replace(solution, stats=stats))
    (place,) = [box for words, box in written if words.startswith(f"{grade}: ")]
    left, top = int(place[0]) - 5, int(place[1])
    for color in (style.STREAK, style.WARNING):
        assert (tuple(sheet[top, left]) == color) == (color == bar)
    assert sum("alpha" in words and "0.034" in words for words, _ in written) == 1


def test_a_solution_without_a_grade_has_no_banner(monkeypatch):
    written = texts(monkeypatch)
    *pictures, solution = solved((120, 90), (30, 40), (80, 50))
    draw_overview(*pictures, replace(solution, stats=replace(solution.stats, grade=None)))
    assert not any(words.startswith(tuple(Grade)) for words, _ in written)


def alternatives(count, weight=0.2):
    """Hypotheses of different colors and factors."""
    own = {"rgb": (0.4, 0.1, 0.02), "weight": 0.9, "alpha_difference": 0.0, "radius": 8.0}
    own |= {"hex": "#aa5a27", "alpha_factor": 1.0, "name": "disc on an arc, one paint"}
    others = [{**own, "hex": f"#a0402{i}", "alpha_factor": 1.3 + i, "weight": weight}
              for i in range(1, count)]  # fmt: skip
    return tuple(Alternative(**one) for one in (own, *others))


@pytest.mark.diagonal
@pytest.mark.parametrize("size", [(120, 90), (400, 60), (60, 400)])
@pytest.mark.parametrize("count", [1, 5])
def test_alternatives_have_swatches(monkeypatch, size, count):
    """exact: each color with its factor of alpha below, in a row."""
    image, plate, solution = solved(size, (30, 30), (40, 40))
    own, *others = alternatives(count)
    others = replace(own, hex=solution.model.color), *others  # the answer has one color
    stats = replace(solution.stats, grade=Grade.ASSUMED, alpha_scale_std=0.2, alternatives=others)
    written = texts(monkeypatch)
    sheet = draw_overview(image, plate, replace(solution, stats=stats))
    boxes, lefts = dict(written), []  # of the answer's color the last: it is named above, too
    for one in others:
        left, top, _, _ = (round(edge) for edge in boxes[one.hex])
        assert tuple(sheet[top - 30, left + 20]) == tuple(bytes.fromhex(one.hex[1:]))
        below = boxes[f"alpha x {one.alpha_factor:.2f}"]
        assert below[0] == pytest.approx(left, abs=3)
        assert top < below[1] < top + 60
        lefts.append(left)
    assert lefts == sorted(lefts)
    said = " ".join(words for words, _ in written)
    assert said.count("by one standard deviation") == 1
    assert all(right <= 1800 - 40 for _, (_, _, right, _) in written)


def test_sheet_of_gray_pictures_has_no_colors(monkeypatch):
    image, plate, solution = solved((120, 90), (30, 40), (80, 50))
    stats = {"grade": Grade.ASSUMED, "grade_reasons": ("gray",), "alternatives": alternatives(3)}
    written = texts(monkeypatch)
    draw_overview(image, plate, replace(solution, stats=replace(solution.stats, **stats)))
    said = [words for words, _ in written]
    assert "gray, without a hue" in said
    assert "alpha x 2.30" in said
    assert not any("#" in words for words in said)


@pytest.mark.parametrize("grade", [Grade.CONFIRMED, None])
def test_confirmed_and_ungraded_solutions_have_no_swatches(monkeypatch, grade):
    image, plate, solution = solved((120, 90), (30, 40), (80, 50))
    stats = replace(solution.stats, alternatives=alternatives(3), grade=grade)
    written = texts(monkeypatch)
    draw_overview(image, plate, replace(solution, stats=stats))
    assert "WHAT ELSE FITS" not in [words for words, _ in written]


def test_path_is_drawn_only_of_the_likeliest_hypothesis():
    image, plate, solution = solved((120, 90), (30, 40), (80, 50))
    corners = ((30.0, 60.0), (40.0, 60.0), (40.0, 70.0))
    sweep = SweepSummary(
        silhouette="disc",
        path="line",
        xy=((30.0, 80.0), (80.0, 80.0)),
        length=50.0,
        radius=6.0,
        radius_std=0.1,
        outlines=(corners, corners),
        diagnostics=Diagnostics(),
    )
    stats = replace(solution.stats, sweep=sweep, weights=(0.2, 0.8))
    own = Alternative("no shape, one paint", (1.0, 0.0, 0.0), "#ff0000", 0.8, 1.0, 0.0, None)
    bright = [
        np.count_nonzero((draw_overview(image, plate, s)[700:900, 40:1000] == style.BRIGHT).all(-1))
        for s in (
            replace(solution, solver="Swept()", stats=stats),
            replace(solution, solver="Smooth()", stats=replace(stats, alternatives=(own,))),
        )
    ]
    assert bright[0] > bright[1] + 500


def test_a_large_picture_is_reduced():
    y, x = np.mgrid[:600, :1900].astype(np.float32)
    light = np.stack([0.2 + x / 4000, 0.3 + y / 4000, 0.5 - x / 4500], axis=-1)
    image = light.copy()
    image[100:500, 300:1600] *= 0.9
    little = NoiseModel(read_std=1e-6)
    image, plate = (LinearImage(a.astype(np.float32), little) for a in (image, light))
    streak = Streak.from_box((300, 100, 1600, 500), (1900, 600))
    solution = solve(image, plate, ColorModel.from_hex("#ff8000"), Pixelwise(), streak=streak)
    assert draw_overview(image, plate, solution).shape[1] == 1800


def test_captions_do_not_overlap(monkeypatch):
    written = texts(monkeypatch)
    draw_overview(*solved((120, 90), (30, 40), (80, 50), name="a long name " * 12 + "猫.png"))
    boxes = [box for _, box in written]
    for i, a in enumerate(boxes):
        for b in boxes[:i]:
            apart = a[2] <= b[0] or b[2] <= a[0] or a[3] <= b[1] or b[3] <= a[1]
            assert apart


def test_flagged_pixels_are_named(monkeypatch):
    image, plate, solution = solved((120, 90), (30, 40), (80, 50))
    quality = solution.quality.copy()
    y, x = (part[:4] for part in np.nonzero(solution.streak))
    quality[y, x] |= np.uint8(Quality.SATURATED)
    written = texts(monkeypatch)
    flagged = Solution(
        *(solution.alpha, solution.alpha_std, solution.premultiplied, solution.premultiplied_std),
        *(quality, solution.model, solution.solver, solution.stats),
    )
    sheet = draw_overview(image, plate, flagged)
    assert any(words.startswith("clipped ") for words, _ in written)
    assert (sheet == (236, 64, 190)).all(axis=-1).any()


def test_faint_streaks_are_shown_white(monkeypatch):
    written = texts(monkeypatch)
    image, plate, solution = solved((300, 60), (15, 30), (285, 30))
    draw_overview(image, plate, solution)
    (white,) = (float(w.removeprefix("white = ")) for w, _ in written if w.startswith("white"))
    assert white < 0.12


def test_solution_without_known_pixels_is_drawn():
    image, plate, _ = solved((60, 40), (20, 20), (40, 20))
    gray = ColorModel.from_samples(plate.rgb[20:22, 20:22].reshape(-1, 3), std=1e-3)
    unknown = solve(image, plate, gray, Pixelwise(1e-9), streak=Streak(np.ones((40, 60), bool)))
    assert not unknown.known.any()
    assert draw_overview(image, plate, unknown).shape[1] == 1800


def test_rejects_different_sizes():
    image, plate, solution = solved((60, 40), (20, 20), (40, 20))
    with pytest.raises(ValueError, match="same size"):
        draw_overview(image, LinearImage(plate.rgb[:30]), solution)


def test_sheet_names_a_guess_in_the_light_of_a_camera(monkeypatch):
    image, plate, answer = solved((60, 40), (20, 20), (40, 20))
    meta = replace(plate.meta, to_srgb=tuple(map(tuple, np.eye(3))))
    draws = (plate.rgb[answer.streak_place],)
    guess = PlateGuess(
        plate.rgb, plate.variance, plate.valid, meta, answer.streak, draws, draws[0], NOISE
    )
    written = texts(monkeypatch)
    draw_overview(image, guess, answer)
    assert "a guess" in [words for words, _ in written]
