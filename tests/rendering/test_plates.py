"""Plates: one hue, two hues, many; the seed decides. And a fence."""

import builtins

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from blurmatte.errors import BlurmatteError
from blurmatte.radiometry import SRGB, LinearImage
from blurmatte.rendering import Camera, colorful_plate
from blurmatte.rendering.plates import (
    PHOTOS,
    photo_plate,
    plain_plate,
    striped_plate,
    textured_plate,
    two_hue_plate,
    wire_fence,
)

FIRST, SECOND = np.array([0.5, 0.2, 0.1]), np.array([0.1, 0.2, 0.4])
PLATES = {
    "plain": lambda rng: plain_plate((90, 60), FIRST, rng),
    "two hues": lambda rng: two_hue_plate((90, 60), FIRST, SECOND, rng),
    "colorful": lambda rng: colorful_plate((90, 60), rng),
    "textured": lambda rng: textured_plate((90, 60), rng),
}


@pytest.mark.parametrize("name", PLATES)
def test_plates_are_light_of_their_size_and_seed(name):
    plate = PLATES[name](3)
    assert plate.shape == (60, 90, 3)
    assert plate.dtype == np.float64
    assert plate.min() > 0.01
    assert plate.max() < 0.85
    assert plate.tobytes() == PLATES[name](np.random.default_rng(3)).tobytes()
    assert plate.tobytes() != PLATES[name](4).tobytes()


def test_plain_plate_has_one_hue_and_some_texture():
    plate = PLATES["plain"](3)
    assert_allclose(np.cross(plate, FIRST), 0, atol=1e-15)
    assert_allclose([plate[..., 0].min(), plate[..., 0].max()], [0.55 * 0.5, 0.5])
    assert np.diff(plate[..., 0], axis=1).std() > 1e-3


def test_two_hue_plate_lies_on_the_segment():
    plate = PLATES["two hues"](3)
    share = (plate - FIRST) @ (SECOND - FIRST) / np.sum((SECOND - FIRST) ** 2)
    assert_allclose(plate, FIRST + share[..., None] * (SECOND - FIRST), atol=1e-14)
    assert 0 <= share.min() < 0.1
    assert 0.9 < share.max() <= 1


def test_colorful_plate_spreads_over_all_directions():
    """A streak across it meets colors far from one line and one plane."""
    plate = colorful_plate((200, 150), 3)
    direction = plate / np.linalg.norm(plate, axis=-1, keepdims=True)
    spread = np.linalg.svd(
        (direction - direction.mean(axis=(0, 1))).reshape(-1, 3), compute_uv=False
    )
    assert np.all(spread[:2] / np.sqrt(plate[..., 0].size) > 0.1)


# Stripes

STRIPES = np.array([[0.5, 0.1, 0.1], [0.1, 0.4, 0.1], [0.1, 0.1, 0.6]])


def stripes_in_points(size, colors, width, angle, fine=40):
    """Each pixel the mean of fine x fine points of sharp stripes."""
    x, y = ((np.arange(side * fine) + 0.5) / fine - side / 2 for side in size)
    across = np.cos(angle) * x + np.sin(angle) * y[:, None]
    points = colors[np.floor(across / width).astype(int) % len(colors)]
    return points.reshape(size[1], fine, size[0], fine, 3).mean(axis=(1, 3))


@pytest.mark.diagonal
@pytest.mark.parametrize("degrees", [0, 1e-5, 20, 45, 65, 90, 137, 180, -30])
@pytest.mark.parametrize("width", [2, 5.3])
def test_stripes_are_averaged_over_each_pixel(degrees, width):
    size, angle = (19, 14), np.radians(degrees)
    exact = stripes_in_points(size, STRIPES, width, angle)
    assert_allclose(striped_plate(size, STRIPES, width, angle), exact, atol=0.015)


def test_upright_stripes_are_exact():
    plate = striped_plate((6, 2), STRIPES, 2.25)
    first = STRIPES[2] + (STRIPES[1] - STRIPES[2]) * 0.75
    assert_allclose(plate[1, 0], first, rtol=1e-12)
    assert_allclose(plate[:, 1:3], np.broadcast_to(STRIPES[2], (2, 2, 3)), rtol=1e-12)
    assert_allclose(plate[:, 3:5], np.broadcast_to(STRIPES[0], (2, 2, 3)), rtol=1e-12)
    assert_allclose(plate[0, 5], STRIPES[1] + (STRIPES[0] - STRIPES[1]) * 0.25, rtol=1e-12)


def test_stripe_colors_have_equal_shares():
    plate = striped_plate((300, 300), np.eye(3), 10, 0.4)
    assert_allclose(plate.sum(axis=-1), 1)
    assert_allclose(plate.mean(axis=(0, 1)), 1 / 3, atol=0.01)


# Texture


def test_texture_has_equal_power_in_each_octave():
    """In waves of 4 to 64 pixels; the lens takes what is finer."""
    size = 256
    power = np.abs(np.fft.fft2(textured_plate((size, size), 0), axes=(0, 1))) ** 2
    f = size * np.hypot(np.fft.fftfreq(size), np.fft.fftfreq(size)[:, None])
    octaves = [power[(f >= low) & (f < 2 * low)].sum(axis=0) for low in (4, 8, 16, 32)]
    assert_allclose(octaves / np.mean(octaves, axis=0), 1, atol=0.35)
    finest = power[(f >= 64) & (f < 128)].sum(axis=0)
    assert np.all(finest < 0.6 * np.mean(octaves, axis=0))


