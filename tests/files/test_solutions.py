"""Solutions as files: EXR with every number, stacks of TIFF that ImageJ opens."""

import json
import os
import shutil
import subprocess
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import OpenEXR
import OpenImageIO as oiio
import pytest
import tifffile

import blurmatte as bm
from blurmatte.color.model import ColorModel
from blurmatte.errors import FileError
from blurmatte.files.reading import read, read_layer
from blurmatte.files.solutions import read_solution, save_stack, stats_to_mapping
from blurmatte.files.writing import write
from blurmatte.matting import Quality, SolutionStats
from blurmatte.matting.maps import Grade
from blurmatte.matting.solution import Solution
from blurmatte.matting.stats import MatchSummary, MedianNoise, SmoothSummary, SweepSummary
from blurmatte.matting.summary import Alternative
from blurmatte.radiometry import NoiseModel
from blurmatte.sweep.assess.calibration import ErrorTerms
from blurmatte.sweep.model.cast_shadow import CastShadow
from blurmatte.sweep.sweep import Diagnostics

STATS = SolutionStats(
    pixels=600,
    pixels_known=590,
    pixels_misfit=3,
    sum_alpha=123.25,
    sum_alpha_std=2.5,
    alpha_scale_std=0.01,
    streak_box=(1, 2, 30, 20),
    other_boxes=((1, 2, 3, 4), (5, 6, 7, 8)),
    insignificant_others=2,
    image_noise=NoiseModel((1e-5, 2e-5, 3e-5), 0.002, 0.01),
    plate_noise=MedianNoise(0.003),
    match=MatchSummary(
        in_words="shifted", shift=(1.0, -0.5), agreement=1.01, edge_agreement=float("inf")
    ),
    may_be_shadow=True,
    rough_guess=0.17,
    exposure_time=0.02,
    readout="left",
    sweep=SweepSummary(
        silhouette="disc",
        path="arc",
        xy=((0.1, 1 / 3), (2.0, 3.0)),
        length=20.0,
        radius=5.0,
        radius_std=0.1,
        outlines=(((0.0, 1.0), (2.0, 3.0)), ()),
        diagnostics=Diagnostics(converged=False, residual_excess=1.1),
        shadow=CastShadow((-6.0, 8.0), 3.0, (0.4, 0.5, 0.6)),
    ),
    smooth=SmoothSummary(2, 0.5, 12, converged=True),
    sum_shadow=-4.5,
    weights=(0.9, 0.1),
    shape_log_odds=(-float("inf"), 1e-5),
    alternatives=(Alternative("one", (0.1, 0.2, 0.3), "#808080", 0.9, 1.0, 0.0, None),),
    claimed_error=0.02,
    error_terms=ErrorTerms(radius=0.1),
    grade_reasons=("color", "noise"),
    grade=Grade.PLAUSIBLE,
    alpha_error=0.031,
)
ARRAYS = ("alpha", "alpha_std", "premultiplied", "premultiplied_std", "quality")
JAR = Path("/usr/share/java/ij.jar")  # of Debian's package imagej
READER = """
import ij.*; import ij.io.*;
public class Read {
    public static void main(String[] files) {
        ImagePlus image = new Opener().openImage(files[0]);
        ImageStack stack = image.getStack();
        System.out.println(stack.getSize() + " " + image.getWidth() + " " + image.getHeight()
            + " " + image.getBitDepth());
        System.out.println(image.getInfoProperty());
        for (int k = 1; k <= stack.getSize(); k++)
            System.out.println(stack.getSliceLabel(k) + "|" + stack.getProcessor(k).getf(3, 2));
    }
}
"""


