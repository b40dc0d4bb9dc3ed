"""Every command, with correct input and with common mistakes."""

import csv
import json
import os
import re
import shutil
import signal
import struct
import subprocess
import sys
import zlib
from dataclasses import replace
from pathlib import Path

import numpy as np
import OpenEXR
import pytest
from benchmarks.rendered import add_noise
from PIL import Image
from tests.commands import complaint, good, run
from tests.scenes import on_line
from tests.scenes.texts import BALL

import blurmatte as bm
from blurmatte.cli.console import ExitCode, swatches
from blurmatte.explain.solution import grade_in_words
from blurmatte.matting.summary import Alternative
from blurmatte.rendering import colorful_plate

NOISE = bm.NoiseModel(gain=1e-5, read_std=4e-4)
COLOR = "#ffbc43"
PIXELWISE = ("--solver", "pixelwise")
FAST = (*PIXELWISE, "--transfer", "srgb")  # a curve that is given is not compared with others
NAMES = [
    *("alpha.png", "color.png", "layer.exr", "layer.png"),
    *("model.json", "overview.png", "report.json"),
]


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    """A folder with image.png, plate.png (16 bit) and a mask, and their truth."""
    folder = tmp_path_factory.mktemp("scene")
    bm.write(folder / "sharp.png", bm.LinearImage(np.full((9, 9, 3), [0.8, 0.4, 0.04])))
    return pictures_of_ball(folder, (128, 80), (30, 34), (90, 46), 12, 18)


def pictures_of_ball(folder, size, start, end, radius, tile):
    """The folder, with image, plate and mask of an orange ball that moves straight."""
    body = bm.rendering.Ball(radius, (0.9, 0.45, 0.05), ambient=0.6)
    truth = on_line(colorful_plate(size, rng=2, tile=tile), start, end, body)
    rng = np.random.default_rng(5)
    for name, picture in (("image", truth.image), ("plate", truth.plate)):
        noisy = add_noise(picture.rgb, NOISE, rng).astype(np.float32)
        bm.write(folder / f"{name}.png", bm.LinearImage(noisy))
    bm.write(folder / "mask.png", (truth.layer.alpha > 0).astype(float))
    return folder


@pytest.fixture
def here(scene, tmp_path):
    """A copy of the scene that a test may change."""
    shutil.copytree(scene, tmp_path / "scene")
    return tmp_path / "scene"


def solve(scene, out):
    """Results of the scene in a folder, by the fastest solver."""
    files = (scene / "image.png", "--plate", scene / "plate.png", "--color", COLOR)
    return good("solve", *files, *FAST, "--out", out)


@pytest.fixture(scope="module")
def swept(scene, tmp_path_factory):
    """Results of the scene by the default solver."""
    out = tmp_path_factory.mktemp("swept")
    good(
        "solve", scene / "image.png", "--plate", scene / "plate.png", "--color", COLOR, "--out", out
    )
    return out


def content(folder):
    return {path.name: path.read_bytes() for path in Path(folder).iterdir()}


def test_solve_writes_all_results(scene, tmp_path):
    out = tmp_path / "new" / "results"
    result = good("solve", scene / "image.png", "--plate", scene / "plate.png", "--out", out)
    assert sorted(path.name for path in out.iterdir()) == NAMES
    assert result.stderr == ""
    *graded, first, second, third = result.stdout.splitlines()
    assert first.startswith("Solution(128x80, alpha up to 0.")
    assert re.fullmatch(r"#ff\w{4}, rank 1, ± 0\.\d+°", second)
    assert third == str(out / "overview.png")
    solution = bm.read_solution(out / "layer.exr")
    assert graded == grade_in_words(solution)
    assert solution.stats.sum_alpha == pytest.approx(np.pi * 12**2, rel=0.03)
    report = json.loads((out / "report.json").read_text())
    assert report["model"]["rank"] == 1
    assert report["command"].startswith("blurmatte")


def test_solve_counts_pixels_that_are_unknown(scene, tmp_path):
    """Where the plate has the given color."""
    files = scene / "image.png", "--plate", scene / "plate.png", "--color", "#346e6e"
    said = good("solve", *files, *PIXELWISE, "--out", tmp_path).stdout
    stats = bm.read_solution(tmp_path / "layer.exr").stats
    unknown = stats.pixels - stats.pixels_known
    assert unknown > 100
    assert f"\n{unknown} pixels of the streak are unknown and not in the sum\n" in said


def test_solve_names_the_remedy_of_a_second_color(scene, tmp_path):
    body = bm.rendering.Ball(12, (0.9, 0.45, 0.05), second_color=(0.1, 0.2, 0.8))
    truth = on_line(bm.read(scene / "plate.png").rgb, (30, 34), (90, 46), body)
    rng = np.random.default_rng(5)
    bm.write(tmp_path / "two.png", bm.LinearImage(add_noise(truth.image.rgb, NOISE, rng)))
    options = "--plate", scene / "plate.png", "--color", COLOR, *PIXELWISE, "--out", tmp_path
    hint = "may have a second color, and alpha then lacks it; give both (--rank 2, --color twice)"
    assert hint in good("solve", tmp_path / "two.png", *options).stderr
    assert hint not in good("solve", scene / "image.png", *options).stderr


@pytest.fixture
def graded(monkeypatch):
    """A function: from now on solutions have this grade, and matching errors."""
    usual = bm.solve

    def of(grade, **others):
        graded = {"grade": bm.Grade(grade), "alpha_error": 0.04, "alpha_scale_std": 0.25, **others}

        def solve(*args, **kwargs):
            solution = usual(*args, **kwargs)
            stats = replace(solution.stats, grade_reasons=("color",), **graded)
            return replace(solution, stats=stats)

        monkeypatch.setattr(bm, "solve", solve)

    return of


def test_first_line_is_the_grade(scene, tmp_path, graded):
    graded("assumed")
    first, second, *_ = solve(scene, tmp_path).stdout.splitlines()
    assert first == (
        "assumed: the color is uncertain; alpha is known up to a factor of 1 ± 0.25, within 0.04, "
        "its sum within 25 %"
    )
    assert second.startswith("Solution(128x80, ")
    report = json.loads((tmp_path / "report.json").read_text())
    assert report["grade"] == "assumed"
    assert report["in_words"][0] == f"{first}."
    assert bm.read_solution(tmp_path / "layer.exr").grade is bm.Grade.ASSUMED
    assert f"{first}." in good("info", tmp_path / "layer.exr").stdout.splitlines()


