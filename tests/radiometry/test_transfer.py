"""Code values ⇄ light: the standards' own numbers, exact inverses, true tables and slopes."""

import sys

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

import blurmatte as bm
from blurmatte.radiometry import (
    LINEAR,
    REC709,
    SRGB,
    Transfer,
    gamma,
    named_transfer,
    nearest_transfer,
)
from blurmatte.radiometry.transfer import LOG_CURVES, log_curve

CURVES = [SRGB, REC709, LINEAR, gamma(2.2), gamma(0.45)]
CODES = np.linspace(0, 1, 256)


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
def test_encode_inverts_decode(curve):
    v = np.linspace(-0.5, 1.5, 4001)  # noise below black and light above white survive
    assert_allclose(curve.encode(curve.decode(v)), v, atol=1e-12)
    assert_allclose(curve.decode(curve.encode(v)), v, atol=1e-12)


@pytest.mark.parametrize("curve", CURVES, ids=lambda curve: curve.name)
def test_curve_is_odd_and_increases_from_0_to_1(curve):
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


def test_transfer_of_user_functions():
    square = Transfer("square", np.square, np.sqrt)
    assert_allclose(square.table(256)[128], (128 / 255) ** 2)


@pytest.mark.parametrize("name", ["sRGB", "gamma", "gamma-2", "log", ""])
def test_rejects_unknown_names(name):
    with pytest.raises(ValueError, match=r"use srgb, .*slog3.*, or e\.g\. gamma2\.2"):
        named_transfer(name)


@pytest.mark.parametrize("exponent", [0, -2.2, 11, np.nan])
def test_rejects_gamma_out_of_range(exponent):
    with pytest.raises(ValueError, match=r"gamma must lie between 0\.1 and 10"):
        gamma(exponent)


STEPS = np.array([-0.02, 0.0, 0.03, 0.2, 0.55, 1.1])


def test_table_is_interpolated_linearly():
    """Exact: decode gives the entries at their code values, and straight lines between them."""
    curve = Transfer.from_table("steps", STEPS)
    codes = np.linspace(0, 1, 6)
    assert_allclose(curve.decode(codes), STEPS, atol=1e-15)
    assert_allclose(curve.decode((codes[1:] + codes[:-1]) / 2), (STEPS[1:] + STEPS[:-1]) / 2)
    assert_allclose(curve.decode(1.2), 1.1 + 0.55)  # as straight as it ended
    assert curve.decode(0.5).shape == ()


@pytest.mark.parametrize("light", [STEPS, SRGB.table(4081), np.array([0.0, 3.0])])
def test_encode_inverts_decode_of_a_table(light):
    """Exact: below black and above white too."""
    curve = Transfer.from_table("table", light)
    v = np.linspace(-1.5, 2, 5001)
    assert_allclose(curve.encode(curve.decode(v)), v, atol=1e-12)
    assert_allclose(curve.decode(curve.encode(v)), v, atol=1e-12)
    assert np.all(np.diff(curve.decode(v)) > 0)


def test_a_table_from_zero_is_odd_and_near_its_curve():
    """Invariant: like the other curves, it is odd; 4081 entries are sRGB to a part in a million."""
    curve = Transfer.from_table("table", SRGB.table(4081))
    v = np.linspace(0, 1, 777)
    assert_array_equal(curve.decode(-v), -curve.decode(v))
    assert_allclose(curve.decode(v), SRGB.decode(v), atol=1e-6)
    assert_allclose(curve.table(256), SRGB.table(256), atol=1e-12)


def test_a_table_keeps_shape_and_precision():
    """Invariant: pictures of float32 stay float32, whatever their shape; order does not matter."""
    curve = Transfer.from_table("table", STEPS)
    rng = np.random.default_rng(0)
    v = rng.uniform(-0.5, 1.5, (70, 500, 3)).astype(np.float32)  # more than is done at once
    light = curve.decode(v)
    assert light.dtype == np.float32
    assert light.shape == v.shape
    turned = curve.decode(v[::-1, ::-1])
    assert_array_equal(turned[::-1, ::-1], light)


