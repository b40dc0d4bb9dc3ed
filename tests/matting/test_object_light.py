"""Inpainting: pixels of unknown light have that of their neighbors, so that layers have no holes."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from tests.scenes import photographed, rendered

from blurmatte.matting import PixelMaps, Quality, solve
from blurmatte.matting.object_light import inpaint_light
from blurmatte.radiometry import LinearImage
from blurmatte.rendering import Ball, Camera, Scene
from blurmatte.rendering.plates import plain_plate
from blurmatte.trajectory import Trajectory

SHAPE = (30, 40)
COLOR = np.array([0.5, 0.3, 0.1])
B = np.array([0.2, 0.4, 0.6])


def maps_of(alpha, P, lit, quality=None):
    std = np.where(lit[..., None], 0.01, np.inf) * np.ones(3)
    quality = np.zeros(SHAPE, np.uint8) if quality is None else quality
    return PixelMaps(
        alpha.copy(), np.full(SHAPE, 0.02), np.where(lit[..., None], P, 0), std, quality
    )


def pictures(alpha, P, valid=None, top=np.inf):
    light = P + (1 - alpha[..., None]) * B
    image = LinearImage(np.minimum(light, top), valid=valid)
    return image, LinearImage(np.broadcast_to(B, light.shape).copy())


@pytest.mark.parametrize("size", [1, 5, 20], ids=["pixel", "patch", "most"])
def test_unknown_pixels_of_one_paint_have_its_color(size):
    """exact: also where known neighbors are far."""
    alpha = np.linspace(0.2, 0.9, SHAPE[1]) * np.ones(SHAPE)
    P = alpha[..., None] * COLOR
    lit = np.ones(SHAPE, bool)
    lit[5 : 5 + size, 8 : 8 + size] = False
    maps = maps_of(alpha, P, lit)
    inpaint_light(maps, *pictures(alpha, P, lit))
    assert_allclose(maps.premultiplied, P, atol=1e-10)
    assert_allclose(maps.premultiplied_std[~lit], 0.02 * np.broadcast_to(COLOR, (*SHAPE, 3))[~lit])
    assert np.all(maps.premultiplied_std[lit] == 0.01)


def test_std_is_the_scatter_of_the_neighbors():
    """oracle: between stripes of two colors, each is equally likely."""
    alpha = np.ones(SHAPE)
    P = np.where(np.arange(SHAPE[1])[:, None] % 2 == 0, COLOR, 0.2 * COLOR) * np.ones((*SHAPE, 1))
    lit = np.ones(SHAPE, bool)
    lit[15, 20] = False
    maps = maps_of(alpha, P, lit)
    inpaint_light(maps, *pictures(alpha, P, lit))
    assert_allclose(maps.premultiplied[15, 20], 0.6 * COLOR, rtol=0.15)
    assert_allclose(maps.premultiplied_std[15, 20], 0.4 * COLOR, rtol=0.1)


def test_clipped_channels_have_at_least_the_clipped_light():
    alpha, lit = np.ones(SHAPE), np.ones(SHAPE, bool)
    lit[12:18, 15:25] = False
    P = np.where(lit[..., None], 0.8 * COLOR, 3.0)
    image, plate = pictures(alpha, P, lit, top=1.0)
    assert image.clipped[~lit].all()
    maps = maps_of(alpha, P, lit)
    inpaint_light(maps, image, plate)
    assert_allclose(maps.premultiplied[~lit], 1)
    assert np.all(maps.premultiplied_std[~lit] > 0.9 * (1 - 0.8 * COLOR))


@pytest.mark.parametrize("flag", [Quality.OCCLUDED, Quality.OUTSIDE, Quality.PLATE_IN_MODEL])
def test_occluded_and_undetermined_pixels_stay_empty(flag):
    alpha, lit = np.full(SHAPE, 0.5), np.ones(SHAPE, bool)
    lit[12:18, 15:25] = False
    maps = maps_of(alpha, alpha[..., None] * COLOR, lit, ~lit * np.uint8(flag))
    inpaint_light(maps, *pictures(alpha, alpha[..., None] * COLOR, lit))
    assert np.all(maps.premultiplied[~lit] == 0)
    assert np.all(np.isinf(maps.premultiplied_std[~lit]))


def test_clipped_highlight_is_filled_in_the_layer():
    body = Ball(16, (0.8, 0.35, 0.06), highlight=2.0)
    scene = Scene(
        plain_plate((128, 96), (0.3, 0.33, 0.36), 5), Trajectory.line((59, 48), (69, 48)), body
    )
    truth = rendered(scene)
    image, plate = photographed(scene, Camera(code_std=1 / 255), 3, plate_frames=1)
    solution = solve(image, plate)
    blown = image.clipped.all(axis=-1) & (truth.layer.alpha > 0.9)
    assert np.count_nonzero(blown) > 3
    assert np.all(solution.layer.alpha[blown] > 0.9)
    again = solution.layer.over(plate).rgb
    assert np.all(again[blown] > 0.98)
    assert np.all((solution.quality[blown] & np.uint8(Quality.SATURATED)) != 0)


def test_without_known_pixels_nothing_is_filled():
    alpha, dark = np.full(SHAPE, 0.5), np.zeros(SHAPE, bool)
    maps = maps_of(alpha, alpha[..., None] * COLOR, dark)
    inpaint_light(maps, *pictures(alpha, alpha[..., None] * COLOR, dark))
    assert np.all(np.isinf(maps.premultiplied_std))
