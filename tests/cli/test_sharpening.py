"""blurmatte sharpen: a solution in, sharp layers or a clip out."""

import json
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image
from tests.commands import complaint, good, run
from tests.scenes import on_line, rendered

import blurmatte as bm
from blurmatte.rendering import colorful_plate
from blurmatte.rendering.pose import Change
from blurmatte.sweep import Sweep
from blurmatte.sweep.model.path import LINE
from blurmatte.sweep.model.silhouette import DISC

SIZE = (72, 48)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Image and plate, a solution with its sweep, and one without."""
    folder = tmp_path_factory.mktemp("sharpen")
    ball = bm.rendering.Ball(8, (0.7, 0.35, 0.1), second_color=(0.1, 0.2, 0.7))
    path = (22.0, 20.0, 48.0, 28.0)
    truth = on_line(colorful_plate(SIZE, 1, tile=16), path[:2], path[2:], ball)
    sweep = Sweep(
        *(LINE, np.array(path), DISC, np.array([8.0]), bm.ColorModel.any()),
        *(1e-4 * np.eye(5), SIZE),
    )
    layer, shape = truth.layer, SIZE[::-1]
    solution = bm.Solution(
        *(layer.alpha, np.full(shape, 0.01), layer.premultiplied, np.full((*shape, 3), 0.004)),
        *(np.where(layer.alpha > 0, 0, 16).astype(np.uint8), truth.model, "truth"),
        sweep=sweep,
    )
    bm.write(folder / "layer.exr", solution)
    bm.write(folder / "no_sweep.exr", replace(solution, sweep=None))
    bm.write(folder / "image.png", truth.image)
    bm.write(folder / "plate.png", truth.plate)
    return folder


def test_one_moment_is_a_layer(folder, tmp_path):
    good("sharpen", folder / "layer.exr", "-o", tmp_path / "ball.exr")
    layer = bm.read_layer(tmp_path / "ball.exr")
    assert layer.alpha.max() > 0.999
    assert abs(layer.alpha.sum() / (np.pi * 8**2) - 1) < 0.01


def test_frames_are_a_clip_of_layers(folder, tmp_path):
    said = good("sharpen", folder / "layer.exr", "--frames", 3, "-o", tmp_path / "ball.mov")
    assert "3 sharp" in said.output
    assert said.output.splitlines()[-1] == str(tmp_path / "ball.mov")
    assert len(list(bm.read_layers(tmp_path / "ball.mov"))) == 3


def test_layer_alone_states_no_misfit_and_its_sheet_is_no_strip(folder, tmp_path):
    """Exact: the noise of a layer is not known; the page is 1800 wide and near 16:10."""
    sheet = "--sheet", tmp_path / "sheet.png", "-o", tmp_path / "ball.exr"
    assert "misfit" not in good("sharpen", folder / "layer.exr", *sheet).output
    answer = good("sharpen", folder / "layer.exr", "-o", tmp_path / "ball.exr", "--json").output
    assert json.loads(answer)["misfit"] is None
    with Image.open(tmp_path / "sheet.png") as page:
        assert 1000 < page.height < 1500


def test_several_layers_are_one_clip(folder, tmp_path):
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "layer.exr").write_bytes((folder / "layer.exr").read_bytes())
    said = good("sharpen", tmp_path / "*/layer.exr", "--frames", 2, "-o", tmp_path / "ball.mov")
    assert said.output.count("2 sharp") == 2
    assert "not refined" in said.output
    assert len(list(bm.read_layers(tmp_path / "ball.mov"))) == 4
    good("sharpen", tmp_path / "*/layer.exr", "-o", tmp_path / "row.##.exr")
    assert len(list(tmp_path.glob("row.*.exr"))) == 2
    sheet = "--sheet", tmp_path / "sheet.png"
    assert "one layer" in complaint(run("sharpen", tmp_path / "*/layer.exr", *sheet, "-o", "a.mov"))


def test_clips_without_alpha_show_the_moments_over_the_plate(folder, tmp_path):
    for name in ("ball.webp", "ball.gif"):
        good(
            *("sharpen", folder / "layer.exr", "--plate", folder / "plate.png"),
            *("--frames", 3, "-o", tmp_path / name),
        )
        with Image.open(tmp_path / name) as clip:
            assert clip.n_frames == 3
            assert clip.size == SIZE


def test_pictures_refine_the_path_and_are_behind_a_gif(folder, tmp_path):
    result = good(
        *("sharpen", folder / "layer.exr", "--image", folder / "image.png", "--match", "none"),
        *("--plate", folder / "plate.png", "--frames", 2, "-o", tmp_path / "ball.gif", "--json"),
        *("--sheet", tmp_path / "sheet.png"),
    )
    answer = json.loads(result.output)
    assert answer["frames"] == 2
    assert 25 < answer["path_length_px"] < 29
    assert (tmp_path / "ball.gif").stat().st_size > 0
    assert bm.read(tmp_path / "sheet.png").size[0] == 1800


def test_before_a_guess_the_misfit_is_that_of_noise(tmp_path):
    """Honest: around what it hides, a guess is the image, and their difference shows no noise."""
    path, across = (50.0, 44.0, 100.0, 56.0), np.linspace(1, 1.3, 160)[:, None]
    wall = np.broadcast_to(across * (0.45, 0.5, 0.55), (100, 160, 3))
    ball = bm.rendering.Ball(9, (0.85, 0.25, 0.05))
    truth = on_line(wall, path[:2], path[2:], ball)
    noise = np.random.default_rng(0).normal(0, 0.006, truth.image.rgb.shape)
    codes = np.rint(255 * bm.SRGB.encode(np.clip(truth.image.rgb + noise, 0, 1)))
    bm.write(tmp_path / "image.png", bm.decode(codes.astype(np.uint8), bm.SRGB))
    solved = ("--region", "36,30,114,70", "--solver", "swept", "--out", tmp_path)
    good("solve", tmp_path / "image.png", "--plate", "none", *solved)
    result = good(
        *("sharpen", tmp_path / "layer.exr", "--image", tmp_path / "image.png", "--plate", "none"),
        *("--out", tmp_path / "ball.exr", "--json"),
    )
    assert 0.7 < json.loads(result.stdout)["misfit"] < 1.4
    assert "does not explain the light" not in result.stderr


def test_wrong_calls_are_refused(folder, tmp_path):
    layer = folder / "layer.exr"
    assert "--frames" in complaint(run("sharpen", layer, "--frames", 0, "-o", tmp_path / "a.exr"))
    assert "no alpha" in complaint(run("sharpen", layer, "--frames", 2, "-o", tmp_path / "a.gif"))
    assert "--plate" in complaint(
        run("sharpen", layer, "--image", folder / "image.png", "-o", tmp_path / "a.exr")
    )
    assert "no shape on a path" in complaint(
        run("sharpen", folder / "no_sweep.exr", "-o", tmp_path / "a.exr")
    )


@pytest.mark.battery
def test_spin_is_measured_and_used(folder, tmp_path):
    spinning = tmp_path / "spinning"
    spinning.mkdir()
    paint = np.random.default_rng(1).uniform(0.1, 0.9, (4, 8, 3))
    texture = np.repeat(np.repeat(paint, 24, axis=0), 24, axis=1)
    path = (22.0, 20.0, 48.0, 28.0)
    truth = rendered(
        bm.rendering.Scene(
            colorful_plate(SIZE, 1, tile=16),
            bm.Trajectory.line(path[:2], path[2:]),
            bm.rendering.Ball(8, texture=texture, ambient=1.0),
            Change(spin=(0.0, 0.9, 0.3)),
        )
    )
    solution = bm.read_solution(folder / "layer.exr")
    bm.write(spinning / "layer.exr", solution)
    bm.write(spinning / "image.png", truth.image)
    bm.write(spinning / "plate.png", truth.plate)
    pictures = ("--image", spinning / "image.png", "--plate", spinning / "plate.png")
    call = ("sharpen", spinning / "layer.exr", *pictures, "--match", "none", "--spin", "measure")
    answer = json.loads(good(*call, "-o", tmp_path / "ball.exr", "--json").output)
    turned = answer["spin"]["rate_deg_per_exposure"] * np.array(answer["spin"]["axis"])
    assert np.linalg.norm(turned - np.degrees([0.0, 0.9, 0.3])) < 5
    assert answer["spin"]["revolutions_per_second"] is None
    assert "the direction of time is unknown" in answer["spin"]["ambiguity"]


def test_a_spin_needs_pictures(folder, tmp_path):
    out = ("-o", tmp_path / "ball.exr")
    assert "--spin needs --image" in complaint(
        run("sharpen", folder / "layer.exr", "--spin", "auto", *out)
    )
    assert "must be none, auto, measure" in complaint(
        run("sharpen", folder / "layer.exr", "--spin", "maybe", *out)
    )
    assert not (tmp_path / "ball.exr").exists()


@pytest.mark.battery
def test_a_spin_needs_texture(folder, tmp_path):
    out = ("-o", tmp_path / "ball.exr")
    pictures = ("--image", folder / "plate.png", "--plate", folder / "plate.png")
    out = ("--spin", "measure", *out)
    said = complaint(run("sharpen", folder / "layer.exr", *pictures, "--match", "none", *out))
    assert len(said.splitlines()) <= 3
    assert not (tmp_path / "ball.exr").exists()
