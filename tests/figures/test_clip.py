"""draw_clip: each of several objects has a color; one object has the default color."""

import sys
from dataclasses import replace

import numpy as np
import pytest
from tests.motion.clip.sightings import sighted

from blurmatte.figures import ClipPhysics, draw_clip, style
from blurmatte.figures.clip import Matte, charts_of
from blurmatte.figures.sheet import Canvas
from blurmatte.layer import Layer
from blurmatte.motion import BallPlace, FrameMotion
from blurmatte.motion.picture.motion import Scale
from blurmatte.radiometry import LinearImage

PLATE = LinearImage(np.full((90, 120, 3), 0.05))
BLUE, ORANGE = (0x1F, 0x77, 0xB4), (0xFF, 0x7F, 0x0E)  # the first two of the palette


def row(k, number, y, doubts=""):
    s = sighted((20.0 + 15 * k, y), (6.0, 0.0), radius_std=0.05, doubts=(doubts,) if doubts else ())
    return FrameMotion(k, k / 30, s, number, True, object=number)


@pytest.fixture(scope="module")
def sheet():
    """The sheet of one object without doubts."""
    return draw_clip(PLATE, [row(k, 1, 45.0) for k in range(5)])


def rows_with(sheet, color):
    """Rows of the picture that contain a color, without the charts below."""
    return np.flatnonzero((sheet[:1300] == color).all(axis=-1).any(axis=1))


@pytest.mark.parametrize("count", [1, 2])
def test_objects_have_different_colors(count):
    """Exact: the second is lower; a single object has no color of several."""
    rows = [row(k, n + 1, 25.0 + 40 * n) for k in range(5) for n in range(count)]
    sheet = draw_clip(PLATE, rows)
    assert sheet.shape[1] == 1800
    alone, several = (style.OTHER, style.STREAK), (BLUE, ORANGE)
    assert all(len(rows_with(sheet, c)) > 0 for c in (several if count == 2 else alone))
    assert all(len(rows_with(sheet, c)) == 0 for c in (alone if count == 2 else several))
    if count == 2:
        assert rows_with(sheet, BLUE).max() < rows_with(sheet, ORANGE).min()


def test_sheet_has_one_ground_a_name_and_a_legend(sheet):
    """Exact: charts are not white, the name is in the title alone, below the picture is a legend."""
    named = draw_clip(PLATE, [row(k, 1, 45.0) for k in range(5)], name="rally.mp4")
    assert not (sheet == 255).all(axis=-1).any()
    assert (sheet == style.GROUND).all(axis=-1)[1405:].mean() > 0.8
    assert np.flatnonzero((sheet != named).any(axis=(1, 2))).max() < 80
    swatches = [(sheet[1405:1460] == c).all(axis=-1).sum() for c in (style.OTHER, style.STREAK)]
    assert swatches == [14**2, 14**2]


def test_doubted_frames_are_dashed(sheet):
    """Exact: doubtful frames have neither bright lines nor crosses."""
    sure, doubted = ([row(k, 1, 45.0, doubts) for k in range(5)] for doubts in ("", "Hidden."))
    sheets = [sheet, draw_clip(PLATE, doubted)]
    bright = [np.sum((one[100:1300] == style.BRIGHT).all(axis=-1)) for one in sheets]
    crosses = [len(rows_with(one, style.STREAK)) for one in sheets]
    assert bright[0] > 300 > bright[1] == 0
    assert crosses[0] > crosses[1] == 0
    one = draw_clip(PLATE, [*sure[:2], doubted[2], *sure[3:]])
    assert len(rows_with(one, style.OTHER)) > 0


def test_clip_without_detections_is_drawn():
    """Exact: the plate alone."""
    assert draw_clip(PLATE, [FrameMotion(0, None, None, reason="nothing moved")]).shape[1] == 1800


def labels(rows, physics):
    """Labels of the charts."""
    return [chart.label for chart in charts_of(rows, physics).charts]


