"""The Python of the README and of docs/python.md runs, commands work, and tables are complete."""

import json
import re
import shlex
from dataclasses import replace
from io import BytesIO
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from tests.commands import run
from tests.encoders import encoder

import blurmatte as bm
from blurmatte.rendering import colorful_plate

ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text(encoding="utf-8")
OUTPUT, PYTHON = (
    (ROOT / "docs" / f"{name}.md").read_text(encoding="utf-8") for name in ("output", "python")
)
EXAMPLES = re.findall(r"```python\n(.*?)```", README + PYTHON, re.DOTALL)
COMMANDS = re.findall(r"^\$ (.*)$", README, re.MULTILINE)
NOISE = bm.NoiseModel(gain=1e-5, read_std=4e-4)


def example(call):
    """The only example that has a call."""
    (found,) = (code for code in EXAMPLES if call in code)
    return found


TEN_LINES = example("bm.save_results")


def table(heading):
    """First cells of the table whose head begins with `heading`, without backticks."""
    rows = README.split(f"| {heading}")[1].split("\n\n")[0].splitlines()[2:]
    return [row.split("|")[1].strip().strip("`") for row in rows]


@pytest.fixture(scope="module")
def pictures(tmp_path_factory):
    """A folder with all files that the examples read."""
    folder = tmp_path_factory.mktemp("readme")
    ball = bm.rendering.Ball(12, 0.9 * bm.ColorModel.from_hex("#ffc032").rgb[0], ambient=0.6)
    path = bm.Trajectory.line((30, 34), (90, 46))
    truth = bm.rendering.render(
        bm.rendering.Scene(colorful_plate((128, 80), rng=2, tile=18), path, ball)
    )
    throw, empty_room = (
        bm.rendering.Camera(NOISE, bits=16).photograph(picture.rgb, seed)
        for seed, picture in enumerate((truth.image, truth.plate))
    )
    bm.write(folder / "throw.png", throw)
    bm.write(folder / "empty_room.png", empty_room)
    for name, picture in (("throw", throw), ("empty_room", empty_room)):
        bm.write(folder / f"{name}.jpg", picture)
    bm.write_frames(folder / "frames" / "ball.####.exr", [truth.layer.fade(f) for f in (0.5, 1)])
    for k in range(8):
        still = bm.rendering.Camera(NOISE, bits=16).photograph(truth.plate.rgb, 2 + k)
        bm.write(folder / f"still_{k}.png", still)
    for k in range(5):  # files as cameras write them: 8 bits, and the exposure time
        light = truth.plate.rgb * 2.0 ** (k - 2)
        exposed = bm.LinearImage(light, meta=replace(throw.meta, exposure_time=2.0 ** (k - 6)))
        bm.write(folder / f"bracket_{k}.jpg", exposed)
    bm.write(folder / "beach.jpg", bm.LinearImage(np.full((90, 160, 3), [0.2, 0.4, 0.7])))
    np.save(folder / "throw.npy", throw.rgb)
    codes = np.rint(65535 * bm.SRGB.encode(empty_room.rgb)).astype(np.uint16)
    np.save(folder / "empty_room.npy", codes)
    return folder


def test_every_example_is_one_of_those_run_here():
    calls = set(re.findall(r"exec\(example\(\"(.*?)\"\)", Path(__file__).read_text()))
    assert {example(call) for call in (*calls, "bm.save_results")} == set(EXAMPLES)


def test_ten_lines_write_what_solve_writes(pictures, monkeypatch, capsys):
    monkeypatch.chdir(pictures)
    names = {}
    exec(TEN_LINES, names)
    assert len([line for line in TEN_LINES.splitlines() if line]) <= 10
    assert capsys.readouterr().out.startswith("Solution(128x80, alpha up to 0.")
    assert bm.read("at_sea.png", bm.SRGB).size == (128, 80)
    assert names["motion"].length == pytest.approx(np.hypot(60, 12), abs=1)
    assert sorted(path.name for path in Path("out").iterdir()) == sorted(table("file in"))


@pytest.mark.filterwarnings("ignore::blurmatte.errors.TransferWarning")
def test_single_steps_run(pictures, monkeypatch, capsys):
    monkeypatch.chdir(pictures)
    exec(example("bm.match_plate"), {})
    assert capsys.readouterr().out.startswith("Solution(128x80, alpha up to 0.")
    assert bm.read_solution("ball.exr").size == (128, 80)


def test_numpy_arrays_run(pictures, monkeypatch):
    monkeypatch.chdir(pictures)
    names = {}
    exec(example("np.load"), names)
    assert names["total"] == pytest.approx(np.pi * 12**2, rel=0.03)


def test_edits_run(pictures, monkeypatch):
    monkeypatch.chdir(pictures)
    names = {}
    exec(example("recolor"), names)
    image, blue = (bm.read(f"{name}.jpg", bm.SRGB).rgb for name in ("throw", "blue"))
    object_light, more_blue = (light[names["changed"]].mean(axis=0) for light in (image, blue))
    assert more_blue[2] > object_light[2] + 0.02
    assert more_blue[0] < object_light[0]
    assert len(bm.read_layers("ball.mov")) == 11
    assert names["whole"].alpha.max() <= 1


def test_pictures_are_drawn(pictures, monkeypatch):
    """Exact: the sheet of the layer is what a notebook shows."""
    monkeypatch.chdir(pictures)
    names = {}
    exec(example("bm.figures.draw_overview"), names)
    assert names["codes"].shape == names["image"].rgb.shape
    look = BytesIO(names["solution"].layer._repr_png_())
    with Image.open("look.png") as written, Image.open(look) as shown:
        assert np.array_equal(np.asarray(written), np.asarray(shown))
    with Image.open("overview.png") as written:
        assert written.width == 1800


