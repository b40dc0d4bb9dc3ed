"""calibrate response, and curves as files in every command: end to end, in this process."""

import json
import sys

import numpy as np
import pytest
from PIL import Image
from tests.commands import complaint, good, run

import blurmatte as bm

TIMES = ("1/32", "1/16", "1/8")


@pytest.fixture(scope="module")
def bracket(tmp_path_factory):
    """Three pictures of one scene, coded with gamma 1.8."""
    folder = tmp_path_factory.mktemp("bracket")
    rng = np.random.default_rng(0)
    light = np.kron(np.exp(rng.uniform(-5, 0.5, (10, 12, 3))), np.ones((8, 8, 1)))
    for number, factor in enumerate((0.5, 1, 2)):
        codes = 255 * np.minimum(light * factor, 1) ** (1 / 1.8) + rng.normal(0, 1, light.shape)
        Image.fromarray(np.rint(codes).clip(0, 255).astype(np.uint8)).save(folder / f"{number}.png")
    return folder


def test_measures_prints_draws_and_uses_curve(bracket, tmp_path):
    """Oracle: the curve of the pictures is recovered, and decodes them."""
    curve, plot = tmp_path / "mycam.json", tmp_path / "mycam.png"
    pictures = (bracket / "?.png", "--exposures", ",".join(TIMES))
    said = good("calibrate", "response", *pictures, "--out", curve, "--plot", plot).stdout
    assert said.startswith("ResponseFit(3 pictures, light known to ")
    assert "Nearest to gamma1.8, which is off by up to " in said
    with Image.open(plot) as picture:
        pixels = np.asarray(picture)
    assert picture.size == (800, 800)
    assert 0.5 < np.mean(pixels == 255) < 0.99  # something on white
    transfer = bm.read_transfer(curve)
    assert transfer.name == "mycam"
    v = np.linspace(0, 1, 256)
    assert np.abs(transfer.decode(v) - v**1.8).max() < 0.02
    assert json.loads(curve.read_text())["exposure_times"] == sorted(
        json.loads(curve.read_text())["exposure_times"]
    )
    answer = good("info", curve).stdout
    assert answer.startswith(f"{curve}: transfer curve mycam\nNearest to gamma1.8")
    answer = good("info", bracket / "1.png", "--transfer", curve).stdout
    assert "transfer: mycam (as you said)" in answer


def test_curve_file_equals_named_transfer(bracket, tmp_path):
    """Invariant: sRGB as a file gives what --transfer srgb gives."""
    layer, srgb = tmp_path / "layer.exr", tmp_path / "srgb.json"
    alpha = np.full((80, 96), 0.3, np.float32)
    bm.write(layer, bm.Layer(alpha, np.repeat(0.2 * alpha[..., None], 3, axis=-1)))
    bm.write(srgb, bm.SRGB)
    for transfer in (srgb, "srgb"):
        out = tmp_path / f"{len(str(transfer))}.exr"
        good("compose", layer, "--over", bracket / "1.png", "--out", out, "--transfer", transfer)
    file, name = (bm.read(tmp_path / f"{len(str(t))}.exr").rgb for t in (srgb, "srgb"))
    assert np.allclose(file, name, atol=1e-6)


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        ([], "has no exposure time; give --exposures 1/60,1/15"),
        (["--exposures", "1/60,x"], "--exposures must be seconds like 1/60,1/15,0.5, got '1/60,x'"),
        (["--exposures", "1/0,1,2"], "--exposures must be seconds"),
        (["--exposures", "1,2"], "--exposures must be 3 numbers, got 2"),
        (["--exposures", "1,1,1"], "the exposure times are all about 1 s"),
        (["--exposures", "4,2,1"], "are equally bright, or the second darker"),
        (["--exposures", "1,2,4", "--out", "curve.png"], "is written as .json"),
        (["--exposures", "1,2,4", "--max-pixels", "10"], "more than the limit of 10"),
    ],
)
def test_refuses_bad_brackets_in_one_line(bracket, tmp_path, arguments, says):
    """Door: and nothing is written."""
    line = complaint(run("calibrate", "response", bracket / "?.png", *arguments))
    assert says in line


def test_refuses_files_of_another_kind(bracket, tmp_path):
    """Door: a color model is no curve, and a curve no color model."""
    curve, model, broken = (tmp_path / name for name in ("c.json", "m.json", "b.json"))
    bm.write(curve, bm.SRGB)
    bm.write(model, bm.ColorModel.from_hex("#d8ff3c"))
    broken.write_text('{"name": "x", "light": [1, 0]}')
    picture = bracket / "1.png"
    assert "holds a color model" in complaint(run("info", picture, "--transfer", model))
    assert "no such file" in complaint(run("info", picture, "--transfer", tmp_path / "none.json"))
    files = (picture, "--plate", bracket / "2.png", "--transfer", "srgb")
    assert "holds a transfer curve" in complaint(run("color", *files, "--color", curve))
    assert "light must rise" in complaint(run("info", broken))


def test_names_missing_extras(bracket, tmp_path, monkeypatch):
    """Door: one line that says what to install."""
    from blurmatte.radiometry.transfer import log_curve

    log_curve.cache_clear()
    monkeypatch.setitem(sys.modules, "PyOpenColorIO", None)
    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)
    line = complaint(run("info", bracket / "1.png", "--transfer", "slog3"))
    assert 'pip install "blurmatte[ocio]"' in line
    pictures = (bracket / "?.png", "--exposures", ",".join(TIMES))
    line = complaint(run("calibrate", "response", *pictures, "--plot", tmp_path / "p.png"))
    assert 'pip install "blurmatte[plot]"' in line
    one = bracket / "1.png"  # needs a region: the plot is refused before the picture is read
    line = complaint(run("calibrate", "noise", one, "--plot", tmp_path / "p.png"))
    assert 'pip install "blurmatte[plot]"' in line
