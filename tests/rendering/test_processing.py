"""Processing in a camera, code values and H.264."""

import sys

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from blurmatte.errors import BlurmatteError
from blurmatte.radiometry import SRGB, NoiseModel
from blurmatte.rendering import Camera, colorful_plate
from blurmatte.rendering.processing import Processing, through_h264

LIGHT = np.array([0.05, 0.2, 0.6])
NOISE = NoiseModel(gain=2e-4, read_std=0.002)
LUMA = np.array([0.299, 0.587, 0.114])
NO_NOISE = np.zeros((1, 1, 3))
pytest.importorskip("av")


@pytest.fixture(scope="module")
def flat():
    return np.tile(LIGHT, (150, 200, 1))


def codes(light, processing, **settings):
    camera = Camera(NOISE, bits=None, processing=processing, **settings)
    return SRGB.encode(camera.photograph(light, 1).rgb)


# Noise reduction


def remaining_noise(strength, window):
    """Noise after a guided filter over noise before, where the gain of all windows is the same."""
    gain = 1 / (1 + strength**2)
    once = np.ones(window) / window
    twice = np.convolve(once, once)
    kernel = (1 - gain) * np.outer(twice, twice)
    kernel[window - 1, window - 1] += gain
    return np.sqrt(np.sum(kernel**2))


@pytest.mark.parametrize("strength", [0.5, 1, 2, 4])
def test_noise_of_uniform_regions_falls_as_documented(flat, strength):
    before, after = codes(flat, Processing()), codes(flat, Processing(strength))
    assert_allclose(
        (after @ LUMA).std() / (before @ LUMA).std(), remaining_noise(strength, 5), rtol=0.05
    )
    chroma = [np.std(v[..., 2] - v @ LUMA) for v in (before, after)]
    assert_allclose(chroma[1] / chroma[0], remaining_noise(2 * strength, 9), rtol=0.05)


def test_noise_is_divided_by_at_most_seven():
    for strength in (0.5, 1, 2):
        assert remaining_noise(strength, 5) == pytest.approx(1 / (1 + strength**2), abs=0.06)
    assert remaining_noise(100, 5) == pytest.approx(1 / 7, rel=0.06)


def test_mean_of_uniform_regions_is_preserved(flat):
    means = [codes(flat, p).mean(axis=(0, 1)) for p in (Processing(), Processing(2))]
    assert_allclose(means[1], means[0], atol=1e-4)


def test_strong_edges_are_preserved(flat):
    light = flat.copy()
    light[:, 100:] *= 0.2
    exact = SRGB.encode(light)[:, 95:105]
    edge = codes(light, Processing(1)).mean(axis=0)[95:105]
    assert_allclose(edge, exact.mean(axis=0), atol=0.02 * np.ptp(exact))


def test_a_variation_as_strong_as_the_threshold_is_halved():
    """Stripes of one pixel whose mean over a window is nearly 0."""
    stripes = 0.5 + 0.03 * np.where(np.indices((40, 60))[1] % 2, 1, -1)
    values = np.repeat(stripes[..., None], 3, axis=2)
    # Independent noise of luma has the variance of one channel times the sum of squared weights.
    variance = np.full(values.shape, 0.03**2 / np.sum(LUMA**2))
    after = Processing(1).apply(values, variance)[10:-10, 10:-10]
    assert_allclose(np.ptp(after, axis=(0, 1)), 0.03, rtol=0.05)


def test_without_noise_nothing_is_reduced(flat):
    values = np.random.default_rng(0).uniform(size=(20, 30, 3))
    assert_allclose(Processing(3).apply(values, 0 * values), values, atol=1e-12)
    assert_allclose(Processing(3).apply(flat, 0 * flat), flat, atol=1e-12)


def test_mosaic_noise_is_reduced(flat):
    plain, reduced = (codes(flat, Processing(s), bayer=True) @ LUMA for s in (0, 1.5))
    assert reduced.std() < 0.7 * plain.std()


