import io

import numpy as np
import pytest
from numpy.testing import assert_allclose
from PIL import Image, ImageCms

from blurmatte.files.icc import (
    ADOBE_RGB,
    CICP_PRIMARIES,
    INTEROP_PRIMARIES,
    ProfileError,
    matrix_to_srgb,
    parse_profile,
)
from blurmatte.radiometry import LINEAR, SRGB

V = np.linspace(0, 1, 257)
SRGB_D50 = ((0.43607, 0.22249, 0.01392), (0.38515, 0.71687, 0.09708), (0.14307, 0.06061, 0.7141))


def light_of(profile, codes):
    """(H, W, 3) codes 0…1 to linear sRGB, straight from the profile."""
    light = np.stack([c.decode(codes[..., i]) for i, c in enumerate(profile.curves)], axis=-1)
    return light if profile.matrix is None else light @ profile.matrix.T


def test_foreign_srgb_profile_gives_srgb():
    made = ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes()
    profile = parse_profile(made)
    assert profile.curves == (SRGB, SRGB, SRGB)
    assert profile.matrix is None


def test_srgb_as_a_table_is_exactly_srgb(make_profile, curve):
    table = np.rint(65535 * SRGB.decode(np.linspace(0, 1, 1024))).astype(int)
    profile = parse_profile(make_profile(curve["curv"](*table), SRGB_D50))
    assert profile.curves[0] is SRGB
    assert profile.matrix is None


@pytest.mark.parametrize(
    ("kind", "values", "light"),
    [
        (0, (1.8,), V**1.8),
        (1, (2, 0.8, 0.2), (0.8 * V + 0.2) ** 2),
        (2, (2, 1.25, -0.25, 0.1), np.where(V >= 0.2, (1.25 * V - 0.25) ** 2 + 0.1, 0.1)),
        (3, (3, 0.9, 0.1, 0.05, 0.1), np.where(V >= 0.1, (0.9 * V + 0.1) ** 3, 0.05 * V)),
        (
            4,
            (2, 0.9, 0.05, 0.1, 0.1, 0.05, 0.01),
            np.where(V >= 0.1, (0.9 * V + 0.05) ** 2 + 0.05, 0.1 * V + 0.01),
        ),
    ],
)
def test_parametric_curves_are_those_of_the_standard(make_profile, curve, kind, values, light):
    """ICC.1:2022, table 68."""
    green = parse_profile(make_profile(curve["para"](kind, *values))).curves[1]
    assert_allclose(green.decode(V), light, atol=5e-5)  # parameters have 16 fractional bits


@pytest.mark.parametrize(
    ("kind", "values"),
    [
        ("para", (3, 2.4, 1 / 1.1, 0.1 / 1.1, 0.1, 0.05)),
        ("para", (1, 2, 0.8, 0.2)),
        ("curv", (0, 3000, 12000, 30000, 65535)),
        ("curv", (461,)),
    ],
)
def test_encode_inverts_decode_beyond_black_and_white(make_profile, curve, kind, values):
    green = parse_profile(make_profile(curve[kind](*values))).curves[1]
    light = np.linspace(green.decode(np.array(0.01)), 1.5, 100)
    light = np.concatenate([-light, light])
    assert_allclose(green.decode(green.encode(light)), light, atol=1e-9)


def test_table_is_interpolated_linearly(make_profile, curve):
    green = parse_profile(make_profile(curve["curv"](0, 13107, 65535))).curves[1]
    assert_allclose(green.decode(np.array([0.25, 0.5, 0.75])), [0.1, 0.2, 0.6])


@pytest.mark.parametrize("tag", [(), (256,)])
def test_the_identity_is_linear(make_profile, curve, tag):
    assert parse_profile(make_profile(curve["curv"](*tag))).curves == (LINEAR,) * 3


