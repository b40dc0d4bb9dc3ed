"""What notebooks show of pictures, layers and solutions."""

import re
import subprocess
import sys
from io import BytesIO
from types import SimpleNamespace

import numpy as np
import pytest
from PIL import Image

import blurmatte as bm
from blurmatte.clips.table import FrameRecord
from blurmatte.figures import draw_look, draw_sharp, style
from blurmatte.figures.motion import draw_path
from blurmatte.motion.columns import Rows
from blurmatte.motion.picture.measure import motion_of_sweep


@pytest.mark.parametrize("kind", ["picture", "layer", "empty layer", "solution"])
def test_a_notebook_shows_the_sheet_of_a_quick_look(kind):
    """Exact: the PNG has the pixels of draw_look."""
    alpha = np.zeros((20, 30), np.float32)
    alpha[5:9, 4:12] = 0 if kind == "empty layer" else 0.5
    layer = bm.Layer(alpha, alpha[..., None] * np.float32([0.9, 0.4, 0.1]))
    thing = layer
    if kind == "picture":
        thing = bm.LinearImage(layer.premultiplied)
    elif kind == "solution":
        maps = bm.matting.PixelMaps.zeros(20, 30)
        maps.alpha[...], maps.premultiplied[...] = alpha, layer.premultiplied
        thing = bm.Solution(*maps, model=bm.ColorModel.any(), solver="Pixelwise()")
    with Image.open(BytesIO(thing._repr_png_())) as shown:
        assert np.array_equal(np.asarray(shown), draw_look(thing))


def moved(size=(64, 48)):
    """A solution whose sweep moved, of a rendered ball."""
    from tests.scenes import rendered

    from blurmatte.rendering import Ball, Scene, colorful_plate
    from blurmatte.trajectory import Trajectory

    plate = colorful_plate(size, rng=1, tile=9)
    path = Trajectory.line((18, 20), (44, 26))
    scene = Scene(plate, path, Ball(6, (0.9, 0.5, 0.05)))
    noise = bm.NoiseModel(0, 1e-3)
    image, plate = (bm.LinearImage(x, noise) for x in (rendered(scene).image.rgb, plate))
    return image, plate, bm.sweep.fit_sweep(image, plate)


def test_motions_are_shown_without_their_picture():
    """Exact: with the ellipses of their errors."""
    motion = motion_of_sweep(moved()[2], None)
    drawn = draw_look(motion)
    assert np.array_equal(drawn, draw_path(motion))
    assert (drawn == np.array(style.STREAK)).all(axis=-1).any()
    assert len(motion._repr_png_()) <= 300_000


@pytest.mark.battery
def test_sharp_objects_are_shown_with_their_own_blur():
    """Exact: draw_sharp of the whole exposure."""
    sharp = bm.deblur(*moved())
    assert np.array_equal(draw_look(sharp), draw_sharp(sharp, sharp.shutter(0, 1)))
    assert len(sharp._repr_png_()) <= 300_000


def test_a_plate_of_frames_is_shown():
    """Exact"""
    frames = [bm.LinearImage(np.full((24, 32, 3), 0.5) + 0.001 * k) for k in range(4)]
    fit = bm.make_plate(frames)
    assert np.array_equal(draw_look(fit), bm.figures.draw_plate(fit))


def test_pictures_of_notebooks_are_small():
    """Exact: at most 300 kB, also of noise, which no PNG compresses."""
    noise = np.random.default_rng(0).uniform(0, 1, (700, 900, 3))
    png = bm.LinearImage(noise)._repr_png_()
    with Image.open(BytesIO(png)) as shown:
        assert 100_000 < len(png) <= 300_000
        assert shown.size[0] >= 300


def test_only_things_with_a_sheet_are_drawn():
    with pytest.raises(TypeError, match=r"thing must be a LinearImage or Layer or .* got list"):
        draw_look([1])


