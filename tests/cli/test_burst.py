"""solve with several --plate: shots from the hand, each with the object elsewhere."""

import json

import numpy as np
import pytest
from tests.commands import complaint, run
from tests.handheld import fine_scene, noisy, shown, similarity, with_ball

import blurmatte as bm

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
