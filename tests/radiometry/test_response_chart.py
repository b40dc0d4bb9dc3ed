"""The chart of a measured curve shows what it says."""

from dataclasses import replace

import numpy as np

import blurmatte as bm

FIT = bm.ResponseFit(
    transfer=bm.Transfer.from_table("mine", bm.SRGB.table(4081)),
    std=np.zeros(256),
    exposure_times=(0.1, 0.2),
    noise=0.004,
    agreement=0.97,
    seen=(0.02, 0.98),
    channel_difference=(0.0, 0.0, 0.0),
    channels_agree=True,
    residuals=np.full((2, 16), np.nan),
)


def test_the_error_is_drawn_as_a_band():
    """Invariant: a larger error colors more of the upper half of the chart."""
    sure = bm.draw_response(FIT)
    unsure = bm.draw_response(replace(FIT, std=np.linspace(0.02, 0, 256)))
    assert sure.shape == unsure.shape == (800, 800, 3)
    assert sure.dtype == np.uint8
    colored = [np.mean(np.ptp(part[:480].astype(int), axis=-1) > 20) for part in (sure, unsure)]
    assert colored[1] > colored[0] + 0.02
