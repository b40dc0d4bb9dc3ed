"""What notebooks show of pictures, layers and solutions."""

import subprocess
import sys
from io import BytesIO

import numpy as np
import pytest
from PIL import Image

import blurmatte as bm
from blurmatte.figures import draw_look


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
