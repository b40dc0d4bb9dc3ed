"""Chroma: light before and after a file blurred the color of it."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.ndimage import gaussian_filter

from blurmatte.radiometry import REC709, SRGB
from blurmatte.rendering import Ball, Camera, Scene, colorful_plate, plain_plate, render
from blurmatte.sweep.model.chroma_subsampling import ChromaBlur, Blur, Compressed, left_untold
from blurmatte.sweep.model.path import ARC, LINE, PARABOLA
from blurmatte.trajectory import Trajectory

SIZE = (96, 72)
GREEN = np.array([0.25, 0.7, 0.12])
BLUR = 1.2
LUMA = np.array([0.299, 0.587, 0.114])


def through_a_file(light, transfer):
    """Brightness as it was, color blurred."""
    codes = transfer.encode(light)
    luma = (codes @ LUMA)[..., None]
    return transfer.decode(luma + gaussian_filter(codes - luma, (BLUR, BLUR, 0)))


def rendered(plate):
    way = Trajectory.line((32, 30), (62, 42))
    truth = render(Scene(plate, way, Ball(9, GREEN)))
    color = truth.scene.body.model.basis[:, 0]
    return truth, color * np.sign(color.sum())


@pytest.mark.parametrize("transfer", [SRGB, REC709], ids=lambda t: t.name)
def test_what_a_file_did_is_taken_back(transfer):
    """Exact: before a wall of one light, whose own color no blur changes."""
    truth, color = rendered(np.full((*SIZE[::-1], 3), (0.4, 0.15, 0.4)))
    light, wall = truth.image.rgb, truth.plate.rgb
    seen = through_a_file(light, transfer)
    assert np.abs(seen - light).max() > 0.02
    back = ChromaBlur(seen, wall, Blur(BLUR), transfer).before(truth.layer.alpha, color[:, None])
    assert_allclose(back, light, atol=1e-5)


def test_most_of_it_is_taken_back_before_tiles():
    """Of the plate's own colors only what they had after the file is known."""
    truth, color = rendered(colorful_plate(SIZE, 3, tile=16))
    light, tiles = truth.image.rgb, truth.plate.rgb
    seen, plate = (through_a_file(x, SRGB) for x in (light, tiles))
    back = ChromaBlur(seen, plate, Blur(BLUR), SRGB).before(truth.layer.alpha, color[:, None])
    there = truth.layer.alpha > 0
    # What is left of the light across its color is what alpha is found from.
    across = np.linalg.svd(color[:, None])[0][:, 1:]
    off = (1 - truth.layer.alpha)[..., None]
    before, after = ((x - off * plate)[there] @ across for x in (seen, back))
    assert np.sqrt(np.mean(after**2)) < 0.4 * np.sqrt(np.mean(before**2))


@pytest.mark.parametrize("hues", ["one", "many"])
def test_most_of_it_is_taken_back_from_two_paints(hues):
    """Across their plane: within it more may be left, from where one paint meets the other."""
    size = (128, 88)
    light = plain_plate(size, (0.4, 0.3, 0.2), 1)
    plate = light if hues == "one" else colorful_plate(size, 3, tile=16)
    ball = Ball(16, GREEN, second_color=np.array([0.2, 0.3, 0.8]))
    truth = render(Scene(plate, Trajectory.line((36, 40), (92, 48)), ball))
    alpha = truth.layer.alpha
    directions = np.linalg.svd(np.stack([ball.color, ball.second_color], axis=1))[0]
    seen, wall = (through_a_file(x, SRGB) for x in (truth.image.rgb, truth.plate.rgb))
    back = ChromaBlur(seen, wall, Blur(BLUR), SRGB).before(alpha, directions[:, :2])
    left = [x - (1 - alpha)[..., None] * wall for x in (seen, back)]
    before, after = (np.sqrt(np.mean((P @ directions[:, 2])[alpha > 0] ** 2)) for P in left)
    assert after < 0.3 * before


def test_where_nothing_was_light_stays():
    wall = plain_plate(SIZE, (0.3, 0.33, 0.36), 1)
    nothing = np.zeros(SIZE[::-1])
    any_paint = GREEN[:, None] / np.linalg.norm(GREEN)
    assert_allclose(
        ChromaBlur(wall, wall, Blur(BLUR), SRGB).before(nothing, any_paint), wall, atol=1e-7
    )
    truth, color = rendered(wall)
    back = ChromaBlur(truth.image.rgb, wall, Blur(BLUR), SRGB).before(
        truth.layer.alpha, color[:, None]
    )
    far = np.s_[:12, :12]
    assert_allclose(back[far], truth.image.rgb[far], atol=1e-7)