def test_second_line_names_alternatives(scene, tmp_path, graded):
    own = {"name": "disc on an arc, one paint", "rgb": (0.4, 0.1, 0.02), "hex": "#aa5a27"}
    own |= {"weight": 0.9, "alpha_factor": 1.0, "alpha_difference": 0.0, "radius": 8.0}
    other = {**own, "hex": "#a04020", "weight": 0.1, "alpha_factor": 1.3}
    graded("assumed", alternatives=tuple(Alternative(**one) for one in (own, other)))
    _, second, third, *_ = solve(scene, tmp_path).stdout.splitlines()
    assert second == "also fits: #a04020 with alpha x 1.30 (disc on an arc, one paint)"
    assert third.startswith("Solution(128x80, ")


@pytest.mark.diagonal
@pytest.mark.parametrize("required", ["confirmed", "plausible"])
@pytest.mark.parametrize("grade", ["confirmed", "plausible", "assumed"])
def test_grade_below_required_sets_exit_code_and_keeps_files(
    scene, tmp_path, graded, grade, required
):
    graded(grade)
    files = (scene / "image.png", "--plate", scene / "plate.png", "--color", COLOR, *FAST)
    result = run("solve", *files, "--out", tmp_path / "o", "--require", required)
    lesser = list(bm.Grade).index(grade) > list(bm.Grade).index(required)
    assert result.exit_code == (ExitCode.LOW_GRADE if lesser else 0)
    assert sorted(content(tmp_path / "o")) == NAMES
    said = f"image.png: its grade is {grade}, --require asks for {required}; its files were written"
    assert (said in result.stderr) == lesser


def test_exit_code_of_a_failed_image_precedes_that_of_a_lesser_grade(here, tmp_path, graded):
    graded("assumed")
    (here / "broken.png").write_text("not a picture")
    images = here / "image.png", here / "broken.png"
    options = ("--plate", here / "plate.png", "--color", COLOR, *FAST, "--require", "confirmed")
    result = run("solve", *images, *options, "--out", tmp_path / "o")
    assert result.exit_code == 2
    assert sorted(content(tmp_path / "o" / "image")) == NAMES


def test_solve_equals_api(scene, swept):
    image, plate = (bm.read(scene / f"{name}.png") for name in ("image", "plate"))
    expected = bm.solve(image, plate, bm.ColorModel.from_hex(COLOR))
    solution = bm.read_solution(swept / "layer.exr")
    assert np.array_equal(solution.alpha, expected.alpha)
    assert np.array_equal(solution.quality, expected.quality)


def test_layer_is_empty_outside_streak(scene, tmp_path):
    solve(scene, tmp_path)
    codes = np.asarray(bm.read_layer(tmp_path / "layer.png").alpha)
    solution = bm.read_solution(tmp_path / "layer.exr")
    assert not codes[~solution.streak].any()
    assert codes.max() <= 1


@pytest.mark.parametrize(
    ("options", "rank", "evidence"),
    [
        (["--color", COLOR], 1, set()),
        (["--color", COLOR, "--color", "2040c0", "--rank", "2"], 2, set()),
        (["--color", "60,40", "--color", "62,41,3"], 1, {"samples"}),
        (["--color", "4,4", "--color-from", "SHARP"], 1, {"samples"}),
        (["--max-brightness", "2"], 1, {"shape", "hue variation"}),
        (["--region", "MASK"], 1, {"shape", "hue variation"}),
    ],
)
def test_accepts_every_form_of_color(scene, tmp_path, options, rank, evidence):
    files = {"SHARP": scene / "sharp.png", "MASK": scene / "mask.png"}
    options = [files.get(option, option) for option in options]
    out = tmp_path / "m.json"
    result = good(
        *("color", scene / "image.png", "--plate", scene / "plate.png"),
        *("--out", out, *options),
    )
    model = bm.read_color_model(out)
    assert model.rank == rank
    assert evidence <= set(model.evidence)
    assert result.stdout.startswith(model.in_words)
    assert ("°" in result.stdout.splitlines()[0]) == bool(model.evidence)
    again = tmp_path / "again.json"
    good(
        *("color", scene / "image.png", "--plate", scene / "plate.png"),
        *("--color", out, "--out", again),
    )
    assert again.read_text() == out.read_text()


def test_region_and_mask_choose_pixels(scene, tmp_path):
    files = (scene / "image.png", "--plate", scene / "plate.png")
    base = ("solve", *files, "--color", COLOR, *FAST)
    good(*base, "--out", tmp_path / "r", "--region", "20,20,70,60")
    good(*base, "--out", tmp_path / "m", "--region", scene / "mask.png")
    region = bm.read_solution(tmp_path / "r" / "layer.exr")
    image, plate = (bm.read(scene / f"{name}.png") for name in ("image", "plate"))
    found = bm.find_streaks(image, plate)[0].mask
    assert np.array_equal(region.streak[20:60, 20:70], found[20:60, 20:70])
    assert np.count_nonzero(region.streak) == np.count_nonzero(found[20:60, 20:70])
    masked = bm.read_solution(tmp_path / "m" / "layer.exr")
    white = bm.read(scene / "mask.png", bm.LINEAR).rgb[..., 0] > 0.5
    assert np.array_equal(masked.streak, white)


def test_occluder_is_excluded_and_flagged(scene, tmp_path):
    light = bm.read(scene / "image.png").rgb
    post = np.zeros_like(light)
    post[:, 56:60] = 1
    bm.write(tmp_path / "post.png", bm.LinearImage(post))
    base = ("solve", scene / "image.png", "--plate", scene / "plate.png", "--color", COLOR, *FAST)
    good(*base, "--out", tmp_path / "o", "--occluder", tmp_path / "post.png")
    solution = bm.read_solution(tmp_path / "o" / "layer.exr")
    flagged = (solution.quality & bm.matting.Quality.OCCLUDED) != 0
    assert flagged[:, 56:60].any()
    assert not flagged[:, :56].any()
    assert not solution.layer.alpha[:, 56:60].any()
    report = json.loads((tmp_path / "o" / "report.json").read_text())
    assert report["flagged"]["OCCLUDED"] == np.count_nonzero(flagged & solution.streak)


def test_region_without_motion_is_solved_with_warning(scene, tmp_path):
    base = ("solve", scene / "image.png", "--plate", scene / "plate.png", "--color", COLOR, *FAST)
    answer = good(*base, "--out", tmp_path, "--region", "90,0,120,20")
    first, line = answer.stderr.splitlines()
    assert "no motion is found in --region 90,0,120,20; all of it is taken" in first
    assert line.startswith(f"blurmatte: warning: {scene / 'image.png'}: Alpha adds up to ")
    assert bm.read_solution(tmp_path / "layer.exr").stats.streak_box == (90, 0, 120, 20)
    report = json.loads((tmp_path / "report.json").read_text("utf-8"))
    warned = [said.removeprefix("blurmatte: warning: ") for said in (first, line)]
    assert report["warnings"] == warned


