"""Uncertainty of alpha from rounding of luma and chroma to whole codes."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from blurmatte.color.model import ColorModel
from blurmatte.matting.evidence import information_of, pixels_of
from blurmatte.matting.smooth import rounding_pulls
from blurmatte.matting.smooth_field import BORDER, CellEvidence
from blurmatte.radiometry import SRGB, LinearImage, Meta, NoiseModel
from blurmatte.rendering.camera import subsample_chroma

SHAPE = (48, 64)
NOISE = NoiseModel(read_std=0.003)
ORANGE, BLUE = np.array([0.8, 0.4, 0.1]), np.array([0.1, 0.2, 0.7])
LINE = ColorModel((ORANGE / np.linalg.norm(ORANGE))[:, None])
PLANE = ColorModel(np.linalg.qr(np.stack([ORANGE, BLUE], axis=1))[0])
META = Meta(transfer=SRGB, levels=256)
Y, X = np.mgrid[: SHAPE[0], : SHAPE[1]]
ALPHA = 0.7 * np.exp(-(((X - 32) / 12) ** 2) - ((Y - 24) / 9) ** 2)


def rounded(light):
    """The picture after rounding of luma and chroma, without noise that would spread codes."""
    return LinearImage(
        SRGB.decode(subsample_chroma(SRGB.encode(light), "4:4:4", 255)), NOISE, meta=META
    )


def pictures(plate):
    through = (1 - ALPHA)[..., None]
    return rounded(through * plate + ALPHA[..., None] * ORANGE), rounded(plate)


def evidence_in_levels(model, image, plate, levels=1):
    """Pixels, and their evidence, alone and in larger cells."""
    pixels = pixels_of(image, plate, model, ALPHA > 0.01)
    maps = *information_of(pixels, ALPHA), pixels.inside, np.zeros(ALPHA.shape)
    own = CellEvidence(*(np.pad(m, BORDER) for m in maps))
    cells = [own]
    for _ in range(levels - 1):
        cells.append(cells[-1].coarser())
    return pixels, cells


@pytest.mark.parametrize("model", [LINE, PLANE], ids=["line", "plane"])
def test_stated_rounding_error_of_sums_is_calibrated(model):
    """Honest: plates of random colors, each of a single code value."""
    rng = np.random.default_rng(0)
    scores = []
    for _ in range(80):
        color = rng.uniform((0.1, 0.3, 0.1), (0.2, 0.5, 0.3))
        image, plate = pictures(np.broadcast_to(color, (*SHAPE, 3)))
        pixels, levels = evidence_in_levels(model, image, plate)
        information, pull = information_of(pixels, ALPHA)
        off = np.sum(pull - information * ALPHA * pixels.use)
        drawn = [p.sum() for p in rounding_pulls(pixels, ALPHA, levels)]
        scores.append(off / np.std(drawn))
    assert 0.8 < np.sqrt(np.mean(np.square(scores))) < 1.25


def test_no_rounding_error_where_nothing_moved():
    """Exact: image and plate are rounded alike."""
    plate = rounded(np.broadcast_to((0.15, 0.4, 0.2), (*SHAPE, 3)))
    pixels, levels = evidence_in_levels(LINE, plate, plate)
    for pull in rounding_pulls(pixels, np.zeros(SHAPE), levels):
        assert_allclose(pull, 0, atol=1e-9)


def test_rounding_errors_of_many_codes_are_independent():
    """Oracle: for as many codes as pixels, sums scatter by the root of their number."""
    plain = np.broadcast_to((0.15, 0.4, 0.2), (*SHAPE, 3))
    fine = plain * np.random.default_rng(1).uniform(0.5, 1.5, plain.shape)
    of_plain, of_fine = (
        np.std([p.sum() for p in rounding_pulls(*with_alpha(plate))]) for plate in (plain, fine)
    )
    assert of_fine < of_plain / 5


def with_alpha(plate):
    pixels, levels = evidence_in_levels(LINE, *pictures(plate))
    return pixels, ALPHA, levels


def test_cells_hold_the_sums_of_their_pixels():
    plate = np.broadcast_to((0.15, 0.4, 0.2), (*SHAPE, 3))
    pixels, levels = evidence_in_levels(LINE, *pictures(plate), levels=3)
    fine, coarse = (rounding_pulls(pixels, ALPHA, levels[:n]) for n in (1, 3))
    for own, of_cells in zip(fine, coarse, strict=True):
        assert of_cells.shape == levels[-1].mask.shape
        blocks = own[BORDER:-BORDER, BORDER:-BORDER].reshape(12, 4, 16, 4).sum(axis=(1, 3))
        assert_allclose(of_cells[BORDER:-BORDER, BORDER:-BORDER], blocks, rtol=1e-6, atol=1e-6)


def test_float_light_and_any_colors_have_no_rounding_error():
    image, plate = pictures(np.broadcast_to((0.15, 0.4, 0.2), (*SHAPE, 3)))
    floats = LinearImage(image.rgb, NOISE)
    pixels, levels = evidence_in_levels(LINE, floats, plate)
    assert rounding_pulls(pixels, ALPHA, levels) == []
    pixels, levels = evidence_in_levels(ColorModel.any(), image, plate)
    assert rounding_pulls(pixels, ALPHA, levels) == []