def rows():
    """Two frames, the first without the object."""
    records = [FrameRecord(7, None, 1, 1, reason="a < b"), FrameRecord(8, 0.25, 1, 1, x=12.34567)]
    return Rows(records)


def test_rows_are_shown_as_a_table_with_units():
    """Exact: columns that are empty in all rows are left out; text is escaped."""
    html = rows()._repr_html_()
    heads = re.findall(r"<th>(.*?)</th>", html)
    assert heads[:5] == [
        "frame",
        "time<br><small>s</small>",
        "object",
        "shot",
        "x<br><small>px</small>",
    ]
    assert heads[5:] == ["reason"]
    assert "<td>7</td><td></td><td>1</td><td>1</td><td></td><td>a &lt; b</td>" in html
    assert "<td>12.35</td>" in html
    assert "2 rows of 21 columns" in html
    assert isinstance(rows()[1:], Rows)
    assert "1 rows" in rows()[1:]._repr_html_()
    assert "0 rows" in Rows([])._repr_html_()


class Frame:
    """What to_table needs of pandas."""

    def __init__(self, rows):
        self.rows, self.attrs = rows, {}

    @classmethod
    def from_records(cls, rows):
        return cls(rows)


def test_rows_become_a_table_of_pandas(monkeypatch):
    """Exact: the numbers of the rows, and the units of their columns."""
    monkeypatch.setitem(sys.modules, "pandas", SimpleNamespace(DataFrame=Frame))
    table = bm.results.to_table(rows())
    assert table.rows == [row.numbers() for row in rows()]
    assert table.attrs["units"]["x"] == "px"
    assert "frame" not in table.attrs["units"]
    assert bm.results.to_table([{"x": 1.5}]).rows == [{"x": 1.5}]
    with pytest.raises(TypeError, match="each of rows must be a FrameMotion"):
        bm.results.to_table([3])


class Dataset(dict):
    """What to_xarray needs of xarray."""

    def __init__(self, arrays, labels):
        super().__init__(arrays)
        self.labels = {name: SimpleNamespace(values=v, attrs={}) for name, v in labels.items()}

    def __getitem__(self, name):
        return self.labels[name] if name in self.labels else super().__getitem__(name)


def test_arrays_get_the_names_of_their_axes(monkeypatch):
    """Exact: views of the maps."""
    monkeypatch.setitem(sys.modules, "xarray", SimpleNamespace(Dataset=Dataset))
    picture = bm.LinearImage(np.full((4, 5, 3), 0.5), bm.NoiseModel(0, 1e-3))
    found = bm.results.to_xarray(picture)
    assert {name: found[name][0] for name in found} == {
        "rgb": ("y", "x", "channel"),
        "valid": ("y", "x"),
        "variance": ("y", "x", "channel"),
    }
    assert found["rgb"][1] is picture.rgb
    assert found["rgb"][2] == {"units": "1"}
    assert found["x"].attrs == {"units": "px"}
    assert list(found["y"].values) == [0, 1, 2, 3]


@pytest.mark.parametrize(("make", "name"), [("to_table", "pandas"), ("to_xarray", "xarray")])
def test_optional_packages_that_are_missing_are_named(make, name, monkeypatch):
    """door."""
    monkeypatch.setitem(sys.modules, name, None)
    thing = rows() if make == "to_table" else bm.LinearImage(np.full((4, 5, 3), 0.5))
    with pytest.raises(bm.BlurmatteError, match=f"^pip install {name}; {make} makes"):
        getattr(bm.results, make)(thing)


def test_figures_are_imported_when_something_is_shown():
    """Exact"""
    lines = (
        "import sys, numpy as np, blurmatte as bm",
        "layer = bm.Layer(np.ones((9, 9)), np.ones((9, 9, 3)))",
        "assert 'blurmatte.figures' not in sys.modules",
        "layer._repr_png_()",
        "assert 'blurmatte.figures' in sys.modules",
    )
    subprocess.run([sys.executable, "-c", "\n".join(lines)], check=True)