def test_lists_other_streaks_as_regions(here, tmp_path):
    image = bm.read(here / "image.png")
    image.rgb[5:14, 100:112] *= 0.3
    bm.write(here / "two.png", image)
    base = ("solve", here / "two.png", "--plate", here / "plate.png", "--color", COLOR, *FAST)
    first = good(*base, "--out", tmp_path / "a").stdout
    assert f"{COLOR}, rank 1, given" in first
    (region,) = re.findall(r"also moved, choose with --region: (\S+)\n", first)
    second = good(*base, "--out", tmp_path / "b", "--region", region)
    assert "also moved" not in second.stdout
    solution = bm.read_solution(tmp_path / "b" / "layer.exr")
    assert ",".join(map(str, solution.stats.streak_box)) == region


@pytest.mark.battery
def test_refusal_names_its_streak(here, tmp_path):
    image = bm.read(here / "plate.png")
    y, x = np.mgrid[:80, :128]
    for x0, y0, radius, part in ((55, 40, 12, 0.7), (106, 12, 6, 0.5)):  # soft: shadows, refused
        distance = np.hypot(x - x0, y - y0)
        image.rgb[...] *= 1 - (part / (1 + np.exp((distance - radius) / 1.5)))[..., None]
    bm.write(here / "dark.png", image)
    base = ("solve", here / "dark.png", "--plate", here / "plate.png", "--out", tmp_path / "o")
    line = complaint(run(*base))
    found = re.search(
        r"the streak in (\S+) \(X0,Y0,X1,Y1\); also moved, choose with --region: (\S+)$", line
    )
    boxes = [list(map(int, box.split(","))) for box in found.groups()]
    assert np.abs(np.subtract(boxes, [[43, 28, 67, 52], [100, 6, 112, 18]])).max() < 9
    assert "The strongest is the streak" not in complaint(run(*base, "--region", found[2]))


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--rank", "5"], "--rank must be 1, 2 or 3, got 5"),
        (["--region", "1,2"], "--region must be x0,y0,x1,y1"),
        (["--color-from", "a.png"], "--color-from needs points to pick"),
    ],
)
@pytest.mark.parametrize("command", ["solve", "color"])
def test_refuses_contradictory_options_before_reading(tmp_path, command, options, said):
    out = tmp_path / ("o" if command == "solve" else "o.json")
    files = (tmp_path / "a.png", "--plate", tmp_path / "b.png", "--out", out)
    assert complaint(run(command, *files, *options)).startswith(said)


def test_warns_of_wrong_color(scene, tmp_path):
    files = (scene / "image.png", "--plate", scene / "plate.png", "--out", tmp_path)
    warned = good("solve", *files, "--color", "#3040ff", *FAST).stderr
    assert warned.startswith(f"blurmatte: warning: {scene / 'image.png'}: ")
    assert "in_words" in (tmp_path / "report.json").read_text("utf-8")


def test_several_images_have_a_folder_each_and_one_may_fail(here, tmp_path):
    shutil.copy(here / "image.png", here / "throw2.png")
    shutil.copy(here / "image.png", here / "throw1.png")
    (here / "throw3.png").write_text("not a picture")
    out = tmp_path / "out"
    files = (here / "throw*.png", "--plate", here / "plate.png", "--color", COLOR)
    result = run("solve", *files, *FAST, "--out", out)
    assert "throw3.png: export it again as PNG" in complaint(result)
    beside = ["manifest.jsonl", "pictures.csv"]
    assert sorted(path.name for path in out.iterdir()) == [*beside, "throw1", "throw2"]
    *answers, summary, table = result.stdout.splitlines()
    assert len(answers) == 8
    assert (summary, table) == ("3 pictures: 2 solved now, 1 refused", str(out / "pictures.csv"))
    assert sorted(content(out / "throw2")) == NAMES


def test_table_of_several_pictures_has_what_was_found_and_why_not(here, tmp_path):
    for number in (1, 2):
        shutil.copy(here / "image.png", here / f"throw{number}.png")
    shutil.copy(here / "plate.png", here / "throw3.png")
    files = (here / "throw*.png", "--plate", here / "plate.png", "--color", COLOR)
    run("solve", *files, *FAST, "--out", tmp_path / "o")
    with (tmp_path / "o" / "pictures.csv").open(encoding="utf-8") as file:
        first, second, third = csv.DictReader(file)
    assert list(first) == [
        *("picture", "folder", "grade", "alpha_error", "sum_alpha", "sum_alpha_std"),
        *("radius", "radius_std", "length", "length_std", "angle", "angle_std", "color", "reason"),
    ]
    assert (first["picture"], first["folder"]) == (str(here / "throw1.png"), "throw1")
    assert first["reason"] == ""
    motion = bm.measure_motion(bm.read_solution(tmp_path / "o/throw1/layer.exr"))
    assert float(first["length"]) == pytest.approx(motion.length, rel=1e-4)
    assert float(first["angle"]) == pytest.approx(np.degrees(motion.angle), rel=1e-4)
    assert float(first["radius"]) == pytest.approx(12, rel=0.03)
    assert float(first["sum_alpha"]) == pytest.approx(np.pi * 12**2, rel=0.03)
    assert second["sum_alpha"] == first["sum_alpha"]
    assert third["folder"] == third["sum_alpha"] == ""
    assert "nothing moved" in third["reason"]


def test_row_of_pictures_is_resumed(here, tmp_path):
    for number in (1, 2, 3):
        shutil.copy(here / "image.png", here / f"throw{number}.png")
    row = ("solve", here / "throw*.png", "--plate", here / "plate.png", "--color", COLOR)
    row = (*row, *FAST, "--out", tmp_path / "o")
    first = good(*row).stdout.splitlines()
    table = (tmp_path / "o" / "pictures.csv").read_text()
    assert first[-2] == "3 pictures: 3 solved now"
    again = good(*row).stdout.splitlines()
    assert again == ["3 pictures: 0 solved now, 3 done before", str(tmp_path / "o/pictures.csv")]
    assert (tmp_path / "o" / "pictures.csv").read_text() == table
    lines = good(*row, "--json").stdout.splitlines()
    assert [Path(json.loads(line)["folder"]).name for line in lines] == [
        "throw1",
        "throw2",
        "throw3",
    ]

    (tmp_path / "o" / "throw1" / "report.json").write_text("{")
    assert "remove the file, and solve its picture again" in complaint(run(*row, "--json"))
    (tmp_path / "o" / "throw1" / "alpha.png").unlink()  # removed, changed, added: solved again
    bm.write(here / "throw2.png", bm.LinearImage(0.99 * bm.read(here / "image.png").rgb))
    shutil.copy(here / "image.png", here / "throw4.png")
    assert good(*row).stdout.splitlines()[-2] == "4 pictures: 3 solved now, 1 done before"
    other = good(*row, "--match", "none").stdout.splitlines()
    assert other[-2] == "4 pictures: 4 solved now"
    bm.write(here / "plate.png", bm.LinearImage(0.999 * bm.read(here / "plate.png").rgb))
    assert good(*row, "--match", "none").stdout.splitlines()[-2] == "4 pictures: 4 solved now"


