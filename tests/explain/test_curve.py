"""Sentences about transfer curves."""

from dataclasses import replace

import numpy as np

from blurmatte.calibration import ResponseFit
from blurmatte.explain import explain
from blurmatte.radiometry import SRGB, Transfer


def test_a_curve_is_compared_with_the_nearest_named_one():
    said = explain(Transfer.from_table("x", 2 * SRGB.table(4081)))
    assert said[0] == "Nearest to srgb, which is off by up to 0.0% of full scale."
    assert said[1] == "Light 0, 0.4281 and 2 at code values 0, 1/2 and 1."


def test_measured_curve_has_an_error_and_names_disagreeing_channels():
    fit = ResponseFit(
        SRGB,
        np.linspace(0.02, 0, 256),
        (0.1, 0.205),
        2 / 255,
        0.93,
        (0.02, 0.98),
        (0.0, 0.01, 0.05),
        True,
        np.zeros((2, 16)),
    )
    said = " ".join(explain(fit))
    assert "known to 2.0% of full scale" in said
    assert "93% of the places agree; noise 2 of 255 code values." in said
    assert "Code values 5 to 250 of 255" in said
    assert "0.1 s, 0.205 s" in said
    assert "one curve" not in said
    said = explain(replace(fit, channels_agree=False))[-1]
    assert "differs by up to 5.0%" in said
