"""Log curves of camera makers: those that the makers print, as tables; what is missing is said."""

import sys

import numpy as np
import pytest
from numpy.testing import assert_allclose

import blurmatte as bm
from blurmatte.radiometry.named_transfers import LOG_CURVES, log_curve

CODES = np.linspace(0, 1, 256)


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
    curve = bm.named_transfer(name)
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
    image = bm.decode(codes, bm.named_transfer("slog3"))
    assert_allclose(image.rgb[1], 0.18, rtol=1e-3)
    assert image.rgb[0, 0, 0] > 38
    assert not image.valid[0, 0]


def test_missing_extra_raises_with_install_command(monkeypatch):
    """Door: one line with the command that installs it."""
    log_curve.cache_clear()
    monkeypatch.setitem(sys.modules, "PyOpenColorIO", None)
    with pytest.raises(bm.BlurmatteError, match=r'pip install "blurmatte\[ocio\]"'):
        bm.named_transfer("vlog")
