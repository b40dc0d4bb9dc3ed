"""draw_clip: each of several objects has a color; one object has the default color."""

from dataclasses import replace

import numpy as np
import pytest

from blurmatte.figures import draw_clip
from blurmatte.figures.drawing import Palette
from blurmatte.motion import BallPlace, FrameMotion, Sighting
from blurmatte.radiometry import LinearImage

PLATE = LinearImage(np.full((90, 120, 3), 0.05))
BLUE, ORANGE = (0x1F, 0x77, 0xB4), (0xFF, 0x7F, 0x0E)  # the first two of the palette


def row(k, number, y, doubts=""):
    x = 20.0 + 15 * k
    s = Sighting(
        x, y, 0.1, 0.1, 0.0, 6.0, 0.0, 0.1, 0.1, 6.0, 0.1, 0.0, 0.01, 5.0, 0.05,
        x - 3, y, x + 3, y, "#ffffff", 1.0, "sweep", "line", "disc", 1.0, False, True, doubts,
    )  # fmt: skip
    return FrameMotion(k, k / 30, s, number, True, object=number)


def rows_with(sheet, color):
    """Rows of the picture that contain a color, without the charts below."""
    return np.flatnonzero((sheet[:850] == color).all(axis=-1).any(axis=1))


@pytest.mark.parametrize("count", [1, 2])
def test_objects_have_different_colors(count):
    """Exact: the second is lower; a single object has no color of several."""
    rows = [row(k, n + 1, 25.0 + 40 * n) for k in range(5) for n in range(count)]
    sheet = draw_clip(PLATE, rows)
    assert sheet.shape[1] == 1800
    alone, several = (Palette.other, Palette.streak), (BLUE, ORANGE)
    assert all(len(rows_with(sheet, c)) > 0 for c in (several if count == 2 else alone))
    assert all(len(rows_with(sheet, c)) == 0 for c in (alone if count == 2 else several))
    if count == 2:
        assert rows_with(sheet, BLUE).max() < rows_with(sheet, ORANGE).min()


def test_doubted_frames_are_dashed():
    """Exact: doubtful frames have neither bright lines nor ellipses."""
    sure, doubted = ([row(k, 1, 45.0, doubts) for k in range(5)] for doubts in ("", "Hidden."))
    bright = [
        np.sum((draw_clip(PLATE, way)[100:850] == Palette.bright).all(axis=-1))
        for way in (sure, doubted)
    ]
    ellipses = [len(rows_with(draw_clip(PLATE, way), Palette.streak)) for way in (sure, doubted)]
    assert bright[0] > 300 > bright[1] == 0
    assert ellipses[0] > ellipses[1] == 0
    one = draw_clip(PLATE, [*sure[:2], doubted[2], *sure[3:]])
    assert len(rows_with(one, Palette.other)) > 0


def test_clip_without_detections_is_drawn():
    """Exact: the plate alone."""
    assert draw_clip(PLATE, [FrameMotion(0, None, None, reason="nothing moved")]).shape[1] == 1800


def test_places_in_space_have_a_chart_of_depth():
    """Exact: three charts instead of two, also if positions or speeds are missing."""
    rows, V = [row(k, 1, 45.0) for k in range(5)], 1e-4 * np.eye(3)
    there = [BallPlace(k, k / 30, 1, np.array([0, 0, 2 + 0.1 * k]), V, V, 0.01) for k in range(4)]
    moving = [replace(ball, velocity=np.ones(3), velocity_covariance=V) for ball in there]
    sheets = [
        draw_clip(PLATE, rows, (), places) for places in (None, [*there, None], [*moving, None])
    ]
    assert {sheet.shape for sheet in sheets} == {sheets[0].shape}
    frames = [charts_in(sheet) for sheet in sheets]
    assert frames == [2, 3, 3]
    assert not np.array_equal(sheets[1], sheets[2])


def charts_in(sheet):
    """Number of charts below the picture, counted as pairs of dark lines."""
    white = (sheet == 255).all(axis=-1).sum(axis=1) > 900
    chart = sheet[np.flatnonzero(white)[len(np.flatnonzero(white)) // 5 :]]
    dark = (chart < 30).all(axis=-1).mean(axis=0) > 0.6
    return int(np.sum(np.diff(dark.astype(int)) == 1)) // 2