def test_another_color_management_system_agrees(make_profile, curve, ramp):
    """Little CMS converts the same codes with the same profile to sRGB."""
    data = make_profile(
        {
            "r": curve["curv"](563),
            "g": curve["para"](0, 2.0),
            "b": curve["curv"](*range(0, 65536, 255)),
        }
    )
    muted = (96 + ramp / 4).astype(np.uint8)  # within sRGB's gamut: nothing is clipped
    theirs = ImageCms.profileToProfile(
        Image.fromarray(muted),
        ImageCms.ImageCmsProfile(io.BytesIO(data)),
        ImageCms.createProfile("sRGB"),
        renderingIntent=ImageCms.Intent.RELATIVE_COLORIMETRIC,
    )
    ours = 255 * SRGB.encode(light_of(parse_profile(data), muted / 255))
    assert ours.min() > 0
    assert_allclose(ours, np.asarray(theirs), atol=1.01)
    assert np.abs(ours - muted).max() > 10  # the profile does something


def test_white_stays_white(make_profile, curve):
    profile = parse_profile(make_profile(curve["curv"](563)))
    assert_allclose(profile.matrix @ np.ones(3), 1, atol=1e-3)


def test_one_profile_gives_one_transfer(make_profile, curve):
    data = make_profile(curve["curv"](563))
    assert parse_profile(data).curves[0] == parse_profile(bytes(bytearray(data))).curves[0]


def test_gray_profile_has_a_curve_and_no_matrix(make_profile, curve):
    profile = parse_profile(make_profile(curve["curv"](461), space=b"GRAY"))
    assert_allclose(profile.curves[1].decode(0.5), 0.5 ** (461 / 256))
    assert profile.matrix is None


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"space": b"CMYK"}, "CMYK"),
        ({"space": b"Lab "}, "Lab"),
        ({"connection": b"Lab "}, "look-up tables"),
        ({"curves": {"r": b"", "g": b""}}, "look-up tables"),
    ],
)
def test_unsupported_profiles_are_rejected(make_profile, curve, changes, says):
    with pytest.raises(ProfileError, match=says):
        parse_profile(make_profile(**{"curves": curve["curv"](563), **changes}))


@pytest.mark.parametrize(
    "tag",
    [
        ("curv", 0, 40000, 20000, 65535),
        ("curv", 7, 7),
        ("curv", 5),
        ("para", 9),
        ("para", 1, -1, 1, 0),
    ],
)
def test_invalid_curves_are_rejected(make_profile, curve, tag):
    kind, *values = tag
    with pytest.raises(ProfileError):
        parse_profile(make_profile(curve[kind](*values)))


@pytest.mark.parametrize("keep", [0, 20, 130, 140, 230])
def test_truncated_profile_is_rejected(make_profile, curve, keep):
    with pytest.raises(ProfileError):
        parse_profile(make_profile(curve["curv"](563))[:keep])


def test_srgb_up_to_rounding_needs_no_matrix():
    assert matrix_to_srgb((0.64, 0.33, 0.30, 0.60, 0.15, 0.06, 0.31270, 0.32900)) is None
    assert matrix_to_srgb((0.6401, 0.3299, 0.2999, 0.6001, 0.1500, 0.0600, 0.3127, 0.3290)) is None


def test_matrix_of_rec2020_is_that_of_bt2087():
    """The inverse of BT.2087-0, equation (5)."""
    to_2020 = [[0.6274, 0.3293, 0.0433], [0.0691, 0.9195, 0.0114], [0.0164, 0.0880, 0.8956]]
    assert_allclose(matrix_to_srgb(CICP_PRIMARIES[9]) @ to_2020, np.eye(3), atol=5e-4)


def test_white_of_d65_stays_white():
    for chromaticities in (ADOBE_RGB, CICP_PRIMARIES[12], INTEROP_PRIMARIES["ciexyzd65"]):
        assert_allclose(matrix_to_srgb(chromaticities).sum(axis=1), 1, atol=1e-12)


@pytest.mark.parametrize("bad", [np.zeros(8), np.full(8, 0.3), [np.nan] * 8])
def test_colors_that_are_no_primaries_are_rejected(bad):
    with pytest.raises(ValueError, match="no three colors"):
        matrix_to_srgb(bad)
