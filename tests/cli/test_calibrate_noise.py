"""calibrate noise, and --noise of solve and color."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from PIL import Image
from tests.commands import complaint, run
from tests.scenes import on_line

import blurmatte as bm
from blurmatte.rendering import colorful_plate

NOISE = bm.NoiseModel(gain=(2e-4, 1e-4, 4e-4), read_std=(0.002, 0.0015, 0.003))
ENCODED = ("--transfer", "srgb")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Four frames of 16 bits, f0.png to f3.png, and a small picture."""
    folder = tmp_path_factory.mktemp("frames")
    level = 0.02 + 0.75 * np.linspace(0, 1, 160) ** 2
    light = np.tile(level[:, None] * [1, 0.8, 0.9], (120, 1, 1))
    for seed in range(4):
        bm.write(
            folder / f"f{seed}.png", bm.rendering.Camera(NOISE, bits=16).photograph(light, seed)
        )
    bm.write(folder / "small.png", bm.LinearImage(np.full((20, 20, 3), 0.5)))
    return folder


def calibrate(*args):
    return run("calibrate", "noise", *args, *ENCODED)


def test_measures_noise_of_frames(folder, tmp_path):
    """Oracle: the noise of the camera; file and plot are written."""
    plot = tmp_path / "plot.png"
    result = calibrate(folder / "f*.png", "--out", tmp_path / "n.json", "--plot", plot)
    assert result.exit_code == 0, result.stderr
    light = np.full(3, 0.3)
    found = bm.read_noise(tmp_path / "n.json")
    assert_allclose(found.variance(light), NOISE.variance(light), rtol=0.06)
    assert result.stdout.splitlines()[0].startswith("NoiseFit(gain 0.000")
    assert "White is " in result.stdout
    with Image.open(plot) as picture:
        assert picture.size == (880, 605)


def test_warns_of_guessed_transfer_once(folder, tmp_path):
    """Door: not for every frame."""
    for seed in range(3):
        with Image.open(folder / f"f{seed}.png") as picture:
            picture.convert("RGB").save(tmp_path / f"e{seed}.png")
    result = run("calibrate", "noise", tmp_path / "e*.png")
    assert result.exit_code == 0, result.stderr
    (line,) = result.stderr.splitlines()
    assert line.startswith("blurmatte: warning: ")


@pytest.mark.parametrize("given", [("--plate", "f1.png"), ("--region", "10,10,150,110")])
def test_measures_noise_of_one_picture(folder, given):
    """Oracle: electrons at white, from one picture of another scene."""
    option, value = given
    result = calibrate(folder / "f0.png", option, folder / value if "plate" in option else value)
    assert result.exit_code == 0, result.stderr
    (line,) = (line for line in result.stdout.splitlines() if line.startswith("White is"))
    electrons = [float(part.split()[0]) for part in line.removeprefix("White is").split(",")]
    assert_allclose(electrons, [5000, 10_000, 2500], rtol=0.15)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["f0.png"], "f0.png: give several frames of a still scene, or --plate"),
        (["f0.png", "--region", "5,5,9,9"], "16 pixels are usable to measure noise"),
        (["f0.png", "--region", "5,5,900,9"], "region 5,5,900,9 must lie in the picture"),
        (["f0.png", "--region", "5,5"], "--region must be x0,y0,x1,y1"),
        (["f0.png", "f1.png", "--plate", "f2.png"], "--plate is for one picture, got 2"),
        (["f0.png", "small.png"], "frame 1 is 160x120 pixels and frame 2 20x20"),
        (["f0.png", "f0.png"], "there is no noise: the pictures are copies of one"),
        (["g*.png"], "there are no such files"),
        (["f0.png", "nowhere.png"], "nowhere.png: "),
        (["f0.png", "f1.png", "--out", "n.png"], "noise is written as .json"),
        (["f0.png", "f1.png", "--plot", "p.json"], "is written as .png or .jpg"),
    ],
)
def test_refuses_in_one_line(folder, arguments, said, monkeypatch):
    """Door."""
    monkeypatch.chdir(folder)
    assert said in complaint(calibrate(*arguments))


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    folder = tmp_path_factory.mktemp("scene")
    body = bm.rendering.Ball(12, (0.9, 0.45, 0.05), ambient=0.6)
    truth = on_line(colorful_plate((128, 80), rng=2, tile=18), (30, 34), (90, 46), body)
    for seed, name in enumerate(("image", "plate")):
        light = getattr(truth, name).rgb
        bm.write(
            folder / f"{name}.png", bm.rendering.Camera(NOISE, bits=16).photograph(light, seed)
        )
    bm.write(folder / "noise.json", NOISE)
    loud = bm.NoiseModel.from_coefficients(4 * NOISE.coefficients)
    bm.write(folder / "loud.json", loud)
    bm.write(folder / "model.json", bm.ColorModel.from_hex("#ffbc43"))
    return folder


def test_solve_uses_noise_of_file(scene, tmp_path):
    """Invariant: twice the noise doubles the errors of pixels."""
    typical = []
    for name in ("noise", "loud"):
        out = tmp_path / name
        result = run("solve", scene / "image.png", "--plate", scene / "plate.png", "--out", out,
                     "--noise", scene / f"{name}.json", "--color", "#ffbc43",
                     "--solver", "pixelwise", *ENCODED)  # fmt: skip
        assert result.exit_code == 0, result.stderr
        solution = bm.read_solution(out / "layer.exr")
        typical.append(np.median(solution.alpha_std[solution.streak & solution.known]))
    assert_allclose(typical[1] / typical[0], 2, rtol=0.1)


def test_color_uses_noise_of_file(scene, monkeypatch):
    """Exact: the fit is given the noise of the file, for image and plate."""
    given = []

    def fit_color(image, plate, streak):
        given.extend([image.noise, plate.noise])
        return bm.ColorModel.from_hex("#ffbc43")

    monkeypatch.setattr(bm, "fit_color", fit_color)
    result = run("color", scene / "image.png", "--plate", scene / "plate.png",
                 "--noise", scene / "noise.json")  # fmt: skip
    assert result.exit_code == 0, result.stderr
    assert given == [NOISE, NOISE]


def test_info_prints_noise_of_file(scene):
    """Exact; a noise model is unchanged."""
    said = run("info", scene / "noise.json").stdout.splitlines()
    assert said[0].startswith("NoiseModel(std ")
    assert said[1] == "gain: 0.0002, 0.0001, 0.0004"
    assert said[2] == "read noise: 0.002, 0.0015, 0.003"
    assert "rank 1" in run("info", scene / "model.json").stdout


def test_info_refuses_other_json(tmp_path):
    """Door."""
    (tmp_path / "a.json").write_text("{}")
    result = run("info", tmp_path / "a.json")
    assert result.exit_code == 2
    assert "holds no color model" in result.stderr
    assert "noise or transfer curve" in result.stderr


def test_solve_refuses_file_without_noise(scene, tmp_path):
    """Door."""
    result = run("solve", scene / "image.png", "--plate", scene / "plate.png", "--out", tmp_path,
                 "--noise", scene / "model.json")  # fmt: skip
    assert "holds no noise model" in complaint(result)