# Tone


@pytest.mark.parametrize("tone", [0.2, 0.6, 1.0])
def test_tone_curve_is_monotone_with_the_stated_slopes(tone):
    v = np.linspace(-0.2, 1.2, 14001)
    values = np.repeat(v[None, :, None], 3, axis=2)
    out = Processing(tone=tone).apply(values, NO_NOISE)[0, :, 0]
    assert np.all(np.diff(out) >= 0)
    assert_allclose(np.interp([0, 0.5, 1], v, out), [0, 0.5, 1], atol=1e-9)
    slopes = np.gradient(out, v)
    assert_allclose(
        np.interp([0, 0.5, 1], v, slopes), [1 - tone, 1 + tone / 2, 1 - tone], atol=1e-3
    )


def test_decoding_does_not_undo_the_tone_curve(flat):
    picture = Camera(bits=16, processing=Processing(tone=0.5)).photograph(flat, 0)
    v = SRGB.encode(LIGHT)
    assert_allclose(picture.rgb[0, 0], SRGB.decode(v + 0.5 * (3 * v**2 - 2 * v**3 - v)), atol=1e-4)


# Sharpening


def test_sharpening_preserves_constants():
    values = np.full((12, 15, 3), SRGB.encode(LIGHT))
    assert_allclose(Processing(sharpening=2).apply(values, NO_NOISE), values, rtol=1e-13)


def test_sharpening_overshoots_by_its_amount_at_an_edge():
    values = np.full((20, 40, 3), 0.3)
    values[:, 20:] = 0.7
    out = Processing(sharpening=1, sharpening_radius=1.5).apply(values, NO_NOISE)[10, :, 0]
    # A step is 0.5 of its height away from its blurred self at the edge between pixels; at the pixel
    # next to it, by the part of the Gaussian's samples that lies beyond the edge.
    weights = np.exp(-(np.arange(-6, 7) ** 2) / (2 * 1.5**2))
    beyond = weights[7:].sum() / weights.sum()
    assert_allclose(out[[19, 20]], [0.3 - 0.4 * beyond, 0.7 + 0.4 * beyond], atol=1e-4)


def test_sharpening_keeps_chroma():
    values = np.random.default_rng(0).uniform(size=(20, 30, 3))
    out = Processing(sharpening=1.5).apply(values, NO_NOISE)
    change = out - values
    assert np.abs(change).max() > 0.1
    assert_allclose(change[..., 1:], change[..., :2], atol=1e-12)


# Together


def test_steps_are_applied_in_order():
    values = np.random.default_rng(0).uniform(0.2, 0.8, (20, 30, 3))
    variance = np.full(values.shape, 0.01)
    by_hand = Processing(1).apply(values, variance)
    by_hand = Processing(tone=0.4).apply(by_hand, variance)
    by_hand = Processing(sharpening=0.7).apply(by_hand, variance)
    assert_array_equal(Processing(1, 0.4, 0.7).apply(values, variance), by_hand)


def test_inactive_processing_changes_no_bytes(flat):
    camera = Camera(NOISE, 1 / 255)
    idle = Camera(NOISE, 1 / 255, processing=Processing(sharpening_radius=3))
    assert_array_equal(camera.expose(flat, 1), idle.expose(flat, 1))


def test_noise_after_processing_is_unknown(flat):
    assert (
        Camera(NOISE, bits=None, processing=Processing(tone=0.1)).photograph(flat, 1).noise is None
    )


def test_white_is_preserved_and_invalid():
    light = np.full((20, 20, 3), 5.0)
    picture = Camera(NOISE, processing=Processing(1, 0.4, 1)).photograph(light, 0)
    assert not picture.valid.any()


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"noise_reduction": -1}, "noise_reduction must be finite and not negative, got -1"),
        ({"tone": 1.5}, "tone must lie between 0 and 1, got 1.5"),
        ({"sharpening": np.inf}, "sharpening must be finite and not negative, got inf"),
        ({"sharpening_radius": 0}, "sharpening_radius must be a positive number of pixels, got 0"),
    ],
)
def test_rejects_wrong_arguments(settings, message):
    with pytest.raises(ValueError, match=message):
        Processing(**settings)


