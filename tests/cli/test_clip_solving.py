"""`solve` of clips: what is a clip, what is written, and what is refused."""

import json
from pathlib import Path

import numpy as np
import pytest
from tests.commands import run
from tests.scenes import on_line

import blurmatte as bm
from blurmatte.cli.clip_solving import ClipOptions
from blurmatte.rendering import Ball, colorful_plate


@pytest.fixture(scope="module")
def shot(tmp_path_factory):
    """Five numbered pictures, a ball in the last four, and the plate."""
    folder, rng = tmp_path_factory.mktemp("shot"), np.random.default_rng(1)
    plate = colorful_plate((72, 48), 1, tile=12)

    def picture(k):
        light = on_line(
            plate, (10 + 11 * k, 18 + k), (20 + 11 * k, 19 + k), Ball(6, (0.7, 0.35, 0.1))
        ).image.rgb
        light = plate if k == 0 else light
        return bm.LinearImage((light + rng.normal(0, 0.01, light.shape)).astype(np.float32))

    bm.write_frames(folder / "f.####.exr", map(picture, range(5)), start=1001)
    known = bm.LinearImage(plate, bm.NoiseModel(read_std=1e-4))
    bm.write(folder / "plate.exr", known)
    return folder


def test_numbered_pictures_become_layers_and_are_solved_once(shot, tmp_path):
    words = ("solve", shot / "f.####.exr", "--plate", shot / "plate.exr", "-o", tmp_path / "o")
    graphics = np.zeros((48, 72, 3), np.uint8)
    graphics[40:, :10] = 255
    bm.write(tmp_path / "graphics.png", graphics)
    words += ("--color", "#e9b45e", "--workers", "1", "--table", "parquet")
    words += ("--occluder", tmp_path / "graphics.png", "--rate", 50, "--frames", "1001:1006")
    first = run(*words)
    assert first.exit_code == 0, first.stderr
    assert "4 layers" in first.stdout
    assert "frames.parquet" in first.stdout
    assert sorted(p.name for p in (tmp_path / "o").glob("layer.*")) == [
        f"layer.{k:06d}.exr" for k in range(1001, 1006)
    ]
    assert "; 1 empty ones of the other frames" in first.stdout
    assert bm.read_layer(tmp_path / "o" / "layer.001001.exr").empty
    again = run(*words, "--json")
    assert again.exit_code == 0
    answer = json.loads(again.stdout)
    numbers = [(row["frame"], row["time"]) for row in answer["frames"]]
    assert numbers == [(k, k / 50) for k in range(1002, 1006)]
    assert sum(answer["grades"].values()) == 4


@pytest.mark.parametrize(
    ("images", "out", "plate", "alone", "clip"),
    [
        (["rally.mp4"], "out", None, False, True),
        (["f.####.exr"], "out", "plate.exr", False, True),
        (["f.%04d.exr"], "out", "plate.exr", True, False),
        (["f.*.exr"], "out", "plate.exr", False, False),
        (["f.*.exr"], "out", None, False, True),
        (["f.*.exr"], "out.mov", "plate.exr", False, True),
        (["a.png", "b.png"], "out", "plate.png", False, False),
    ],
)
def test_what_is_a_clip(images, out, plate, alone, clip):
    plate = None if plate is None else Path(plate)
    assert ClipOptions().means_clip(images, Path(out), plate, alone) is clip


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--solver", "shaded:in_shade.png", "--layers", "exr"), "needs one hex --color"),
        (("--solver", "rough", "--layers", "exr"), "--solver must be auto, swept"),
        (("--region", "9,9,1,1", "--layers", "exr"), "must lie in the picture"),
        (("--color", "12,12"), "give --color as hex or a model file"),
        (("--max-brightness", "0.9"), "--max-brightness is for a single picture"),
        (("--match", "exposure"), "--match exposure is for single pictures"),
        (("--noise", "noise.json"), "--noise is for single pictures"),
        (("--layers", "gif"), "--layers must be exr, png, tif, mov"),
        (("--table", "xlsx"), "--table must be csv or parquet"),
        (("--frames", "7:9"), "they are numbered 1001 to 1005"),
        (("--workers", "2", "--scheduler", "tcp://host:8786"), "give --workers or --scheduler"),
    ],
)
def test_options_that_do_not_fit_are_refused(shot, tmp_path, options, message):
    bm.write(tmp_path / "noise.json", bm.NoiseModel(read_std=0.01))
    options = [tmp_path / one if one == "noise.json" else one for one in options]
    result = run("solve", shot / "f.####.exr", "-o", tmp_path / "o", *options)
    assert result.exit_code == 2
    assert message in result.stderr
    assert not (tmp_path / "o").exists()


def test_a_clip_is_solved_inside_its_region_by_its_solver(shot, tmp_path):
    """Frames whose ball is outside have an empty layer; another solver is another run."""
    words = ("solve", shot / "f.####.exr", "--plate", shot / "plate.exr", "-o", tmp_path / "o")
    words += ("--color", "#e9b45e", "--workers", "1", "--layers", "exr", "--region", "0,0,45,48")
    first = run(*words, "--solver", "smooth")
    assert first.exit_code == 0, first.stderr
    assert bm.read_layer(tmp_path / "o" / "layer.001005.exr").empty
    alpha = bm.read_layer(tmp_path / "o" / "layer.001002.exr").alpha
    assert alpha[:, :45].max() > 0.3
    assert not alpha[:, 45:].any()
    other = run(*words, "--solver", "pixelwise")
    assert "all were done" not in other.stdout


def test_pictures_need_a_plate(shot, tmp_path):
    result = run("solve", shot / "f.0001.exr", "-o", tmp_path / "o")
    assert result.exit_code == 2
    assert "a single picture needs --plate" in result.stderr


def test_row_of_images_is_the_same_in_several_processes(shot, tmp_path):
    """Invariant: the same answers in the same order, and a refusal of one image alone."""
    images = [shot / f"f.{k:04d}.exr" for k in (1002, 1001, 1003)]
    options = ("--plate", shot / "plate.exr", "--solver", "pixelwise", "--color", "#e9b45e", "-q")
    results = [
        run("solve", *images, *options, "--workers", n, "-o", tmp_path / f"o{n}") for n in (1, 2)
    ]
    assert [result.exit_code for result in results] == [2, 2]
    one, two = (
        result.stdout.replace(f"o{n}", "o") for n, result in zip((1, 2), results, strict=True)
    )
    assert one == two
    assert [(tmp_path / "o2" / f"f.{k:04d}" / "layer.exr").exists() for k in range(1001, 1004)] == [
        False, True, True,
    ]  # fmt: skip


def test_info_describes_a_clip_in_four_lines(shot, tmp_path):
    """Exact: H.264 of five frames."""
    path = tmp_path / "a.mp4"
    bm.write_frames(path, bm.read_frames(shot / "f.####.exr"), rate=24)
    said = run("info", path)
    assert said.exit_code == 0, said.output
    assert said.stdout.splitlines() == [
        f"{path}: a clip of 5 frames, 72x48 pixels",
        "time: 0.2083 s from 0 s on, 24 frames a second",
        "codec: h264, yuv420p, 8 bit",
        "transfer: rec709",
    ]
    numbers = json.loads(run("info", path, "--json").stdout)
    assert (numbers["frames"], numbers["undecodable_frames"], numbers["rate"]) == (5, 0, 24)