@pytest.mark.parametrize(
    ("light", "says"),
    [
        ([1.0], "two or more finite numbers"),
        ([[0, 1], [2, 3]], "two or more finite numbers"),
        ([0, np.nan, 1], "two or more finite numbers"),
        ([0, 0.5, 0.5, 1], r"light must rise from each entry to the next, got 0\.5, 0\.5"),
        ([1, 0], "light must rise"),
    ],
)
def test_rejects_tables_that_do_not_increase(light, says):
    """Door: what a table must be."""
    with pytest.raises(ValueError, match=says):
        Transfer.from_table("bad", light)


@pytest.mark.parametrize("curve", [SRGB, REC709, LINEAR, gamma(1.7)], ids=lambda curve: curve.name)
def test_nearest_curve_of_a_named_curve_is_itself(curve):
    """Oracle: also of a table, whatever its scale of light."""
    brighter = Transfer.from_table("x", 7 * curve.table(4081))
    nearest, off = nearest_transfer(brighter)
    assert nearest.name == curve.name
    assert off < 1e-6


def test_nearest_curve_returns_its_distance():
    """Oracle: 0.02 was added in the middle."""
    v = np.linspace(0, 1, 256)
    bent = Transfer.from_table("bent", SRGB.decode(v) + 0.02 * np.sin(np.pi * v) ** 2)
    nearest, off = nearest_transfer(bent)
    assert 0 < off <= 0.02 + 1e-9
    assert nearest.name in {"srgb", "gamma2.0", "gamma2.1", "gamma2.2"}


def scalar_hlg_encode(light):
    """The OETF of ITU-R BT.2100 table 5 as it is printed."""
    a, b, c = 0.17883277, 0.28466892, 0.55991073
    return (3 * light) ** 0.5 if light <= 1 / 12 else a * np.log(12 * light - b) + c


def scalar_pq_encode(nits):
    """The inverse EOTF of ITU-R BT.2100 table 4 as it is printed."""
    m1, m2, c1, c2, c3 = 0.1593017578125, 78.84375, 0.8359375, 18.8515625, 18.6875
    y = (nits / 10000) ** m1
    return ((c1 + c2 * y) / (1 + c3 * y)) ** m2


def test_hlg_is_the_standard():
    """oracle: light of the scene; 75 % is the white of graphics [BT.2408]."""
    light = np.linspace(0, 1, 257)
    hlg = named_transfer("hlg")
    assert_allclose(hlg.encode(light), [scalar_hlg_encode(x) for x in light], atol=1e-7)
    assert_allclose(hlg.decode([0.5, 0.75, 1]), [1 / 12, 0.265, 1], rtol=1e-3)


def test_pq_is_the_standard():
    """oracle: 1 is the white of graphics, 203 cd/m², which is code value 58 % [BT.2408]."""
    nits = np.linspace(0, 10000, 257)
    pq = named_transfer("pq")
    assert_allclose(pq.encode(nits / 203), [scalar_pq_encode(x) for x in nits], atol=1e-12)
    assert_allclose(pq.decode([0.58, 1]), [1, 10000 / 203], rtol=0.01)


@pytest.mark.parametrize("name", ["hlg", "pq"])
def test_hdr_curves_increase_are_odd_and_are_inverted_by_encode(name):
    """exact: of every 12-bit code value; also in float32, and slightly above the top."""
    curve, v = named_transfer(name), np.linspace(-1, 1, 8191)
    assert np.all(np.diff(curve.decode(v)) > 0)
    assert_allclose(curve.encode(curve.decode(v)), v, atol=1e-6)
    assert_allclose(curve.decode(-v), -curve.decode(v))
    assert curve.decode(v.astype(np.float32)).dtype == np.float32
    assert np.all(np.isfinite(curve.decode(np.array([1.1, 1.5]))))
    assert np.all(curve.slope(np.array([0, 0.1, 1.0])) > 0)


def slog3(v):
    """Sony: Technical Summary for S-Gamut3.Cine/S-Log3 and S-Gamut3/S-Log3 (2014)."""
    if v >= 171.2102946929 / 1023:
        return 10 ** ((v * 1023 - 420) / 261.5) * (0.18 + 0.01) - 0.01
    return (v * 1023 - 95) * 0.01125 / (171.2102946929 - 95)


