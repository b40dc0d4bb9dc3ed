"""Light before and after the chroma blur of a file."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.ndimage import gaussian_filter
from tests.scenes import on_line

from blurmatte.radiometry import REC709, SRGB, LinearImage, NoiseModel
from blurmatte.rendering import Ball, Camera, colorful_plate
from blurmatte.rendering.plates import plain_plate
from blurmatte.sweep.model.chroma_subsampling import (
    ChromaBlur,
    file_of,
    image_before,
    light_after,
    light_before,
    light_of_colors,
)

SIZE = (96, 72)
GREEN = np.array([0.25, 0.7, 0.12])
BLUR = 1.2
LUMA = np.array([0.299, 0.587, 0.114])
EVEN = np.full((*SIZE[::-1], 3), (0.4, 0.15, 0.4))
WALL = plain_plate(SIZE, (0.3, 0.33, 0.36), 1)
TILES = colorful_plate(SIZE, 3, tile=16)


def through_a_file(light, transfer):
    """Luma of the code values unchanged, chroma blurred."""
    codes = transfer.encode(light)
    luma = (codes @ LUMA)[..., None]
    return transfer.decode(luma + gaussian_filter(codes - luma, (BLUR, BLUR, 0)))


def before_file(seen, plate, alpha, own, file, transfer):
    plates = plate, light_after(plate, file.seen, transfer)
    return light_before(seen, plates, alpha, own, file, transfer)


@cache
def rendered_before(plate_name):
    plate = {"even": EVEN, "wall": WALL, "tiles": TILES}[plate_name]
    return on_line(plate, (32, 30), (62, 42), Ball(9, GREEN))


def across(truth):
    """(3, 2) directions across the object's color."""
    return np.linalg.svd(truth.scene.body.model.basis)[0][:, 1:]


@pytest.mark.parametrize("transfer", [SRGB, REC709], ids=lambda t: t.name)
def test_the_blur_of_chroma_is_inverted(transfer):
    """exact: before a uniform plate, whose color the blur does not change."""
    truth = rendered_before("even")
    light, alpha, own = truth.image.rgb, truth.layer.alpha, truth.layer.premultiplied
    seen = through_a_file(light, transfer)
    assert np.abs(seen - light).max() > 0.02
    back = before_file(seen, truth.plate.rgb, alpha, own, ChromaBlur(BLUR), transfer)
    assert_allclose(back, light, atol=1e-5)


def test_most_of_the_blur_is_inverted_before_tiles():
    """oracle: light across the object's color; the plate is known only as its file has it."""
    truth = rendered_before("tiles")
    alpha, own = truth.layer.alpha, truth.layer.premultiplied
    seen, plate = (through_a_file(x.rgb, SRGB) for x in (truth.image, truth.plate))
    back = before_file(seen, plate, alpha, own, ChromaBlur(BLUR), SRGB)
    before, after = (
        ((x - (1 - alpha)[..., None] * plate)[alpha > 0]) @ across(truth) for x in (seen, back)
    )
    assert np.sqrt(np.mean(after**2)) < 0.4 * np.sqrt(np.mean(before**2))


def test_light_is_unchanged_where_nothing_moved():
    """exact"""
    truth, nothing = rendered_before("wall"), np.zeros(SIZE[::-1])
    before = before_file(WALL, WALL, nothing, np.zeros_like(WALL), ChromaBlur(BLUR), SRGB)
    assert_allclose(before, WALL, atol=1e-7)
    alpha, own = truth.layer.alpha, truth.layer.premultiplied
    back = before_file(truth.image.rgb, WALL, alpha, own, ChromaBlur(BLUR), SRGB)
    assert_allclose(back[:12, :12], truth.image.rgb[:12, :12], atol=1e-7)


def test_luma_is_unchanged():
    """invariant: as in files; and a blur of 0 pixels changes nothing."""
    truth = rendered_before("wall")
    alpha, own = truth.layer.alpha, truth.layer.premultiplied
    seen = through_a_file(truth.image.rgb, SRGB)
    back = before_file(seen, truth.plate.rgb, alpha, own, ChromaBlur(BLUR), SRGB)
    assert_allclose(SRGB.encode(back) @ LUMA, SRGB.encode(seen) @ LUMA, atol=1e-5)
    same = before_file(seen, truth.plate.rgb, alpha, own, ChromaBlur(0), SRGB)
    assert_allclose(same, seen, atol=1e-9)


@pytest.mark.parametrize("chroma", ["4:4:4", "4:2:0"])
def test_compression_is_inverted_on_average(chroma):
    """honest: the mean of 40 JPEGs with known compression."""
    truth = rendered_before("even")
    camera, rng = Camera(code_std=2 / 255, jpeg_quality=90, chroma=chroma), np.random.default_rng(1)
    seen, B = (
        np.mean([camera.photograph(x.rgb, rng).rgb for _ in range(40)], axis=0, dtype=float)
        for x in (truth.image, truth.plate)
    )
    file = replace(camera.photograph(seen, rng).meta.compression, noise=2 / 255)
    alpha = truth.layer.alpha
    back = before_file(seen, B, alpha, truth.layer.premultiplied, file, SRGB)
    before, after = (
        np.sqrt(np.mean(((x - (1 - alpha)[..., None] * B)[alpha > 0] @ across(truth)) ** 2))
        for x in (seen, back)
    )
    assert after < 0.4 * before


def test_light_of_colors_has_the_luma_of_each_pixel_and_the_direction_of_the_model():
    """exact: of one color before a plate without noise."""
    truth = rendered_before("wall")
    alpha, own = truth.layer.alpha, truth.layer.premultiplied
    basis = truth.scene.body.model.basis
    light = light_of_colors(truth.image, truth.plate, alpha, basis, BLUR)
    seen = alpha > 0.02
    assert_allclose(light[seen] @ LUMA, own[seen] @ LUMA, atol=1e-5)
    assert_allclose(light @ across(truth), 0, atol=1e-9)
    assert not light[alpha == 0].any()


def test_light_of_colors_ignores_blurred_chroma():
    """invariant: chroma noise of files does not change the direction."""
    truth = rendered_before("even")
    basis = truth.scene.body.model.basis
    seen = LinearImage(through_a_file(truth.image.rgb, SRGB), NoiseModel())
    light = light_of_colors(seen, truth.plate, truth.layer.alpha, basis, BLUR)
    assert_allclose(light @ across(truth), 0, atol=1e-9)


def test_clipped_pixels_are_unchanged():
    truth, valid = rendered_before("wall"), np.ones(SIZE[::-1], bool)
    valid[30:34, 40:48] = False
    seen = LinearImage(through_a_file(truth.image.rgb, SRGB), NoiseModel(), valid)
    basis = truth.scene.body.model.basis
    before = image_before(seen, truth.plate, truth.layer.alpha, basis, ChromaBlur(BLUR))
    assert_array_equal(before.rgb[~valid], seen.rgb[~valid])
    assert np.abs(before.rgb - seen.rgb)[valid].max() > 0.01


def test_compression_is_that_of_the_metadata():
    noise = NoiseModel(read_std=0.01)
    jpeg = Camera(code_std=2 / 255, jpeg_quality=90, chroma="4:2:0").photograph(WALL, 1)
    png = Camera(code_std=2 / 255).photograph(WALL, 1)
    assert file_of(png.with_noise(noise)) is None
    file = file_of(jpeg.with_noise(noise))
    assert replace(file, noise=0) == jpeg.meta.compression
    assert_allclose(file.noise, np.median(0.01 / SRGB.slope(jpeg.rgb)), rtol=1e-6)
    assert file.spread > 0