def test_resumed_row_is_still_checked_for_its_grades(here, tmp_path, graded):
    graded("assumed")
    for number in (1, 2):
        shutil.copy(here / "image.png", here / f"throw{number}.png")
    row = ("solve", here / "throw*.png", "--plate", here / "plate.png", "--color", COLOR)
    row = (*row, *FAST, "--out", tmp_path / "o", "--require", "plausible")
    for _ in range(2):
        result = run(*row)
        assert result.exit_code == ExitCode.LOW_GRADE
        assert result.stderr.count("its grade is assumed") == 2


def test_rejects_images_of_equal_names(here, tmp_path):
    (tmp_path / "b").mkdir()
    shutil.copy(here / "image.png", tmp_path / "b")
    images = here / "image.png", tmp_path / "b" / "image.png"
    line = complaint(run("solve", *images, "--plate", here / "plate.png", "--out", tmp_path / "o"))
    assert "give one file named image at a time, got 2" in line
    assert not (tmp_path / "o").exists()


def test_compose_puts_the_layer_over_a_background(scene, tmp_path):
    solve(scene, tmp_path)
    sea = tmp_path / "sea.png"
    light = np.random.default_rng(0).uniform(0, 0.5, (200, 200, 3)).astype(np.float32)
    bm.write(sea, bm.LinearImage(light))
    target = tmp_path / "at sea.png"
    refused = run("compose", tmp_path / "layer.exr", "--over", sea, "--out", target)
    line = complaint(refused)
    assert "sea.png" in line
    assert "--fit cover" in line
    assert not target.exists()
    good("compose", tmp_path / "layer.exr", "--over", sea, "--out", target, "--fit", "cover")
    layer = bm.read_layer(tmp_path / "layer.exr")
    expected = layer.over(bm.compositing.cover(bm.read(sea), layer.size))
    assert np.allclose(bm.read(target).rgb, expected.rgb, atol=1e-4)
    same = tmp_path / "same.exr"
    good("compose", tmp_path / "layer.png", "--over", scene / "plate.png", "--out", same)
    assert bm.read(same).size == (128, 80)
    odd = run("compose", tmp_path / "layer.exr", "--over", sea, "--out", target, "--fit", "fill")
    assert "--fit must be cover" in complaint(odd)


def test_info_describes_a_picture(scene, tmp_path):
    said = good("info", scene / "image.png").stdout
    assert "image.png: PNG, 128x80 pixels, 16 bit RGB" in said
    assert "transfer: srgb (its tags" in said
    assert "valid (not clipped, opaque): 100.00%" in said
    plain = tmp_path / "plain.jpg"
    Image.new("RGB", (30, 20), (10, 20, 30)).save(plain)
    guess = good("info", plain)
    assert "srgb (a guess: nothing in the file says)" in guess.stdout
    assert guess.stderr.startswith("blurmatte: warning: ")
    assert len(guess.stderr.splitlines()) == 1
    answer = good("info", plain, "--transfer", "gamma2.2")
    assert "gamma2.2 (as you said)" in answer.stdout
    assert answer.stderr == ""


def test_info_lists_the_shots_of_a_clip(tmp_path):
    pytest.importorskip("av", reason="needs the extra video")
    views = [bm.LinearImage(colorful_plate((64, 48), seed, tile=12)) for seed in (1, 2)]
    bm.write_frames(tmp_path / "cut.mov", [views[k > 3] for k in range(9)], 25)
    answer = json.loads(good("info", tmp_path / "cut.mov", "--shots", "--json").stdout)
    places = [(shot["start"], shot["stop"], shot["begins_with"]) for shot in answer["shots"]]
    assert places == [(0, 4, "start"), (4, 9, "cut")]
    said = good("info", tmp_path / "cut.mov", "--shots").stdout.splitlines()
    assert said[-2:] == ["shot 1: frames 0 to 3", "shot 2: frames 4 to 8, after a cut"]
    assert "give a clip" in complaint(run("info", "examples/plain/image.png", "--shots"))


def test_info_describes_results(swept, tmp_path):
    solution = good("info", swept / "layer.exr").stdout
    assert "Solution(128x80" in solution
    assert "solver: Swept" in solution
    assert re.search(r"^sum_alpha: [\d.]{1,7}$", solution, re.MULTILINE)
    assert re.search(r"^sweep.outlines: 2 x \d+ points$", solution, re.MULTILINE)
    assert "other_boxes: none" in solution
    assert max(map(len, solution.splitlines())) < 200
    report = good("info", swept / "report.json").stdout
    assert f"{swept / 'report.json'}: a report, text" in report
    assert "explains the streak" in report
    assert "rank 1, given" in good("info", swept / "model.json").stdout
    straight = good("info", swept / "layer.png").stdout
    assert "16 bit RGB and straight alpha: a layer" in straight
    assert "alpha: up to" in straight
    assert "valid" not in straight
    layer = bm.read_layer(swept / "layer.png")
    bm.write(tmp_path / "layer.tif", layer)
    assert "RGB and premultiplied alpha" in good("info", tmp_path / "layer.tif").stdout


@pytest.mark.parametrize(
    "arguments",
    [
        ("info", "x" * 300 + ".png"),
        ("solve", "x" * 300 + ".png", "--plate", "examples/plain/plate.png", "--out", "o"),
        ("render", "x" * 300, "--out", "o"),
        ("render", "easy", "--out", "x" * 300),
    ],
)
def test_names_file_whose_name_is_too_long(arguments):
    """Door: with the message of the system and the name."""
    assert "x" * 300 in complaint(run(*arguments))


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("compose", "layer.exr", "--over", "sea.png", "--out", "at.sea"), "a picture is written"),
        (("stack", "a.exr", "--over", "sea.png", "--out", "at.sea"), "a picture is written as"),
        (("paints", "layer.exr", "--color", "#ff0000", "--out", __file__), "name of a folder"),
        (("info", "nowhere.json"), "nowhere.json: check the name; there is no such file"),
    ],
)
def test_refuses_unwritable_or_unreadable_files_first(arguments, said):
    """Door: before anything is read."""
    answer = complaint(run(*arguments))
    assert said in answer
    assert "nor is it" not in answer


