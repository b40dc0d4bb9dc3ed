"""solve --plate none: a photograph without a plate, and what it contradicts."""

import json

import numpy as np
import pytest
from tests.commands import run

import blurmatte as bm


@pytest.fixture(scope="module")
def photo(tmp_path_factory):
    """A bar that moved before a plain wall, alpha 0.5 within 40 x 16 pixels."""
    rng = np.random.default_rng(0)
    light = np.full((80, 112, 3), (0.5, 0.45, 0.4)) * (1 + np.linspace(0, 0.2, 112)[:, None])
    light[32:48, 36:76] = 0.5 * light[32:48, 36:76] + 0.5 * np.array([0.05, 0.1, 0.6])
    codes = np.rint(255 * bm.SRGB.encode(np.clip(light + rng.normal(0, 0.003, light.shape), 0, 1)))
    path = tmp_path_factory.mktemp("photo") / "photo.png"
    bm.write(path, bm.decode(codes.astype(np.uint8), bm.SRGB))
    return path


def test_photograph_is_solved_before_a_guess(photo, tmp_path):
    """Exact: alpha 0.5 over 640 pixels."""
    region = ("--plate", "none", "--region", "28,24,84,56")
    color = ("--color", "#3f59cb", "--solver", "smooth")
    result = run("solve", photo, *region, *color, "--out", tmp_path)
    assert result.exit_code == 0, result.stderr
    first = result.stdout.splitlines()[0]
    assert not first.startswith("confirmed")
    assert "the plate is a guess from the surroundings of the region" in first
    report = json.loads((tmp_path / "report.json").read_text())
    assert report["stats"]["grade_reasons"][0] == "plate"
    assert report["plate"]["file"] == "plate guessed from the surroundings"
    stats = report["stats"]
    assert abs(stats["sum_alpha"] - 320) < 3 * stats["sum_alpha_std"]
    assert abs(stats["sum_alpha"] - 320) < 32


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ([], "needs --region"),
        (["--region", "28,24,84,56", "--match", "full"], "--match full needs a plate"),
        (["--region", "28,24,84,56", "--solver", "shaded:x.png"], "--solver shaded needs a plate"),
        (["--region", "28,24,84,56", "--transfer", "auto"], "name the curve"),
        (["--layers", "png"], "leave --plate out"),
    ],
)
def test_options_that_need_a_plate_are_refused(photo, tmp_path, options, says):
    result = run("solve", photo, "--plate", "none", *options, "--out", tmp_path / "out")
    assert result.exit_code == 2
    assert says in result.stderr
    assert len(result.stderr.splitlines()) <= 3
    assert not (tmp_path / "out").exists()


@pytest.mark.battery
def test_photograph_is_measured_in_one_command(photo, tmp_path):
    """Exact: alpha sums to 320, of a bar whose middle is at (55.5, 39.5)."""
    out = tmp_path / "motion.json"
    guessed = ("--plate", "none", "--region", "28,24,84,56")
    size = ("--scale", "1mm", "--exposure", "1/60")
    result = run("measure", photo, *guessed, *size, "--out", out)
    assert result.exit_code == 0, result.stderr
    assert "the plate is a guess" in result.stdout.splitlines()[0]
    found = json.loads(out.read_text())
    assert abs(found["x"] - 55.5) < max(3 * found["x_std"], 1)
    assert abs(found["y"] - 39.5) < max(3 * found["y_std"], 1)
    assert "km/h" in result.stdout


def test_measure_of_a_guess_needs_a_region(photo):
    result = run("measure", photo, "--plate", "none")
    assert result.exit_code == 2
    assert "needs --region" in result.stderr


def test_measure_of_a_picture_names_what_solves_it(photo):
    assert "--plate none --region X0,Y0,X1,Y1" in run("measure", photo).stderr


def test_region_of_a_layer_is_refused(bar):
    result = run("measure", bar, "--region", "28,24,84,56")
    assert result.exit_code == 2
    assert "--region needs --plate" in result.stderr


@pytest.fixture(scope="module")
def bar(tmp_path_factory):
    """The layer of the bar."""
    alpha = np.zeros((80, 112), np.float32)
    alpha[32:48, 36:76] = 0.5
    path = tmp_path_factory.mktemp("layer") / "bar.png"
    bm.write(path, bm.Layer(alpha, alpha[..., None] * np.float32([0.05, 0.1, 0.6])))
    return path