@pytest.fixture
def solution():
    rng = np.random.default_rng(0)
    alpha = rng.uniform(-0.1, 1.1, (24, 32)).astype(np.float32)
    quality = rng.choice([0, 0, 0, Quality.MISFIT, Quality.SATURATED, Quality.OUTSIDE], (24, 32))
    std = rng.uniform(0.01, 0.1, (24, 32)).astype(np.float32)
    std[3, 4] = np.inf  # where the plate shows an object color
    light = (alpha[..., None] * [0.7, 0.9, 0.1]).astype(np.float32)
    model = ColorModel(ColorModel.from_hex("#d8ff3c").basis, 1e-4 * np.eye(3), {"hue": np.inf})
    return Solution(
        alpha,
        std,
        light,
        0.1 * np.abs(light),
        quality.astype(np.uint8),
        model,
        "Pixelwise()",
        STATS,
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
    assert back.grade is Grade.PLAUSIBLE
    assert back.stats == STATS
    missing = [field.name for field in fields(STATS) if getattr(STATS, field.name) is None]
    assert missing == []


def test_numbers_that_do_not_apply_are_not_written():
    """Exact: but for the exposure time, which is null if the image's file does not state it."""
    assert list(stats_to_mapping(STATS)) == [field.name for field in fields(STATS)]
    written = stats_to_mapping(SolutionStats(pixels=3))
    assert written["exposure_time"] is None
    assert "sum_alpha" not in written
    assert [name for name, value in written.items() if value is None] == ["exposure_time"]


def test_numbers_of_numpy_are_written_as_those_of_python():
    """Exact: of each kind, and of 32 bits."""
    found = SolutionStats(pixels=np.int64(3), sum_alpha=np.float32(0.25), may_be_shadow=np.True_)
    assert json.dumps(stats_to_mapping(found)).startswith('{"pixels": 3, "sum_alpha": 0.25, ')


def test_a_header_of_an_older_version_is_read(path):
    """Exact: without numbers of this version, and with others."""
    rewritten(path, "blurmatte:stats", '{"sum_alpha": 12.5, "older": {"x": 1}}')
    assert read_solution(path).stats == SolutionStats(sum_alpha=12.5)


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
    odd = replace(solution, stats=SolutionStats(pixels=object()))
    with pytest.raises(TypeError, match="must hold numbers"):
        write(tmp_path / "s.exr", odd)
    assert not list(tmp_path.iterdir())
    with pytest.raises(TypeError, match="stats must be a SolutionStats, got dict"):
        replace(solution, stats={"pixels": 3})


@pytest.fixture
def filled():
    """Numbers that differ in every map and pixel."""
    maps = bm.matting.PixelMaps.zeros(5, 7)
    for k, values in enumerate(maps[:4]):
        values[...] = k + np.arange(values.size, dtype=np.float32).reshape(values.shape) / 100
    maps.alpha_std[0, 0] = np.inf
    maps.quality[2, 3] = 16
    return bm.Solution(*maps, model=bm.ColorModel.any(), solver="Pixelwise()")


def values_of(filled):
    return [
        *(filled.alpha, filled.alpha_std),
        *(filled.premultiplied[..., c] for c in range(3)),
        *(filled.premultiplied_std[..., c] for c in range(3)),
        filled.quality,
    ]


def test_every_map_is_a_page_with_its_name(filled, tmp_path):
    """Exact: as tifffile and OpenImageIO read it."""
    path = tmp_path / "ball.tif"
    bm.write(path, filled)
    with tifffile.TiffFile(path) as file:
        assert np.array_equal(file.asarray(), np.stack(values_of(filled)))
        labels = file.imagej_metadata["Labels"]
        assert labels[:3] == ["alpha", "error of alpha", "red light of the object"]
        assert labels[-1].startswith("flags (1 saturated, 2 plate in model, ")
        assert "premultiplied, 1 is white" in file.imagej_metadata["Info"]
        assert file.imagej_metadata["images"] == len(labels) == 9
    for page, values in enumerate(values_of(filled)):
        assert np.array_equal(oiio.ImageBuf(str(path), page, 0).get_pixels()[..., 0], values)


def test_the_same_solution_gives_the_same_bytes(filled, tmp_path):
    for name in "ab":
        bm.write(tmp_path / f"{name}.tif", filled)
    assert (tmp_path / "a.tif").read_bytes() == (tmp_path / "b.tif").read_bytes()


def test_more_than_a_tiff_can_hold_is_refused(tmp_path):
    """door."""
    large = np.broadcast_to(np.float32(0), (2**15, 2**15))
    with pytest.raises(FileError, match=r"write .exr; 2 maps of 32768x32768 need more than 4 GB"):
        save_stack(tmp_path / "a.tif", {"a": large, "b": large}, "")


@pytest.mark.battery
@pytest.mark.skipif(not JAR.is_file(), reason=f"ImageJ is not there: {JAR}")
@pytest.mark.skipif(shutil.which("javac") is None, reason="there is no Java compiler")
def test_imagej_shows_names_and_numbers(filled, tmp_path):
    """Exact"""
    bm.write(tmp_path / "ball.tif", filled)
    (tmp_path / "Read.java").write_text(READER)
    command = ["java", "-Djava.awt.headless=true", "-cp", str(JAR), "Read.java", "ball.tif"]
    done = subprocess.run(
        command, cwd=tmp_path, capture_output=True, text=True, check=True, env=os.environ
    )
    head, info, *slices = done.stdout.splitlines()
    assert head == "9 7 5 32"
    assert info.startswith("blurmatte: Solution(7x5")
    assert [line.partition("|")[0] for line in slices[:2]] == ["alpha", "error of alpha"]
    seen = [float(line.partition("|")[2]) for line in slices]
    np.testing.assert_allclose(seen, [values[2, 3] for values in values_of(filled)], rtol=1e-6)