@pytest.mark.parametrize(
    ("arguments", "kept"),
    [
        (("edit", "l.exr", "--image", "i.png", "--fade", 2, "--out", "i.png"), "i.png"),
        (
            (
                "compose",
                "l.exr",
                "--over",
                "i.png",
                "--fade",
                2,
                "--out",
                "o.png",
                "--sheet",
                "./i.png",
            ),
            "i.png",
        ),
        (("compose", "l.exr", "--over", "p.png", "--out", "p.png"), "p.png"),
        (("stack", "l.exr", "--over", "p.png", "--out", "l.exr"), "l.exr"),
        (("show", "i.png", "--out", "i.png"), "i.png"),
        (("measure", "l.exr", "--image", "i.png", "--overlay", "i.png"), "i.png"),
        (("remove", "l.exr", "--image", "i.png", "--plate", "p.png", "--out", "p.png"), "p.png"),
        (("calibrate", "noise", "i.png", "p.png", "--plot", "i.png"), "i.png"),
        (("calibrate", "response", "i.png", "p.png", "--plot", "p.png"), "p.png"),
        (("plate", "*.png", "--out", "i.png"), "i.png"),
        (("plate", ".", "--out", "i.png"), "i.png"),
        (("paints", "l.exr", "--color", COLOR, "--color", "#0000ff", "--out", "."), "overview.png"),
    ],
)
def test_refuses_to_replace_its_input(arguments, kept, tmp_path, monkeypatch):
    """Door: also the sheet of a solution."""
    monkeypatch.chdir(tmp_path)
    for name in ("i.png", "p.png", "l.exr", "overview.png"):
        Path(name).write_bytes(b"not to be lost")
    answer = complaint(run(*arguments))
    assert answer.startswith(f"{kept}: ")
    assert "would be replaced" in answer
    assert Path(kept).read_bytes() == b"not to be lost"


def test_rejects_opaque_pictures_as_layers(tmp_path):
    bm.write(tmp_path / "full.png", bm.Layer(np.ones((9, 9)), np.full((9, 9, 3), 0.2)))
    said = good("info", tmp_path / "full.png").stdout
    assert "layer" not in said
    assert "valid (not clipped, opaque): 100.00%" in said


def test_version_and_help():
    assert good("--version").stdout == f"blurmatte {bm.__version__}\n"
    for command in ("solve", "color", "compose", "info"):
        assert command in good("--help").stdout
        assert "--" in good(command, "--help").stdout


# What people feed to it by mistake. Each writes to `path` and returns a part of what must be said.


def _missing(path, here):
    return "there is no such file"


def _empty(path, here):
    path.write_bytes(b"")
    return "empty"


def _text(path, here):
    path.write_text("I am not a picture.\n" * 30)
    return "holds no picture of a known kind"


def _truncated(path, here):
    picture = Image.fromarray(np.random.default_rng(0).integers(0, 255, (80, 128, 3), np.uint8))
    if path.suffix == ".exr":
        bm.write(path, bm.read(here / "image.png"))
    else:
        picture.save(path)
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    return "truncated"


def _other_size(path, here):
    bm.write(path, bm.LinearImage(bm.read(here / "image.png").rgb[:60]))
    return "128x60"


def _gray(path, here):
    bm.write(path, bm.read(here / "image.png").rgb[..., 1])
    return "is gray and"


def _infinite(value):
    def forge(path, here):
        light = bm.read(here / "image.png").rgb.copy()
        light[3, 4, 1] = value
        OpenEXR.File({"type": OpenEXR.scanlineimage}, {"RGB": light}).write(str(path))
        return "1 of 10240 pixels are NaN, infinite, or beyond"

    return forge


def _same(path, here):
    shutil.copy(here / "plate.png", path)
    return "nothing moved"


def _palette(path, here):
    Image.new("P", (128, 80)).save(path)
    return "palette"


def _cmyk(path, here):
    Image.new("CMYK", (128, 80)).save(path)
    return "CMYK"


def _huge(path, here):
    header = struct.pack(">IIBBBBB", 100_000, 100_000, 8, 2, 0, 0, 0)
    chunks = ((b"IHDR", header), (b"IDAT", zlib.compress(b"\0" * 4)), (b"IEND", b""))
    path.write_bytes(
        b"\x89PNG\r\n\x1a\n"
        + b"".join(
            struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
            for kind, data in chunks
        )
    )
    return "--max-pixels"


BAD = [
    ("nowhere.png", _missing),
    *((f"a.{kind}", _empty) for kind in ("png", "jpg", "tif", "exr")),
    ("a.png", _text),
    *((f"a.{kind}", _truncated) for kind in ("png", "jpg", "tif", "exr")),
    ("a.png", _other_size),
    ("a.png", _gray),
    ("a.exr", _infinite(np.nan)),
    ("a.exr", _infinite(np.inf)),
    ("a.png", _same),
    ("a.png", _palette),
    ("a.jpg", _cmyk),
    ("a.png", _huge),
]


@pytest.mark.diagonal
@pytest.mark.parametrize(("name", "forge"), BAD, ids=lambda x: getattr(x, "__name__", x))
@pytest.mark.parametrize("spoiled", ["image", "plate"])
def test_bad_picture_gives_one_line_and_writes_nothing(here, tmp_path, name, forge, spoiled):
    bad = here / "für Ärger 猫" / name
    bad.parent.mkdir()
    says = forge(bad, here)
    if forge is _same and spoiled == "plate":
        shutil.copy(here / "image.png", bad)
    out = tmp_path / "out"
    out.mkdir()
    for result in NAMES:
        (out / result).write_text("from yesterday")
    before = content(out)
    files = {"image": here / "image.png", "plate": here / "plate.png", spoiled: bad}
    options = ("--transfer", "srgb", "--color", COLOR, "--out", out)
    line = complaint(run("solve", files["image"], "--plate", files["plate"], *options))
    assert says in line
    assert name in line or str(files["image"]) in line
    assert content(out) == before


@pytest.mark.parametrize("code", [0, 255])
@pytest.mark.parametrize("kind", ["png", "jpg"])
def test_rejects_black_and_clipped_pictures(tmp_path, code, kind):
    for name in ("image", "plate"):
        Image.new("RGB", (64, 48), (code,) * 3).save(tmp_path / f"{name}.{kind}")
    files = (tmp_path / f"image.{kind}", "--plate", tmp_path / f"plate.{kind}")
    line = complaint(run("solve", *files, "--out", tmp_path / "o", "--transfer", "srgb"))
    assert "nothing moved" in line if code == 0 else "no unclipped pixel" in line
    assert f"image.{kind}" in line
    assert not (tmp_path / "o").exists()


def test_rejects_pictures_of_one_pixel(tmp_path):
    for name in ("image", "plate"):
        Image.new("RGB", (1, 1), (10, 20, 30)).save(tmp_path / f"{name}.png")
    files = (tmp_path / "image.png", "--plate", tmp_path / "plate.png")
    line = complaint(run("solve", *files, "--out", tmp_path / "o", "--transfer", "srgb"))
    assert "image.png: the picture is 1x1 pixels" in line


