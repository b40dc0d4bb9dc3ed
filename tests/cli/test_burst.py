"""solve with several --plate: shots from the hand, each with the object elsewhere."""

import json

import numpy as np
import pytest
from tests.commands import complaint, run
from tests.handheld import fine_scene, noisy, shown, similarity, with_ball
from tests.scenes import on_line

import blurmatte as bm
from blurmatte.rendering import Ball

SIZE = (192, 120)
VIEWS = [similarity(SIZE, -6.3, 4.1, 1, 0.01), similarity(SIZE), similarity(SIZE, 7.7, -3.4)]


@pytest.fixture(scope="module")
def burst(tmp_path_factory):
    """Folder with shot0.png … shot2.png, and the true alpha of shot1."""
    folder, points = tmp_path_factory.mktemp("burst"), fine_scene((230, 150))
    for k, h in enumerate(VIEWS):
        start = np.array([40.0 + 45 * k, 60])
        rendering = with_ball(shown(points, SIZE, h), h, start, start + np.array([20, -8]))
        light = np.clip(noisy(rendering.image.rgb * (1 + 0.03 * (k - 1)), k).rgb, 0, 1)
        codes = np.rint(255 * bm.SRGB.encode(light)).astype(np.uint8)
        bm.write(folder / f"shot{k}.png", bm.decode(codes, bm.SRGB))
        if k == 1:
            alpha = rendering.layer.alpha
    return folder, alpha


def test_shot_is_solved_before_two_others(burst, tmp_path):
    # oracle
    folder, alpha = burst
    plates = ("--plate", folder / "shot0.png", "--plate", folder / "shot2.png")
    options = ("--color", "#ff7845", "--solver", "swept", "--out", tmp_path)
    result = run("solve", folder / "shot1.png", *plates, *options)
    assert result.exit_code == 0, result.stderr
    assert "plate: shifted by" in result.stdout
    layer = bm.read_layer(tmp_path / "layer.exr")
    assert np.sqrt(np.mean((layer.alpha - alpha)[alpha > 0] ** 2)) < 0.02
    report = json.loads((tmp_path / "report.json").read_text())
    assert report["plate"]["file"] == "plate of 2 shots"
    assert not (tmp_path / "parallax.png").exists()


def test_parallax_of_most_shots_is_stated(tmp_path):
    """exact: of a near floor that moves against the wall, by 4 pixels from shot to shot."""
    size, points = (320, 180), fine_scene((440, 260), tile=20)
    floor = points.shape[0] // 2 + 3 * 40
    for k in range(3):
        scene = points.copy()
        scene[floor:] = np.roll(points[floor:], 3 * 4 * k, axis=1)
        h, start = similarity(size, 5 - 4 * k, 3 * k), np.array([60 + 80 * k, 70])
        rendering = with_ball(shown(scene, size, h), h, start, start + np.array([20, -8]))
        light = np.clip(noisy(rendering.image.rgb, k).rgb, 0, 1)
        codes = np.rint(255 * bm.SRGB.encode(light)).astype(np.uint8)
        bm.write(tmp_path / f"shot{k}.png", bm.decode(codes, bm.SRGB))
    plates = ("--plate", tmp_path / "shot0.png", "--plate", tmp_path / "shot2.png")
    options = ("--color", "#ff7845", "--solver", "swept", "--out", tmp_path / "out")
    result = run("solve", tmp_path / "shot1.png", *plates, *options)
    assert result.exit_code == 0, result.stderr
    assert "Parallax: the camera moved in space" in result.stderr
    assert (tmp_path / "out/parallax.png").exists()


@pytest.mark.battery
def test_match_does_not_follow_the_object_before_a_wall(tmp_path):
    """oracle: a displacement of the object looks like one of the camera, and then nothing moved."""
    x, y = np.meshgrid(np.arange(480), np.arange(320))
    shade = 0.35 + 0.2 * np.exp(-((x - 350) ** 2 + (y - 40) ** 2) / 6e4)
    wall, alpha = shade[..., None] * [1, 0.95, 0.85], {}
    for k in range(1, 4):
        start = np.array([120 + 24.0 * k, 180 - 6.0 * k])
        rendering = on_line(wall, start, start + np.array([50, -12]), Ball(13, (0.85, 0.16, 0.05)))
        light = np.clip(noisy(rendering.image.rgb, k).rgb, 0, 1)
        codes = np.rint(255 * bm.SRGB.encode(light)).astype(np.uint8)
        bm.write(tmp_path / f"shot{k}.jpg", bm.decode(codes, bm.SRGB))
        alpha[k] = rendering.layer.alpha
    plates = ("--plate", tmp_path / "shot1.jpg", "--plate", tmp_path / "shot3.jpg")
    result = run("solve", tmp_path / "shot2.jpg", *plates, "--out", tmp_path / "out")
    assert result.exit_code == 0, result.stderr
    assert "shifted" not in result.stdout
    layer = bm.read_layer(tmp_path / "out/layer.exr")
    assert np.sqrt(np.mean((layer.alpha - alpha[2])[alpha[2] > 0] ** 2)) < 0.02


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("shot1.png", "--plate", "none"), "--plate none guesses the plate: give it alone"),
        (("shot1.png", "--solver", "shaded", "--color", "#ff7845"), "needs one --plate, got 2"),
        (("shot1.png", "--layers", "png"), "give one --plate with a clip, got 2"),
    ],
)
def test_several_plates_that_do_not_fit_are_refused(burst, tmp_path, words, message):
    # door
    folder, _ = burst
    image, *options = words
    plates = ("--plate", folder / "shot0.png", "--plate", folder / "shot2.png")
    result = run("solve", folder / image, *plates, *options, "--out", tmp_path / "o")
    assert message in complaint(result)
    assert not (tmp_path / "o").exists()
