"""Solutions as stacks of TIFF: every number and every name, also in ImageJ."""

import os
import shutil
import subprocess
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import pytest
import tifffile

import blurmatte as bm
from blurmatte.errors import FileError
from blurmatte.files.stacks import save_stack

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
    """Numbers that differ in every map and pixel."""
    maps = bm.matting.PixelMaps.zeros(5, 7)
    for k, values in enumerate(maps[:4]):
        values[...] = k + np.arange(values.size, dtype=np.float32).reshape(values.shape) / 100
    maps.alpha_std[0, 0] = np.inf
    maps.quality[2, 3] = 16
    return bm.Solution(*maps, model=bm.ColorModel.any(), solver="Pixelwise()")


def values_of(solution):
    return [
        *(solution.alpha, solution.alpha_std),
        *(solution.premultiplied[..., c] for c in range(3)),
        *(solution.premultiplied_std[..., c] for c in range(3)),
        solution.quality,
    ]


def test_every_map_is_a_page_with_its_name(solution, tmp_path):
    """Exact: as tifffile and OpenImageIO read it."""
    path = tmp_path / "ball.tif"
    bm.write(path, solution)
    with tifffile.TiffFile(path) as file:
        assert np.array_equal(file.asarray(), np.stack(values_of(solution)))
        labels = file.imagej_metadata["Labels"]
        assert labels[:3] == ["alpha", "error of alpha", "red light of the object"]
        assert labels[-1].startswith("flags (1 saturated, 2 plate in model, ")
        assert "premultiplied, 1 is white" in file.imagej_metadata["Info"]
        assert file.imagej_metadata["images"] == len(labels) == 9
    for page, values in enumerate(values_of(solution)):
        assert np.array_equal(oiio.ImageBuf(str(path), page, 0).get_pixels()[..., 0], values)


def test_the_same_solution_gives_the_same_bytes(solution, tmp_path):
    for name in "ab":
        bm.write(tmp_path / f"{name}.tif", solution)
    assert (tmp_path / "a.tif").read_bytes() == (tmp_path / "b.tif").read_bytes()


def test_more_than_a_tiff_can_hold_is_refused(tmp_path):
    """door."""
    large = np.broadcast_to(np.float32(0), (2**15, 2**15))
    with pytest.raises(FileError, match=r"write .exr; 2 maps of 32768x32768 need more than 4 GB"):
        save_stack(tmp_path / "a.tif", {"a": large, "b": large}, "")


@pytest.mark.battery
@pytest.mark.skipif(not JAR.is_file(), reason=f"ImageJ is not there: {JAR}")
@pytest.mark.skipif(shutil.which("javac") is None, reason="there is no Java compiler")
def test_imagej_shows_names_and_numbers(solution, tmp_path):
    """Exact"""
    bm.write(tmp_path / "ball.tif", solution)
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
    np.testing.assert_allclose(seen, [values[2, 3] for values in values_of(solution)], rtol=1e-6)
