"""Every command of the documents runs, with all extras and with none.

The documents name files, such as throw.png. A stage has a small picture or clip under each of these
names, so that a documented command does here what it says. Without an extra a command does the same,
or names the extra in one line.
"""

import json
import os
import re
import shlex
import shutil
import subprocess
import sys
import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tests.commands import runner
from tests.scenes import on_line

import blurmatte as bm
from blurmatte.cli import app
from blurmatte.rendering import Ball, colorful_plate

ROOT = Path(__file__).parents[1]
DOCUMENTS = [
    ROOT / "README.md",
    *sorted((ROOT / "docs").glob("*.md")),
    *sorted((ROOT / "docs" / "howto").glob("*.md")),
]
SIZE = (640, 400)  # the documents name points and boxes in it
SMALL = (96, 64)
NOISE = bm.NoiseModel(gain=1e-5, read_std=4e-4)
COLOR = 0.9 * bm.ColorModel.from_hex("#d8ff3c").rgb[0]
BEFORE_WALL = "before_wall.png"  # throw.png before a smooth scene, which guesses of a plate need
# Modules that only extras install, by the extra
EXTRAS = {
    "cluster": "distributed",
    "heic": "pillow_heif",
    "ocio": "PyOpenColorIO",
    "photos": "skimage",
    "plot": "matplotlib",
    "raw": "rawpy",
    "tables": "pyarrow",
    "ui": "starlette",
    "video": "av",
}
# Need a server, a terminal's shell, or another object than a ball; `ui` runs until it is ended
ELSEWHERE = ("--scheduler", "--install-completion", "--rotation")


def documented():
    """Every `blurmatte …` of the documents' console blocks, without the words before it."""
    for path in DOCUMENTS:
        for block in re.findall(
            r"```console\n(.*?)```", path.read_text(encoding="utf-8"), re.DOTALL
        ):
            yield from re.findall(r"(?:^ *\$ |/)blurmatte (.*)$", block, re.MULTILINE)


CALLS = sorted(
    call
    for call in set(documented())
    if call.split()[0] != "ui" and not any(word in call for word in ELSEWHERE)
)


def seen(light, seed):
    """What a camera with noise records of linear light (H, W, 3)."""
    return bm.rendering.Camera(NOISE, bits=16).photograph(light, seed)


def wall(size):
    """Light of an even wall (H, W, 3) that a lamp at its right side lights."""
    return np.full((*size[::-1], 3), 0.3) * np.linspace(0.8, 1, size[0])[:, None]


def ball_on(plate, start, end, radius):
    """A picture of a moving ball of the documents' color."""
    return on_line(plate, start, end, Ball(radius, COLOR, ambient=0.6))


def set_stage(folder):
    """Write every file that the documents name."""
    write_pictures(folder)
    write_rows(folder)
    write_clips(folder)
    write_results(folder)


def write_pictures(folder):
    plate = colorful_plate(SIZE, rng=2, tile=24)
    throw, empty = ball_on(plate, (188, 146), (214, 164), 22), seen(plate, 1)
    picture = seen(throw.image.rgb, 0)
    for name, one in (("throw", picture), ("empty_room", empty)):
        for extension in ("png", "jpg", "tif"):
            bm.write(folder / f"{name}.{extension}", one)
    bm.write(folder / "handheld.jpg", seen(np.roll(plate, 1, axis=1) * 0.95, 3))
    bm.write(folder / "handheld.png", seen(np.roll(plate, 1, axis=1) * 0.95, 3))
    bm.write(folder / "sunny.png", empty)
    for k in range(3):  # from the hand
        moving = ball_on(plate, (120 + 90 * k, 130), (150 + 90 * k, 142), 22).image.rgb
        bm.write(folder / f"frame{k + 1}.jpg", seen(np.roll(moving, k, axis=1), 10 + k))
    bm.write(folder / "in_shade.png", seen(plate * [0.4, 0.5, 0.6], 4))
    bm.write(folder / "sharp.png", seen(ball_on(plate, (96, 70), (96, 70), 22).image.rgb, 5))
    for name, size in (("beach.jpg", (500, 300)), ("beach.png", SIZE)):
        bm.write(folder / name, bm.LinearImage(np.full((*size[::-1], 3), [0.2, 0.4, 0.7])))
    where, fence = np.zeros((2, *SIZE[::-1], 3), np.uint8)
    where[80:230, 90:310], fence[:, 300:306] = 255, 255
    bm.write(folder / "where.png", where)
    bm.write(folder / "fence.png", fence)
    bm.write(folder / "wall.tif", seen(wall((920, 620)), 6))
    before_wall = ball_on(wall(SIZE), (188, 146), (214, 164), 22).image.rgb
    bm.write(folder / BEFORE_WALL, seen(before_wall, 0))
    lens = {"fx": 700, "fy": 700, "cx": 320, "cy": 200, "size": SIZE}
    (folder / "lens.json").write_text(json.dumps(lens), encoding="utf-8")
    shutil.copytree(ROOT / "examples", folder / "examples")
    scene = (ROOT / "docs" / "scenes.md").read_text(encoding="utf-8")
    (folder / "my_scene.toml").write_text(re.search(r"```toml\n(.*?)```", scene, re.DOTALL)[1])