def test_camera_rejects_wrong_processing():
    with pytest.raises(TypeError, match="processing must be a Processing, got dict"):
        Camera(processing={})


@pytest.fixture(scope="module")
def pictures():
    """Four frames of odd sides with noise of their own."""
    plate = colorful_plate((61, 45), 1, tile=15)
    return [Camera(NoiseModel(read_std=0.003)).expose(plate, seed) for seed in range(4)]


def error(frames, pictures):
    return np.sqrt(np.mean((np.array(frames, float) - np.array(pictures, float)) ** 2))


def test_decoded_frames_have_order_and_size(pictures):
    marked = [codes.copy() for codes in pictures]
    for n, codes in enumerate(marked):
        codes[:20, :20] = 60 * n
    frames = through_h264(marked, 10)
    assert [f.shape for f in frames] == [(45, 61, 3)] * 4
    assert all(f.dtype == np.uint8 for f in frames)
    assert_allclose([f[5:15, 5:15].mean() for f in frames], [0, 60, 120, 180], atol=2)


def test_same_pictures_same_bytes(pictures):
    assert_array_equal(through_h264(pictures, 23), through_h264(pictures, 23))


def test_larger_crf_has_larger_error(pictures):
    errors = [error(through_h264(pictures, crf), pictures) for crf in (0, 17, 28, 40)]
    assert errors == sorted(errors)
    assert errors[3] > 1.5 * errors[1]


def test_gray_is_preserved_within_rounding():
    """A lossless clip differs only by rounding to the 219 luma steps of video range."""
    gray = np.random.default_rng(0).integers(0, 256, (32, 48, 1), np.uint8)
    codes = np.repeat(gray, 3, axis=2)
    (frame,) = through_h264([codes], 0)
    assert np.abs(frame.astype(int) - codes).max() <= 1


@pytest.mark.parametrize("color", [(200, 60, 30), (20, 90, 160), (255, 255, 255), (0, 0, 0)])
def test_constant_colors_are_preserved_within_rounding(color):
    codes = np.full((16, 16, 3), color, np.uint8)
    (frame,) = through_h264([codes], 0)
    assert np.abs(frame.astype(int) - codes).max() <= 2


def test_subsampled_pixels_share_chroma():
    """Luma of an edge between two colors stays sharp (Rec. 709), and its chroma does not."""
    codes = np.full((16, 32, 3), (200, 60, 60), np.uint8)
    codes[:, 15:] = (60, 60, 200)
    (frame,) = through_h264([codes], 0)
    luma = np.array([0.2126, 0.7152, 0.0722])
    assert_allclose(frame @ luma, codes @ luma, atol=3)
    assert np.abs(frame[8, 13:17].astype(int) - codes[8, 13:17]).max() > 20


def test_codes_reject_wrong_arguments(pictures):
    with pytest.raises(ValueError, match="pictures must be one or more, got none"):
        through_h264([], 23)
    with pytest.raises(TypeError, match=r"codes must be \(H, W, 3\) uint8"):
        through_h264([pictures[0].astype(np.uint16)], 23)
    with pytest.raises(ValueError, match="pictures must have one size"):
        through_h264([pictures[0], pictures[1][1:]], 23)
    with pytest.raises(ValueError, match="crf must lie between 0 and 51, got 52"):
        through_h264(pictures, 52)


def test_without_the_package_the_error_names_the_extra(pictures, monkeypatch):
    monkeypatch.setitem(sys.modules, "av", None)
    with pytest.raises(BlurmatteError, match=r'pip install "blurmatte\[video\]"'):
        through_h264(pictures, 23)
