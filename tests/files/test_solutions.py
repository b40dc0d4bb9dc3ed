from dataclasses import replace

import numpy as np
import OpenEXR
import OpenImageIO as oiio
import pytest

from blurmatte.color import ColorModel
from blurmatte.errors import FileError
from blurmatte.files import read, read_layer, read_solution, write
from blurmatte.matting import Grade, Quality, Solution

ARRAYS = ("alpha", "alpha_std", "premultiplied", "premultiplied_std", "quality")


@pytest.fixture
def solution():
    rng = np.random.default_rng(0)
    alpha = rng.uniform(-0.1, 1.1, (24, 32)).astype(np.float32)
    quality = rng.choice([0, 0, 0, Quality.MISFIT, Quality.SATURATED, Quality.OUTSIDE], (24, 32))
    std = rng.uniform(0.01, 0.1, (24, 32)).astype(np.float32)
    std[3, 4] = np.inf  # where the plate shows an object color
    light = (alpha[..., None] * [0.7, 0.9, 0.1]).astype(np.float32)
    model = ColorModel(ColorModel.from_hex("#d8ff3c").basis, 1e-4 * np.eye(3), {"hue": np.inf})
    stats = {"box": (1, 2, 30, 20), "noise": np.float32(0.25), "streaks": [(1, 2), (3, 4)], "n": 3}
    return Solution(
        alpha,
        std,
        light,
        0.1 * np.abs(light),
        quality.astype(np.uint8),
        model,
        "Pixelwise()",
        stats,
    )


@pytest.fixture
def path(tmp_path, solution):
    write(tmp_path / "s.exr", solution)
    return tmp_path / "s.exr"


def test_solution_round_trips(path, solution):
    back = read_solution(path)
    for name in ARRAYS:
        assert np.array_equal(getattr(back, name), getattr(solution, name)), name
        assert getattr(back, name).dtype == getattr(solution, name).dtype
    assert np.array_equal(back.model.basis, solution.model.basis)
    assert np.array_equal(back.model.covariance, solution.model.covariance)
    assert back.model.evidence == solution.model.evidence
    assert back.solver == "Pixelwise()"
    assert back.stats == {
        **{"box": (1, 2, 30, 20), "noise": 0.25, "streaks": ((1, 2), (3, 4)), "n": 3}
    }


def test_double_precision_is_stored_as_float32(tmp_path, solution):
    doubled = Solution(
        *(getattr(solution, name).astype(float) / 3 for name in ARRAYS[:4]),
        solution.quality,
        solution.model,
        "Pixelwise()",
    )
    write(tmp_path / "s.exr", doubled)
    assert np.array_equal(read_solution(tmp_path / "s.exr").alpha, doubled.alpha.astype(np.float32))


def test_rgba_channels_are_the_layer(path, solution):
    layer = read_layer(path)
    assert np.array_equal(layer.alpha, solution.layer.alpha)
    assert np.array_equal(layer.premultiplied, solution.layer.premultiplied)
    assert np.array_equal(read(path).rgb, solution.layer.premultiplied)


def test_openexr_reads_every_channel(path, solution):
    file = OpenEXR.File(str(path), separate_channels=True)
    seen = {name: channel.pixels for name, channel in file.channels().items()}
    expected = {"A": solution.layer.alpha, "alpha.raw": solution.alpha}
    expected |= {"alpha.std": solution.alpha_std, "quality.flags": solution.quality}
    for c, color in enumerate("RGB"):
        expected[color] = solution.layer.premultiplied[..., c]
        expected[f"premultiplied.{color}"] = solution.premultiplied[..., c]
        expected[f"premultiplied_std.{color}"] = solution.premultiplied_std[..., c]
    assert seen.keys() == expected.keys()
    for name, values in expected.items():
        assert np.array_equal(seen[name], values.astype(np.float32)), name
    assert file.header()["blurmatte:solver"] == "Pixelwise()"
    assert "#d8ff3c" in file.header()["blurmatte:model"]


def rewritten(path, name, text):
    """Write the file again with another text in its header."""
    source = oiio.ImageInput.open(str(path))
    spec, pixels = source.spec(), source.read_image(oiio.FLOAT)
    source.close()
    spec[name] = text
    target = oiio.ImageOutput.create(str(path))
    target.open(str(path), spec)
    target.write_image(pixels)
    target.close()


def test_grade_and_calibrated_errors_round_trip(tmp_path, solution):
    graded = {"grade": str(Grade.PLAUSIBLE), "grade_reasons": ["color", "noise"]}
    graded |= {"alpha_error": 0.031, "alpha_scale_std": 0.043, "weights": [0.9, 0.1]}
    write(tmp_path / "s.exr", replace(solution, stats=graded))
    back = read_solution(tmp_path / "s.exr")
    assert back.grade is Grade.PLAUSIBLE
    assert back.stats == {**graded, "grade_reasons": ("color", "noise"), "weights": (0.9, 0.1)}


def test_solution_with_a_sweep_of_an_older_version_is_rejected(path):
    rewritten(path, "blurmatte:sweep", '{"bulges": 0, "size": [32, 24]}')
    with pytest.raises(
        FileError, match=r"s\.exr: solve its picture again; the sweep of an older blurmatte"
    ):
        read_solution(path)


def test_changed_header_is_rejected(path, solution):
    rewritten(path, "blurmatte:model", "{}")
    with pytest.raises(
        FileError,
        match=r"give the EXR as blurmatte.write made it; another program or version wrote its header",
    ):
        read_solution(path)


def test_solution_is_written_as_exr_only(tmp_path, solution):
    with pytest.raises(FileError, match=r"a Solution is written as \.exr"):
        write(tmp_path / "s.png", solution)


def test_stats_that_are_not_data_raise_type_error(tmp_path, solution):
    odd = Solution(
        *(getattr(solution, name) for name in ARRAYS), solution.model, "", {"f": object()}
    )
    with pytest.raises(TypeError, match="stats must hold"):
        write(tmp_path / "s.exr", odd)
    assert not list(tmp_path.iterdir())
