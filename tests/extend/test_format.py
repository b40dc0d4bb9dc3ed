"""A format of one row, which a library in use reads: it works wherever pictures do.

What a file is must be known before any line of a program runs, so the row stands in the list of the
package. Outside of it, a program reads a file into a `LinearImage`, which every function takes.
"""

import subprocess
import sys

import numpy as np
import pytest

import blurmatte as bm
from blurmatte import formats
from blurmatte.formats import Format, Holds, pictures_in

PNM = Format("portable pixmap", Holds.PICTURE, (".ppm",), rb"P6\s", "OpenImageIO")


@pytest.fixture
def row(monkeypatch):
    """The list with that row; the first one whose content matches is meant."""
    monkeypatch.setattr(formats, "FORMATS", (PNM, *formats.FORMATS))


@pytest.fixture(scope="module")
def files(paint, tmp_path_factory):
    """Image and plate of a ball as such files: a header and 8-bit codes."""
    folder = tmp_path_factory.mktemp("ppm")
    for name, picture in (("image", paint.image), ("plate", paint.plate)):
        codes = np.rint(255 * bm.SRGB.encode(np.clip(picture.rgb, 0, 1))).astype(np.uint8)
        header = "P6 {} {} 255\n".format(*picture.size).encode()
        (folder / f"{name}.ppm").write_bytes(header + codes.tobytes())
    return folder


@pytest.mark.usefixtures("row")
def test_its_light_and_its_levels_are_read(files, paint):
    image = bm.read(files / "image.ppm", transfer=bm.SRGB)
    assert np.abs(bm.SRGB.encode(image.rgb) - bm.SRGB.encode(paint.image.rgb)).max() < 0.51 / 255
    assert image.meta.levels == 256


@pytest.mark.usefixtures("row")
def test_folders_and_names_know_it(files):
    assert {path.name for path in pictures_in(files)} == {"image.ppm", "plate.ppm"}
    assert formats.format_at(files / "image.ppm") is PNM
    assert not formats.is_clip(files / "image.ppm")


@pytest.mark.usefixtures("row")
def test_it_is_solved_saved_and_read(files, paint, tmp_path):
    image, plate = (bm.read(files / f"{n}.ppm", transfer=bm.SRGB) for n in ("image", "plate"))
    solution = bm.solve(image, plate, paint.model, bm.Pixelwise())
    bm.save_results(tmp_path, image, plate, solution)
    back = bm.read_solution(tmp_path / "layer.exr")
    assert np.array_equal(back.alpha, solution.alpha)
    assert np.corrcoef(back.alpha.ravel(), paint.layer.alpha.ravel())[0, 1] > 0.95


def test_a_command_takes_it(files):
    added = (
        "from blurmatte import formats as f; "
        'row = f.Format("portable pixmap", f.Holds.PICTURE, (".ppm",), rb"P6\\s", "OpenImageIO"); '
        "f.FORMATS = (row, *f.FORMATS); from blurmatte.__main__ import run; run()"
    )
    command = sys.executable, "-c", added, "info", "image.ppm", "--transfer", "srgb"
    done = subprocess.run(command, cwd=files, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert "192x128" in done.stdout


def test_without_the_row_it_is_refused_with_a_remedy(files):
    with pytest.raises(bm.errors.FileError, match="PNM"):
        bm.read(files / "image.ppm")