def write_rows(folder):
    """Brackets, stills, bursts, several throws and numbered pictures."""
    plate = colorful_plate(SMALL, rng=3, tile=12)
    for name in ("still", "burst", "bracket", "throws", "frames"):
        (folder / name).mkdir()
    for k in range(8):
        bm.write(folder / "still" / f"{k}.png", seen(plate, k))
        moving = ball_on(plate, (8 + 10 * k, 20), (16 + 10 * k, 26), 5).image.rgb
        bm.write(folder / "burst" / f"{k}.png", seen(moving, k))
        bm.write(folder / "frames" / f"{k}.png", seen(moving, k))
    large = colorful_plate(SIZE, rng=2, tile=24)
    for k in range(2):
        moving = ball_on(large, (150, 140 + 40 * k), (190, 150 + 40 * k), 22).image.rgb
        for extension in ("png", "jpg"):
            bm.write(folder / "throws" / f"{k + 1}.{extension}", seen(moving, k))
    bm.write(folder / "throws" / "3.jpg", seen(large, 9))
    for k in range(5):
        picture = seen(plate * 2.0 ** (k - 2), k)
        exposed = replace(picture, meta=replace(picture.meta, exposure_time=2.0 ** (k - 6)))
        bm.write(folder / "bracket" / f"{k}.jpg", exposed)
    for name, k in (("a", 0), ("b", 2), ("c", 4)):
        bm.write(folder / f"{name}.png", seen(plate * 2.0 ** (k - 2), k))
    flight = [seen(light, k) for k, light in enumerate(falling(plate, 90, first=45))]
    for extension in ("exr", "png"):
        bm.write_frames(folder / f"shot.####.{extension}", flight, start=0)
    bm.write(folder / "plate.exr", bm.LinearImage(plate.astype(np.float32), NOISE))


def falling(plate, count, first=0, place=lambda t: (8 + 7 * t, 12 + 0.3 * t**2), radius=5):
    """Light of `count` frames: a ball flies through twelve of them, from the frame `first`."""
    for k in range(count):
        age = k - first
        if age < 0 or age > 11:
            yield plate
        else:
            yield ball_on(plate, place(age), place(age + 0.5), radius).image.rgb


def thrown(t):
    """Place of the ball in throw.mp4 after t frames: 9.81 m/s² at 1.4 mm a pixel."""
    return 40 + 48 * t, 40 + 9.81 / (2 * 0.0014 * 30**2) * (t - 6) ** 2


def write_clips(folder):
    plate = colorful_plate(SMALL, rng=3, tile=12)
    for name, count, first, rate in (
        ("rally", 310, 25, 10),
        ("juggling", 12, 0, 30),
    ):
        frames = (seen(light, k) for k, light in enumerate(falling(plate, count, first)))
        bm.write_frames(folder / f"{name}.mp4", frames, rate)
    large = colorful_plate(SIZE, rng=2, tile=24)
    throw = falling(large, 53, 40, thrown, radius=20 / 1.4)
    bm.write_frames(folder / "throw.mp4", (seen(light, k) for k, light in enumerate(throw)), 30)
    layers = [ball_on(large, (60 + 40 * k, 90), (90 + 40 * k, 99), 14).layer for k in range(4)]
    bm.write_frames(folder / "layers" / "ball.####.exr", layers)
    bm.write_frames(folder / "layers" / "ball.mov", layers, 30)
    bm.write_frames(folder / "ball.mov", layers, 30)
    bm.write_frames(folder / "gone.####.png", (seen(plate, k) for k in range(4)))