def logc3(v):
    """ARRI: ALEXA Log C Curve, Usage in VFX (2012), EI 800 for scene-linear light."""
    cut, a, b, c, d, e, f = 0.010591, 5.555556, 0.052272, 0.247190, 0.385537, 5.367655, 0.092809
    return (10 ** ((v - d) / c) - b) / a if v > e * cut + f else (v - f) / e


def vlog(v):
    """Panasonic: V-Log/V-Gamut Reference Manual (2014)."""
    b, c, d = 0.00873, 0.241514, 0.598206
    return (v - 0.125) / 5.6 if v < 0.181 else 10 ** ((v - d) / c) - b


def log3g10(v):
    """RED: White Paper on REDWideGamutRGB and Log3G10 (915-0187, Rev-C)."""
    a, b, c, g = 0.224282, 155.975327, 0.01, 15.1927
    return v / g - c if v < 0 else (10 ** (v / a) - 1) / b - c


def logc4(v):
    """ARRI: LogC4 Logarithmic Color Space, Specification (2022)."""
    a, b, c = (2**18 - 16) / 117.45, (1023 - 95) / 1023, 95 / 1023
    s = 7 * np.log(2) * 2 ** (7 - 14 * c / b) / (a * b)
    t = (2 ** (14 * (-c / b) + 6) - 64) / a
    return (2 ** (14 * (v - c) / b + 6) - 64) / a if v >= 0 else v * s + t


def davinci(v):
    """Blackmagic Design: DaVinci Wide Gamut Intermediate (2021)."""
    a, b, c, m, cut = 0.0075, 7.0, 0.07329248, 10.44426855, 0.02740668
    return 2 ** (v / c - b) - a if v > cut else v / m


PRINTED = {
    "slog3": slog3,
    "logc3": logc3,
    "logc4": logc4,
    "vlog": vlog,
    "log3g10": log3g10,
    "davinci": davinci,
}


@pytest.mark.parametrize("name", PRINTED)
def test_curves_equal_the_published_formulas(name):
    """Oracle: the maker's formula, one code value at a time."""
    printed = [PRINTED[name](v) for v in CODES]
    assert_allclose(log_curve(name).decode(CODES), printed, rtol=3e-4, atol=3e-5)


@pytest.mark.parametrize(
    ("name", "code"),
    [("slog3", 420), ("logc3", 400), ("vlog", 433), ("log3g10", 341), ("davinci", 344)],
)
def test_middle_gray_has_the_published_code(name, code):
    """Oracle: 10-bit code values of 18 % gray in the makers' tables."""
    assert_allclose(1023 * log_curve(name).encode(0.18), code, atol=0.5)


@pytest.mark.parametrize("name", LOG_CURVES)
def test_log_curves_increase_and_are_inverted_by_encode(name):
    """Exact: each is a curve with an inverse, and white is brighter than paper."""
    curve = bm.radiometry.named_transfer(name)
    assert curve.name == name
    assert curve is log_curve(name)
    light = curve.decode(CODES)
    assert np.all(np.diff(light) > 0)
    assert_allclose(curve.encode(light), CODES, atol=1e-9)
    assert -0.1 < light[0] <= 1e-8
    assert light[-1] > 8


def test_codes_decode_to_light_above_one():
    """Exact: middle gray of S-Log3 in 16 bits is 0.18, and the top of the range is no measurement."""
    codes = np.full((2, 3, 3), round(420 / 1023 * 65535), np.uint16)
    codes[0, 0] = 65535
    image = bm.decode(codes, bm.radiometry.named_transfer("slog3"))
    assert_allclose(image.rgb[1], 0.18, rtol=1e-3)
    assert image.rgb[0, 0, 0] > 38
    assert not image.valid[0, 0]


def test_missing_extra_raises_with_install_command(monkeypatch):
    """Door: one line with the command that installs it."""
    log_curve.cache_clear()
    monkeypatch.setitem(sys.modules, "PyOpenColorIO", None)
    with pytest.raises(bm.BlurmatteError, match=r'pip install "blurmatte\[ocio\]"'):
        bm.radiometry.named_transfer("vlog")