def test_object_is_removed_by_a_guess_with_grain(photo, bar, tmp_path):
    """Exact: the wall, with noise of a standard deviation of 0.003."""
    out = tmp_path / "gone.png"
    result = run("remove", bar, "--image", photo, "--plate", "none", "--out", out)
    assert result.exit_code == 0, result.stderr
    assert "is a guess from its surroundings, within 0.0" in result.stderr
    wall = np.full((80, 112, 3), (0.5, 0.45, 0.4)) * (1 + np.linspace(0, 0.2, 112)[:, None])
    error = (bm.read(out).rgb - wall)[32:48, 36:76]
    assert np.abs(error.mean(axis=(0, 1))).max() < 0.002
    assert 0.8 < error.std() / 0.003 < 1.25
    kept = np.ones((80, 112), bool)
    kept[32:48, 36:76] = False
    assert np.array_equal(bm.read(out).rgb[kept], bm.read(photo).rgb[kept])


def test_only_what_the_layer_covers_is_guessed(photo, bar, tmp_path):
    """The streak of a solution without a plate may be all of the region."""
    layer, maps = bm.read_layer(bar), bm.matting.PixelMaps.zeros(80, 112)
    maps.alpha[...], maps.premultiplied[...] = layer.alpha, layer.premultiplied
    maps.quality[...] = bm.matting.Quality.OUTSIDE
    maps.quality[24:56, 28:84] = 0
    bm.write(tmp_path / "bar.exr", bm.Solution(*maps, model=bm.ColorModel.any(), solver=""))
    out = tmp_path / "gone.png"
    result = run("remove", tmp_path / "bar.exr", "--image", photo, "--plate", "none", "--out", out)
    assert result.exit_code == 0, result.stderr
    changed = np.any(bm.read(out).rgb != bm.read(photo).rgb, axis=-1)
    assert changed[32:48, 36:76].all()
    assert not changed[layer.alpha == 0].any()


def test_object_is_faded_before_a_guess(photo, bar, tmp_path):
    """Exact: alpha 0.25 instead of 0.5."""
    out = tmp_path / "faded.png"
    own = ("--image", photo, "--plate", "none", "--fade", "0.5")
    assert run("edit", bar, *own, "--out", out).exit_code == 0
    wall = np.full((80, 112, 3), (0.5, 0.45, 0.4)) * (1 + np.linspace(0, 0.2, 112)[:, None])
    expected = 0.75 * wall[32:48, 36:76] + 0.25 * np.array([0.05, 0.1, 0.6])
    error = bm.read(out).rgb[32:48, 36:76] - expected
    assert np.abs(error.mean(axis=(0, 1))).max() < 0.003


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (("color", "photo"), "solve --plate none finds the color"),
        (("remove", "bar.####.png", "--image", "photo"), "of a row give the plate"),
        (("sharpen", "bar"), "--plate none needs --image"),
        (("solve", "photo"), "find IMAGE --plate none proposes regions"),
    ],
)
def test_commands_that_cannot_guess_say_what_to_do(photo, bar, tmp_path, words, says):
    """Of a color, of a row of layers, and without the picture."""
    paths = {"photo": photo, "bar": bar, "bar.####.png": bar.parent / "bar.####.png"}
    out = () if words[0] == "color" else ("--out", tmp_path / "out.png")
    result = run(*(paths.get(word, word) for word in words), "--plate", "none", *out)
    assert result.exit_code == 2
    assert says in result.stderr
    assert not (tmp_path / "out.png").exists()


def test_region_is_proposed_for_solve(photo, tmp_path):
    """The bar is in columns 36 to 75 and rows 32 to 47."""
    result = run("find", photo, "--plate", "none")
    assert result.exit_code == 0, result.stderr
    (line,) = result.stdout.splitlines()
    x0, y0, x1, y1 = map(int, line.removeprefix("--region ").split(","))
    assert 20 <= x0 <= 36 < 76 <= x1 <= 92
    assert 16 <= y0 <= 32 < 48 <= y1 <= 64
    wall = tmp_path / "wall.png"
    bm.write(wall, bm.read(photo).crop((0, 0, 112, 28)))
    nothing = run("find", wall, "--plate", "none")
    assert nothing.exit_code == 2
    assert "nothing stands out" in nothing.stderr