def test_places_in_space_have_a_chart_of_depth():
    """Exact: the charts are drawn too if positions or speeds are missing."""
    rows, V = [row(k, 1, 45.0) for k in range(5)], 1e-4 * np.eye(3)
    there = [BallPlace(k, k / 30, 1, np.array([0, 0, 2 + 0.1 * k]), V, V, 0.01) for k in range(4)]
    moving = [replace(ball, velocity=np.ones(3), velocity_covariance=V) for ball in there]
    known = [ClipPhysics(places=[*places, None]) for places in (there, moving)]
    space = ["x, m", "height, m", "depth, m", "speed in space, m/s", "radius, px"]
    assert [labels(rows, physics) for physics in known] == [space, space]
    sheets = [draw_clip(PLATE, rows, (), physics) for physics in known]
    assert not np.array_equal(*sheets)


def test_scale_gives_charts_in_meters():
    """Exact: lengths from the first place, heights upwards; pixels if an object has no scale."""
    rows = [row(k, 1, 45.0 + k) for k in range(5)]
    charts = charts_of(rows, ClipPhysics({1: Scale(0.02)})).charts
    assert [chart.label for chart in charts[:2]] == ["x, m", "height, m"]
    assert [chart.values[4] for chart in charts[:2]] == [
        (pytest.approx(4 * 15 * 0.02), pytest.approx(0.002)),
        (pytest.approx(-4 * 0.02), pytest.approx(0.002)),
    ]
    pixels = ["x, px", "y, px", "speed, px per exposure", "radius, px"]
    assert labels(rows, ClipPhysics({2: Scale(0.02)})) == pixels


def test_scale_bar_has_its_length():
    """Exact: at 0.02 m per pixel a bar of 0.5 m is 25 px of the plate long."""
    rows = [row(k, 1, 20.0) for k in range(5)]
    plain, scaled = (draw_clip(PLATE, rows, (), ClipPhysics(s)) for s in ({}, {1: Scale(0.02)}))
    bar = (scaled == style.BRIGHT).all(axis=-1) & ~(plain == style.BRIGHT).all(axis=-1)
    per_pixel = (1800 - 2 * 40) / PLATE.size[0]
    assert bar[900:1400].sum(axis=1).max() == pytest.approx(25 * per_pixel, abs=2)


def test_sheet_without_matplotlib_has_no_charts(monkeypatch):
    """Door: the picture, and a sentence in place of the charts."""
    rows = [row(k, 1, 45.0) for k in range(5)]
    with_charts = draw_clip(PLATE, rows)
    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)
    without = draw_clip(PLATE, rows)
    assert without.shape[0] < with_charts.shape[0] - 500


def test_frames_are_shown_with_their_alpha(monkeypatch):
    """Exact: each frame has its number, and its alpha in the same surroundings; empty layers none."""
    titles = []
    grid = Canvas.grid

    def drawn(sheet, panels, layout, name):
        titles.extend(panel.title for panel in panels)
        assert len({panel.pixels.shape for panel in panels}) == 1
        for picture, alpha in zip(panels[:2], panels[2:], strict=True):
            bright = picture.pixels.max(axis=-1) > 200
            assert np.array_equal(bright, alpha.pixels.max(axis=-1) > 200)
        grid(sheet, panels, layout, name)

    monkeypatch.setattr(Canvas, "grid", drawn)
    width, height = PLATE.size
    mattes = []
    for k, x in enumerate((2, width - 9, None)):
        alpha = np.zeros((height, width), np.float32)
        if x is not None:
            alpha[10:16, x : x + 7] = 1
        layer = Layer(alpha, alpha[..., None] * np.ones(3, np.float32))
        dark = LinearImage(np.zeros((height, width, 3), np.float32))
        mattes.append(Matte(5 + k, layer.over(dark), layer))
    without, sheet = draw_clip(PLATE, []), draw_clip(PLATE, [], mattes=mattes)
    assert titles == ["frame 5", "frame 6", "alpha 5", "alpha 6"]
    assert sheet.shape[0] > without.shape[0]
