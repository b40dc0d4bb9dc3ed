import numpy as np
import pytest
from numpy.testing import assert_allclose

from blurmatte.compositing import cover, light_gain
from blurmatte.radiometry import LinearImage


def test_background_of_equal_size_is_unchanged():
    picture = LinearImage(np.random.default_rng(0).uniform(size=(9, 7, 3)))
    assert cover(picture, (7, 9)) is picture


@pytest.mark.parametrize("size", [(40, 30), (30, 30), (10, 60), (200, 100), (1, 1), (81, 60)])
def test_background_of_any_size_keeps_its_light(size):
    picture = LinearImage(np.full((60, 80, 3), [0.2, 0.5, 7.0], np.float32))
    covered = cover(picture, size)
    assert covered.size == size
    assert covered.valid.all()
    assert_allclose(covered.rgb, np.broadcast_to([0.2, 0.5, 7.0], covered.rgb.shape), rtol=1e-5)


def test_background_is_scaled_around_its_center():
    x = np.broadcast_to(np.arange(80.0)[:, None], (60, 80, 3)).astype(np.float32)
    half = cover(LinearImage(x), (30, 30))
    assert_allclose(
        half.rgb[:, 3:-3, 0], np.tile(2 * np.arange(30) + 10.5, (30, 1))[:, 3:-3], atol=0.01
    )


def test_background_is_averaged_without_overshoot():
    checks = np.indices((64, 64)).sum(axis=0) % 2
    picture = LinearImage(checks[..., None].repeat(3, axis=-1).astype(np.float32))
    small = cover(picture, (8, 8)).rgb
    assert_allclose(small, 0.5, atol=0.02)
    step = LinearImage((picture.rgb * 0 + (np.arange(64) > 30)[:, None]).astype(np.float32))
    assert cover(step, (100, 100)).rgb.min() >= 0
    assert cover(step, (100, 100)).rgb.max() <= 1 + 1e-6


def test_invalid_pixels_stay_invalid():
    valid = np.ones((60, 80), bool)
    valid[30, 40] = False
    covered = cover(LinearImage(np.ones((60, 80, 3), np.float32), valid=valid), (40, 30))
    assert not covered.valid[15, 20]
    assert covered.valid.mean() > 0.98


def test_rejects_empty_sizes():
    with pytest.raises(ValueError, match="1 or more"):
        cover(LinearImage(np.ones((4, 4, 3))), (0, 5))


def test_light_gain_is_the_ratio_of_mean_light():
    plate = LinearImage(np.full((4, 6, 3), [0.1, 0.2, 0.4]))
    bright = LinearImage(np.full((3, 3, 3), [0.3, 0.2, 0.1]))
    assert_allclose(light_gain(bright, plate), [3, 1, 0.25])


def test_light_gain_excludes_invalid_pixels():
    rgb = np.full((2, 2, 3), 0.5)
    rgb[0, 0] = 50
    valid = np.array([[False, True], [True, True]])
    assert_allclose(light_gain(LinearImage(rgb, valid=valid), LinearImage(np.ones((1, 1, 3)))), 0.5)


def test_light_gain_rejects_pictures_without_light():
    black, white = LinearImage(np.zeros((2, 2, 3))), LinearImage(np.ones((2, 2, 3)))
    with pytest.raises(ValueError, match="no light on average"):
        light_gain(white, black)
    nothing = LinearImage(np.ones((2, 2, 3)), valid=np.zeros((2, 2), bool))
    with pytest.raises(ValueError, match="no pixel of the background is valid"):
        light_gain(nothing, white)