def test_brightness_of_code_values_stays():
    """Invariant: luma is what files keep."""
    truth, color = rendered(plain_plate(SIZE, (0.3, 0.33, 0.36), 1))
    seen = through_a_file(truth.image.rgb, SRGB)
    back = ChromaBlur(seen, truth.plate.rgb, Blur(BLUR), SRGB).before(
        truth.layer.alpha, color[:, None]
    )
    assert_allclose(SRGB.encode(back) @ LUMA, SRGB.encode(seen) @ LUMA, atol=1e-5)
    again = ChromaBlur(seen, truth.plate.rgb, Blur(0), SRGB).before(
        truth.layer.alpha, color[:, None]
    )
    assert_array_equal(again.shape, seen.shape)
    assert_allclose(again, seen, atol=1e-9)


@pytest.mark.parametrize("family", [LINE, ARC, PARABOLA], ids=lambda f: f.name)
def test_what_is_left_untold_moves_whole_rims(family):
    """Oracle: the middle by as much in all directions, the ends along the way as well."""
    path = family.starts(np.linspace((10, 20), (50, 50), 33))[0]
    covariance = left_untold(family, path, BLUR)
    rim = covariance[-1, -1]
    assert_allclose(rim, (0.06 * BLUR) ** 2)
    assert_allclose(covariance[-1, :-1], 0)
    assert_allclose(covariance, 4 * left_untold(family, path, BLUR / 2))
    _, D = family.at(path, np.array([0, 0.5, 1]))
    first, middle, last = D @ covariance[:-1, :-1] @ D.swapaxes(1, 2)
    along = np.array([0.8, 0.6])
    assert_allclose(middle, rim * np.eye(2), rtol=1e-3, atol=1e-3 * rim)
    for end in (first, last):
        assert_allclose(end, rim * (np.eye(2) + np.outer(along, along)), rtol=1e-3)


@pytest.mark.parametrize("chroma", ["4:4:4", "4:2:0"])
def test_what_compression_did_is_taken_back(chroma):
    """Honest: the mean of many pictures of a file that says how it was compressed, before a wall."""
    truth, color = rendered(np.full((*SIZE[::-1], 3), (0.4, 0.15, 0.4)))
    camera, rng = Camera(code_std=2 / 255, jpeg_quality=90, chroma=chroma), np.random.default_rng(1)
    seen, B = (
        np.mean([camera.photograph(light, rng).rgb for _ in range(40)], axis=0, dtype=float)
        for light in (truth.image.rgb, truth.plate.rgb)
    )
    file = Compressed(camera.photograph(seen, rng).meta.compression, 2 / 255)
    alpha = truth.layer.alpha
    back = ChromaBlur(seen, B, file, SRGB).before(alpha, color[:, None])
    across = np.linalg.svd(color[:, None])[0][:, 1:]
    before, after = (
        np.sqrt(np.mean(((x - (1 - alpha)[..., None] * B)[alpha > 0] @ across) ** 2))
        for x in (seen, back)
    )
    assert after < 0.4 * before


def test_drawn_pictures_are_such_as_the_file_would_have_held():
    """Honest: across the color, in blocks, as much is left of them as of pictures that were taken."""
    truth, color = rendered(plain_plate(SIZE, (0.4, 0.15, 0.4), 2))
    camera, alpha = Camera(code_std=2 / 255, jpeg_quality=90, chroma="4:2:0"), truth.layer.alpha
    across, within = np.linalg.svd(color[:, None])[0][:, 1:], color[:, None]
    B, rng = truth.plate.rgb, np.random.default_rng(3)

    def left(light):
        e = (light - (1 - alpha)[..., None] * B)[8:-8, 8:-8] @ across
        blocks = e.reshape(e.shape[0] // 8, 8, -1, 8, 2).mean(axis=(1, 3))
        inside = (alpha[8:-8, 8:-8] > 0).reshape(len(blocks), 8, -1, 8).any(axis=(1, 3))
        return np.mean(blocks[inside] ** 2)

    taken, drawn = [], []
    for seed in range(12):
        image = camera.photograph(truth.image.rgb, rng)
        bled = ChromaBlur(image.rgb, B, Compressed(image.meta.compression, 2 / 255), SRGB)
        std = 2 / 255 * SRGB.slope(image.rgb)
        taken.append(left(bled.before(alpha, within)))
        drawn += [left(light) for light in bled.drawn(alpha, within, std, 1 + seed % 2)]
    assert_allclose(np.mean(drawn), np.mean(taken), rtol=0.25)
    assert_array_equal(*(bled.drawn(alpha, within, std, 1) for _ in range(2)))