def test_plate_example_runs(pictures, monkeypatch):
    monkeypatch.chdir(pictures)
    image, plate = bm.read("throw.png", bm.SRGB), bm.read("empty_room.png", bm.SRGB)
    lights = [plate.rgb] * 60
    lights[40] = image.rgb
    save_clip("rally.mp4", lights)
    names = {}
    exec(example("bm.make_plate"), names)
    alpha = names["solution"].layer.alpha
    assert alpha.sum(dtype=float) == pytest.approx(np.pi * 12**2, rel=0.05)
    assert np.array_equal(bm.read("plate.exr").variance, names["fit"].plate.variance)


def test_guess_example_runs(tmp_path, monkeypatch, capsys):
    """A ball of radius 12 before a plain wall."""
    monkeypatch.chdir(tmp_path)
    wall, path = np.full((96, 160, 3), [0.3, 0.34, 0.4]), bm.Trajectory.line((50, 44), (106, 52))
    truth = bm.rendering.render(bm.rendering.Scene(wall, path, bm.rendering.Ball(12)))
    bm.write("alone.png", bm.rendering.Camera(NOISE, bits=16).photograph(truth.image.rgb, 3))
    names = {}
    exec(example("bm.background.guess_plate"), names)
    assert capsys.readouterr().out.startswith("within 0.0")
    alpha = names["solution"].alpha
    assert alpha.sum(dtype=float) == pytest.approx(np.pi * 12**2, rel=0.05)


def test_motion_example_runs(pictures, monkeypatch, capsys):
    monkeypatch.chdir(pictures)
    image, plate = bm.read("throw.png", bm.SRGB), bm.read("empty_room.png", bm.SRGB)
    Path("out").mkdir(exist_ok=True)
    bm.write("out/layer.exr", bm.solve(image, plate))
    names = {}
    exec(example("bm.measure_motion(bm"), names)
    motion = names["motion"]
    assert motion.radius == pytest.approx(12, abs=4 * motion.radius_std)
    assert motion.length == pytest.approx(np.hypot(60, 12), abs=4 * motion.length_std)
    assert "km/h" in capsys.readouterr().out


def test_fall_example_runs(pictures, monkeypatch, capsys):
    monkeypatch.chdir(pictures)
    plate = bm.read("empty_room.png", bm.SRGB)
    ball = bm.rendering.Ball(7, 0.9 * bm.ColorModel.from_hex("#d8ff3c").rgb[0], ambient=0.6)
    lights = []
    for k in range(5):
        path = bm.Trajectory.parabola(
            (15 + 20 * k, 50 - 18 * k + 4 * k**2), (12, 8 * k - 14), (0, 5)
        )
        lights.append(bm.rendering.render(bm.rendering.Scene(plate.rgb, path, ball)).image.rgb)
    save_clip("rally.mp4", lights)
    bm.write("plate.exr", plate)
    names = {}
    exec(example("bm.measure_clip"), names)
    found = [row for row in names["rows"] if row.sighting is not None]
    assert len(found) == 5
    assert len(Path("rally.csv").read_text().splitlines()) == 6
    assert capsys.readouterr().out


def save_clip(path, lights):
    """A lossless clip, tagged as sRGB, with noise of one code value."""
    rng, size = np.random.default_rng(3), lights[0].shape[1::-1]
    with encoder(path, "libx264rgb", size, "rgb24", options={"qp": "0"}) as (stream, add):
        stream.codec_context.color_trc = 13
        for light in lights:
            codes = 255 * bm.SRGB.encode(light) + rng.normal(size=light.shape)
            add(np.clip(np.rint(codes), 0, 255).astype(np.uint8))


def test_first_command_solves_the_example(tmp_path, monkeypatch):
    command = COMMANDS[0].split(" && ")[-1]
    assert command.startswith(".venv/bin/blurmatte ")
    monkeypatch.chdir(ROOT)
    arguments = shlex.split(command)[1:]
    place = arguments.index("--out") + 1
    assert arguments[place] == "out/"
    arguments[place] = str(tmp_path / "out")
    result = run(*arguments)
    assert (result.exit_code, result.stderr) == (0, "")
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == sorted(table("file in"))


def test_shape_determines_the_color_before_a_plain_wall(tmp_path, monkeypatch):
    command = re.search(
        r"`blurmatte (solve examples/plain/.*? --out) out/plain/` is `confirmed`", README
    )[1]
    monkeypatch.chdir(ROOT)
    result = run(*command.split(), tmp_path / "plain")
    assert (result.exit_code, result.stderr) == (0, "")
    truth = json.loads((ROOT / "examples/plain/truth.json").read_text())
    report = json.loads((tmp_path / "plain" / "report.json").read_text())
    stats = report["stats"]
    assert report["grade"] == "confirmed"
    assert abs(stats["sweep"]["radius"] - truth["radius"]) < 4 * stats["sweep"]["radius_std"]
    assert abs(stats["sum_alpha"] / truth["alpha_sum"] - 1) < 0.005


def test_second_command_is_what_ci_runs():
    assert COMMANDS[1].endswith("&& scripts/check")
    assert COMMANDS[1] in (ROOT / ".ci" / "run").read_text().splitlines()
    assert f"$ {COMMANDS[1]}\n" in (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")


def test_every_flag_is_explained():
    flags = re.findall(r"^\| `([A-Z_]+)` \| (\d+) \|", OUTPUT, re.MULTILINE)
    assert flags == [(flag.name, str(flag.value)) for flag in bm.matting.Quality]
