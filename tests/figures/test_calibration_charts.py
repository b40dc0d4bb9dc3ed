"""Charts of noise and response."""

import sys
from dataclasses import replace

import numpy as np
import pytest

from blurmatte.calibration import ResponseFit, measure_noise
from blurmatte.errors import BlurmatteError
from blurmatte.figures import draw_noise, draw_response
from blurmatte.radiometry import SRGB, NoiseModel, Transfer
from blurmatte.rendering import Camera


@pytest.fixture(scope="module")
def fit():
    level = np.tile(np.linspace(0.02, 0.8, 64)[:, None] * [1, 0.8, 0.9], (48, 1, 1))
    camera = Camera(NoiseModel(gain=2e-4, read_std=0.002))
    return measure_noise(camera.photograph(level, seed) for seed in range(3))


def test_noise_chart_has_a_curve_for_each_channel(fit):
    """Exact: pixels of all three colors on white."""
    picture = draw_noise(fit)
    assert picture.shape == (605, 880, 3)
    assert picture.dtype == np.uint8
    red, green, blue = np.moveaxis(picture.astype(int), -1, 0)
    for strong, others in ((red, (green, blue)), (green, (red, blue)), (blue, (red, green))):
        assert np.count_nonzero((strong > others[0] + 40) & (strong > others[1] + 40)) > 300


def test_missing_matplotlib_raises_with_install_command(fit, monkeypatch):
    """Door."""
    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)
    with pytest.raises(BlurmatteError, match=r'pip install "blurmatte\[plot\]"'):
        draw_noise(fit)


RESPONSE = ResponseFit(
    transfer=Transfer.from_table("mine", SRGB.table(4081)),
    std=np.zeros(256),
    exposure_times=(0.1, 0.2),
    noise=0.004,
    agreement=0.97,
    seen=(0.02, 0.98),
    channel_difference=(0.0, 0.0, 0.0),
    channels_agree=True,
    residuals=np.full((2, 16), np.nan),
)


def test_larger_response_error_widens_the_band():
    """Invariant: a larger error colors more of the upper half of the chart."""
    sure = draw_response(RESPONSE)
    unsure = draw_response(replace(RESPONSE, std=np.linspace(0.02, 0, 256)))
    assert sure.shape == unsure.shape == (800, 800, 3)
    assert sure.dtype == np.uint8
    colored = [np.mean(np.ptp(part[:480].astype(int), axis=-1) > 20) for part in (sure, unsure)]
    assert colored[1] > colored[0] + 0.02