def test_warns_of_swapped_pictures(tmp_path):
    body = bm.rendering.Ball(14, (0.9, 0.45, 0.05))
    truth = on_line(colorful_plate((128, 80), rng=2, tile=3), (44, 34), (84, 40), body)
    rng = np.random.default_rng(0)
    for name, picture in (("plate", truth.image), ("image", truth.plate)):
        noisy = add_noise(picture.rgb, NOISE, rng).astype(np.float32)
        bm.write(tmp_path / f"{name}.png", bm.LinearImage(noisy))
    result = good(
        *("solve", tmp_path / "image.png", "--plate", tmp_path / "plate.png"),
        *("--color", COLOR, *FAST, "--out", tmp_path),
    )
    line = result.stderr.splitlines()[0]  # alpha below 0 may follow
    assert line.startswith("blurmatte: warning: ")
    assert "image.png" in line
    assert "swapped" in line
    assert "swapped" in json.loads((tmp_path / "report.json").read_text())["warnings"][0]


def test_warns_of_guessed_transfer_once(small, tmp_path):
    for name in ("image", "plate"):
        codes = np.rint(255 * bm.SRGB.encode(bm.read(small / f"{name}.png").rgb)).astype(np.uint8)
        Image.fromarray(codes).save(tmp_path / f"plain {name}.png")
    files = (tmp_path / "plain image.png", "--plate", tmp_path / "plain plate.png")
    files += ("--color", COLOR)
    result = good("solve", *files, *PIXELWISE, "--out", tmp_path / "o")
    (line,) = result.stderr.splitlines()
    assert line.startswith(f"blurmatte: warning: {tmp_path / 'plain plate.png'}: the file has no")
    again = good("solve", *files, *FAST, "--out", tmp_path / "o")
    assert again.stderr == ""


@pytest.mark.parametrize("out", ["file", "file/below/it"])
def test_refuses_folder_that_is_a_file(here, tmp_path, out):
    (tmp_path / "file").write_text("mine")
    files = (here / "image.png", "--plate", here / "plate.png", "--color", COLOR)
    line = complaint(run("solve", *files, "--out", tmp_path / out))
    assert str(tmp_path / "file") in line
    assert (tmp_path / "file").read_text() == "mine"
    line = complaint(run("color", *files, "--out", tmp_path / out / "m.json"))
    assert "m.json" in line


def test_accepts_any_file_name(here, tmp_path):
    odd = tmp_path / "my pictures — Größe 100% [1]"
    shutil.copytree(here, odd)
    files = (odd / "image.png", "--plate", odd / "plate.png", "--color", COLOR)
    result = good("solve", *files, *FAST, "--out", odd / "ergebnisse für dich")
    assert "Größe" in result.stdout
    report = json.loads((odd / "ergebnisse für dich" / "report.json").read_text("utf-8"))
    assert report["image"]["file"] == "image.png"


@pytest.mark.parametrize(
    ("options", "says"),
    [
        (["--color", "#12345"], "must look like #d8ff3c"),
        (["--color", "#000000"], "black"),
        (["--color", COLOR, "--color", "#2040c0"], "two colors are --rank 2"),
        (["--color", COLOR, "--rank", "2"], "takes 2 hex colors"),
        (["--rank", "2"], "--rank 2 needs colors"),
        (["--color", "60,40", "--rank", "3"], "leave --color out"),
        (["--color", "60,40", "--rank", "4"], "--rank must be 1, 2 or 3"),
        (["--rank", "0"], "--rank must be 1, 2 or 3"),
        (["--color", COLOR, "--color", "60,40"], "not a mixture"),
        (["--color", "600,40"], "must lie in the picture"),
        (["--color", "6,x"], "x,y or x,y,radius"),
        (["--color", "core"], "no opaque core"),
        (["--color", "nowhere.json"], "nowhere.json"),
        (["--color-from", "sharp.png"], "needs points"),
        (["--transfer", "rec2020"], "no transfer is called"),
        (["--region", "0,0,9"], "x0,y0,x1,y1"),
        (["--region", "0,0,999,50"], "must lie in the picture"),
        (["--region", "nowhere.png"], "nowhere.png"),
        (["--region", "SHARP"], "the mask"),
        (["--occluder", "SHARP", "--color", "#ff0000"], "the occluder"),
        (["--max-brightness", "-1"], "--max-brightness must be above 0, got -1"),
        (["--solver", "smooth:0"], "must have a number F above 0, got '0'"),
        (["--require", "assumed"], "--require must be confirmed or plausible, got 'assumed'"),
        (["--region", "BLACK"], "has no white pixel"),
        (["--occluder", "WHITE", "--color", "#ff0000"], "marks all pixels"),
        (["--max-pixels", "100"], "more than the limit of 100"),
    ],
)
def test_refuses_bad_options_in_one_line(scene, tmp_path, options, says):
    named = {"SHARP": scene / "sharp.png"}
    for name, light in (("BLACK", 0.0), ("WHITE", 1.0)):
        named[name] = tmp_path / f"{name}.png"
        bm.write(named[name], bm.LinearImage(np.full((80, 128, 3), light)))
    options = [str(named.get(option, option)) for option in options]
    files = ("--plate", scene / "plate.png", "--out", tmp_path / "o")
    assert says in complaint(run("solve", scene / "image.png", *files, *options))
    assert not (tmp_path / "o").exists()


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["solve"], "Missing argument 'IMAGE'; see"),
        (["solve", "a.png", "--out", "o"], "a single picture needs --plate"),
        (["solve", "a.png", "b.png", "--out", "o"], "in quotes, a pattern means frames"),
        (
            ["solve", "--plat", "b.png"],
            "--plat (Possible options: --opacity, --plate, --rate); see",
        ),
        (["solve", "a.png", "--plate", "b.png", "--out"], "requires an argument"),
        (["solve", "a.png", "--plate", "b.png", "--out", "o", "--rank", "two"], "valid integer"),
        (["slove"], "No such command 'slove'"),
        (["--colour"], "No such option"),
        (["--color", "#ff0000", "solve"], "--color goes behind the command"),
    ],
)
def test_reports_wrong_usage_in_one_line(words, says):
    line = complaint(run(*words))
    assert says in line
    assert line.endswith("--help")


def test_pattern_without_files_is_named(scene, tmp_path):
    pattern = scene / "no*.png"
    line = complaint(run("solve", pattern, "--plate", scene / "plate.png", "--out", tmp_path / "o"))
    assert f"{pattern}: there are no such files" in line


def test_out_of_memory_gives_one_line(scene, tmp_path, monkeypatch):
    def full(*args, **kwargs):
        raise MemoryError

    monkeypatch.setattr(bm, "solve", full)
    files = (scene / "image.png", "--plate", scene / "plate.png", "--color", COLOR)
    line = complaint(run("solve", *files, "--out", tmp_path / "o"))
    assert "image.png: too large for the memory" in line


