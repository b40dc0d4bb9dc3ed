"""Sentences about noise and transfer curves."""

from dataclasses import replace

import numpy as np

from blurmatte.calibration import NoiseFit, ResponseFit
from blurmatte.explain import explain
from blurmatte.radiometry import SRGB, NoiseModel, Transfer


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


def noise_fit(spread, coherence=1.0, rounding=0.0, relative=0.0, changed=0.0):
    sensor = NoiseModel(gain=2e-4, read_std=0.002, relative_std=relative)
    covariance = np.stack([np.diag((spread * row) ** 2) for row in sensor.coefficients])
    ratios = np.full((3, 4), coherence)
    return NoiseFit(sensor, NoiseModel(read_std=rounding), covariance, (), (), (), ratios, changed)


def test_noise_is_given_in_electrons():
    """Exact."""
    said = explain(noise_fit(0.01))
    assert said[0].startswith("Gain, light per electron: 0.0002000 ± 0.0000020, ")
    assert said[1] == "White is 5000 ± 50, 5000 ± 50, 5000 ± 50 electrons."
    assert said[2].startswith("Read noise, 1 is white: 0.0020000 ± 0.0000100, ")
    assert said[3:] == ["Every pixel has noise of its own."]


def test_rounding_correlation_and_changed_pixels_are_reported():
    """Exact: rounding, a fraction of light, changed pixels, and correlation."""
    said = " ".join(explain(noise_fit(0.01, 4.0, 0.006, 0.01, 0.125)))
    assert "White is" not in said
    assert "And this fraction of the light: 0.010000 ± 0.000050, " in said
    assert "Rounding to code values makes 0.43 of the variance at light 0.2" in said
    assert "Noise is correlated over 2.0, 2.0, 2.0 px (R, G, B), " in said
    assert "8x8: 4," in said
    assert "12.5% of the pixels changed by more than noise" in said


def test_inseparable_gain_and_read_noise_are_reported():
    """Exact."""
    said = explain(noise_fit(0.9))
    assert any(line.startswith("The light is too even") for line in said)
    assert not any(line.startswith("White") for line in said)
