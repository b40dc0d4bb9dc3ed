"""Code values ⇄ light: the standards' own numbers, exact inverses, true tables and slopes."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from blurmatte.radiometry import LINEAR, REC709, SRGB, Transfer, gamma, named_transfer

CURVES = [SRGB, REC709, LINEAR, gamma(2.2), gamma(0.45)]


def scalar_srgb_decode(v):
    """IEC 61966-2-1 as it is printed, one number at a time."""
    return v / 12.92 if v <= 0.04045 else ((v + 0.055) / 1.055) ** 2.4


def scalar_rec709_encode(light):
    """BT.709 as it is printed, with its rounded constants."""
    return 4.5 * light if light < 0.018 else 1.099 * light**0.45 - 0.099


def test_srgb_is_the_standard():
    v = np.linspace(0, 1, 257)
    assert_allclose(SRGB.decode(v), [scalar_srgb_decode(x) for x in v], rtol=1e-14)
    assert_allclose(255 * SRGB.encode(0.18), 117.6, atol=0.1)  # middle gray
    assert_allclose(SRGB.decode(128 / 255), 0.2158605, rtol=1e-6)


def test_rec709_is_the_standard():
    light = np.linspace(0, 1, 257)
    assert_allclose(REC709.encode(light), [scalar_rec709_encode(x) for x in light], atol=4e-4)


def test_gamma_is_a_power():
    assert_allclose(gamma(2.2).decode(0.5), 0.5**2.2)
    assert_array_equal(LINEAR.decode(np.array([0.1, 2.0])), [0.1, 2.0])


@pytest.mark.parametrize("curve", CURVES, ids=lambda curve: curve.name)
def test_encode_undoes_decode(curve):
    v = np.linspace(-0.5, 1.5, 4001)  # noise below black and light above white survive
    assert_allclose(curve.encode(curve.decode(v)), v, atol=1e-12)
    assert_allclose(curve.decode(curve.encode(v)), v, atol=1e-12)


@pytest.mark.parametrize("curve", CURVES, ids=lambda curve: curve.name)
def test_curve_is_odd_and_rises_from_0_to_1(curve):
    v = np.linspace(0, 1, 1001)
    assert_array_equal(curve.decode(-v), -curve.decode(v))
    assert_allclose(curve.decode(v[[0, -1]]), [0, 1], atol=1e-15)
    assert np.all(np.diff(curve.decode(v)) > 0)


@pytest.mark.parametrize("levels", [256, 65536])
def test_table_holds_the_light_of_every_code(levels):
    table = SRGB.table(levels)
    assert table.shape == (levels,)
    assert_array_equal(table, SRGB.decode(np.arange(levels) / (levels - 1)))


@pytest.mark.parametrize("curve", [SRGB, REC709, LINEAR, gamma(2.2)], ids=lambda curve: curve.name)
def test_slope_is_the_derivative(curve):
    light, h = np.array([0.05, 0.2, 0.5, 0.9]), 1e-6
    v = curve.encode(light)
    derivative = (curve.decode(v + h) - curve.decode(v - h)) / (2 * h)
    assert_allclose(curve.slope(light), derivative, rtol=1e-3)


def test_curves_have_names():
    for curve in (SRGB, REC709, LINEAR):
        assert named_transfer(curve.name) is curve
    assert_allclose(named_transfer("gamma2.4").decode(0.5), 0.5**2.4)
    assert repr(named_transfer("gamma2")) == "Transfer(gamma2)"


def test_a_camera_of_ones_own():
    square = Transfer("square", np.square, np.sqrt)
    assert_allclose(square.table(256)[128], (128 / 255) ** 2)


@pytest.mark.parametrize("name", ["sRGB", "gamma", "gamma-2", "log", ""])
def test_unknown_name(name):
    with pytest.raises(ValueError, match=r"use srgb, rec709, linear or e\.g\. gamma2\.2"):
        named_transfer(name)


@pytest.mark.parametrize("exponent", [0, -2.2, 11, np.nan])
def test_impossible_gamma(exponent):
    with pytest.raises(ValueError, match=r"gamma must lie between 0\.1 and 10"):
        gamma(exponent)
