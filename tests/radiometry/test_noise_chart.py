"""The photon transfer curve as a picture."""

import sys

import numpy as np
import pytest

from blurmatte.errors import BlurmatteError
from blurmatte.radiometry import NoiseModel, draw_noise, measure_noise
from blurmatte.rendering import Camera


@pytest.fixture(scope="module")
def fit():
    level = np.tile(np.linspace(0.02, 0.8, 64)[:, None] * [1, 0.8, 0.9], (48, 1, 1))
    camera = Camera(NoiseModel(gain=2e-4, read_std=0.002))
    return measure_noise(camera.photograph(level, seed) for seed in range(3))


def test_it_has_a_curve_for_each_channel(fit):
    """Exact: pixels of all three colors on white."""
    picture = draw_noise(fit)
    assert picture.shape == (605, 880, 3)
    assert picture.dtype == np.uint8
    red, green, blue = np.moveaxis(picture.astype(int), -1, 0)
    for strong, others in ((red, (green, blue)), (green, (red, blue)), (blue, (red, green))):
        assert np.count_nonzero((strong > others[0] + 40) & (strong > others[1] + 40)) > 300


def test_matplotlib_is_asked_for(fit, monkeypatch):
    """Door."""
    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)
    with pytest.raises(BlurmatteError, match=r'pip install "blurmatte\[plot\]"'):
        draw_noise(fit)
