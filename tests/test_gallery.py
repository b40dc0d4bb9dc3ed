"""The gallery's scripts reproduce the pictures shown."""

import runpy
import sys
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

GALLERY = Path(__file__).parents[1] / "docs" / "gallery"
PAGES = sorted(path for path in GALLERY.glob("*.py") if path.stem != "figure")


def named(path):
    """A page, in the battery unless it is the fastest."""
    marks = () if path.stem == "two_colors" else pytest.mark.battery
    return pytest.param(path, id=path.stem, marks=marks)


@pytest.mark.parametrize("page", [named(page) for page in PAGES])
def test_pages_reproduce_their_pictures(page, tmp_path, monkeypatch):
    monkeypatch.setattr(sys, "argv", [str(page), str(tmp_path)])
    monkeypatch.syspath_prepend(GALLERY)  # as `python docs/gallery/…` does
    runpy.run_path(str(page), run_name="__main__")
    (printed,) = tmp_path.iterdir()
    shown, now = (np.asarray(Image.open(path)) for path in (GALLERY / printed.name, printed))
    assert shown.shape == now.shape
    assert np.abs(shown.astype(int) - now).mean() < 1  # of 255; another machine rounds otherwise


def test_every_page_is_in_the_gallery():
    text = (GALLERY / "README.md").read_text()
    assert PAGES
    for page in PAGES:
        assert f"({page.name})" in text
        assert f"({page.stem}.jpg)" in text
