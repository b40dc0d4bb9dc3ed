"""blurmatte plate: a plate and its sheet from a clip, and errors of one line."""

import numpy as np
import pytest
from PIL import Image
from tests.commands import complaint, run
from tests.encoders import encoder

import blurmatte as bm
from blurmatte.rendering import colorful_plate

pytest.importorskip("av")


def save_clip(path, lights):
    """A lossless clip, 10 frames a second, tagged as sRGB."""
    with encoder(path, "ffv1", lights[0].shape[1::-1], "bgr0", rate=10) as (stream, add):
        stream.codec_context.color_trc = 13
        for light in lights:
            add(np.rint(255 * bm.SRGB.encode(np.clip(light, 0, 1))).astype(np.uint8))
    return path


@pytest.fixture(scope="module")
def scene():
    return 0.1 + 0.6 * colorful_plate((96, 64), 3, tile=12)


@pytest.fixture(scope="module")
def clip(tmp_path_factory, scene):
    """30 frames with noise, before which a square goes from left to right."""
    rng, lights = np.random.default_rng(1), []
    for i in range(30):
        light = scene + rng.normal(0, 0.004, scene.shape)
        light[20:34, 2 + 2 * i : 16 + 2 * i] = (0.8, 0.3, 0.05)
        lights.append(light)
    return save_clip(tmp_path_factory.mktemp("clip") / "walk.mkv", lights)


def test_makes_plate_of_clip(tmp_path, clip, scene):
    # honest
    result = run("plate", clip, "--out", tmp_path / "plate.exr")
    assert result.exit_code == 0, result.stderr
    assert "30 frames" in result.stdout
    assert result.stdout.splitlines()[-1].endswith("plate_overview.png")
    plate = bm.read(tmp_path / "plate.exr")
    z = (plate.rgb - scene) / np.sqrt(plate.variance)
    assert plate.valid.mean() > 0.98
    assert np.std(z[plate.valid]) == pytest.approx(1, abs=0.15)
    with Image.open(tmp_path / "plate_overview.png") as sheet:
        assert sheet.width == 1800
    std = np.median(np.sqrt(plate.variance))
    assert (
        f"error of the light, of each pixel: {std:.2g}"
        in run("info", tmp_path / "plate.exr").stdout
    )


def test_makes_plate_of_chosen_frames(tmp_path, clip):
    out = tmp_path / "plate.exr"
    for window, count in (
        (("--frames", "10:15"), 5),
        (("--frames", "1s:1.5s"), 5),
        (("--frames", "::6"), 5),
    ):
        result = run("plate", clip, "--out", out, *window)
        assert result.stdout.startswith(f"plate of {count} frames"), result.stderr


def test_makes_plate_of_pictures(tmp_path, scene):
    rng, names = np.random.default_rng(2), []
    for i in range(4):
        names.append(tmp_path / f"{i}.exr")
        light = scene + rng.normal(0, 0.004, scene.shape)
        bm.write(names[-1], bm.LinearImage(light.astype(np.float32)))
    for source in (names, [tmp_path / "?.exr"]):
        result = run("plate", *source, "--out", tmp_path / "out" / "plate.png")
        assert result.stdout.startswith("plate of 4 frames, 96x64"), result.stderr


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--frames", ":2"], "at least 3 frames, got 2"),
        (["--frames", "late:"], "seconds like 4.5s, got 'late'"),
        (["--frames", "::0"], "--frames must have a step of at least 1"),
        (["--transfer", "auto"], "no transfer is called 'auto'"),
    ],
)
def test_refuses_in_one_line_and_changes_no_file(tmp_path, clip, arguments, said):
    # door
    out = tmp_path / "plate.exr"
    out.write_bytes(b"what was there")
    assert said in complaint(run("plate", clip, "--out", out, *arguments))
    assert out.read_bytes() == b"what was there"
    assert list(tmp_path.iterdir()) == [out]


def test_plate_of_a_camera_that_pans_is_larger_than_its_frames(tmp_path):
    wide = 0.1 + 0.6 * colorful_plate((140, 90), 5, tile=9)
    path = save_clip(tmp_path / "pan.mkv", [wide[5:85, 2 * i : 2 * i + 100] for i in range(12)])
    result = run("plate", path, "--out", tmp_path / "plate.exr")
    assert result.exit_code == 0, result.stderr
    assert "12 of 12 frames are registered to frame 6" in result.stdout
    width, height = bm.read(tmp_path / "plate.exr").size
    assert 122 <= width <= 124
    assert 80 <= height <= 82