def test_texture_varies_in_color_as_much_as_in_brightness():
    plate = textured_plate((128, 96), 0)
    channels = np.corrcoef(plate.reshape(-1, 3).T)
    assert np.all(np.abs(channels[np.triu_indices(3, 1)]) < 0.5)


# Photographs


@pytest.mark.parametrize("name", PHOTOS)
def test_photographs_load(name):
    plate = photo_plate(name, (300, 200))
    assert plate.shape == (200, 300, 3)
    assert plate.dtype == np.float64
    assert plate.min() > 0
    assert 0.5 < plate.max() < 1.005
    assert plate.tobytes() == photo_plate(name, (300, 200)).tobytes()
    assert plate.std(axis=(0, 1)).min() > 0.02


def test_photograph_is_the_center_within_rounding():
    from skimage import data

    codes = data.chelsea()
    assert codes.shape == (300, 451, 3)
    plate = photo_plate("chelsea", (101, 100))
    assert_array_equal(np.rint(255 * SRGB.encode(plate)), codes[100:200, 175:276])


def test_photograph_is_not_on_8_bit_steps():
    plate = photo_plate("chelsea", (200, 200))
    rest = 255 * (SRGB.encode(plate) - SRGB.encode(Camera().photograph(plate, 0).rgb.astype(float)))
    assert_allclose(rest.std(), 12**-0.5, rtol=0.02)


def test_photographs_need_scikit_image(monkeypatch):
    real = builtins.__import__

    def without(name, *arguments, **named):
        if name.startswith("skimage"):
            raise ImportError(name)
        return real(name, *arguments, **named)

    monkeypatch.setattr(builtins, "__import__", without)
    with pytest.raises(BlurmatteError, match=r'pip install "blurmatte\[photos\]"'):
        photo_plate("coffee", (10, 10))


# Fence


def test_fence_alpha_is_0_or_1():
    fence = wire_fence((120, 90), 21, 4, FIRST)
    assert fence.size == (120, 90)
    assert set(np.unique(fence.alpha)) == {0, 1}
    assert_array_equal(fence.premultiplied[fence.alpha == 0], 0)
    assert fence.premultiplied[fence.alpha == 1].min() > 0
    assert_allclose(np.cross(fence.premultiplied, FIRST), 0, atol=1e-15)
    plate = LinearImage(colorful_plate((120, 90), 1))
    seen = fence.over(plate).rgb
    assert_array_equal(seen[fence.alpha == 0], plate.rgb[fence.alpha == 0])


@pytest.mark.parametrize(("spacing", "width"), [(21, 4), (12.5, 1), (40, 7.5)])
def test_fence_has_wires_of_its_width_and_spacing(spacing, width):
    alpha = wire_fence((500, 400), spacing, width, FIRST).alpha
    assert_allclose(alpha.mean(), 1 - (1 - width / spacing) ** 2, rtol=0.03)


def test_fence_wires_have_both_signs_of_the_angle():
    fence = wire_fence((301, 201), 60, 3, FIRST, angle=0.3).alpha
    assert fence[100, 150] == 1  # wires cross in the center
    t = np.arange(-60, 60)
    for lean in (0.3, -0.3):  # along a wire, from upright
        x, y = np.rint(150 + t * np.sin(lean)), np.rint(100 + t * np.cos(lean))
        assert np.all(fence[y.astype(int), x.astype(int)] == 1)


def test_wires_are_round():
    """Light falls from the left: brightest left of the middle, darkest on the right."""
    fence = wire_fence((201, 3), 400, 101, FIRST, angle=1e-9)
    light = fence.premultiplied[1, 50:151, 0]
    assert np.argmax(light) == 50 - 30
    assert_allclose([light.max(), light.min()], [FIRST[0], 0.3 * FIRST[0]], rtol=1e-3)


# The door


def test_rejects_wrong_arguments():
    with pytest.raises(ValueError, match=r"size must be \(width, height\)"):
        colorful_plate((0, 10), 1)
    with pytest.raises(ValueError, match="tile must be positive"):
        colorful_plate((10, 10), 1, tile=0)
    with pytest.raises(ValueError, match="second must be three linear values"):
        two_hue_plate((10, 10), FIRST, (0, 0, 0), 1)
    with pytest.raises(TypeError, match="rng"):
        plain_plate((10, 10), FIRST)


def test_rejects_wrong_stripes():
    with pytest.raises(ValueError, match="colors must be 2 or more, got 1"):
        striped_plate((10, 10), [FIRST], 5)
    with pytest.raises(ValueError, match="colors must be three linear values"):
        striped_plate((10, 10), [FIRST, (0, 0, 0)], 5)
    with pytest.raises(ValueError, match=r"width must be 2 pixels or more, got 1\.5"):
        striped_plate((10, 10), STRIPES, 1.5)
    with pytest.raises(ValueError, match="angle must be finite, got nan"):
        striped_plate((10, 10), STRIPES, 5, np.nan)


def test_rejects_wrong_photographs():
    with pytest.raises(ValueError, match=r"name must be one of astronaut, .*, got 'cat'"):
        photo_plate("cat", (10, 10))
    with pytest.raises(ValueError, match="'coffee' is 600x400 pixels, less than size 600x401"):
        photo_plate("coffee", (600, 401))


def test_rejects_wrong_fences():
    with pytest.raises(ValueError, match="width must be 1 pixel or more and less than spacing"):
        wire_fence((10, 10), 5, 6, FIRST)
    with pytest.raises(ValueError, match="width must be 1 pixel or more and less than spacing"):
        wire_fence((10, 10), 5, 0.5, FIRST)
    with pytest.raises(ValueError, match="angle must lie between 0 and pi/2, got 2"):
        wire_fence((10, 10), 9, 3, FIRST, angle=2)
