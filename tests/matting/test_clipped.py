"""One clipped channel: pixels of a color of rank 1 are solved from the other two."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from blurmatte.background import Matching
from blurmatte.color.model import ColorModel
from blurmatte.matting import Pixelwise, Quality, Smooth, solve
from blurmatte.matting.object_light import light_given
from blurmatte.matting.special_pixels import one_clipped
from blurmatte.radiometry import LinearImage, NoiseModel
from blurmatte.streaks import Streak

COLOR = np.array([1.4, 0.6, 0.2])
MODEL = ColorModel((COLOR / np.linalg.norm(COLOR))[:, None])
PLANE = ColorModel(np.linalg.qr(np.array([[1.4, 0.1], [0.6, 0.2], [0.2, 0.7]]))[0])
SIZE = (64, 48)
SIGMA = 0.01


def pictures(seed=0, sigma=0.0, in_plate=False):
    """(alpha, P, image, plate): red is clipped in the lower half, of the image or of the plate."""
    rng = np.random.default_rng(seed)
    B = np.random.default_rng(9).uniform(0.1, 0.6, (SIZE[1], SIZE[0], 3))
    alpha = np.full(SIZE[::-1], 0.4)
    if in_plate:
        B[24:, :, 0] = 1.3
    else:
        alpha[24:] = 0.85
        B[24:, :, 0] = 0.5  # so that all of red is above 1
    P = alpha[..., None] * COLOR
    C = P + (1 - alpha[..., None]) * B
    noise = NoiseModel(read_std=sigma)
    seen = [light + rng.normal(0, sigma, light.shape) if sigma else light for light in (C, B)]
    image, plate = (
        LinearImage(np.minimum(light, 1), noise, (light < 1).all(axis=-1)) for light in seen
    )
    return alpha, P, image, plate


@pytest.mark.parametrize("in_plate", [False, True], ids=["image", "plate"])
def test_exact_pictures_give_the_exact_answer(in_plate):
    """exact: alpha, and the light in the clipped channel too."""
    alpha, P, image, plate = pictures(in_plate=in_plate)
    clipped = one_clipped(image, plate)
    assert clipped[24:].all()
    assert not clipped[:24].any()
    everywhere = Streak(np.ones(SIZE[::-1], bool))
    solution = solve(image, plate, MODEL, Pixelwise(), streak=everywhere, matching=Matching.NONE)
    known = solution.known & clipped
    assert known.mean() > 0.45
    assert_allclose(solution.alpha[known], alpha[known], rtol=0, atol=1e-10)
    assert_allclose(solution.premultiplied[known], P[known], rtol=0, atol=1e-10)
    assert np.all(solution.quality[clipped] & Quality.SATURATED)
    assert_allclose(solution.layer.premultiplied[known], P[known], atol=1e-10)


@pytest.mark.parametrize("in_plate", [False, True], ids=["image", "plate"])
def test_errors_are_honest(in_plate):
    """honest: of alpha and of the light, in the clipped channel and the others."""
    z_alpha, z_light = [], []
    for seed in range(4):
        alpha, P, image, plate = pictures(seed, SIGMA, in_plate)
        everywhere = Streak(np.ones(SIZE[::-1], bool))
        solution = solve(
            image, plate, MODEL, Pixelwise(), streak=everywhere, matching=Matching.NONE
        )
        known = one_clipped(image, plate) & (solution.alpha_std < 0.1)
        z_alpha.append((solution.alpha - alpha)[known] / solution.alpha_std[known])
        z_light.append((solution.premultiplied - P)[known] / solution.premultiplied_std[known])
    assert np.concatenate(z_alpha).size > 2000
    assert abs(np.mean(np.concatenate(z_alpha))) < 0.1
    assert_allclose(np.std(np.concatenate(z_alpha)), 1, atol=0.1)
    assert_allclose(np.std(np.concatenate(z_light)), 1, atol=0.1)


def test_error_of_two_channels_exceeds_that_of_three():
    """invariant: the error grows if a channel is omitted."""
    alpha, P, image, plate = pictures()
    image, plate = (p.with_noise(NoiseModel(read_std=SIGMA)) for p in (image, plate))
    everywhere = Streak(np.ones(SIZE[::-1], bool))
    whole = LinearImage(P + (1 - alpha[..., None]) * plate.rgb, image.noise)
    full = solve(
        whole, plate, MODEL, Pixelwise(), streak=everywhere, matching=Matching.NONE
    ).alpha_std[24:]
    less = solve(
        image, plate, MODEL, Pixelwise(), streak=everywhere, matching=Matching.NONE
    ).alpha_std[24:]
    assert np.all(less > 0.999 * full)


def test_pixels_of_rank_2_and_missing_pixels_stay_unknown():
    """exact: no equation is left."""
    _, _, image, plate = pictures()
    everywhere = Streak(np.ones(SIZE[::-1], bool))
    of_plane = solve(image, plate, PLANE, Pixelwise(), streak=everywhere, matching=Matching.NONE)
    assert not of_plane.known[24:].any()
    assert not of_plane.layer.alpha[24:].any()
    dark = LinearImage(np.minimum(image.rgb, 0.9), image.noise, image.valid)
    missing = solve(dark, plate, MODEL, Pixelwise(), streak=everywhere, matching=Matching.NONE)
    assert not missing.known[24:].any()
    assert missing.known[:24].any()


def test_two_clipped_channels_leave_alpha_unknown():
    """exact: one equation for both alpha and light has no unique solution."""
    _, _, image, plate = pictures()
    rgb = image.rgb.copy()
    rgb[24:, :, 1] = 1
    worse = LinearImage(rgb, image.noise, image.valid)
    assert not one_clipped(worse, plate)[24:].any()
    everywhere = Streak(np.ones(SIZE[::-1], bool))
    assert (
        not solve(worse, plate, MODEL, Pixelwise(), streak=everywhere, matching=Matching.NONE)
        .known[24:]
        .any()
    )


def test_smooth_uses_pixels_with_a_clipped_channel():
    """honest: smoothed alpha is nearer to the truth than interpolation from the neighbors."""
    _, _, image, plate = pictures(1, SIGMA)
    everywhere = Streak(np.ones(SIZE[::-1], bool))
    solution = solve(image, plate, MODEL, Smooth(), streak=everywhere, matching=Matching.NONE)
    lower = solution.alpha[30:]  # six pixels from where all channels are known: 0.4 there
    assert abs(np.median(lower) - 0.85) < 0.02
    assert_allclose(np.median(solution.premultiplied[30:], axis=(0, 1)), 0.85 * COLOR, rtol=0.05)


@pytest.mark.parametrize("model", [MODEL, PLANE, ColorModel.any()], ids=["1", "2", "3"])
def test_light_of_a_known_alpha_needs_as_many_channels_as_the_model_has_ranks(model):
    """exact: with alpha given, the remaining channels determine the light within the model."""
    rng = np.random.default_rng(3)
    B = rng.uniform(0.1, 0.5, (1, 4, 3))
    P = rng.uniform(0.2, 0.4, (1, 4, model.rank)) @ model.basis.T
    alpha = np.full((1, 4), 0.5)
    C = P + 0.5 * B
    for count in range(4):
        C[0, count, :count] = 2
    image = LinearImage(C, NoiseModel(read_std=1e-3), (C < 1).all(axis=-1))
    found, std, _ = light_given(
        alpha, 0 * alpha, model, image, LinearImage(B, NoiseModel(read_std=1e-3))
    )
    for count in range(4):
        if 3 - count >= model.rank:
            assert_allclose(found[0, count], P[0, count], atol=1e-10)
        else:
            assert np.all(np.isinf(std[0, count]))
            assert not found[0, count].any()