def write_results(folder):
    """What the commands before a command have written."""
    here = Path.cwd()
    os.chdir(folder)
    try:
        for call in (
            "render --all --out scenes/",
            "solve throw.png --plate empty_room.png --out out/",
            "solve throws/1.png throws/2.png --plate empty_room.png --out out/",
            "solve rally.mp4 --frames 24:31 --out out/ --workers 1",
            "calibrate noise still/*.png --out camera.json",
            "calibrate response 'bracket/*.jpg' --out mycam.json",
            "color throw.png --plate empty_room.png --out ball.json",
            "solve scenes/easy/image.png --plate scenes/easy/plate.png --out results/easy",
        ):
            result = runner().invoke(app, shlex.split(call))
            assert result.exit_code == 0, (call, result.output)
    finally:
        os.chdir(here)


def run_all(stage, without):
    """Print a line for each call: what it gives in a copy of the stage, without some modules."""
    for module in without:
        sys.modules[module] = None
    for number, call in enumerate(CALLS):
        folder = stage.parent / f"{'none' if without else 'all'}_{number}"
        shutil.copytree(stage, folder, copy_function=os.link)
        if "--plate none" in call:
            os.replace(folder / BEFORE_WALL, folder / "throw.png")
        os.chdir(folder)
        result = runner().invoke(app, shlex.split(call))
        os.chdir(stage)
        shutil.rmtree(folder)
        print(json.dumps([call, result.exit_code, result.stdout, result.stderr]), flush=True)


@pytest.fixture(scope="module")
def stage(tmp_path_factory):
    folder = tmp_path_factory.mktemp("documented") / "stage"
    folder.mkdir()
    set_stage(folder)
    return folder


def answers(stage, extras):
    """Exit code, output and errors of each call, from a process that can import these extras."""
    words = [
        sys.executable,
        "-m",
        "tests.test_documented_commands",
        stage,
        *(EXTRAS[name] for name in EXTRAS if name not in extras),
    ]
    done = subprocess.run(
        words, capture_output=True, text=True, encoding="utf-8", check=False, cwd=ROOT
    )
    assert done.returncode == 0, done.stderr
    lines = (json.loads(line) for line in done.stdout.splitlines() if line.startswith("["))
    return {call: answer for call, *answer in lines}


@pytest.mark.battery
def test_documented_commands_run_with_all_extras(stage):
    found = answers(stage, EXTRAS)
    assert found.keys() == set(CALLS)
    assert {call: answer for call, answer in found.items() if answer[0] != 0} == {}


@pytest.mark.battery
def test_documented_commands_run_or_name_the_extra_without_extras(stage):
    found = answers(stage, ())
    assert found.keys() == set(CALLS)
    failed = {call: answer for call, answer in found.items() if answer[0] != 0}
    unnamed = {
        call: answer
        for call, answer in failed.items()
        if not re.search(r'pip install "blurmatte\[\w+\]"', answer[2]) or answer[2].count("\n") > 3
    }
    assert unnamed == {}
    # All scenes contain two with photographs; curves of camera makers are those of OpenColorIO
    needs = re.compile(r"\.(mp4|mov|parquet)\b|--plot|--table parquet|render --all|slog3")
    assert [call for call in failed if not needs.search(call)] == []


def test_extras_are_those_of_the_project():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    extras = project["optional-dependencies"]
    assert EXTRAS.keys() == extras.keys() - {"all", "dev", "docs"}
    assert extras["all"] == [f"blurmatte[{','.join(sorted(EXTRAS))}]"]


if __name__ == "__main__":
    run_all(Path(sys.argv[1]), sys.argv[2:])