@pytest.mark.parametrize("command", ["info", "compose"])
def test_info_and_compose_refuse_in_one_line(scene, tmp_path, command):
    (tmp_path / "bad.exr").write_bytes(b"")
    options = ("--over", scene / "plate.png", "--out", tmp_path / "c.png")
    line = complaint(run(command, tmp_path / "bad.exr", *(options if command == "compose" else ())))
    assert "bad.exr: copy or export it again; the file is empty" in line
    assert not (tmp_path / "c.png").exists()


# The program itself.

PROGRAM = (sys.executable, "-c", "from blurmatte.cli import app; app()")


def test_help_prints_nothing_to_stderr():
    done = subprocess.run([*PROGRAM, "--help"], capture_output=True, text=True, check=False)
    assert done.returncode == 0
    assert done.stderr == ""


def test_program_ends_with_one_line(tmp_path):
    done = subprocess.run(
        [*PROGRAM, "info", tmp_path / "Ä b.png"], capture_output=True, text=True, check=False
    )
    assert done.returncode == 2
    assert done.stdout == ""
    assert (
        done.stderr == f"blurmatte: {tmp_path / 'Ä b.png'}: check the name; there is no such file\n"
    )


@pytest.mark.skipif(os.name != "posix", reason="signals as POSIX has them")
def test_interrupt_exits_130_quietly(scene, tmp_path):
    code = (
        "import signal, time, blurmatte as bm; from blurmatte.cli import app\n"
        "signal.signal(signal.SIGINT, signal.default_int_handler)  # a job in the background has none\n"
        "def slow(*a, **k):\n    print('ready', flush=True); time.sleep(60)\n"
        "bm.solve = slow; app()"
    )
    files = [scene / "image.png", "--plate", scene / "plate.png", "--color", COLOR]
    running = subprocess.Popen(
        [sys.executable, "-c", code, "solve", *files, "--out", tmp_path / "o"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert running.stdout.readline() == "ready\n"
    running.send_signal(signal.SIGINT)
    said, complained = running.communicate(timeout=120)
    assert (running.returncode, said, complained) == (130, "", "")
    assert not (tmp_path / "o").exists()


@pytest.fixture(scope="module")
def renderings(tmp_path_factory):
    """A folder with two rendered scenes, one and two, and their scene file."""
    folder = tmp_path_factory.mktemp("rendered")
    for name, text in (("one", BALL), ("two", BALL.replace("seed = 1", "seed = 2"))):
        (folder / f"{name}.toml").write_text(text)
    good("render", folder / "one.toml", folder / "two.toml", "--out", folder / "scenes")
    return folder


def test_render_writes_pictures_and_truth(renderings):
    folder = renderings / "scenes" / "one"
    assert sorted(p.name for p in folder.iterdir()) == [
        *("image.png", "overview.png", "plate.png", "scene.toml", "truth")
    ]
    assert (folder / "scene.toml").read_text() == BALL
    assert len(list((folder / "truth").glob("subframe_*.exr"))) == 8
    assert bm.read(folder / "image.png").size == (48, 36)
    assert bm.read(folder / "overview.png").size == (4 * 48, 36)


def test_render_writes_a_single_scene_into_the_folder(renderings, tmp_path):
    result = good("render", renderings / "one.toml", "--out", tmp_path / "x")
    assert result.stdout.strip() == str(tmp_path / "x" / "overview.png")
    same = (tmp_path / "x" / "image.png").read_bytes()
    assert same == (renderings / "scenes" / "one" / "image.png").read_bytes()


def test_render_numbers_the_frames_of_a_clip(tmp_path):
    (tmp_path / "clip.toml").write_text(BALL + "[clip]\ncount = 2\nduty = 0.5\n")
    good("render", tmp_path / "clip.toml", "--out", tmp_path / "x")
    assert sorted(p.name for p in (tmp_path / "x").iterdir()) == ["000", "001"]


def test_render_lists_its_scenes():
    lines = good("render", "--list").stdout.splitlines()
    assert len(lines) == len(bm.scenes.scene_names())
    assert any(line.startswith("easy ") and "orange ball" in line for line in lines)


@pytest.mark.parametrize(
    ("args", "says"),
    [
        ((), "give a SCENE, or --all, or --list"),
        (("easy",), "give --out, the folder"),
        (
            ("nowhere", "--out", "x"),
            "nowhere: check the name; there is no such file; the built-in scenes are",
        ),
    ],
)
def test_render_refuses_in_one_line(args, says):
    assert says in complaint(run("render", *args))


def test_score_of_solutions_has_every_metric(renderings, tmp_path):
    for name in ("one", "two"):
        scene = renderings / "scenes" / name
        files = (scene / "image.png", "--plate", scene / "plate.png")
        model = scene / "truth" / "model.json"
        good("solve", *files, "--out", tmp_path / name, "--color", model)
    result = good(
        "score", tmp_path, "--truth", renderings / "scenes", "--out", tmp_path / "scores.json"
    )
    head, *rows = result.stdout.splitlines()
    assert "alpha RMSE" in head
    names = [["one", "yes"], ["two", "yes"], ["mean", "yes"], ["std", "error"]]
    assert [row.split()[:2] for row in rows] == names
    scores = json.loads((tmp_path / "scores.json").read_text())
    assert scores["one"]["alpha_rmse"] < 0.05
    assert 0.5 < scores["one"]["alpha_spread"] < 1  # calibrated on harder scenes than this


def test_score_accepts_one_file(renderings, tmp_path):
    scene = renderings / "scenes" / "one"
    bm.write(tmp_path / "mine.png", bm.read_layer(scene / "truth" / "layer.exr"))
    rows = good("score", tmp_path / "mine.png", "--truth", scene).stdout.splitlines()
    assert len(rows) == 2
    assert rows[1].split()[:2] == ["one", "yes"]


def test_scene_without_a_result_counts_as_a_miss(renderings, tmp_path):
    shutil.copytree(renderings / "scenes" / "one" / "truth", tmp_path / "one")
    result = good("score", tmp_path, "--truth", renderings / "scenes")
    assert result.stderr == "blurmatte: two: no result, a miss\n"
    assert result.stdout.splitlines()[2].split()[:2] == ["two", "miss"]


def test_scores_are_a_table(renderings, tmp_path):
    """Exact: one row for each scene, with its name."""
    truth, out = renderings / "scenes", tmp_path / "scores.csv"
    (place, *_) = bm.scenes.find_scenes(truth)
    result = run("score", place / "truth/layer.exr", "--truth", place, "--out", out)
    assert result.exit_code == 0, result.stderr
    names, values = (line.split(",") for line in out.read_text().splitlines())
    assert (names[:2], values[:2]) == (["scene", "answered"], [place.name, "True"])


def test_score_refuses_in_one_line(renderings, tmp_path):
    truth = ("--truth", renderings / "scenes" / "one")
    layer = bm.read_layer(renderings / "scenes" / "one" / "truth" / "layer.exr")
    small = bm.Layer(layer.alpha[:-1], layer.premultiplied[:-1])
    bm.write(tmp_path / "small.exr", small)
    bm.write(tmp_path / "nan.exr", bm.Layer(np.nan * layer.alpha, layer.premultiplied))
    bm.write(tmp_path / "opaque.png", bm.LinearImage(layer.premultiplied))
    for name, says in [
        ("small.exr", "the result is 48x35 pixels and the truth 48x36"),
        ("nan.exr", "NaN"),
        ("opaque.png", "has no alpha"),
        ("missing.exr", "missing.exr"),
        (".", "holds no result"),
    ]:
        assert says in complaint(run("score", tmp_path / name, *truth))
    says = complaint(run("score", tmp_path / "small.exr", "--truth", tmp_path))
    assert "holds no scene with its truth" in says


def test_damaged_result_is_named_and_counts_as_a_miss(renderings, tmp_path):
    for name in ("one", "two"):
        shutil.copytree(renderings / "scenes" / name / "truth", tmp_path / name)
    (tmp_path / "two" / "layer.exr").write_bytes(b"nothing")
    result = run("score", tmp_path, "--truth", renderings / "scenes")
    assert result.exit_code == 2
    (line,) = result.stderr.splitlines()
    assert "layer.exr" in line
    assert line.endswith("a miss")
    assert result.stdout.splitlines()[2].split()[:2] == ["two", "miss"]


def test_swatches_are_drawn_on_terminals_only(monkeypatch):
    basis = bm.ColorModel.from_hex("#d8a03c").basis
    model = bm.ColorModel(basis, 0.02**2 * (np.eye(3) - basis @ basis.T))
    assert swatches(model) == []
    monkeypatch.setattr("sys.stdout.isatty", lambda: True)
    (row,) = swatches(model)
    assert row.count("\x1b[48;2;") == 9
    assert "48;2;255;190;73" in row
    assert swatches(bm.ColorModel.any()) == []


def bent(scene, folder, exponent):
    """The same pictures in files that were encoded with another curve."""
    for name in ("image.png", "plate.png"):
        with Image.open(scene / name) as picture:
            light = bm.SRGB.decode(np.asarray(picture, float) / 255)
        codes = np.rint(255 * light ** (1 / exponent)).astype(np.uint8)
        Image.fromarray(codes).save(folder / name)
    return folder / "image.png", "--plate", folder / "plate.png"


@pytest.fixture(scope="module")
def small(tmp_path_factory):
    """A smaller ball, for searches that fit shapes with several curves."""
    return pictures_of_ball(tmp_path_factory.mktemp("small"), (80, 56), (18, 24), (54, 32), 7, 12)


def test_auto_finds_transfer(small, tmp_path):
    result = good("color", *bent(small, tmp_path, 1), "--transfer", "auto")
    assert result.stdout.startswith("transfer: linear")
    straight = good(
        "color", small / "image.png", "--plate", small / "plate.png", "--transfer", "auto"
    )
    assert straight.stdout.startswith("transfer: srgb")


def test_warns_of_better_transfer(small, tmp_path):
    files = (*bent(small, tmp_path, 1), "--out", tmp_path / "out")
    result = run("solve", *files, "--color", COLOR, *PIXELWISE)
    assert "light looks bent: with --transfer linear" in result.stderr


def test_no_transfer_warning_if_transfers_differ(scene, tmp_path):
    image, _, plate = bent(scene, tmp_path, 1)
    bm.write(tmp_path / "plate.exr", bm.read(plate, bm.SRGB))
    files = (image, "--plate", tmp_path / "plate.exr", "--out", tmp_path / "out")
    assert "light looks bent" not in good("solve", *files, "--color", COLOR, *PIXELWISE).stderr
    assert (tmp_path / "out" / "alpha.png").exists()


def test_solver_shaded_solves_shadow(scene, tmp_path):
    shade = bm.read(scene / "plate.png").rgb * np.array([0.4, 0.55, 0.8], np.float32)
    bm.write(tmp_path / "shade.png", bm.LinearImage(shade))
    files = (scene / "image.png", "--plate", scene / "plate.png", "--transfer", "srgb", "--solver")
    out = ("--out", tmp_path / "a", "--color", COLOR)
    good("solve", *files, f"shaded:{tmp_path / 'shade.png'}", *out)
    solution = bm.read_solution(tmp_path / "a" / "layer.exr")
    assert solution.solver == "Shaded(plate in shadow)"
    assert solution.stats.sum_shadow is not None
    good("solve", *files, "shaded", "--out", tmp_path / "b", "--color", COLOR)
    assert "light=" in bm.read_solution(tmp_path / "b" / "layer.exr").solver


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--solver", "shaded"), "--solver shaded needs the plate in shadow, shaded:FILE"),
        (("--solver", "swept:2"), "--solver swept takes no value"),
        (("--solver", "fast"), "--solver must be auto, swept, smooth, pixelwise or shaded"),
        (("--seconds", "0"), "--seconds must be a number above 0, got 0"),
        (("--seconds", "2", "--solver", "smooth"), "--seconds limits the search for shapes"),
        (("--opacity", "glass"), "--opacity must be solid or any, got 'glass'"),
        (("--opacity", "any", "--solver", "smooth"), "--opacity is for shapes of --solver auto"),
        (("--match", "much"), "--match must be auto, none, exposure, shift or full, got 'much'"),
    ],
)
def test_refuses_unknown_solvers_and_matching(scene, tmp_path, options, words):
    """door"""
    files = (scene / "image.png", "--plate", scene / "plate.png", "--out", tmp_path / "o")
    assert words in complaint(run("solve", *files, *options))
    assert not (tmp_path / "o").exists()


def test_matches_and_reports_shifted_plate(scene, tmp_path):
    plate = bm.read(scene / "plate.png")
    moved = bm.LinearImage(np.roll(plate.rgb, (1, 2), axis=(0, 1)))
    bm.write(tmp_path / "moved.png", moved)
    files = (scene / "image.png", "--plate", tmp_path / "moved.png", "--color", COLOR)
    said = good("solve", *files, *FAST, "--out", tmp_path / "o").stdout
    assert "plate: shifted by +2.00, +1.00 px" in said
    report = json.loads((tmp_path / "o" / "report.json").read_text())
    assert np.allclose(report["stats"]["match"]["shift"], (2, 1), atol=0.02)
    assert any("shifted by +2.00, +1.00 px" in line for line in report["in_words"])
