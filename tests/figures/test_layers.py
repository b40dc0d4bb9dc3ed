"""Sheets of edits, and previews."""

import numpy as np
import pytest

from blurmatte.figures import draw_edit, draw_look
from blurmatte.figures.drawing import srgb_codes
from blurmatte.layer import Layer
from blurmatte.radiometry import LinearImage, Meta

EMPTY = Layer(np.zeros((128, 192)), np.zeros((128, 192, 3)))


def panels_of(sheet, pixels):
    """How many places of the sheet hold these pixels, by their first row."""
    row = pixels[len(pixels) // 2]
    step = row[:: max(1, len(row) // 8)]
    found = [np.flatnonzero((sheet == color).all(axis=-1).ravel()).size for color in step]
    return min(found)


def test_sheet_contains_the_pictures(paint):
    edited = paint.layer.recolor("#00ff00").fade(3)
    after = edited.over(paint.plate)
    sheet = draw_edit(paint.layer, edited, paint.image, after, "fade 3")
    assert sheet.shape[1] == 1800
    assert sheet.dtype == np.uint8
    for picture in (paint.image, after):
        assert panels_of(sheet, srgb_codes(picture.rgb))


@pytest.mark.parametrize("size", [(192, 128), (400, 90), (90, 128)])
def test_before_and_after_are_side_by_side(size):
    """Exact: in the same rows, half of the sheet wide or 720 pixels high."""
    alpha = np.zeros(size[::-1])
    alpha[30:50, 30:50] = 0.5
    layer = Layer(alpha, alpha[..., None] * [1.0, 0, 0])
    plain = [LinearImage(np.full((*size[::-1], 3), light, np.float32)) for light in (0.1, 0.6)]
    sheet = draw_edit(layer, layer.fade(2), *plain)
    places = []
    for picture in plain:
        column = (sheet == srgb_codes(picture.rgb)[0, 0]).all(axis=-1)
        y, x = np.nonzero(column[:850])
        places.append((y.min(), x.min()))
    assert places[0][0] == places[1][0]
    assert places[1][1] - places[0][1] == 846 + 28


def test_layers_without_pictures_and_empty_layers_are_drawn(paint):
    removed = draw_edit(paint.layer, paint.layer.fade(0))
    assert removed.shape[1] == 1800
    with_pictures = draw_edit(paint.layer, EMPTY, paint.image, paint.plate)
    assert with_pictures.shape[0] > removed.shape[0]


def test_preview_accepts_every_kind(paint):
    for thing in (paint.image, paint.layer, EMPTY):
        assert draw_look(thing).shape[1] == 1800
    camera = LinearImage(paint.image.rgb, meta=Meta("x.png"))
    assert panels_of(draw_look(camera), srgb_codes(paint.image.rgb))


def test_rejects_wrong_arguments(paint):
    with pytest.raises(ValueError, match="both layers are empty"):
        draw_edit(EMPTY, EMPTY)
    with pytest.raises(ValueError, match="same size"):
        draw_edit(paint.layer, EMPTY.crop((0, 0, 5, 5)))
    with pytest.raises(ValueError, match="same size"):
        draw_edit(paint.layer, EMPTY, paint.image.crop((0, 0, 5, 5)), paint.image)
    with pytest.raises(TypeError, match="got str"):
        draw_look("out.png")
